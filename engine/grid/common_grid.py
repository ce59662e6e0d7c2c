"""The grid on which two epochs are compared, and whether it fits into the memory."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...interface.parameters import GridChangeParameters, given
from ..core.arrays import Float, Index
from ..core.errors import InputError
from ..core.machine_memory import machine_memory
from ..pointcloud.in_parts import Points, bounds_of, parts_of
from .chosen_cell import CELL_SIDES_M, CellChoice
from .grid import Grid, snapped_grid

# Measured peaks of change.listed_difference(), the zones and the pictures after it, the points aside.
_BYTES_A_CELL = 280.0  # of the grid, cells of one size
_BYTES_OF_PLANTS = 60.0  # more, where the clouds record plants
_BYTES_A_GROWING_CELL = 20.0  # of the grid, cells that grow: marks, labels and pictures
_BYTES_ON_THE_SLOPE = 300.0  # more for each cell that lies on the slope
_BYTES_OF_A_PART = 0.3e9  # worked on at a time
_BYTES_AT_ONCE, _CELLS_AT_ONCE = 620.0, 1_000_000  # for so many cells, which are worked on as a whole
_SQUARE_CELLS = 16.0  # cells, and at least _MIN_SQUARE_M metres: squares with points are on the slope
_MOST_SQUARES = 10_000_000  # of the extent, up to which those with points are marked rather than sorted
_MIN_SQUARE_M = 4.0

Bounds = tuple[float, float, float, float]


def common_grid(
    reference: Points,
    moving: Points,
    parameters: GridChangeParameters,
    *,
    plants: bool = False,
    bounds: Bounds | None = None,
) -> Grid:
    """The snapped grid that covers both clouds ((n, 3) and (m, 3)) where their extents meet.

    Args:
        plants: whether the cells also hold a cloud's plants.
        bounds: ``union`` of the clouds, where it is known.

    Raises:
        InputError: the extents do not meet (both are named), or the grid needs more than ``allowed``.
    """
    bounds = bounds or union(reference, moving)
    # cells of one size are all held, wherever the slope is
    area = slope_area((reference, moving), parameters.cell_side) if parameters.grows else 0.0
    refuse_too_large(bounds, area, parameters, plants=plants)
    return snapped_grid(bounds, parameters.cell_side)


def allowed(parameters: GridChangeParameters) -> float:
    """Bytes that the grid may take: ``memory_limit``, or half of the machine's memory."""
    limit = given(parameters.memory_limit)
    return limit * 1e9 if limit is not None else machine_memory() / 2


def refuse_too_large(bounds: Bounds, area: float, parameters: GridChangeParameters, *, plants: bool) -> None:
    """Raise InputError where the grid over ``bounds``, of which ``area`` m² are slope, needs more than ``allowed``."""
    limit = allowed(parameters)
    needed = memory_needed(bounds, area, parameters, plants=plants)
    if needed <= limit:
        return
    rows, columns = snapped_grid(bounds, parameters.cell_side).shape
    raise InputError(
        f"A grid of {rows} by {columns} cells needs {needed / 1e9:.3g} GB, more than the "
        f"{limit / 1e9:.3g} GB allowed; clip to the slope, use a cell of at least "
        f"{_cell_that_fits(bounds, area, parameters, plants=plants):g} m, or raise memory_limit."
    )


def affordable(
    choice: CellChoice,
    clouds: Sequence[Points],
    parameters: GridChangeParameters,
    *,
    plants: bool = False,
    bounds: Bounds | None = None,
) -> CellChoice:
    """The cell that the clouds chose, or the next of ``CELL_SIDES_M`` whose grid needs no more than ``allowed``.

    A cell that was given stays what it is. ``bounds`` are the ``union`` of the clouds, where it is known.
    """
    if not choice.automatic:
        return choice
    bounds, limit = bounds or union(clouds[0], clouds[-1]), allowed(parameters)

    def needed(cell: float) -> float:
        sized = replace(parameters, cell=cell)
        return memory_needed(bounds, slope_area(clouds, cell) if sized.grows else 0.0, sized, plants=plants)

    wanted = needed(choice.cell)
    if wanted <= limit:
        return choice
    cell = next((side for side in CELL_SIDES_M if side > choice.cell and needed(side) <= limit), 0.0)
    sized = replace(parameters, cell=choice.cell)
    cell = cell or _cell_that_fits(bounds, slope_area(clouds, choice.cell), sized, plants=plants)
    sentence = (
        f"Cells of {cell:g} m, because cells of {choice.cell:g} m, which would suit the points, need "
        f"{wanted / 1e9:.3g} GB of the {limit / 1e9:.3g} GB allowed; raise memory_limit, or clip to the "
        "slope, for smaller ones."
    )
    return CellChoice(cell, True, sentence)


def memory_needed(bounds: Bounds, area: float, parameters: GridChangeParameters, *, plants: bool) -> float:
    """Bytes for the grid over ``bounds`` (west, south, east, north), of which ``area`` m² are slope."""
    cells = math.prod(snapped_grid(bounds, parameters.cell_side).shape)
    if not parameters.grows:
        return cells * (_BYTES_A_CELL + (_BYTES_OF_PLANTS if plants else 0.0))
    on_slope = min(area / parameters.cell_side**2, cells)
    whole = _BYTES_AT_ONCE * min(cells, _CELLS_AT_ONCE)
    if cells <= _CELLS_AT_ONCE:
        return whole
    return max(cells * _BYTES_A_GROWING_CELL + on_slope * _BYTES_ON_THE_SLOPE + _BYTES_OF_A_PART, whole)


def slope_area(clouds: Sequence[Points], cell: float) -> float:
    """Area (m²) of the squares in which the clouds ((n, 3) each) have points."""
    side = max(_SQUARE_CELLS * cell, _MIN_SQUARE_M)
    clouds = [cloud for cloud in clouds if len(cloud)]
    if not clouds:
        return 0.0
    low, high = (np.floor(end / side).astype(np.int64)[:2] for end in _ends(clouds))
    columns, rows = (high - low + 1).tolist()
    parts = (xyz for cloud in clouds for xyz in parts_of(cloud))
    squares = (_squares(part, side, low, columns) for part in parts)
    if columns * rows > _MOST_SQUARES:
        return float(np.unique(np.concatenate([np.unique(numbers) for numbers in squares])).size) * side**2
    reached = np.zeros(columns * rows, dtype=bool)
    for numbers in squares:
        reached[numbers] = True
    return float(np.count_nonzero(reached)) * side**2


def _squares(xyz: Float, side: float, low: Index, columns: int) -> Index:
    """Number (n,) of the square of each point."""
    column, row = (np.floor(xyz[:, axis] / side).astype(np.int64) - low[axis] for axis in (0, 1))
    return np.asarray(row * columns + column)


def _ends(clouds: Sequence[Points]) -> tuple[Float, Float]:
    """Lowest and highest coordinates of all clouds together, (3,) each."""
    lows, highs = zip(*(bounds_of(cloud) for cloud in clouds), strict=True)
    return np.min(lows, axis=0), np.max(highs, axis=0)


def union(reference: Points, moving: Points) -> Bounds:
    """Bounds of both clouds: west, south, east, north.

    Raises:
        InputError: they do not meet.
    """
    extents = [tuple(float(end[k]) for end in bounds_of(c) for k in (0, 1)) for c in (reference, moving)]
    a, b = extents
    meet = (max(a[0], b[0]), max(a[1], b[1]), min(a[2], b[2]), min(a[3], b[3]))
    if meet[0] > meet[2] or meet[1] > meet[3]:
        raise InputError(
            f"The epochs do not overlap: the first spans {_extent(a)}, the second {_extent(b)}; "
            "check that both are of the same slope and in the same reference system."
        )
    return min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3])


def _cell_that_fits(bounds: Bounds, area: float, parameters: GridChangeParameters, *, plants: bool) -> float:
    """The smallest cell of two significant digits, in steps of a tenth, whose grid fits."""
    cell, limit = parameters.cell_side, allowed(parameters)
    while memory_needed(bounds, area, replace(parameters, cell=cell), plants=plants) > limit and cell < 100.0:
        larger = cell * 1.1
        unit = 10.0 ** (math.floor(math.log10(larger)) - 1)
        cell = min(round(math.ceil(larger / unit) * unit, 10), 100.0)
    return cell


def _extent(bounds: tuple[float, ...]) -> str:
    return f"x {bounds[0]:.1f} to {bounds[2]:.1f}, y {bounds[1]:.1f} to {bounds[3]:.1f}"
