"""A first look at all points of a cloud: where they are, how dense, and what they carry."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ..core.arrays import Bool, Float, Index
from ..core.errors import InputError
from ..core.messages import shown
from ..core.progress import Progress
from ..geometry.point_spacing import spacing_from_counts
from ..geometry.square_counts import counted_squares
from ..pointcloud.cloud import PointCloud
from ..pointcloud.in_parts import CloudFile
from ..pointcloud.kept_parts import KeptParts
from ..pointcloud.reading import open_cloud
from .returns import GROUND, NOISE

_MOST_SQUARES = 4_000_000  # of a metre, over the header's extent; more of them are made larger
_MIN_GROUND_SHARE = 0.001  # of the points, from which a cloud is classified


@dataclass(frozen=True)
class CloudLook:
    """What a cloud holds within an area.

    Attributes:
        points: without those of the classes of noise, of which there are ``noise``.
        low, high: (3,) metres.
        squares: (n, 2) column and row of the squares of ``side`` metres with points, from ``corner`` on.
        counts: (n,) points in each.
        ground: points of class 2.
        coloured: whether a point has a colour; ``largest_colour`` is the largest value.
        shaded: whether intensities differ.
    """

    points: int
    noise: int
    low: Float
    high: Float
    corner: Float
    side: float
    squares: Index
    counts: Index
    ground: int
    coloured: bool
    largest_colour: int
    shaded: bool

    @property
    def spacing(self) -> float:
        """Mean distance (m) of the points, see ``point_spacing``."""
        extent = float((self.high - self.low)[:2].max())
        return self.side * spacing_from_counts(self.squares, self.counts, extent / self.side)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north."""
        return float(self.low[0]), float(self.low[1]), float(self.high[0]), float(self.high[1])

    @property
    def classified(self) -> bool:
        """Whether there are enough points of class 2 to be the ground."""
        return self.ground >= _MIN_GROUND_SHARE * self.points and self.ground > 0

    @property
    def colours(self) -> str:
        """What can be shown from above: ``rgb``, ``intensity``, or empty."""
        return "rgb" if self.coloured else "intensity" if self.shaded else ""


def kept_parts(cloud: CloudFile, area: BaseGeometry | None, progress: Progress | None = None) -> Iterator[PointCloud]:
    """The parts of a cloud read with its classes, without points outside an area (on its edge is within) and noise."""
    if area is not None:
        shapely.prepare(area)
    for part in _near(cloud, area).parts(progress):
        chosen = _chosen(part, area)
        yield part if chosen.all() else _of(part, chosen)


def looked_through(
    cloud: CloudFile, area: BaseGeometry | None, folder: Path, progress: Progress
) -> tuple[CloudLook, Callable[[Progress], Iterator[PointCloud]]]:
    """As ``look_at``, and a way to go again through the parts that ``kept_parts`` gives.

    Args:
        folder: where these are kept meanwhile; where its disk has no room the cloud is read again.
    """
    if not KeptParts.room(cloud, folder):
        return look_at(cloud, area, progress), lambda again: kept_parts(cloud, area, again)
    kept = KeptParts(folder / "parts")
    return look_at(cloud, area, progress, kept), kept.parts


def _near(cloud: CloudFile, area: BaseGeometry | None) -> CloudFile:
    """Of a COPC, what can lie in the area only."""
    return cloud if area is None else replace(cloud, near=area.bounds)


def look_at(
    cloud: CloudFile, area: BaseGeometry | None, progress: Progress, keep: KeptParts | None = None
) -> CloudLook:
    """Look at a cloud that is read with its classes and colours.

    Args:
        area: polygons in metres of the cloud's frame; None: all.
        keep: takes the parts.

    Raises:
        InputError: as ``read_cloud``; no point is left within the area.
    """
    side, corner = _squares_of(cloud)
    seen = _Seen()
    if area is not None:
        shapely.prepare(area)

    def places() -> Iterator[Index]:
        for part in _near(cloud, area).parts(progress):
            kept = _of(part, _chosen(part, area, seen))
            seen.add(kept)
            if keep is not None:
                keep.add(kept)
            yield np.floor((kept.xyz[:, :2] - corner) / side).astype(np.int64) + _OFFSET

    squares, counts = counted_squares(places())
    if not seen.points:
        where = "" if area is None else " within the region of interest"
        raise InputError(f"{shown(cloud.path)} has no points{where} but noise; check the area and the classes.")
    return CloudLook(
        seen.points,
        seen.noise,
        seen.low,
        seen.high,
        corner,
        side,
        squares - _OFFSET,
        counts,
        seen.ground,
        seen.largest > 0,
        seen.largest,
        seen.intensities[0] < seen.intensities[1],
    )


_OFFSET = 1 << 30  # squares west or south of the corner, as where a header lies, get positive numbers


class _Seen:
    """Tallies over the parts."""

    def __init__(self) -> None:
        self.points = self.noise = self.ground = self.largest = 0
        self.low, self.high = np.full(3, np.inf), np.full(3, -np.inf)
        self.intensities = (1 << 16, -1)

    def add(self, part: PointCloud) -> None:
        if not len(part):
            return
        self.points += len(part)
        self.low = np.minimum(self.low, part.xyz.min(axis=0))
        self.high = np.maximum(self.high, part.xyz.max(axis=0))
        if part.classification is not None:
            self.ground += int(np.count_nonzero(part.classification == GROUND))
        if part.rgb is not None:
            self.largest = max(self.largest, int(part.rgb.max()))
        if part.intensity is not None:
            least, most = int(part.intensity.min()), int(part.intensity.max())
            self.intensities = min(self.intensities[0], least), max(self.intensities[1], most)


def _chosen(part: PointCloud, area: BaseGeometry | None, seen: _Seen | None = None) -> Bool:
    chosen: Bool = np.ones(len(part), dtype=bool)
    if area is not None:
        chosen = np.asarray(shapely.intersects_xy(area, part.xyz[:, 0], part.xyz[:, 1]))
    if part.classification is not None:
        noise = np.isin(part.classification, NOISE)
        if seen is not None:
            seen.noise += int(np.count_nonzero(noise & chosen))
        chosen &= ~noise
    return chosen


def _of(part: PointCloud, chosen: Bool) -> PointCloud:
    return PointCloud(
        part.xyz[chosen],
        part.crs,
        part.path,
        rgb=None if part.rgb is None else part.rgb[chosen],
        intensity=None if part.intensity is None else part.intensity[chosen],
        classification=None if part.classification is None else part.classification[chosen],
    )


def _squares_of(cloud: CloudFile) -> tuple[float, Float]:
    """Side (m, a power of two) and corner of squares that are not too many for the header's extent."""
    header, frame = open_cloud(cloud.path, cloud.inputs)
    factor = frame.horizontal_factor
    low, high = (np.array(end[:2]) * factor for end in (header.bounds_low, header.bounds_high))
    if not header.bounds_trusted or not np.isfinite([*low, *high]).all():
        return 1.0, np.zeros(2)
    area = float(np.prod(np.maximum(high - low, 1.0)))
    side = 2.0 ** max(0, math.ceil(math.log2(math.sqrt(area / _MOST_SQUARES))))
    return side, np.floor(low)
