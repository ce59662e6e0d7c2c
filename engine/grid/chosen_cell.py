"""The cell of the grid where it is left to the clouds, and how far cells may grow where that is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from ...interface.parameters import AUTO, ChangeParameters, GridChangeParameters, given
from ..core.arrays import Float, Index
from ..geometry.point_spacing import point_spacing, spacing_from_counts
from ..geometry.square_counts import counted, counted_squares
from ..pointcloud.in_parts import Points, SpooledCloud, bounds_of, parts_of

CELL_SIDES_M = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
"""Sides of a cell that are chosen from, metres."""
MAX_GROWN_SIDE_M = 1.6
"""Side (m) from which on a cell's level of detection is no reason to grow any more."""
MIN_POINTS = 4
"""Points that a grown cell takes in either epoch, at least."""
_MIN_SERVED_SHARE = 0.9  # share of the squares with points of both surveys that must have enough of both
_MAX_STEPS = 4  # doublings beyond MAX_GROWN_SIDE_M

Parameters = TypeVar("Parameters", bound=GridChangeParameters)


@dataclass(frozen=True)
class CellChoice:
    """The side of a cell (m), whether it was given or left to the clouds, and why it is what it is, in a sentence."""

    cell: float
    automatic: bool
    sentence: str

    def facts(self) -> dict[str, object]:
        """For the run record."""
        return {"cell_m": self.cell, "chosen": "auto" if self.automatic else "given", "sentence": self.sentence}


def choose_cell(clouds: Sequence[Points], parameters: GridChangeParameters) -> CellChoice:
    """The cell as given, or that of ``CELL_SIDES_M`` which is nearest to how far the sparser survey's points lie apart.

    With one point in a cell at the median, smaller cells would show nothing finer, and larger ones would blur what the
    points show; cells that grow start from there.

    Args:
        clouds: ground points (n, 3) of each survey, metres.
    """
    side = given(parameters.cell)
    if side is not None:
        return CellChoice(side, False, f"Cells of {side:g} m, as given.")
    spacing = max(_spacing(cloud) for cloud in clouds)
    cell = min(CELL_SIDES_M, key=lambda side: abs(math.log(side / spacing)))
    whose = "the sparser survey" if len(clouds) > 1 else "the first survey"
    sentence = (
        f"Cells of {cell:g} m, chosen because the points of {whose} are {spacing:.2g} m apart; --cell fixes another "
        "size."
    )
    return CellChoice(cell, True, sentence)


def _spacing(cloud: Points) -> float:
    if not isinstance(cloud, SpooledCloud):
        return point_spacing(cloud[:, :2])
    low, high = (corner[:2] for corner in cloud.bounds)
    squares = counted_squares(np.floor(xyz[:, :2] - low).astype(np.int64) for xyz in parts_of(cloud))
    return spacing_from_counts(*squares, float((high - low).max()))


def with_cell(parameters: Parameters, choice: CellChoice) -> Parameters:
    """``parameters`` with the cell that was chosen."""
    return replace(parameters, cell=choice.cell)


def level_step(cell: float, parameters: ChangeParameters) -> int:
    """How often ``cell`` (m) may double its side to reach the level.

    Within ``largest_cell``, or until ``MAX_GROWN_SIDE_M``.
    """
    largest = given(parameters.largest_cell)
    ratio = math.log2((largest or MAX_GROWN_SIDE_M) / cell)
    return max(0, math.floor(ratio + 1e-9) if largest else math.ceil(ratio - 1e-9))


def largest_step(
    first: Points,
    second: Points,
    cell: float,
    parameters: ChangeParameters,
    standing: tuple[Index | None, Index | None] = (None, None),
) -> int:
    """How often ``cell`` (m) may double its side.

    That is ``level_step``, and where the largest cell is left to the clouds, more until nine tenths of the squares in
    which both surveys have points have enough of both.

    Args:
        first, second: points (n, 3) and (m, 3) of the epochs, metres; or the middles of cells with points.
        standing: how many points each of these stands for; one by default.
    """
    step = level_step(cell, parameters)
    if parameters.largest_cell != AUTO or not len(first) or not len(second):
        return step
    low, high = (end(a, b)[:2] for end, a, b in zip((np.minimum, np.maximum), bounds_of(first), bounds_of(second)))
    for more in range(_MAX_STEPS):
        side = cell * 2 ** (step + more)
        if (
            side > float((high - low).max())
            or _served((first, second), standing, (low, high), side) >= _MIN_SERVED_SHARE
        ):
            return step + more
    return step + _MAX_STEPS


def _served(
    clouds: tuple[Points, Points], standing: tuple[Index | None, Index | None], ends: tuple[Float, Float], side: float
) -> float:
    """Share of the squares with points of both surveys that have enough of both; 0 without such squares."""
    low, high = ends
    origin = np.floor(low / side)
    columns = int(np.floor(high[0] / side) - origin[0]) + 1

    def squares(xyz: Float) -> Index:
        place = (np.floor(xyz[:, :2] / side) - origin).astype(np.int64)
        return np.asarray(place[:, 1] * columns + place[:, 0])

    counts = []
    for cloud, each in zip(clouds, standing, strict=True):
        if each is None:
            counts.append(counted(squares(xyz) for xyz in parts_of(cloud)))
        else:
            assert not isinstance(cloud, SpooledCloud)
            number, place = np.unique(squares(cloud), return_inverse=True)
            counts.append((number, np.bincount(place.ravel(), each).astype(np.int64)))
    _, a, b = np.intersect1d(counts[0][0], counts[1][0], assume_unique=True, return_indices=True)
    fewest = np.minimum(counts[0][1][a], counts[1][1][b])
    return float(np.mean(fewest >= MIN_POINTS)) if fewest.size else 0.0
