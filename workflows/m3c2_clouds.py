"""The two clouds of M3C2 in memory or on the disk, as the memory allows, and the core points to measure at."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS
from shapely import prepare
from shapely.geometry.base import BaseGeometry

from ..engine.core.arrays import Bool, Float, Index
from ..engine.core.errors import InputError
from ..engine.core.machine_memory import machine_memory
from ..engine.core.messages import shown
from ..engine.core.progress import Progress
from ..engine.epochs.comparability import refuse_other_heights
from ..engine.geometry.rigid_transform import RigidTransform
from ..engine.ground.pdal_pipelines import GROUND
from ..engine.ground.raw_survey import taken_as_ground
from ..engine.m3c2.scales import Scales, inside, overlap_bounds, survey_cores
from ..engine.m3c2.surveys import HeldSurvey, StoredSurvey, Survey
from ..engine.pointcloud.cloud import PointCloud
from ..engine.pointcloud.header import preflight
from ..engine.pointcloud.in_parts import CloudFile
from ..engine.pointcloud.reading import read_cloud
from ..engine.vector.area import Roi, refuse_outside
from ..interface.parameters import DistanceParameters, given
from . import pair
from .pair import ground_of, ground_on_disk
from .run import Run
from .settings import DistanceSettings

BASE_BYTES = 360_000_000
"""Memory of the program itself and of the points that are in work, measured."""
POINT_BYTES = 320
"""Memory of a point of either cloud that is in memory, measured."""
CORE_BYTES = 900
"""Memory of a core point, measured."""
FEWEST_AT_ONCE, MOST_AT_ONCE = 100_000, 3_000_000
"""Points of both clouds that are in memory at a time, where they are on the disk."""
MAX_HEIGHT_OFFSET_M = 3.0  # where all of a survey is farther off in height it was not registered


@dataclass(frozen=True)
class Memory:
    """How much may be taken, bytes."""

    allowed: float

    @classmethod
    def of(cls, parameters: DistanceParameters) -> Memory:
        limit = given(parameters.memory_limit)
        return cls(limit * 1e9 if limit is not None else machine_memory() / 2)

    def holds(self, points: int) -> bool:
        """Whether both clouds, of so many points, are held in memory."""
        return points <= pair.MAX_HELD_POINTS and BASE_BYTES + points * POINT_BYTES <= self.allowed

    @property
    def most_cores(self) -> int:
        """Core points that leave enough for the clouds' points."""
        return int((self.allowed - BASE_BYTES - FEWEST_AT_ONCE * POINT_BYTES) / CORE_BYTES)

    def at_once(self, cores: int = 0) -> int:
        """Points of clouds on the disk that are in memory at a time, next to so many core points."""
        left = (self.allowed - BASE_BYTES - cores * CORE_BYTES) / POINT_BYTES
        return max(FEWEST_AT_ONCE, min(MOST_AT_ONCE, int(left)))


@dataclass(frozen=True)
class Clouds:
    """Both clouds in one frame, and which points of the reference's file (n,) its ground is (None: all).

    Core points lie within ``area`` (None: everywhere). The clouds are whole: a cylinder at the edge of the area that
    lacks the points beyond it has another mean.
    """

    surveys: tuple[Survey, Survey]
    crs: CRS
    taken: Bool | None
    memory: Memory
    area: BaseGeometry | None = None

    @property
    def in_parts(self) -> bool:
        return isinstance(self.surveys[0], StoredSurvey)

    def next_to(self, cores: int) -> tuple[Survey, Survey]:
        """The surveys, of whose points fewer are in memory at a time next to many core points."""
        at_once = self.memory.at_once(cores)
        first, second = (
            replace(survey, at_once=at_once) if isinstance(survey, StoredSurvey) else survey for survey in self.surveys
        )
        return first, second


@dataclass(frozen=True)
class Cores:
    """Where to measure: ``xyz`` (m, 3) metres, the file they are in, and which of its points they are (None: all)."""

    xyz: Float
    path: Path
    keep: NDArray[np.bool_] | None


def refuse_memory_early(clouds: tuple[Path, Path], core: Path | None, parameters: DistanceParameters) -> None:
    """Raise InputError where the memory allowed is too little, by the headers and what is given."""
    memory = Memory.of(parameters)
    points = sum(preflight(path).count for path in clouds)
    if memory.holds(points):
        return
    cores = 0 if core is None else preflight(core).count
    if cores <= memory.most_cores:
        return
    least = f"{(BASE_BYTES + FEWEST_AT_ONCE * POINT_BYTES + cores * CORE_BYTES) / 1e9:.2f}"
    allowed, names = f"{memory.allowed / 1e9:.3g}", " and ".join(shown(path) for path in clouds)
    if core is None:
        raise InputError(
            f"The {points:,} points of {names} need at least {least} GB, even in parts, and {allowed} GB are allowed; "
            "raise --memory-limit, or clip the clouds to the slope."
        )
    raise InputError(
        f"The {cores:,} core points of {shown(core)} need at least {least} GB, even in parts, and {allowed} GB are "
        "allowed; raise --memory-limit, or give fewer core points."
    )


def read_clouds(
    run: Run,
    folder: Path,
    paths: tuple[Path, Path],
    settings: DistanceSettings,
    transform: RigidTransform | None,
    region: Roi | None = None,
) -> Clouds:
    """The ground of both clouds in one frame.

    Args:
        folder: for the points of clouds that stay on the disk.
        region: of the core points.

    Raises:
        InputError: as the readers; heights of another system; a disk that is too full; a region elsewhere.
    """
    memory = Memory.of(settings.distances)
    with run.step("read", 0.0, 0.2, "reading") as entry:
        counts = [preflight(path).count for path in paths]
        entry["points"] = counts
        if memory.holds(sum(counts)):
            clouds = _held(paths, settings, transform, memory, run.progress)
        else:
            entry["in_parts"] = True
            clouds = _stored(folder, paths, settings, transform, run.progress)
    if region is None:
        return clouds
    for survey, path in zip(clouds.surveys, paths, strict=True):
        low, high = (end.tolist() for end in survey.bounds)
        refuse_outside(region, (low[0], low[1], high[0], high[1]), path)
    prepare(region.geometry)
    return replace(clouds, area=region.geometry)


def _held(
    paths: tuple[Path, Path],
    settings: DistanceSettings,
    transform: RigidTransform | None,
    memory: Memory,
    progress: Progress,
) -> Clouds:
    read = [read_cloud(path, settings.inputs, progress=progress) for path in paths]
    taken = taken_as_ground(read[0].classification, settings.surface.ground, paths[0])
    first, second = (ground_of(cloud, settings.surface.ground, progress) for cloud in read)
    if transform is not None:
        second = replace(second, xyz=transform.apply(second.xyz))
    refuse_other_heights(first, second, MAX_HEIGHT_OFFSET_M)
    return Clouds((_survey(first), _survey(second)), first.crs, taken, memory)


def _survey(cloud: PointCloud) -> HeldSurvey:
    return HeldSurvey(cloud.xyz, None if cloud.plants is None else cloud.plants.error)


def _stored(
    folder: Path,
    paths: tuple[Path, Path],
    settings: DistanceSettings,
    transform: RigidTransform | None,
    progress: Progress,
) -> Clouds:
    memory, ground, inputs = Memory.of(settings.distances), settings.surface.ground, settings.inputs
    with progress.stage(0.0, 0.4):
        first = ground_on_disk(paths[0], folder, ground, inputs, progress)
    with progress.stage(0.4, 0.8):
        second = ground_on_disk(paths[1], folder, ground, inputs, progress)
    if transform is not None:
        second = second.moved(transform)
    refuse_other_heights(first, second, MAX_HEIGHT_OFFSET_M)
    surveys = []
    for number, cloud in enumerate((first, second)):
        progress.update(0.8 + 0.1 * number, "sorting the points")
        surveys.append(StoredSurvey.of(cloud, memory.at_once()))
    taken = None
    if len(first) < preflight(paths[0]).count:
        file = CloudFile.of(paths[0], inputs, classification=True)
        taken = np.concatenate([part.classification == GROUND for part in file.parts()])
    progress.info(
        "The clouds stay on the disk and are measured in parts, which gives the same results; --memory-limit says how "
        "much memory they may take."
    )
    return Clouds((surveys[0], surveys[1]), first.crs, taken, memory)


def choose_cores(
    clouds: Clouds,
    reference: Path,
    core: Path | None,
    scales: Scales,
    settings: DistanceSettings,
    progress: Progress,
) -> tuple[Cores, Scales]:
    """The core points that are given, else points of the reference, evenly spread, and the scales with their spacing.

    Where the spacing is left to the clouds, and clouds on the disk have more core points than the memory holds, it is
    the next that fits.

    Raises:
        InputError: more core points than the memory holds, at a spacing that is given.
    """
    if core is not None:
        xyz = read_cloud(core, settings.inputs, progress=progress).xyz
        keep = None if clouds.area is None else inside(clouds.area, xyz)
        if keep is not None and not keep.any():
            raise InputError(f"{shown(core)} has no core point inside the region of --roi; check both.")
        return Cores(xyz if keep is None else xyz[keep], core, keep), scales
    first, later = clouds.surveys
    bounds, wanted = overlap_bounds(first, later), scales.core_spacing
    xyz, number = survey_cores(first, wanted, bounds, clouds.area)
    while clouds.in_parts and len(xyz) > clouds.memory.most_cores:
        if given(settings.distances.core_spacing) is not None:
            raise InputError(
                f"{len(xyz):,} core points, every {wanted:g} m, are more than the {clouds.memory.most_cores:,} that "
                f"fit into the {clouds.memory.allowed / 1e9:.3g} GB allowed; give a larger --core-spacing, or raise "
                "--memory-limit."
            )
        scales = replace(scales, core_spacing=_next_plain(scales.core_spacing))
        xyz, number = survey_cores(first, scales.core_spacing, bounds, clouds.area)
    if scales.core_spacing > wanted:
        progress.warning(
            f"Core points every {scales.core_spacing:g} m, because those every {wanted:g} m, which would suit the "
            f"points, need more than the {clouds.memory.allowed / 1e9:.3g} GB allowed; raise --memory-limit for more."
        )
    return Cores(xyz, reference, _kept(number, preflight(reference).count, clouds.taken)), scales


def _kept(number: Index, count: int, taken: Bool | None) -> Bool:
    """Which of the ``count`` points of a file the points ``number`` of those taken are."""
    keep = np.zeros(count, dtype=bool)
    keep[number if taken is None else np.flatnonzero(taken)[number]] = True
    return keep


def _next_plain(value: float) -> float:
    """The next of 1, 2, 2.5, 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value) + 1e-9)
    return float(f"{min(s * power for s in (1.0, 2.0, 2.5, 5.0, 10.0) if s * power > value * (1 + 1e-9)):.6g}")
