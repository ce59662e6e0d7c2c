"""What is decided once for a survey that is read in parts: returns, plane, outliers, spacing.

Each is what ``extraction`` decides with all points in memory. Medians of positions, which only say where boxes begin
and what is far away, are those of an even sample of at most ``MAX_SAMPLE`` points.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from laspy import DecompressionSelection
from numpy.typing import NDArray

from ....interface.parameters import GroundParameters
from ...core.arrays import Bool, Float, Index
from ...geometry.dominant_plane import Plane, apply_matrix, flattening_matrix
from ...geometry.point_spacing import spacing_of_squares
from ...pointcloud.header import CloudHeader, preflight
from ...pointcloud.records import PLACES, coordinates, read_records
from ...pointcloud.returns import ReturnCounts, Returns, are_last, returns_of
from ..filtering import MIN_PLANE_POINTS, PLANE_CELL, plane_through
from ..outliers import MIN_RADIUS_SPACINGS, box_numbers, core_reach, small_groups
from ..pdal_pipelines import NOISE
from ..squares import first_of_runs
from ..tally import Tally, metre_squares, square_keys, square_places

MAX_SAMPLE = 1_000_000
"""Points of the sample from which medians of positions are taken."""


@dataclass(frozen=True)
class Part:
    """Some of a file's points: ``xyz`` (n, 3) m, ``number`` and ``total`` (n,) of their returns, ``labels`` (n,)."""

    xyz: Float
    number: NDArray[np.uint8]
    total: NDArray[np.uint8]
    labels: NDArray[np.uint8]


@dataclass(frozen=True)
class Denoising:
    """Which points are outliers: those in boxes of small groups, see ``outliers``, and the file's own noise.

    ``boxes`` (m,) are their numbers, ascending, ``middle`` (3,) and ``radius`` (m) where boxes lie and how large.
    """

    asked: bool
    middle: Float
    radius: float
    boxes: Index

    def outliers(self, flat: Float, labels: NDArray[np.uint8]) -> Bool:
        """(n,) which of the points (n, 3) in the slope's frame, with their classes (n,), are outliers."""
        if not self.asked:
            return np.zeros(len(flat), dtype=bool)
        box = box_numbers(flat, self.middle, self.radius)
        return np.asarray((box < 0) | np.isin(box, self.boxes) | np.isin(labels, NOISE), dtype=np.bool_)


@dataclass(frozen=True)
class Survey:
    """Decisions on the points of a file, in metres; ``returns.last`` is empty, see ``taken``."""

    header: CloudHeader
    flags_in_class: bool
    returns: Returns
    plane: Plane
    denoising: Denoising

    def parts(self) -> Iterator[Part]:
        """The points in the order of the file."""
        return parts(self.header, self.flags_in_class)

    def flat(self, xyz: Float) -> Float:
        """Points (n, 3) in the slope's frame."""
        return apply_matrix(flattening_matrix(self.plane), xyz)

    def taken(self, part: Part, parameters: GroundParameters) -> Bool:
        """(n,) the points that may be ground."""
        if not (parameters.last_returns and self.returns.usable):
            return np.ones(len(part.xyz), dtype=bool)
        return are_last(part.number, part.total)


def parts(header: CloudHeader, flags_in_class: bool) -> Iterator[Part]:
    """The points of an uncompressed cloud in metres, in groups of some megabytes."""
    for records in read_records(header, selection=PLACES | DecompressionSelection.CLASSIFICATION):
        labels = np.array(records["classification"], dtype=np.uint8)
        yield Part(
            coordinates(records, header),
            np.array(records["return_number"], dtype=np.uint8),
            np.array(records["number_of_returns"], dtype=np.uint8),
            np.asarray(labels & 0x1F if flags_in_class else labels, dtype=np.uint8),
        )


def look_through(path: Path, parameters: GroundParameters, *, flags_in_class: bool) -> Survey:
    """Decide on the points of an uncompressed cloud in metres, which is read four times.

    Raises:
        InputError: all points lie on a line.
    """
    header = preflight(path)
    low, sample, counts = _first_look(header, flags_in_class)
    plane = _plane(header, flags_in_class, low, sample)
    matrix = flattening_matrix(plane)
    flat = apply_matrix(matrix, sample)
    middle = np.median(flat, axis=0)
    reach = core_reach(flat, middle)
    core = Tally()
    for part in parts(header, flags_in_class):
        flat = apply_matrix(matrix, part.xyz)
        core.add(metre_squares(flat[np.abs(flat - middle).max(axis=1) <= reach]))
    radius = max(parameters.denoise_radius, MIN_RADIUS_SPACINGS * spacing_of(core))
    boxes = Tally()
    for part in parts(header, flags_in_class) if parameters.denoise else ():
        number = box_numbers(apply_matrix(matrix, part.xyz), middle, radius)
        boxes.add(number[number >= 0])
    occupied, points = boxes.found()[0], boxes.counts().astype(np.int64)
    small = occupied[small_groups(occupied, points, parameters.denoise_group)] if len(occupied) else occupied
    denoising = Denoising(parameters.denoise, middle, radius, small)
    return Survey(header, flags_in_class, returns_of(counts), plane, denoising)


@dataclass(frozen=True)
class Kept:
    """The points of a survey without its outliers, in the slope's frame and seen from above.

    ``count`` of them; ``removed`` (m, 3) are the outliers in the slope's frame. ``places`` (k, 2) and ``points`` (k,)
    are the squares of a metre of the slope's frame that hold points, and these. ``spacing`` is seen from above,
    ``flat_spacing`` in the slope's frame; ``area`` (m²) that of squares of a metre seen from above. ``low`` (2,) and
    ``flat_low`` (2,) are the least coordinates, ``flat_size`` (2,) the extent in the slope's frame. ``cloth_low`` (2,)
    are the least coordinates of the points that take part, in the frame in which the cloth is laid.
    """

    count: int
    removed: Float
    places: Index
    points: Float
    spacing: float
    flat_spacing: float
    area: float
    low: Float
    flat_low: Float
    flat_size: Float
    cloth_low: Float


def look_at_kept(survey: Survey, parameters: GroundParameters) -> Kept:
    """What the points without outliers cover; the file is read once."""
    squares, above = Tally(), Tally()
    low, flat_low, flat_high = np.full(2, np.inf), np.full(2, np.inf), np.full(2, -np.inf)
    removed, count, cloth_low = [np.zeros((0, 3))], 0, np.full(2, np.inf)
    for part in survey.parts():
        flat = survey.flat(part.xyz)
        out = survey.denoising.outliers(flat, part.labels)
        removed.append(flat[out])
        flat, xyz, taken = flat[~out], part.xyz[~out], survey.taken(part, parameters)[~out]
        laid = (flat if parameters.slope_aligned else xyz)[taken]
        cloth_low = np.minimum(cloth_low, laid[:, :2].min(axis=0, initial=np.inf))
        if not len(flat):
            continue
        count += len(flat)
        low = np.minimum(low, xyz[:, :2].min(axis=0))
        flat_low = np.minimum(flat_low, flat[:, :2].min(axis=0))
        flat_high = np.maximum(flat_high, flat[:, :2].max(axis=0))
        squares.add(metre_squares(flat))
        above.add(metre_squares(xyz))
    return Kept(
        count,
        np.vstack(removed),
        square_places(squares.found()[0]),
        squares.counts(),
        spacing_of(above) if count else 0.0,
        spacing_of(squares) if count else 0.0,
        float(len(above.counts())),
        low,
        flat_low,
        flat_high - flat_low,
        cloth_low,
    )


def spacing_of(squares: Tally) -> float:
    """``point_spacing`` of points counted in squares of a metre."""
    return spacing_of_squares(square_places(squares.found()[0]), squares.counts())


def _first_look(header: CloudHeader, flags_in_class: bool) -> tuple[Float, Float, ReturnCounts]:
    """The least coordinates (3,), a sample (n, 3) and what the return numbers say."""
    low, done, counts = np.full(3, np.inf), 0, ReturnCounts()
    step = -(-header.count // MAX_SAMPLE)
    sample = []
    for part in parts(header, flags_in_class):
        low = np.minimum(low, part.xyz.min(axis=0))
        sample.append(part.xyz[-done % step :: step])
        counts = counts.with_more(part.number, part.total)
        done += len(part.xyz)
    return low, np.concatenate(sample), counts


def _plane(header: CloudHeader, flags_in_class: bool, low: Float, sample: Float) -> Plane:
    """The slope's plane through the lowest points of cells, as ``dominant_plane`` finds it."""
    keys, lowest = np.zeros(0, dtype=np.int64), np.zeros((0, 3))
    for part in parts(header, flags_in_class):
        place = np.floor((part.xyz[:, :2] - low[:2]) / PLANE_CELL).astype(np.int64)
        keys, lowest = _lowest(square_keys(place), part.xyz, keys, lowest)
    return plane_through(lowest if len(lowest) >= MIN_PLANE_POINTS else sample)


def _lowest(key: Index, xyz: Float, keys: Index, lowest: Float) -> tuple[Index, Float]:
    """Cells and their lowest points, those found before (``keys`` and ``lowest``) and new ones together."""
    order = np.lexsort((xyz[:, 2], key))
    order = order[first_of_runs(key[order])]
    # those from before come first, so that of points at one height the first in the file stays
    key, xyz = np.concatenate([keys, key[order]]), np.vstack([lowest, xyz[order]])
    order = np.lexsort((xyz[:, 2], key))
    order = order[first_of_runs(key[order])]
    return key[order], xyz[order]
