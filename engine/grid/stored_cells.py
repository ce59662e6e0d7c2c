"""Cells of one size of a survey on the disk: the same as of one in memory, without an array of all its points."""

from __future__ import annotations

from ..pointcloud.in_parts import SpooledCloud, parts_of
from .cell_statistics import CellStatistics, median_level, statistics_of_parts
from .grid import Grid
from .stored_tiles import StoredTiles
from .tiled_points import Frame, Tiles

_TILE_CELLS = 384
"""Along the side of the tiles that are worked on one after the other."""


def stored_statistics(cloud: SpooledCloud, grid: Grid, *, sloping: bool) -> CellStatistics:
    """As ``sloping_statistics``, or ``cell_statistics`` of means, with the means of what is known of the plants."""
    tiles = Tiles(grid.shape, (_TILE_CELLS, _TILE_CELLS), 0)
    stored = StoredTiles.on(cloud, Frame(grid, 0, 0, grid.shape), tiles)
    level = median_level(lambda: parts_of(cloud), grid)
    found = statistics_of_parts((stored.of_tile(tile) for tile in stored.filled), level, grid, sloping=sloping)
    stored.file.unlink()
    return found
