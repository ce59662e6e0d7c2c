"""What a rigid motion cannot remove: one survey is stretched in plan against the other.

Grid distances taken for ground distances, units that differ slightly and rotations by linearised matrices stretch a
survey by some hundredths of a per cent. Stable patches then ask for motions that change steadily over the slope.
The strain is estimated together with the motion by least squares, and its error from how blocks of patches disagree.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.special import fdtri

from ..core.arrays import Float
from .block_jackknife import block_jackknife

_COMPONENTS = ((0, 0), (1, 1), (0, 1))  # in plan: the relief of a slope hardly fixes those with heights
_MIN_CONFIDENCE = 0.999  # with which a strain must stand out from its errors: unstretched pairs are many
_LARGEST = 1e-2  # of a strain that two surveys may have: a component with a larger error is not known at all
_SMALLEST = 1e-7


@dataclass(frozen=True)
class Strain:
    """Of the moving surface against the reference, about ``centre`` (3,), local coordinates.

    ``components`` (3,): xx, yy and xy, positive where the moving survey is too short. ``second_moment`` (3, 3) of what
    they may be.
    """

    centre: Float
    components: Float
    second_moment: Float

    @property
    def largest(self) -> float:
        """The principal strain that is farthest from zero."""
        xx, yy, xy = self.components
        values = np.linalg.eigvalsh([[xx, xy], [xy, yy]])
        return float(values[np.argmax(np.abs(values))])

    def displacement(self, places: Float) -> Float:
        """(3, 3) mean square of what it displaces at ``places`` (n, 3), square metres."""
        by = _by_components(places - self.centre)
        return np.asarray(np.einsum("nia,ab,njb->ij", by, self.second_moment, by) / max(len(places), 1))


def estimated_strain(matrices: Float, vectors: Float, centre: Float, block: NDArray[np.int64]) -> Strain | None:
    """The strain that patches show; None where errors explain it, or with fewer blocks than unknowns.

    Args:
        matrices, vectors: (k, 6, 6) and (k, 6) of the patches' equations for the motion, in units of their variance.
        centre: (k, 3) of the patches, metres.
        block: (k,) number of each patch's block.
    """
    middle = centre.mean(axis=0)
    away = _by_components(centre - middle)
    both = np.zeros((len(centre), 6, 6 + len(_COMPONENTS)))
    both[:, :, :6], both[:, 3:, 6:] = np.eye(6), away
    matrices, vectors = np.einsum("kia,kij,kjb->kab", both, matrices, both), np.einsum("kia,ki->ka", both, vectors)
    whole = matrices.sum(axis=0)
    inverse = np.linalg.pinv(whole[:6, :6], hermitian=True)
    information, axes = np.linalg.eigh(whole[6:, 6:] - whole[6:, :6] @ inverse @ whole[:6, 6:])
    known = axes[:, information > _LARGEST**-2]
    if not known.shape[1] or block.max() < 6 + 2 * known.shape[1]:
        return None
    turn = np.zeros((6 + len(_COMPONENTS), 6 + known.shape[1]))
    turn[:6, :6], turn[6:, 6:] = np.eye(6), known
    matrices, vectors = np.einsum("ia,kij,jb->kab", turn, matrices, turn), vectors @ turn
    whole = matrices.sum(axis=0)
    solution = -np.linalg.solve(whole + 1e-12 * np.trace(whole) * np.eye(len(whole)), vectors.sum(axis=0))
    covariance, widen = block_jackknife(matrices, vectors, solution, block)
    covariance, estimate = (widen @ covariance @ widen)[6:, 6:], solution[6:]
    # Hotelling's limit for a covariance that is known from so many blocks
    count, freedom = len(estimate), int(block.max()) - len(solution) + 1
    limit = count * freedom / (freedom - count + 1) * fdtri(count, freedom - count + 1, _MIN_CONFIDENCE)
    if estimate @ np.linalg.solve(covariance, estimate) < limit:
        return None
    mean, moment, size = _moments(estimate, covariance)
    rest = np.eye(len(_COMPONENTS)) - known @ known.T
    return Strain(middle, known @ mean, known @ moment @ known.T + size**2 * rest)


def _by_components(away: Float) -> Float:
    """(n, 3, 3) displacement at ``away`` (n, 3) from the middle by each component."""
    found = np.zeros((len(away), 3, len(_COMPONENTS)))
    for number, (i, j) in enumerate(_COMPONENTS):
        found[:, i, number] += away[:, j]
        if i != j:
            found[:, j, number] += away[:, i]
    return found


def _moments(estimate: Float, covariance: Float) -> tuple[Float, Float, float]:
    """Mean (q,) and second moment (q, q) of components, and their size, by an ``estimate`` with its ``covariance``.

    The size is the likeliest one; it tells how far components that are badly known may differ from zero (empirical
    Bayes, Efron and Morris 1973, doi:10.1080/01621459.1973.10481350).
    """
    values, axes = np.linalg.eigh(covariance)
    values = np.maximum(values, 1e-300)
    squares = (axes.T @ estimate) ** 2

    def unlikely(logarithm: float) -> float:
        total = np.exp(2 * logarithm) + values
        return float(np.sum(np.log(total) + squares / total))

    size = float(np.exp(minimize_scalar(unlikely, bounds=np.log([_SMALLEST, _LARGEST]), method="bounded").x))
    share = size**2 / (size**2 + values)
    mean = axes @ (share * (axes.T @ estimate))
    return mean, np.outer(mean, mean) + (axes * (share * values)) @ axes.T, size
