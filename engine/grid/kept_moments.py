"""Sums of a survey's points in the cells of a grid. A series keeps them; cells grow from them without the points."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float, Index
from .block_moments import PLAIN_SUMS, UZ, VZ, ZZ, Moments, N, U, V, Z, listed_moments
from .grid import Grid
from .tiled_points import Counted, Frame, Tiles, Window


@dataclass(frozen=True)
class KeptMoments:
    """The sums of ``block_moments.Moments`` of the cells that have points, heights from ``level`` (m).

    Attributes:
        cell: (n,) flat indices in the grid of ``shape``, ascending.
        sums: (10 + k, n), with k further values of each point.
        shape: rows and columns of the grid.
    """

    cell: Index
    sums: Float
    shape: tuple[int, int]
    level: float

    @classmethod
    def of_parts(
        cls, parts: Iterable[tuple[Float, list[NDArray[np.floating]]]], grid: Grid, level: float
    ) -> KeptMoments:
        """From parts of a survey that hold all points of their cells: (n, 3), and what else is known of each."""
        found = [listed_moments(xyz, grid, level, more) for xyz, more in parts]
        if not found:
            return cls(np.zeros(0, dtype=np.int64), np.zeros((PLAIN_SUMS, 0)), grid.shape, level)
        cell = np.concatenate([cells for cells, _ in found])
        order = np.argsort(cell, kind="stable")
        return cls(cell[order], np.concatenate([sums for _, sums in found], axis=1)[:, order], grid.shape, level)

    @property
    def points(self) -> NDArray[np.int64]:
        """How many points each cell has, (n,)."""
        return np.round(self.sums[N]).astype(np.int64)

    @property
    def known(self) -> int:
        """How many further values each point has."""
        return len(self.sums) - PLAIN_SUMS

    def from_level(self, level: float) -> KeptMoments:
        """The same, with heights from another level (m)."""
        sums, rise = self.sums.copy(), self.level - level
        sums[ZZ] += 2.0 * rise * sums[Z] + rise**2 * sums[N]
        for with_height, without in ((Z, N), (UZ, U), (VZ, V)):
            sums[with_height] += rise * self.sums[without]
        return replace(self, sums=sums, level=level)


@dataclass(frozen=True)
class TiledMoments:
    """Kept sums by the rows and columns of a frame: what ``tiled_points.Tiled`` is of points."""

    kept: KeptMoments
    row: Index
    column: Index
    frame: Frame
    tiles: Tiles

    @classmethod
    def on(cls, kept: KeptMoments, frame: Frame, tiles: Tiles) -> TiledMoments:
        row, column = np.divmod(kept.cell, kept.shape[1])
        return cls(kept, row + frame.top, column + frame.left, frame, tiles)

    @property
    def known(self) -> int:
        """How many further values each point has."""
        return self.kept.known

    def reaches(self, tile: int, within: NDArray[np.bool_]) -> bool:
        """See ``Tiled``."""
        here = self._inside(self.tiles.window(tile))
        return bool(within[self.row[here], self.column[here]].any())

    def counts(self, within: NDArray[np.bool_]) -> Counted:
        """See ``Tiled``."""
        chosen = within[self.row, self.column]
        return self.kept.cell[chosen], self.kept.points[chosen].astype(np.int32)

    def hit(self, within: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], int]:
        """See ``Tiled``."""
        cells = np.zeros(within.shape, dtype=bool)
        chosen = within[self.row, self.column]
        cells[self.row[chosen], self.column[chosen]] = True
        return cells, int(self.kept.points[chosen].sum())

    def moments(self, window: Window, grid: Grid) -> Moments:
        """Of the cells in a window of the frame, whose grid is ``grid``."""
        here = self._inside(window)
        sums = np.zeros((len(self.kept.sums), *grid.shape))
        sums[:, self.row[here] - window[0].start, self.column[here] - window[1].start] = self.kept.sums[:, here]
        return Moments(sums, grid.cell)

    def _inside(self, window: Window) -> Index:
        """Places of the cells in a window of the frame."""
        first, last = np.searchsorted(self.row, (window[0].start, window[0].stop))
        column = self.column[first:last]
        return first + np.flatnonzero((column >= window[1].start) & (column < window[1].stop))
