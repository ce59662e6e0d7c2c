"""Clouds that stay on the disk and are read in parts, for what needs not all points at once."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import shapely
from laspy import DecompressionSelection as Fields
from numpy.typing import NDArray
from pyproj import CRS
from shapely.geometry.base import BaseGeometry

from ...interface.parameters import InputParameters
from ..core.arrays import Float
from ..core.errors import InputError
from ..core.messages import shown
from ..core.progress import Progress
from ..geometry.columns import greatest, least
from ..geometry.rigid_transform import RigidTransform
from .cloud import PointCloud
from .copc import NearChunks, chosen_chunks
from .extent import CheckedRecords
from .header import preflight
from .plant_cover import ERROR, HEIGHT, PlantCover
from .reading import open_cloud
from .records import PLACES, ExtraDimension, coordinates, extra_dimensions

_PART_POINTS = 1_000_000
_HEIGHT_BINS = 4096


@dataclass(frozen=True)
class CloudFile:
    """A cloud in a file of any size, in metres, each point moved by ``transform``.

    Attributes:
        crs: what its points are in once they are read.
        colours: also read colours and intensity.
        classification: also read the classes.
        near: west, south, east and north (m, before it is moved) of what is wanted; of a COPC the rest is not read.
        spacing: distance (m) of points that will do; of a COPC finer levels are not read.
    """

    path: Path
    crs: CRS
    inputs: InputParameters | None = None
    transform: RigidTransform | None = None
    colours: bool = False
    classification: bool = False
    near: tuple[float, float, float, float] | None = None
    spacing: float | None = None

    @classmethod
    def of(
        cls,
        path: Path,
        inputs: InputParameters | None = None,
        *,
        transform: RigidTransform | None = None,
        colours: bool = False,
        classification: bool = False,
    ) -> CloudFile:
        """Look at the header of a cloud.

        Raises:
            InputError: see ``open_cloud``.
        """
        return cls(path, open_cloud(path, inputs)[1].crs, inputs, transform, colours, classification)

    @property
    def count(self) -> int:
        """How many points it has, by its header."""
        return preflight(self.path).count

    @property
    def chosen(self) -> NearChunks | None:
        """The chunks that are read by ``near`` and ``spacing``; None: all."""
        if self.near is None and self.spacing is None:
            return None
        header, frame = open_cloud(self.path, self.inputs)
        metres = frame.horizontal_factor
        bounds = None if self.near is None else (np.array(self.near[:2]) / metres, np.array(self.near[2:]) / metres)
        return chosen_chunks(header, bounds, None if self.spacing is None else self.spacing / metres)

    def parts(self, progress: Progress | None = None) -> Iterator[PointCloud]:
        """The points in the order of the file, in groups of some megabytes; colours have the 16 bits of the file.

        Args:
            progress: gets the share that was read, and the warnings about the file.

        Raises:
            InputError: as ``read_cloud``.
        """
        progress = progress or Progress()
        header, frame = open_cloud(self.path, self.inputs, progress)
        plants = {d.name: d for d in extra_dimensions(header) if d.name in (ERROR, HEIGHT) and d.dtype.kind in "uif"}
        wanted = PLACES
        wanted |= Fields.INTENSITY | Fields.RGB if self.colours else PLACES
        wanted |= Fields.CLASSIFICATION if self.classification else PLACES
        wanted |= Fields.ALL_EXTRA_BYTES if plants else PLACES
        chosen = self.chosen
        count = header.count if chosen is None else chosen.points
        checked = CheckedRecords(header, wanted, None if chosen is None else chosen.starts)
        coloured = self.colours and header.colours
        for records in checked:
            xyz = coordinates(records, header, frame.factors)
            yield PointCloud(
                xyz if self.transform is None else self.transform.apply(xyz),
                frame.crs,
                self.path,
                rgb=np.column_stack([records[c] for c in ("red", "green", "blue")]) if coloured else None,
                intensity=np.array(records["intensity"]) if self.colours else None,
                classification=np.array(records["classification"]) if self.classification else None,
                plant_error=_single(plants.get(ERROR), records),
                plant_height=_single(plants.get(HEIGHT), records),
            )
            progress.update(checked.done / count)
        for sentence in checked.extent(frame).warnings:
            progress.warning(sentence)


def _single(dimension: ExtraDimension | None, records: object) -> NDArray[np.float32] | None:
    return None if dimension is None else dimension.values(records).astype(np.float32)


@dataclass(frozen=True)
class SpooledCloud:
    """Ground points that lie in a file of their own, uncompressed, with what is known of the plants over them.

    Attributes:
        file: the points; it goes with the folder that it is in.
        stored: how many values of plants a point has there: its error, and the plants' height.
        values: how many of them count.
        transform: what each point is moved by when it is read.
    """

    file: Path
    count: int
    stored: int
    values: int
    crs: CRS
    path: Path
    transform: RigidTransform | None = None

    def __len__(self) -> int:
        return self.count

    @property
    def dtype(self) -> np.dtype[np.void]:
        """Of a point in the file."""
        return point_dtype(self.stored)

    def moved(self, transform: RigidTransform) -> SpooledCloud:
        """The same points in another frame."""
        assert self.transform is None
        return replace(self, transform=transform)

    def parts(self) -> Iterator[tuple[Float, PlantCover | None]]:
        """Points (n, 3) in the order of the cloud, a million at a time, and the plants over them."""
        for start in range(0, self.count, _PART_POINTS):
            held = min(_PART_POINTS, self.count - start)
            records = np.fromfile(self.file, self.dtype, held, offset=start * self.dtype.itemsize)
            more = [np.array(records["more"][:, k]) for k in range(self.values)]
            yield self._moved(np.array(records["xyz"])), cover_of(more)

    def every(self, step: int) -> Float:
        """Each ``step``-th point from the first one on, (n, 3)."""
        found, done = [], 0
        for xyz, _ in self.parts():
            found.append(xyz[-done % step :: step])
            done += len(xyz)
        return np.concatenate(found)

    @cached_property
    def bounds(self) -> tuple[Float, Float]:
        """Lowest and highest coordinates, (3,) each."""
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for xyz, _ in self.parts():
            low, high = np.minimum(low, least(xyz)), np.maximum(high, greatest(xyz))
        return low, high

    def median_height(self) -> float:
        """As ``np.median`` of all heights, m."""
        low, high = (float(end[2]) for end in self.bounds)
        edges = np.linspace(low, high, _HEIGHT_BINS + 1)[1:-1]
        counts = np.zeros(_HEIGHT_BINS, dtype=np.int64)
        for xyz, _ in self.parts():
            counts += np.bincount(np.searchsorted(edges, xyz[:, 2]), minlength=_HEIGHT_BINS)
        middle = np.array([(self.count - 1) // 2, self.count // 2])
        bins = np.unique(np.searchsorted(np.cumsum(counts), middle, side="right"))
        near = [np.zeros(0)]
        for xyz, _ in self.parts():
            number = np.searchsorted(edges, xyz[:, 2])
            near.append(xyz[(number >= bins[0]) & (number <= bins[-1]), 2])
        below = int(counts[: bins[0]].sum())
        return float(np.mean(np.sort(np.concatenate(near))[middle - below]))

    def _moved(self, xyz: Float) -> Float:
        return xyz if self.transform is None else self.transform.apply(xyz)


Points = Float | SpooledCloud
"""Points (n, 3) in memory, or on the disk."""


def parts_of(points: Points) -> Iterator[Float]:
    """The points (n, 3) part by part; in one, where they are in memory."""
    if isinstance(points, SpooledCloud):
        yield from (xyz for xyz, _ in points.parts())
    else:
        yield points


def every_of(points: Points, step: int) -> Float:
    """Each ``step``-th point, (n, 3)."""
    return points.every(step) if isinstance(points, SpooledCloud) else points[::step]


def bounds_of(points: Points) -> tuple[Float, Float]:
    """Lowest and highest coordinates, (3,) each."""
    return points.bounds if isinstance(points, SpooledCloud) else (least(points), greatest(points))


def spool(
    path: Path,
    inputs: InputParameters | None,
    file: Path,
    *,
    label: int | None = None,
    area: BaseGeometry | None = None,
    progress: Progress | None = None,
) -> SpooledCloud:
    """Write the ground points of a cloud into ``file``, uncompressed.

    The cloud may come out empty, where none has the class or lies in the area.

    Args:
        label: those of this class only.
        area: those within these polygons only, in metres of the cloud's frame.

    Raises:
        InputError: as ``read_cloud``; the disk is too full for the points, and these sorted by tiles.
    """
    header = preflight(path)
    names = [d.name for d in extra_dimensions(header) if d.name in (ERROR, HEIGHT) and d.dtype.kind in "uif"]
    stored = len(set(names)) if ERROR in names else 0
    needed, free = 2 * header.count * point_dtype(stored).itemsize, shutil.disk_usage(file.parent).free
    if needed > free:
        raise InputError(
            f"The points of {shown(path)} need {needed / 1e9:.2g} GB on the disk of {file.parent} while they are in "
            f"use, and {free / 1e9:.2g} GB are free; free some space or choose another output folder."
        )
    if area is not None:
        shapely.prepare(area)
    cloud, dtype, count = CloudFile.of(path, inputs, classification=label is not None), point_dtype(stored), 0
    with file.open("wb") as stream:
        for part in cloud.parts(progress):
            chosen = np.ones(len(part), dtype=bool) if label is None else part.classification == label
            if area is not None:
                chosen = chosen & shapely.contains_xy(area, *part.xyz[:, :2].T)
            records = np.empty(len(part.xyz[chosen]), dtype)
            records["xyz"] = part.xyz[chosen]
            for k, known in enumerate((part.plant_error, part.plant_height)[:stored]):
                assert known is not None
                records["more"][:, k] = known[chosen]
            records.tofile(stream)
            count += len(records)
    # a selection by class is of another program, whose plants are not known
    values = stored if label is None or count == header.count else 0
    return SpooledCloud(file, count, stored, values, cloud.crs, path)


def point_dtype(values: int) -> np.dtype[np.void]:
    """A point with so many more ``values``."""
    return np.dtype([("xyz", "<f8", (3,)), ("more", "<f4", (values,))])


def cover_of(values: list[NDArray[np.floating]]) -> PlantCover | None:
    """From no, one or two arrays (n,): errors, and heights."""
    return PlantCover(*values) if values else None
