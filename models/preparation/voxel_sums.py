"""Averages in voxels of a cloud that is read in parts: the result does not depend on how it was cut.

Coordinates are added up as whole numbers of micrometres within their voxel, because sums of whole numbers are the same
in any order; so a cloud in memory and the same cloud read from a file in parts have the same voxels, bit for bit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...engine.core.arrays import Float, Index
from ...engine.core.errors import InputError
from .voxels import VoxelGrid, morton

_UNIT = 1e-6
"""Metres of the whole numbers that are added up."""
_BITS = 21
_HALF = 1 << (_BITS - 1)
_PRODUCTS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
_WAITING = 200_000
"""Rows that wait at least before they are merged."""


@dataclass(frozen=True)
class SparseVoxels:
    """``grid`` without ``inverse``: the points in the order of ``voxels.voxel_grid``; and how to find a point's voxel.

    ``keys`` (m,) rise; ``place`` (m,) is where the voxel of each key is in ``grid.points``. ``spread``, where it was
    asked for, has a row (6,) for each of ``grid.points``: the products xx, xy, xz, yy, yz, zz of its points about their
    average, added up, m².
    """

    grid: VoxelGrid
    matrix: Float
    size: float
    keys: Index
    place: Index
    spread: Float | None = None

    def lookup(self, xyz: Float) -> Index:
        """The voxel of each of (n, 3) points in the cloud's coordinates; -1 where no point of the cloud was."""
        key, _ = _keys(self.matrix, self.size, xyz)
        at = np.searchsorted(self.keys, key)
        at[at == len(self.keys)] = 0
        found = self.place[at]
        found[self.keys[at] != key] = -1
        return found


class VoxelSums:
    """Adds up points, part by part, in voxels of side ``size`` m in the frame that ``matrix`` (4, 4) leads to.

    Args:
        spread: also how the points of a voxel spread about their average.
    """

    def __init__(self, matrix: Float, size: float, *, spread: bool = False) -> None:
        self.matrix, self.size = matrix, size
        self._products = _PRODUCTS if spread else ()
        self._merged = _Sums.empty(len(self._products))
        self._waiting: list[_Sums] = []

    def add(self, xyz: Float) -> None:
        """Add (n, 3) points in the cloud's coordinates, m.

        Raises:
            InputError: the cloud is wider than voxels can be numbered.
        """
        if not len(xyz):
            return
        key, within = _keys(self.matrix, self.size, xyz)
        products = np.empty((len(key), len(self._products)), dtype=np.int64)
        for column, (a, b) in enumerate(self._products):
            np.multiply(within[:, a], within[:, b], out=products[:, column])
        self._waiting.append(_Sums(key, within, products, np.ones(len(key), dtype=np.int64)).combined())
        # Merging only what has grown as large as all before keeps the work linear.
        if sum(len(part.keys) for part in self._waiting) > max(len(self._merged.keys), _WAITING):
            self._merge()

    def finish(self) -> SparseVoxels:
        """The averages of all points added.

        Raises:
            InputError: there were none.
        """
        self._merge()
        sums = self._merged
        if not len(sums.keys):
            raise InputError("There are no points to screen; check the cloud, its region and its classes.")
        cell = _cells(sums.keys)
        mean = (cell + _UNIT / self.size * (sums.within / sums.count[:, None])) * self.size
        shifted = cell - cell.min(axis=0)
        layers = int(shifted[:, 2].max()) + 1
        order = np.argsort(morton(shifted[:, 0], shifted[:, 1]) * layers + shifted[:, 2], kind="stable")
        place = np.empty(len(order), dtype=np.int64)
        place[order] = np.arange(len(order))
        grid = VoxelGrid(mean[order], np.empty(0, dtype=np.int64), sums.count[order])
        spread = sums.spread(self._products)[order] if self._products else None
        return SparseVoxels(grid, self.matrix, self.size, sums.keys, place, spread)

    def _merge(self) -> None:
        if self._waiting:
            self._merged = _Sums.of([self._merged, *self._waiting]).combined()
            self._waiting = []


@dataclass(frozen=True)
class _Sums:
    """``keys`` (n,), the points' places ``within`` (n, 3) their voxels in micrometres, added up, the ``products``
    (n, k) of any two coordinates of these, added up, and ``count``.
    """

    keys: Index
    within: Index
    products: Index
    count: Index

    @classmethod
    def empty(cls, products: int) -> _Sums:
        none = np.empty(0, dtype=np.int64)
        return cls(none, np.empty((0, 3), dtype=np.int64), np.empty((0, products), dtype=np.int64), none)

    @classmethod
    def of(cls, parts: list[_Sums]) -> _Sums:
        return cls(
            np.concatenate([part.keys for part in parts]),
            np.concatenate([part.within for part in parts]),
            np.concatenate([part.products for part in parts]),
            np.concatenate([part.count for part in parts]),
        )

    def combined(self) -> _Sums:
        """One row a key, rising."""
        if not len(self.keys):
            return self
        order = np.argsort(self.keys, kind="stable")
        keys = self.keys[order]
        starts = np.flatnonzero(np.concatenate([[True], keys[1:] != keys[:-1]]))
        count = np.add.reduceat(self.count[order], starts)
        return _Sums(keys[starts], _added(self.within, order, starts), _added(self.products, order, starts), count)

    def spread(self, products: tuple[tuple[int, int], ...]) -> Float:
        """``SparseVoxels.spread`` in the order of the keys."""
        result = self.products.astype(np.float64)
        for column, (a, b) in enumerate(products):
            result[:, column] -= self.within[:, a].astype(np.float64) * self.within[:, b] / self.count
        return result * _UNIT**2


def _added(values: Index, order: Index, starts: Index) -> Index:
    """Columns of ``values`` (n, k), put in ``order`` and added up from each of ``starts`` to the next."""
    result = np.empty((len(starts), values.shape[1]), dtype=np.int64)
    for column in range(values.shape[1]):
        result[:, column] = np.add.reduceat(values[order, column], starts)
    return result


def flat_axis(matrix: Float, xyz: Float, axis: int) -> Float:
    """Coordinate (n,) of points (n, 3) on one axis of the frame that ``matrix`` leads to.

    Written out, so that a point's result does not depend on the others that are computed with it, which a product of
    matrices does not promise.
    """
    a, b, c, d = matrix[axis]
    return np.asarray(a * xyz[:, 0] + b * xyz[:, 1] + c * xyz[:, 2] + d, dtype=np.float64)


def _keys(matrix: Float, size: float, xyz: Float) -> tuple[Index, Index]:
    """Key (n,) of each point's voxel and its place (n, 3) within that, micrometres."""
    key = np.zeros(len(xyz), dtype=np.int64)
    within = np.empty((len(xyz), 3), dtype=np.int64)
    for axis in range(3):
        place = flat_axis(matrix, xyz, axis)
        cell = np.floor(place * (1.0 / size))
        if len(cell) and not (cell.min() >= -_HALF and cell.max() < _HALF):
            raise InputError(
                f"The cloud reaches more than {_HALF * size / 1000:.0f} km from its slope; remove its outliers first."
            )
        within[:, axis] = np.rint((place - cell * size) * (1.0 / _UNIT))
        key = (key << _BITS) | (cell.astype(np.int64) + _HALF)
    return key, within


def _cells(keys: Index) -> Index:
    mask = (1 << _BITS) - 1
    return np.stack([((keys >> (_BITS * (2 - axis))) & mask) - _HALF for axis in range(3)], axis=1)
