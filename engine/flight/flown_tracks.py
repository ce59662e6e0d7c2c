"""Where a survey was flown: from a trajectory file, or from the scan angles of its returns."""

from __future__ import annotations

import csv
import math
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from io import TextIOWrapper
from pathlib import Path

import numpy as np

from ...interface.input_files import TRAJECTORY
from ..core.arrays import Float, Index
from ..core.errors import InputError
from ..core.input_files import open_input
from ..core.messages import shown

STRIP_PAUSE_S = 5.0
"""Pause of the returns that begins a new strip where the file does not number its strips."""
_BIN_S = 0.5  # of flight from which one place of the carrier is taken
_MIN_RETURNS, _MIN_SPREAD_DEG = 50, 10.0  # of such a bin
_MAX_MISFIT = 0.02  # of the returns of a strip to beams from its places, as a share of the carrier's height over them
_MIN_SIGNED_DEG = 2.0  # to each side that angles across the flight reach
_TURNS = 3  # of fitting, as the direction of flight and the places follow from one another
_COLUMNS = ("time", "x", "y", "z")
_MAX_LINES = 3_000_000  # four hours at 200 Hz
_MAX_WAY_M = 1e6  # of a trajectory in plan; a longer one has places in other units or of another system


@dataclass(frozen=True)
class Track:
    """Places ``xyz`` (n, 3) of the carrier, metres, in the order flown at the times ``seconds`` (n,)."""

    xyz: Float
    seconds: Float


def read_trajectory(path: Path) -> Track:
    """A trajectory of a CSV file with the columns time (s), x, y and z (m, in the plan's system), in any order.

    Raises:
        InputError: a column is missing, a value is no number, there are fewer than two places, or they lie farther
            apart than any aircraft flies.
    """
    try:
        with TextIOWrapper(open_input(path, TRAJECTORY), encoding="utf-8-sig", newline="") as stream:
            table = _table(csv.reader(stream), shown(path))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{shown(path)} cannot be read as a CSV file of a trajectory; give one in UTF-8.") from error
    if len(table) < 2 or not np.isfinite(table).all():
        raise InputError(f"{shown(path)} holds {len(table)} places, and a trajectory needs two or more finite ones.")
    table = table[np.argsort(table[:, 0], kind="stable")]
    with np.errstate(over="ignore", invalid="ignore"):
        way = float(np.hypot(*np.diff(table[:, 1:3], axis=0).T).sum())
    if not way <= _MAX_WAY_M:
        raise InputError(
            f"The places of {shown(path)} make a way of {way / 1e3:,.0f} km; give them in metres, in the plan's "
            f"system, at most {_MAX_WAY_M / 1e3:,.0f} km in all."
        )
    return Track(table[:, 1:], table[:, 0])


def _table(rows: Iterator[list[str]], name: str) -> Float:
    """Time, x, y and z (n, 4) of the lines, in their order."""
    names = [column.strip().lower() for column in next(rows, [])]
    missing = [column for column in _COLUMNS if column not in names]
    if missing:
        raise InputError(
            f"{name} has no column {missing[0]}; a trajectory has a heading with the columns time, x, y and z."
        )
    places = [names.index(column) for column in _COLUMNS]
    values = array("d")
    for number, row in enumerate(rows, 2):
        if number > _MAX_LINES:
            raise InputError(f"{name} has more than {_MAX_LINES:,} lines; give places at 200 Hz or less.")
        if not any(cell.strip() for cell in row):
            continue
        try:
            values.extend([float(row[place]) for place in places])
        except (ValueError, IndexError) as error:
            raise InputError(f"Line {number} of {name} holds no four numbers; correct or remove it.") from error
    return np.array(values, dtype=np.float64).reshape(-1, 4)


def strips_of(source: Index, seconds: Float | None) -> Index:
    """The strip of each return (n,), from 0 on in the order of their numbers or times.

    By the file's numbers ``source`` (n,) where it has several; else a pause of the times of 5 s begins a new one.
    """
    if len(source) and source.min() != source.max():
        return np.asarray(np.unique(source, return_inverse=True)[1], dtype=np.int64)
    if seconds is None or not len(seconds):
        return np.zeros(len(source), dtype=np.int64)
    order = np.argsort(seconds, kind="stable")
    strip = np.empty(len(source), dtype=np.int64)
    strip[order] = np.concatenate([[0], np.cumsum(np.diff(seconds[order]) > STRIP_PAUSE_S)])
    return strip


def track_from_angles(xyz: Float, seconds: Float, angle: Float) -> Track | None:
    """Places of the carrier along one strip, from its returns; None where their angles do not show it.

    A beam across the flight that leaves at the angle a from the vertical comes down at p = s + (z - p_z) tan(a) to the
    right, s and z being the carrier's place across and its height; so p + p_z tan(a) is a line over tan(a) whose
    beginning and rise are s and z. It is fitted to each half second; along the flight the carrier is where the returns
    are. Returns that this misses by more than 2 % of the height (a cone of beams, an aircraft that rolls while angles
    are not of the vertical) show nothing.

    Args:
        xyz: (n, 3) metres.
        seconds: (n,) times.
        angle: (n,) degrees, positive to the right of the flight.
    """
    order = np.argsort(seconds, kind="stable")
    xyz, seconds, slant = xyz[order], seconds[order], np.tan(np.radians(angle[order]))
    half = np.floor((seconds - seconds[0]) / _BIN_S)  # numbered, not listed: a damaged time may be years away
    bins = np.split(np.arange(len(xyz)), np.flatnonzero(np.diff(half)) + 1)
    bins = [b for b in bins if len(b) >= _MIN_RETURNS and float(np.ptp(angle[order[b]])) >= _MIN_SPREAD_DEG]
    if len(bins) < 3:
        return None
    middle = xyz.mean(axis=0)
    local, times = xyz - middle, np.array([seconds[b].mean() for b in bins])
    places = np.array([local[b].mean(axis=0) for b in bins])
    fitted, over, square = _fitted(local, slant, bins, times, places)
    if over <= 0 or math.sqrt(square) > _MAX_MISFIT * over:
        return None
    return Track(fitted + middle, times)


def on_both_sides(angle: Float) -> bool:
    """Whether angles (n,), degrees, are counted to two sides, as those of a cone without a side are not."""
    return len(angle) > 0 and float(angle.min()) < -_MIN_SIGNED_DEG and float(angle.max()) > _MIN_SIGNED_DEG


def _fitted(local: Float, slant: Float, bins: list[Index], times: Float, places: Float) -> tuple[Float, float, float]:
    """Places of the carrier (k, 3) at ``times`` (k,), its median height over the returns and the median mean square of
    what the fit leaves, m².

    Args:
        local: (n, 3) returns.
        slant: (n,) tangents of their angles.
        bins: the returns of each time.
        places: (k, 3) their means.
    """
    over, square = 0.0, math.inf
    for _ in range(_TURNS):
        way = np.polyfit(times - times.mean(), places[:, :2], 1)[0]
        along = way / max(float(np.hypot(*way)), 1e-12)
        right = np.array([along[1], -along[0]])
        found, squares = [], []
        for b in bins:
            across, forth = local[b, :2] @ right, float((local[b, :2] @ along).mean())
            design = np.column_stack([np.ones(len(b)), slant[b]])
            target = across + local[b, 2] * slant[b]
            (aside, height), *_ = np.linalg.lstsq(design, target, rcond=None)
            squares.append(float(np.mean((design @ (aside, height) - target) ** 2)))
            found.append([*(forth * along + aside * right), height])
        places = np.array(found)
        over = float(np.median(places[:, 2] - [local[b, 2].mean() for b in bins]))
        square = float(np.median(squares))
    return places, over, square
