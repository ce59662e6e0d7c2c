"""Which part of a slope two surveys compare, why not the rest, and what larger cells would compare."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...interface.seen import (
    COMPARED,
    EXCLUDED,
    KEYS,
    LABELS,
    NOT_IN_BOTH,
    NOT_IN_FIRST,
    NOT_IN_LATER,
    NOT_SEEN,
    OUTSIDE,
    TOO_FEW,
)
from ..core.arrays import Bool
from ..grid.growing_cells import surveyed
from ..grid.seen_cells import near_cells
from .result import Change

_MIN_COMMON_SHARE = 0.8
_BLOCK_M = 1.0  # half of the gap between points, m, that an outline bridges at least


def common_rate_at(change: Change, multiple: int) -> float:
    """Share of common cells, were the cells ``multiple`` times as large."""
    least = max(int(change.minimum_points), 1)
    common, either = (
        combine(*(change.layout.block_sums(count, multiple) >= least for count in change.points))
        for combine in (np.logical_and, np.logical_or)
    )
    return float(common.sum() / max(either.sum(), 1))


def cell_that_compares(change: Change) -> float | None:
    """The smallest multiple of the cell with which 80 % of the cells or more would be common; None: there is none."""
    for multiple in (2, 3, 4, 5, 6, 8, 10, 15, 20, 30, 50):
        if multiple >= max(change.grid.shape):
            break
        if common_rate_at(change, multiple) >= _MIN_COMMON_SHARE:
            return round(multiple * change.grid.cell, 6)
    return None


@dataclass(frozen=True)
class Seen:
    """Which cells of a slope were compared, and why the others were not.

    Attributes:
        classes: (rows, columns) of ``interface.seen``.
        cell: side of a cell, m.
    """

    classes: NDArray[np.uint8]
    cell: float

    @cached_property
    def _cells(self) -> NDArray[np.int64]:
        """How many cells each class has."""
        return np.bincount(self.classes.ravel(), minlength=len(LABELS))

    def area(self, *classes: int) -> float:
        """Of the cells of some ``classes``, m²."""
        return float(self._cells[list(classes)].sum()) * self.cell**2

    @property
    def unseen(self) -> Bool:
        """Cells (rows, columns) of the slope that were not compared."""
        return np.isin(self.classes, NOT_SEEN)

    @property
    def slope_area(self) -> float:
        """m², whatever was compared of it."""
        return self.area(COMPARED, *NOT_SEEN)

    def share(self, *classes: int) -> float:
        """Of the slope that is of some ``classes``."""
        return self.area(*classes) / max(self.slope_area, 1e-9)

    @property
    def share_of_both(self) -> float:
        """Share compared of the slope that has ground of both surveys nearby."""
        return self.area(COMPARED) / max(self.area(COMPARED, TOO_FEW), 1e-9)

    def shares(self) -> dict[str, float]:
        """Share of the slope of each class, for the run record."""
        return {KEYS[one]: self.share(one) for one in (COMPARED, *NOT_SEEN)}


def seen(change: Change) -> Seen:
    """Class of each cell of the grid.

    The slope is the region that was given, or else the outline of both surveys with its holes. A cell is compared if it
    has a change. Another one lacks the ground of a survey nearby (``seen_cells.near_points``); if it lacks neither, the
    points around are too few.
    """
    layout, known = change.layout, change.seen
    points = [layout.on_grid(count) for count in change.points]
    if known.near is None:
        near = [near_cells(count > 0, change.grid.cell) for count in points]
    else:
        near = [cells.array for cells in known.near]
    valid = layout.on_grid(change.valid)
    inside = _outline(points, valid, change.grid.cell) if known.inside is None else known.inside.array
    # 0, 1, 2, 3: ground of both surveys nearby, not of the first, not of the later, of neither
    missing = ~near[0] + 2 * ~near[1]
    classes = np.array([TOO_FEW, NOT_IN_FIRST, NOT_IN_LATER, NOT_IN_BOTH], dtype=np.uint8)[missing]
    classes[valid] = COMPARED
    if known.excluded is not None:
        classes[known.excluded.array] = EXCLUDED
    classes[~inside] = OUTSIDE
    return Seen(classes, change.grid.cell)


def _outline(points: Sequence[NDArray[np.signedinteger[Any]]], valid: Bool, cell: float) -> Bool:
    """Cells within the outline of either survey, with the holes in both."""
    reach = max(1, round(_BLOCK_M / cell))
    first, second = (surveyed(count > 0, int(count.sum()), reach) for count in points)
    label, _ = ndimage.label(~(first | second | valid))
    edge = np.unique(np.concatenate([label[0], label[-1], label[:, 0], label[:, -1]]))
    return np.isin(label, edge[edge > 0], invert=True)
