"""Weighted planes on square cells, each fitted to its own points and, with less weight, to those around."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ..core.arrays import Bool, Float
from .columns import greatest
from .plane_kernels import moved_sums, plane_heights, power_sums, product_sums


class Planes:
    """Weighted planes on square cells of side 1, each fitted to its own and (with less weight) the eight cells around.

    ``pool`` holds the weights of the cells before, of itself and behind, along each axis.

    Sums of products are shifted from cell to cell instead of searching neighbours, so the cost is linear in points.
    """

    AROUND = (0.5, 1.0, 0.5)
    ALONE = (0.0, 1.0, 0.0)

    def __init__(self, xy: Float, pool: tuple[float, float, float] = AROUND) -> None:
        self.pool = pool
        index = np.floor(xy).astype(np.int64)
        self.shape = tuple(int(v) + 1 for v in greatest(index))
        self.key = index[:, 0] * self.shape[1] + index[:, 1]
        self.x, self.y = np.ascontiguousarray((xy - index - 0.5).T)

    def fit(
        self, z: Float, weight: Float, prior_height: float, prior_slope: float, spread: Float | None = None
    ) -> tuple[Float, Float, Float]:
        """Height and inclinations of each cell's plane; the priors pull it towards 0 and towards level.

        Args:
            spread: (n, 5) where points are averages of ``weight`` others: sums over these of xx, xy, yy, xz, yz about
                the average. The planes are then those of the others.
        """
        count = self.shape[0] * self.shape[1]
        z, weight = (np.ascontiguousarray(values, dtype=np.float64) for values in (z, weight))
        sums = product_sums(self.key, self.x, self.y, z, weight, count).reshape(9, *self.shape)
        if spread is not None:
            for k, column in zip((3, 4, 5, 7, 8), spread.T):
                sums[k] = sums[k] + self.sum(column)
        return planes_of(sums, self.pool, prior_height, prior_slope)

    def at_points(self, height: Float, along: Float, across: Float) -> Float:
        """(n,) height of the cells' planes at the points."""
        planes = (np.ascontiguousarray(values, dtype=np.float64).ravel() for values in (height, along, across))
        return plane_heights(self.key, self.x, self.y, *planes)

    def sum(self, values: Float) -> Float:
        """Sum of the points' values in each cell."""
        sums = np.bincount(self.key, values, self.shape[0] * self.shape[1])
        return np.asarray(sums, dtype=np.float64).reshape(self.shape)

    def power_sums(self, values: Float, chosen: Bool) -> Float:
        """(5, rows, columns) number and sums of the first to fourth powers of the ``chosen`` values (n,) of a cell."""
        return power_sums(self.key, np.ascontiguousarray(values), chosen, self.shape[0] * self.shape[1]).reshape(
            5, *self.shape
        )

    def pooled(self, values: Float) -> Float:
        """Values of cells with (weighted) those of the cells around added."""
        for axis in (0, 1):
            values = ndimage.correlate1d(values, self.pool, axis=axis, mode="constant")
        return np.asarray(values, dtype=np.float64)


def planes_of(
    sums: Float, pool: tuple[float, float, float], prior_height: float, prior_slope: float
) -> tuple[Float, Float, Float]:
    """Height and inclinations of each cell's plane, as of ``Planes.fit``, from sums (9, rows, columns) over its points.

    ``sums`` are those of ``plane_kernels.product_sums``.
    """
    w, sx, sy, sxx, sxy, syy, sz, sxz, syz = moved_sums(sums, pool)
    w = w + prior_height + 1e-9
    sxx, syy = sxx + prior_slope * w, syy + prior_slope * w
    # cofactors of the symmetric 3 x 3 normal matrix
    c00, c01, c02 = sxx * syy - sxy * sxy, sxy * sy - sx * syy, sx * sxy - sxx * sy
    c11, c12, c22 = w * syy - sy * sy, sx * sy - w * sxy, w * sxx - sx * sx
    determinant = w * c00 + sx * c01 + sy * c02
    height = (c00 * sz + c01 * sxz + c02 * syz) / determinant
    along = (c01 * sz + c11 * sxz + c12 * syz) / determinant
    across = (c02 * sz + c12 * sxz + c22 * syz) / determinant
    return height, along, across
