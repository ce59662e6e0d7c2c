"""The grid of a series, about its first survey."""

from __future__ import annotations

from dataclasses import replace

from ...interface.parameters import ChangeParameters, GridChangeParameters
from ..core.progress import Progress
from ..grid.chosen_cell import CellChoice, choose_cell, with_cell
from ..grid.common_grid import affordable, common_grid
from ..grid.grid import Grid
from ..pointcloud.in_parts import Points


def held_whole(parameters: GridChangeParameters) -> GridChangeParameters:
    """The parameters for the grid's memory: a series holds arrays of all cells, also if cells grow."""
    return replace(parameters, adaptive=False) if isinstance(parameters, ChangeParameters) else parameters


def grid_of(
    first: Points, parameters: GridChangeParameters, *, with_plants: bool, progress: Progress
) -> tuple[Grid, CellChoice]:
    """The grid of a series, about its first survey, and how its cell came about."""
    change = held_whole(parameters)
    choice = affordable(choose_cell((first,), change), (first,), change, plants=with_plants)
    if choice.automatic:
        progress.info(choice.sentence)
    return common_grid(first, first, with_cell(change, choice), plants=with_plants), choice
