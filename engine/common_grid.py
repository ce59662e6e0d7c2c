"""The grid on which two epochs are compared, and whether it fits into the memory."""

from __future__ import annotations

import math

import numpy as np

from .errors import InputError
from .gridding import Float, Grid, snapped_grid
from .parameters import GridChangeParameters

_BYTES_A_CELL = 280.0  # measured peak of change.difference() and what follows it, per cell of the grid
_BYTES_A_GROWING_CELL = 620.0
_BYTES_OF_PLANTS = 100.0  # more, where the clouds tell of plants


def common_grid(reference: Float, moving: Float, parameters: GridChangeParameters, *, plants: bool = False) -> Grid:
    """The snapped grid that covers both clouds ((n, 3) and (m, 3)) where their extents meet.

    Args:
        plants: whether the cells also hold what a cloud tells of plants.

    Raises:
        InputError: the extents do not meet (both are named), or the grid needs more than ``memory_limit``.
    """
    extents = [tuple(float(end(c[:, k])) for end in (np.min, np.max) for k in (0, 1)) for c in (reference, moving)]
    a, b = extents
    meet = (max(a[0], b[0]), max(a[1], b[1]), min(a[2], b[2]), min(a[3], b[3]))
    if meet[0] > meet[2] or meet[1] > meet[3]:
        raise InputError(
            f"The epochs do not overlap: the first spans {_extent(a)}, the second {_extent(b)}; "
            "check that both are of the same slope and in the same reference system."
        )
    union = (min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3]))
    grid = snapped_grid(union, parameters.cell)
    limit = parameters.memory_limit * 1e9
    more = _BYTES_OF_PLANTS if plants else 0.0
    a_cell = more + (_BYTES_A_GROWING_CELL if parameters.grows else _BYTES_A_CELL)
    cells = grid.rows * grid.columns
    if cells * a_cell > limit:
        one_size = "turn off cells that grow, " if parameters.grows and cells * (_BYTES_A_CELL + more) <= limit else ""
        raise InputError(
            f"A grid of {grid.rows} by {grid.columns} cells needs {cells * a_cell / 1e9:.3g} GB, more than the "
            f"{parameters.memory_limit:g} GB allowed; clip to the slope, use a cell of at least "
            f"{_cell_that_fits(union, parameters.cell, limit / a_cell):g} m, {one_size}or raise memory_limit."
        )
    return grid


def _cell_that_fits(bounds: tuple[float, float, float, float], cell: float, most: float) -> float:
    """The smallest cell of two significant digits, in steps of a tenth, whose grid has at most so many cells."""
    while math.prod(snapped_grid(bounds, cell).shape) > most:
        larger = cell * 1.1
        unit = 10.0 ** (math.floor(math.log10(larger)) - 1)
        cell = round(math.ceil(larger / unit) * unit, 10)
    return cell


def _extent(bounds: tuple[float, ...]) -> str:
    return f"x {bounds[0]:.1f} to {bounds[2]:.1f}, y {bounds[1]:.1f} to {bounds[3]:.1f}"
