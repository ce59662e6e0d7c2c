"""Two clouds that are compared: their days, their ground, their common and stable area, their registration."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pyproj import CRS
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from ..engine.change.difference import Areas, either_area, listed_difference
from ..engine.change.doubts import warn_of_doubtful_change
from ..engine.change.result import Change
from ..engine.core.progress import Progress
from ..engine.epochs.comparability import refuse_other_heights, registered_offset
from ..engine.epochs.epoch import Epoch, parse_date
from ..engine.geometry.rigid_transform import RigidTransform
from ..engine.ground.classified_ground import warn_of_classes
from ..engine.ground.pdal_pipelines import GROUND
from ..engine.ground.raw_survey import taken_as_ground
from ..engine.pointcloud.cloud import PointCloud
from ..engine.pointcloud.header import preflight
from ..engine.pointcloud.in_parts import Points, SpooledCloud, spool
from ..engine.pointcloud.plant_cover import PlantCover
from ..engine.registration.result import RegistrationResult
from ..engine.registration.surveys import register_surveys
from ..engine.vector.area import read_roi
from ..engine.vector.corrections import Corrections
from ..interface.corrections import EXCLUDE
from ..interface.dates import date_in_name
from ..interface.parameters import ChangeParameters, InputParameters, RegistrationParameters

MAX_HELD_POINTS = 6_000_000
"""Points of both surveys up to which they are held in memory."""
SPOOL = "spool"
"""Folder of a run, while it works, for the points of others."""


def dated_pair(reference: Path, moving: Path, days: tuple[str | None, str | None]) -> tuple[Epoch, Epoch]:
    """Two clouds with their days (YYYY-MM-DD): as given, else as in the file's name.

    Raises:
        InputError: one given is no date.
    """
    first, second = days
    return _dated(reference, first), _dated(moving, second)


def _dated(cloud: Path, day: str | None) -> Epoch:
    return Epoch(cloud, parse_date(day) if day else date_in_name(cloud))


Cloud = PointCloud | SpooledCloud
"""In memory, or on the disk."""


def survey_of(cloud: Cloud) -> tuple[Points, PlantCover | None]:
    """Points, and the plants over them; those on the disk have their own."""
    return (cloud, None) if isinstance(cloud, SpooledCloud) else (cloud.xyz, cloud.plants)


def ground_of(cloud: PointCloud, ground: str, progress: Progress) -> PointCloud:
    """The points of a cloud that ``SurfaceParameters.ground`` takes, without colours; warns where they are no surface.

    Raises:
        InputError: there is none, or those of class 2 contradict each other.
    """
    mask = taken_as_ground(cloud.classification, ground, cloud.path)
    taken = cloud if mask is None else PointCloud(cloud.xyz[mask], cloud.crs, cloud.path)
    if ground == "class_2":
        warn_of_classes(taken.path, taken.xyz, progress.warning)
    return taken


def is_large(clouds: Sequence[Path]) -> bool:
    """Whether clouds stay on the disk, by their headers: beyond so many points they would take memory by points."""
    return sum(preflight(path).count for path in clouds) > MAX_HELD_POINTS


def ground_on_disk(
    cloud: Path, folder: Path, ground: str, inputs: InputParameters | None, progress: Progress
) -> SpooledCloud:
    """As ``ground_of``, for a cloud that stays on the disk; its points go to ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{len(list(folder.iterdir()))}.points"
    taken = spool(cloud, inputs, file, label=GROUND if ground == "class_2" else None, progress=progress)
    if not len(taken):
        taken_as_ground(None, ground, cloud)
    if ground == "class_2":
        warn_of_classes(taken.path, taken, progress.warning)
    return taken


def stable_area(path: Path | None, crs: CRS, progress: Progress | None = None) -> BaseGeometry | None:
    """The polygons known to be stable, in ``crs``; ``progress`` gets the warnings about them."""
    if path is None:
        return None
    area = read_roi(path, crs)
    if progress is not None:
        for note in area.notes:
            progress.warning(note)
    return area.geometry


def common_area(path: Path | None, first: Cloud, transform: RigidTransform) -> BaseGeometry | None:
    """The region of interest as both epochs hold it: the later cloud was clipped before it was moved."""
    if path is None:
        return None
    area = read_roi(path, first.crs).geometry
    return area.intersection(_moved_area(area, first, transform))


def excluded_area(corrections: Corrections | None, first: Cloud, transform: RigidTransform) -> BaseGeometry | None:
    """What one survey's corrections exclude, in the frame of the first one; None for nothing."""
    area = None if corrections is None else corrections.shape(EXCLUDE)
    return None if area is None or area.is_empty else _moved_area(area, first, transform)


def excluded_of_pair(
    corrections: Corrections | None, pair: tuple[Epoch, Epoch], first: Cloud, transform: RigidTransform
) -> BaseGeometry | None:
    """What the corrections of either survey exclude, in the frame of the first one; None for nothing."""
    if corrections is None:
        return None
    moves = (RigidTransform.identity(), transform)
    areas = (excluded_area(corrections.of(e.date), first, move) for e, move in zip(pair, moves, strict=True))
    return either_area(*areas)


def _moved_area(area: BaseGeometry, first: Cloud, transform: RigidTransform) -> BaseGeometry:
    """An area of the later survey, in the frame of the first one."""
    height = first.median_height() if isinstance(first, SpooledCloud) else float(np.median(first.xyz[:, 2]))
    middle = np.array([[area.centroid.x, area.centroid.y, height]])
    shift = (transform.apply(middle) - middle)[0]
    return translate(area, shift[0], shift[1])


def compare_pair(
    first: Cloud,
    second: Cloud,
    parameters: ChangeParameters,
    areas: Areas,
    registration_error: float,
    progress: Progress,
) -> Change:
    """The difference of two clouds in one frame (see ``change.listed_difference``); warns of what makes it doubtful."""
    (reference, of_reference), (moving, of_moving) = survey_of(first), survey_of(second)
    change = listed_difference(
        reference,
        moving,
        parameters,
        registration_error=registration_error,
        areas=areas,
        plants=(of_reference, of_moving),
        progress=progress,
    )
    warn_of_doubtful_change(change, progress, may_grow=not parameters.adaptive)
    return change


def register_pair(
    first: Cloud, second: Cloud, parameters: RegistrationParameters, stable: Path | None, progress: Progress
) -> RegistrationResult:
    """Register ``second`` to ``first`` (see ``registration.register_surveys``) and report its warnings.

    Raises:
        InputError: see ``registration.register``; heights of another system or unit, farther off than is registered.
    """
    refuse_other_heights(first, second, registered_offset(parameters))
    area = stable_area(stable, first.crs, progress)
    result = register_surveys(survey_of(first), survey_of(second), parameters, stable=area, progress=progress)
    for warning in result.warnings:
        progress.warning(warning)
    return result
