"""What a part of patches fixes of its motion, how sure that is, and which of its places contradict the others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from ..core.arrays import Bool, Float
from ..geometry.voxels import block_numbers
from .block_jackknife import block_jackknife
from .observability import MIN_CURVATURE_RATIO, MIN_STANDARD_ERRORS, Information, unknown_motion
from .surface_patches import Equations, Patches

CORRELATED = 3.0  # pairs share points of their planes: so many count as one
LEFT_OUT_BLOCK_WIDTHS = 4.0  # widths of the blocks of patches that are left out together
_PLACE_RADIUS_WIDTHS = 2.5  # widths about a patch that are compared with all else
# times the median contradiction of places: 0.1 % by chance, with the four motions that a place constrains
_MAX_CONTRADICTION_RATIO = 6.0
_MIN_PLACE_CURVATURE_RATIO = 1e-3  # of a place's largest curvature: above, the place constrains the motion
_MAX_PLACES_TRIED, _DISC_RADII_WIDTHS = 6, (1.5, 2.5, 4.0)  # places tried, and widths about them
_MAX_REMAINING_CONTRADICTION = 0.5  # of the places' median contradiction may remain without the worst one
_MAX_CONTRADICTING_SHARE = 0.4  # of a part's patches: more is not the exception
_MAX_ROUNDS = 12
_MIN_PATCHES = 20


def part_information(
    system: Equations, patches: Patches, weight: Float, motion: Float, spacing: float, offset: float
) -> Information:
    """What a part fixes: a direction is observable where the relief stands out from the noise of the normals.

    The covariance is that of ``block_jackknife``, so that what a single place fixes is not sure.

    Args:
        weight: (k,) of the patches, by area and by their noise.
        motion: (6,) that the part asks for.
        spacing, offset: of the points, and the largest expected offset, metres.
    """
    some = np.flatnonzero(weight > 0)
    weight = weight[some] / max(float(weight.sum()), 1e-300)
    matrices, vectors = weight[:, None, None] * system.matrix[some], weight[:, None] * system.vector[some]
    whole = matrices.sum(axis=0)
    curvature, directions = np.linalg.eigh(whole)
    # the weighted mean of as many products of two independent errors
    effective = float(1.0 / max(np.sum(weight**2 * CORRELATED / np.maximum(system.pairs[some], 1)), 1e-300))
    least = MIN_STANDARD_ERRORS * system.roughness / np.sqrt(max(effective, 1.0))
    observable = curvature > max(least, MIN_CURVATURE_RATIO * float(curvature[-1]))
    fixed = directions[:, observable]
    covariance = np.zeros((6, 6))
    if fixed.shape[1] and len(some) > 1:
        block = block_numbers(patches.centre[some], LEFT_OUT_BLOCK_WIDTHS * patches.width)
        if block.max() == 0:
            block = np.arange(len(some))
        own = np.einsum("ia,kij,jb->kab", fixed, matrices, fixed), (vectors + matrices @ motion) @ fixed
        spread, _ = block_jackknife(*own, np.zeros(fixed.shape[1]), block)
        sure = np.sqrt(np.diag(spread)) <= spacing / 2
        observable[np.flatnonzero(observable)[~sure]] = False
        spread[~sure] = spread[:, ~sure] = 0.0
        covariance = fixed @ spread @ fixed.T
    free = directions[:, ~observable] @ directions[:, ~observable].T
    return Information(curvature, directions, observable, covariance + free @ unknown_motion(offset) @ free)


def contradicting(system: Equations, patches: Patches, agrees: Bool, offset: float) -> Bool:
    """(k,) patches of a part that lie in a place which asks for another motion than all the rest of the part.

    A piece that slid nearly along its own planes agrees patch by patch and still pulls the whole along. A place of
    many patches shows that far more reliably than one patch. How much places contradict one another by noise and by
    bends of the surveys is measured by their median. A piece that pulls much makes all places contradict one another:
    then the worst one is left out if the others agree without it.
    """
    if np.count_nonzero(agrees) < _MIN_PATCHES:
        return np.zeros(len(patches), dtype=bool)
    left = agrees.copy()
    least = max(_MIN_PATCHES, (1 - _MAX_CONTRADICTING_SHARE) * np.count_nonzero(agrees))
    places = _places(system, patches, agrees)
    for _ in range(_MAX_ROUNDS):
        against = _against(places, left[places.patch], offset)
        middle = float(np.median(against[left[places.patch]]))
        odd = left[places.patch] & (against > _MAX_CONTRADICTION_RATIO * middle)
        if not odd.any():
            odd, without = _without_worst(places, left[places.patch], against, offset)
            if without > _MAX_REMAINING_CONTRADICTION * middle:
                break
        fewer = left.copy()
        fewer[places.patch[odd]] = False
        if np.count_nonzero(fewer) < least:
            break
        left = fewer
    return agrees & ~left


@dataclass(frozen=True)
class _Places:
    """Equations of some patches (n,) in units of their own noise, and which of them are near to one another (n, n)."""

    patch: NDArray[np.int64]
    centre: Float
    width: float
    matrices: Float
    vectors: Float
    near: csr_array


def _places(system: Equations, patches: Patches, agrees: Bool) -> _Places:
    some = np.flatnonzero(agrees)
    noise = np.maximum(system.rest[some], float(np.median(system.rest[some])) / 4)
    share = system.pairs[some] / (CORRELATED * np.maximum(noise, 1e-12))
    pairs = cKDTree(patches.centre[some]).query_pairs(_PLACE_RADIUS_WIDTHS * patches.width, output_type="ndarray")
    rows, columns = np.concatenate([pairs.T, pairs.T[::-1], np.tile(np.arange(len(some)), (2, 1))], axis=1)
    near = csr_array((np.ones(len(rows)), (rows, columns)), shape=(len(some), len(some)))
    matrices = (system.matrix[some] * share[:, None, None]).reshape(-1, 36)
    return _Places(some, patches.centre[some], patches.width, matrices, system.vector[some] * share[:, None], near)


def _without_worst(places: _Places, left: Bool, against: Float, offset: float) -> tuple[Bool, float]:
    """The disc (n,) of patches without which the others contradict one another least, and how much they then do."""
    best = np.zeros(len(left), dtype=bool), np.inf
    for worst in np.argsort(np.where(left, -against, 0.0), kind="stable")[:_MAX_PLACES_TRIED]:
        away = np.linalg.norm(places.centre - places.centre[worst], axis=1)
        for radius in _DISC_RADII_WIDTHS:
            odd = left & (away < radius * places.width)
            others = left & ~odd
            if others.any():
                middle = float(np.median(_against(places, others, offset)[others]))
                best = (odd, middle) if middle < best[1] else best
    return best


def _against(places: _Places, left: Bool, offset: float) -> Float:
    """(n,) squared distance of the motions asked for about each patch and by all others, in their own variances.

    It is 1 by chance. Only patches that are ``left`` (n,) count.
    """
    matrices, vectors = places.matrices * left[:, None], places.vectors * left[:, None]
    here, pull = (places.near @ matrices).reshape(-1, 6, 6), places.near @ vectors
    rest = matrices.sum(axis=0).reshape(6, 6) - here + np.eye(6) / offset**2
    unsure = np.linalg.inv(rest)
    elsewhere = -np.einsum("kij,kj->ki", unsure, vectors.sum(axis=0) - pull)
    values, axes = np.linalg.eigh(here)
    firm = values > np.maximum(_MIN_PLACE_CURVATURE_RATIO * values[:, -1:], 1 / offset**2)
    inverse = np.where(firm, 1.0 / np.where(firm, values, 1.0), 0.0)
    asked = np.einsum("kij,ki->kj", axes, pull + np.einsum("kij,kj->ki", here, elsewhere)) * inverse
    # the difference of both motions and its covariance, in the place's own axes
    spread = np.einsum("kij,kil,klm->kjm", axes, unsure, axes)
    spread = np.where(firm[:, :, None] & firm[:, None, :], spread, 0.0)
    spread[:, np.arange(6), np.arange(6)] += np.where(firm, inverse, 1.0)
    against = np.einsum("ki,ki->k", asked, np.linalg.solve(spread, asked[:, :, None])[:, :, 0])
    return np.asarray(against / np.maximum(firm.sum(axis=1), 1))
