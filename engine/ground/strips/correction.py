"""A classified survey, strip by strip: how well its strips fit, and a copy in which they do."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from laspy import DecompressionSelection as Fields
from laspy import PackedPointRecord

from ...core.arrays import Float, Index
from ...core.progress import Progress
from ...pointcloud.extent import square_metres
from ...pointcloud.header import CloudHeader, Vector
from ...pointcloud.reading import open_cloud
from ...pointcloud.records import PLACES, coordinates, extra_dimensions, read_records
from ...pointcloud.times import LARGEST_TIME_S
from ...pointcloud.writing import Target, copy_records, scales_and_offsets, set_coordinates
from ..pdal_pipelines import GROUND
from ..result import HEIGHT_OVER_GROUND
from .judgement import StripFit, judged
from .model import StripTimes
from .overlaps import Moments, Overlaps, StripPoints

MAX_STRIPS = 40
"""More are not fitted: they would be parts of strips."""
_POINTS_PER_STRIP = 8.0
"""In a cell, that its size aims at."""
_MIN_CELL_M, _MAX_CELL_M = 0.5, 5.0
_MAX_PAIRS = 40_000
_MAX_SCALE_M = 0.001
_REACH_M = 0.3
"""Points this near the ground are compared: of strips that lie higher, the ground itself holds next to none."""
_MIN_GAP_S = 5.0
"""Without numbers of strips, a survey is parted where no point was measured for so long."""
_COMPARING = "comparing flight strips"
_FIELDS = PLACES | Fields.POINT_SOURCE_ID | Fields.GPS_TIME


@dataclass(frozen=True)
class _Numbering:
    """Which strip a point is of: by its number in the file, or by the ends (k - 1,) of the pauses in time, s."""

    names: tuple[int, ...]
    ends: Float | None

    def of(self, source: Index, seconds: Float) -> Index:
        """Strip (n,) from 0 on; -1 where it is none of these."""
        if self.ends is not None:
            return np.searchsorted(self.ends, seconds).astype(np.int64)
        strip = np.searchsorted(np.array(self.names), source).clip(max=len(self.names) - 1)
        return np.where(np.array(self.names)[strip] == source, strip, -1)


@dataclass(frozen=True)
class FittedStrips:
    """How the strips fit, and what numbers them."""

    fit: StripFit
    numbering: _Numbering


def fit_strips(path: Path, progress: Progress | None = None) -> FittedStrips | None:
    """Compare the strips of a classified cloud where they overlap; None for one strip, too many, or too little overlap.

    Raises:
        InputError: as ``read_records``.
    """
    progress = progress or Progress()
    header, frame = open_cloud(path)
    seen = _looked_through(header, frame.factors, progress)
    if seen is None:
        return None
    strips = len(seen.numbering.names)
    if not 2 <= strips <= MAX_STRIPS:
        return None
    cell = float(np.clip(np.sqrt(_POINTS_PER_STRIP * strips * seen.area / seen.points.sum()), _MIN_CELL_M, _MAX_CELL_M))
    moments = Moments(cell, seen.low, int((seen.high[0] - seen.low[0]) / cell) + 2, strips)
    done = 0
    for xyz, source, seconds in _points(header, frame.factors):
        moments.add(StripPoints(xyz, seen.numbering.of(source, seconds), seconds))
        done += len(xyz)
        progress.update(0.3 + 0.5 * done / header.count, _COMPARING)
    times = StripTimes((seen.begin + seen.end) / 2, np.maximum((seen.end - seen.begin) / 2, 1e-3))
    fit = judged(_some(moments.overlaps()), cell, seen.numbering.names, seen.points, times)
    return None if fit is None else FittedStrips(fit, seen.numbering)


def copy_fitted(source: Path, target: Path, fitted: FittedStrips) -> None:
    """Copy a cloud of the survey with each strip where the ``fitted`` model puts it; strips it does not know stay.

    Raises:
        EngineError, InputError: as ``copy_records``.
    """
    model, numbering = fitted.fit.model, fitted.numbering
    assert model is not None
    header, frame = open_cloud(source)

    def moved(records: PackedPointRecord) -> Float:
        numbers, seconds = _source(records), _seconds(records)
        xyz = coordinates(records, header, frame.factors)
        strip = numbering.of(numbers, seconds)
        known = strip >= 0
        xyz[known] -= model.correction(strip[known], seconds[known])
        return xyz

    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for records in read_records(header, selection=_FIELDS):
        xyz = moved(records)
        low, high = np.minimum(low, xyz.min(axis=0)), np.maximum(high, xyz.max(axis=0))
    scales, offsets = scales_and_offsets(target, np.stack([low, high]), _scales(header, frame.factors))

    def change(records: PackedPointRecord, part: slice) -> None:
        set_coordinates(records.array, moved(records), scales, offsets)

    copy_records(header, [Target(target, frame.crs, scales, offsets, change)])


def _scales(header: CloudHeader, factors: Vector) -> Float:
    """Of the file, or finer: corrections are smaller than the centimetre in which some are stored."""
    return np.minimum(np.array(header.scales) * factors, _MAX_SCALE_M)


def strips_sentence(fit: StripFit, name: str) -> str:
    """What the user has to know about the strips of ``name``; empty where they fit."""
    if fit.before < WORTH_TELLING_M:
        return ""
    apart = f"The flight strips of {name} disagree by {fit.before:.3f} m in height where they overlap"
    if fit.model is None:
        return f"{apart}; no correction of them holds on ground that it was not fitted to, so they stay as surveyed."
    return (
        f"{apart}; they were fitted to one another ({_WORDS[fit.level]}), which leaves {fit.after:.3f} m on ground "
        "that the correction was not fitted to."
    )


WORTH_TELLING_M = 0.02
_WORDS = {
    "height": "heights",
    "position": "heights and positions",
    "drift": "heights, positions and slow drift",
}


def _some(pairs: Overlaps) -> Overlaps:
    """At most _MAX_PAIRS, evenly over all."""
    if len(pairs) <= _MAX_PAIRS:
        return pairs
    # Whole blocks are held out later, so neighbours are left out rather than places.
    return pairs.chosen(np.sort(np.random.default_rng(0).choice(len(pairs), _MAX_PAIRS, replace=False)))


def _points(header: CloudHeader, factors: Vector) -> Iterator[tuple[Float, Index, Float]]:
    """Points near the ground where their height over it is known, else those of the ground's class."""
    heights = next((d for d in extra_dimensions(header) if d.name == HEIGHT_OVER_GROUND), None)
    fields = _FIELDS | (Fields.CLASSIFICATION if heights is None else Fields.ALL_EXTRA_BYTES)
    for records in read_records(header, selection=fields):
        if heights is None:
            near = np.asarray(records["classification"]) == GROUND
        else:
            near = np.abs(heights.values(records)) < _REACH_M
        if near.any():
            yield coordinates(records, header, factors)[near], _source(records)[near], _seconds(records)[near]


def _source(records: PackedPointRecord) -> Index:
    return np.asarray(records["point_source_id"]).astype(np.int64)


def _seconds(records: PackedPointRecord) -> Float:
    if "gps_time" not in (records.array.dtype.names or ()):
        return np.zeros(len(records))
    seconds = np.asarray(records["gps_time"], dtype=np.float64)
    return np.where(np.abs(seconds) < LARGEST_TIME_S, seconds, 0.0)


@dataclass(frozen=True)
class _Seen:
    """What a first look at the points tells: extent and occupied ``area`` (m²), and of each strip the number of its
    ``points``, and when it begins and ends (s), (k,) each.
    """

    low: Float
    high: Float
    area: float
    numbering: _Numbering
    points: Float
    begin: Float
    end: Float


def _looked_through(header: CloudHeader, factors: Vector, progress: Progress) -> _Seen | None:
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    squares = np.empty(0, dtype=np.int64)
    # Points, first and last second by number of strip and by turn of the clock.
    tables: tuple[_Table, _Table] = ({}, {})
    done = 0
    for xyz, source, seconds in _points(header, factors):
        low, high = np.minimum(low, xyz.min(axis=0)), np.maximum(high, xyz.max(axis=0))
        squares = np.union1d(squares, square_metres(xyz))
        turn = np.floor(seconds / _MIN_GAP_S).astype(np.int64)
        for table, key in zip(tables, (source, turn), strict=True):
            _count(table, key, seconds)
        done += len(xyz)
        progress.update(0.3 * done / header.count, _COMPARING)
    by_source, by_turn = tables
    if not by_source:
        return None
    if len(by_source) > 1:
        rows = np.array([by_source[name] for name in sorted(by_source)])
        return _Seen(low, high, float(len(squares)), _Numbering(tuple(sorted(by_source)), None), *rows.T)
    turns = np.array(sorted(by_turn))
    rows = np.array([by_turn[int(turn)] for turn in turns])
    pauses = np.flatnonzero(np.diff(turns) > 1)
    first, last = np.append(0, pauses + 1), np.append(pauses, len(turns) - 1)
    points = np.add.reduceat(rows[:, 0], first)
    numbering = _Numbering(tuple(range(1, len(first) + 1)), rows[pauses, 2] + 1e-6)
    return _Seen(low, high, float(len(squares)), numbering, points, rows[first, 1], rows[last, 2])


_Table = dict[int, tuple[float, float, float]]


def _count(table: _Table, key: Index, seconds: Float) -> None:
    """Add points to a table of their number, and first and last second, by ``key`` (n,)."""
    names, number = np.unique(key, return_inverse=True)
    counts = np.bincount(number)
    begin, end = np.full(len(names), np.inf), np.full(len(names), -np.inf)
    np.minimum.at(begin, number, seconds)
    np.maximum.at(end, number, seconds)
    for k, name in enumerate(names.tolist()):
        held = table.get(name, (0.0, np.inf, -np.inf))
        table[name] = (held[0] + counts[k], min(held[1], float(begin[k])), max(held[2], float(end[k])))
