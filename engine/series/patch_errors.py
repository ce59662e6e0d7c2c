"""Error of a mean change over an area, measured on patches of stable ground of that size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..core.arrays import Float
from ..statistics.robust import nmad

_MIN_PATCHES = 12
_MIN_COVERED_SHARE = 0.5  # of a patch's cells


@dataclass(frozen=True)
class PatchErrors:
    """``sides`` (k,) of square patches in cells, and what their mean changes scatter by beyond sampling, ``excess``.

    ``excess`` (k,) is a variance in m². It holds what neighbouring cells share: the registration, remains of plants,
    the ground filter.
    """

    sides: tuple[int, ...]
    excess: tuple[float, ...]

    def excess_of(self, cells: int) -> float:
        """Variance (m²) for an area of ``cells`` cells; that of the next smaller patches, 0 where there are none."""
        side = max(cells, 1) ** 0.5
        known = [e for s, e in zip(self.sides, self.excess, strict=True) if s <= side]
        return known[-1] if known else 0.0


def patch_errors(change: Float, variance: Float, stable: NDArray[np.bool_]) -> PatchErrors:
    """Scatter of the mean change of patches about zero: their NMAD squared, less the sampling variance of their mean.

    Patches of 2, 4, 8 ... cells a side lie side by side; those that are stable and measured in at least half of their
    cells count. Sizes with fewer than twelve such patches are left out. In the manner of the patches method of
    Dehecq et al. 2020 (doi:10.3389/feart.2020.566802) for the errors of means.

    Args:
        change: (rows, columns) metres, NaN where not measured.
        variance: sampling variance of ``change``, m².
        stable: cells outside of everything that moved.
    """
    known = stable & np.isfinite(change) & np.isfinite(variance)
    sides, found = [], []
    side = 2
    while side <= min(change.shape):
        rows, columns = (n // side * side for n in change.shape)

        def blocks(values: Float, side: int = side, rows: int = rows, columns: int = columns) -> Float:
            cut = values[:rows, :columns]
            return cut.reshape(rows // side, side, columns // side, side).sum(axis=(1, 3))

        count = blocks(known.astype(np.float64))
        enough = count >= _MIN_COVERED_SHARE * side**2
        if np.count_nonzero(enough) < _MIN_PATCHES:
            break
        means = blocks(np.where(known, change, 0.0))[enough] / count[enough]
        sampling = blocks(np.where(known, variance, 0.0))[enough] / count[enough] ** 2
        scatter = nmad(means, 0.0) ** 2
        sides.append(side)
        found.append(max(0.0, scatter - float(np.median(sampling))))
        side *= 2
    return PatchErrors(tuple(sides), tuple(found))


def away_from(moved: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Cells farther than ``reach`` cells from all that moved."""
    if not moved.any():
        return ~moved
    away: NDArray[np.bool_] = ndimage.distance_transform_cdt(~moved, metric="chessboard") > reach
    return away
