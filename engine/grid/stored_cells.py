"""Cells of one size of a survey on the disk: the same as of one in memory, without an array of all its points."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float
from ..pointcloud.in_parts import SpooledCloud, parts_of
from .cell_statistics import CellStatistics, median_level, statistics_of_parts
from .grid import Grid
from .kept_moments import KeptMoments
from .stored_tiles import StoredTiles
from .tiled_points import Frame, Tiles

_TILE_CELLS = 384
"""Along the side of the tiles that are worked on one after the other."""


def stored_statistics(cloud: SpooledCloud, grid: Grid, *, sloping: bool) -> CellStatistics:
    """As ``sloping_statistics``, or ``cell_statistics`` of means, with the means of what is known of the plants."""
    level = median_level(lambda: parts_of(cloud), grid)
    with _tiles(cloud, grid) as tiles:
        return statistics_of_parts(tiles, level, grid, sloping=sloping)


def stored_moments(cloud: SpooledCloud, grid: Grid) -> KeptMoments:
    """The sums of the points in the cells of a grid, with those of what is known of the plants."""
    level = median_level(lambda: parts_of(cloud), grid)
    with _tiles(cloud, grid) as tiles:
        return KeptMoments.of_parts(tiles, grid, level)


@contextmanager
def _tiles(cloud: SpooledCloud, grid: Grid) -> Iterator[Iterator[tuple[Float, list[NDArray[np.floating]]]]]:
    """The points in a grid tile by tile, those of each cell in the cloud's order, and what else is known of each."""
    tiles = Tiles(grid.shape, (_TILE_CELLS, _TILE_CELLS), 0)
    stored = StoredTiles.on(cloud, Frame(grid, 0, 0, grid.shape), tiles)
    try:
        yield (stored.of_tile(tile) for tile in stored.filled)
    finally:
        stored.file.unlink()
