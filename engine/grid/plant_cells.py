"""What plants do to a ground cloud: the error of its heights, and how high the plants stand; by point and by cell."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float
from .grid import Grid, cell_index

MIN_CLEAR_PLANT_ERRORS = 3.0
"""Times the error by plants that the mean change of a group of cells must be, to be evidence.

Many cells side by side beyond their level are no chance where their errors are their own. What plants do is one error
for metres around: at 95 % one patch of grass in twenty is beyond its level as a whole; beyond three errors, one in 370.
"""


@dataclass(frozen=True)
class PlantCells:
    """Plants in the cells of a change; arrays (rows, columns) or (cells,), metres, NaN where a cell has no points.

    ``error_from`` and ``error_to`` are the cells' mean errors by plants, along the direction of the change; an epoch of
    which nothing is known has zeros. ``height_from`` and ``height_to`` are the plants' heights; None where they are not
    known of both epochs.
    """

    error_from: Float
    error_to: Float
    height_from: Float | None = None
    height_to: Float | None = None

    @property
    def error(self) -> Float:
        """Of the change: both epochs' together."""
        return np.hypot(self.error_from, self.error_to)

    def laid_out(self, way: Callable[[NDArray[Any]], NDArray[Any]]) -> PlantCells:
        """With each array as ``way`` lays it out."""
        heights = (None if h is None else way(h) for h in (self.height_from, self.height_to))
        return PlantCells(way(self.error_from), way(self.error_to), *heights)

    def scaled(self, factor: Float | float) -> PlantCells:
        """With errors ``factor`` (rows, columns; or one for all) times as large."""
        return replace(self, error_from=self.error_from * factor, error_to=self.error_to * factor)


def cell_means(xyz: Float, values: NDArray[np.floating], grid: Grid) -> Float:
    """Mean of the points' ``values`` (n,) in each cell (rows, columns); NaN without points."""
    number = cell_index(xyz, grid)
    inside = number >= 0
    cells = grid.rows * grid.columns
    count = np.bincount(number[inside], minlength=cells)
    total = np.bincount(number[inside], values[inside], minlength=cells)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan)).reshape(grid.shape)


def together(first: tuple[Float | None, Float | None], second: tuple[Float | None, Float | None]) -> PlantCells | None:
    """The plants of two epochs, each its errors and heights (rows, columns) or None; None if nothing is known."""
    errors = first[0], second[0]
    known = next((e for e in errors if e is not None), None)
    if known is None:
        return None
    error_from, error_to = (np.zeros(known.shape) if e is None else e for e in errors)
    if first[1] is None or second[1] is None:
        return PlantCells(error_from, error_to)
    return PlantCells(error_from, error_to, first[1], second[1])


def clear_of_plants(labels: NDArray[np.integer], count: int, dz: Float, plants: Float) -> NDArray[np.bool_]:
    """Which of the groups 0 to ``count`` have a mean change beyond its error by plants, (count + 1,).

    Args:
        labels: number of each cell's group (rows, columns).
        dz, plants: change of the cells and its error by plants, metres (rows, columns), NaN outside of groups.
    """
    inside = np.flatnonzero(labels.ravel() > 0)
    group = labels.ravel()[inside]
    change, error = (np.bincount(group, v.ravel()[inside], minlength=count + 1) for v in (dz, plants))
    return np.asarray(np.abs(change) >= MIN_CLEAR_PLANT_ERRORS * error)
