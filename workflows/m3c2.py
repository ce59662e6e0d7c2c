"""M3C2 as a command: two clouds in; core points, rasters and a run record out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely import contains_xy
from shapely.geometry.base import BaseGeometry

from ..engine.change.difference import uniform_shift
from ..engine.core.arrays import Float
from ..engine.core.earlier_results import refuse_results
from ..engine.core.errors import InputError
from ..engine.core.json_values import plain
from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..engine.core.staged_outputs import refuse_other_than_cloud, refuse_unwritable
from ..engine.core.version import VERSION
from ..engine.epochs.comparability import refuse_other_heights, require_comparable
from ..engine.epochs.dating import check_days
from ..engine.epochs.epoch import Epoch, check_pair
from ..engine.geometry.rigid_transform import RigidTransform, registration_error
from ..engine.grid import geotiff
from ..engine.ground.raw_survey import refuse_raw, taken_as_ground
from ..engine.m3c2.distances import Cylinder, Distances, LevelTerms, Status, cylinder_statistics, m3c2_distances
from ..engine.m3c2.lattice import Lattice
from ..engine.m3c2.level import calibrated, level_facts, report_level, slope_of
from ..engine.m3c2.normals import fit_planes
from ..engine.m3c2.scales import Scales, choose_scales, overlap_bounds, spread_cores
from ..engine.pointcloud.cloud import PointCloud
from ..engine.pointcloud.reading import open_cloud, read_cloud, read_dimension
from ..engine.pointcloud.writing import copy_with
from ..interface.parameters import AUTO, DistanceParameters, InputParameters, given
from .early_memory import refuse_points_early
from .pair import dated_pair, ground_of, stable_area
from .products.m3c2 import RASTERS, dimensions, main_figures, median_level_95, write_rasters
from .run import Run, record_name_of
from .settings import DistanceSettings, groups

_LONGER_CYLINDER_RATIO = 4.0  # cylinders so many times as long show whether points lie just beyond
_MAX_HEIGHT_OFFSET_M = 3.0  # m; where all of a survey is farther off in height it was not registered
_NORMALS = ("NormalX", "NormalY", "NormalZ")


@dataclass(frozen=True)
class Cores:
    """Where to measure: ``xyz`` (m, 3) metres, the file they are in, and which of its points they are (None: all)."""

    xyz: Float
    path: Path
    keep: NDArray[np.bool_] | None


@dataclass(frozen=True)
class _Known:
    """What is known before: where normals point, the registration's standard error (m), and what is stable."""

    toward: Float
    registration_error: float
    stable: BaseGeometry | None


def m3c2_step(
    reference: Path,
    moving: Path,
    output: Path,
    settings: DistanceSettings,
    *,
    raster_dir: Path | None,
    core: Path | None,
    dates: tuple[str | None, str | None],
    transform_path: Path | None,
    stable: Path | None = None,
    overwrite: bool = False,
    progress: Progress,
) -> RunResult:
    """Distances along the normal of ``moving`` from ``reference``, at core points and as rasters.

    Args:
        output: the core points, .laz; ``NAME_run.json`` is written next to it.
        raster_dir: folder of the rasters; that of ``output`` by default.
        core: cloud of the core points; by default points of the reference, evenly spread.
        transform_path: transform.json to apply to ``moving`` first.
        stable: polygons known to be stable, on which the level is calibrated; found in the distances without.
        overwrite: replace rasters that ``raster_dir`` holds. Other results there are not touched, nor asked about.

    Raises:
        InputError: see the readers; clouds that do not overlap; no core point that can be measured.
    """
    parameters = settings.distances
    toward = parse_direction(parameters.orientation)
    epochs = dated_pair(reference, moving, dates)
    refuse_other_than_cloud(output)
    refuse_unwritable(output)
    raster_files = [f"{name}.tif" for name in RASTERS]
    if raster_dir is not None:
        refuse_results(raster_dir, raster_files, overwrite=overwrite)
    folder, record_name = output.absolute().parent, record_name_of(output)
    raster_dir = folder if raster_dir is None else raster_dir.absolute()
    optional = [("core", core), ("transform", transform_path), ("stable", stable)]
    inputs = [*((f"epoch {e.name}", e.path) for e in epochs), *optional]
    run = Run("m3c2", groups(settings, "inputs", "dates", "surface", "distances"), inputs, progress)
    run.refuse_outputs([output, output.with_name(record_name), *(raster_dir / name for name in raster_files)])
    if parameters.normals == "given" and core is None:
        raise InputError(f"--normals given needs --core, a cloud with the dimensions {', '.join(_NORMALS)}.")
    check_pair(*epochs)
    transform = RigidTransform.load(transform_path) if transform_path else None
    _refuse_clouds(run, epochs, core, settings)
    hashes = run.hash_inputs()[:2]
    if transform is not None:
        run.facts["transform"] = transform.matrix
    error = _registration_error(parameters, transform_path, progress)
    if stable is not None and not parameters.calibrate:
        progress.warning(
            "--stable has no effect with --no-calibrate: only the calibration of the level of detection uses its "
            "polygons; leave one of the two out."
        )
    with run.writing(folder, record_name=record_name, others=[raster_dir]) as stage:
        clouds, taken = _read(run, (reference, moving), settings, transform)
        scales = _scales(run, clouds, parameters, cores_given=core is not None)
        with run.step("distances", 0.35, 0.85, "measuring") as entry:
            cores = _cores(clouds, reference, core, scales.core_spacing, settings.inputs, progress)
            known = _Known(toward, error, stable_area(stable, clouds[0].crs, run.progress))
            found = _measure(run, clouds, cores, scales, settings, known)
            entry["core_points"] = len(cores.xyz)
        run.facts["level_of_detection"] = level_facts(found, calibrate=parameters.calibrate)
        with run.step("write", 0.85, 1.0, "writing"):
            keep = _of_all(cores.keep, taken)
            copy_with(cores.path, stage.path(output.name), settings.inputs, keep=keep, dimensions=dimensions(found))
            tags = _tags(epochs, found, transform, hashes)
            cell = given(parameters.distance_cell) or scales.core_spacing
            run.outputs["points"] = stage.final(output.name)
            run.outputs |= write_rasters(found, cell, clouds[0].crs, tags, 0.0, run.stage_in(raster_dir))
        run.figures = _figures(found, scales, parameters)
    return run.result()


def _refuse_clouds(run: Run, epochs: tuple[Epoch, Epoch], core: Path | None, settings: DistanceSettings) -> None:
    """Raise InputError where headers, days or classes show that the clouds cannot be compared."""
    reference, moving = (e.path for e in epochs)
    for other in (moving, core):
        if other is not None:
            require_comparable(reference, other, settings.inputs)
    if settings.surface.ground != "class_2":  # of which the headers do not tell how many there are
        refuse_points_early((reference, moving))
    check_days(epochs, trusted=settings.dates.trust_dates, progress=run.progress)
    refuse_raw((reference, moving), settings.surface.ground, settings.inputs)


def _tags(
    epochs: tuple[Epoch, Epoch], found: Distances, transform: RigidTransform | None, hashes: tuple[str, ...]
) -> dict[str, str]:
    return geotiff.raster_tags(
        epochs=(epochs[0].date, epochs[1].date),
        median_level=median_level_95(found),
        translation=None if transform is None else transform.translation,
        software=f"SlopeWatch {VERSION}",
        input_sha256=" ".join(hashes),
    )


def _figures(found: Distances, scales: Scales, parameters: DistanceParameters) -> dict[str, Any]:
    return {
        **main_figures(found),
        "normal_scale_m": None if parameters.normals != "fitted" else scales.normal_scale,
        "projection_scale_m": scales.projection_scale,
        "half_length_m": scales.half_length,
    }


def _read(
    run: Run, paths: tuple[Path, Path], settings: DistanceSettings, transform: RigidTransform | None
) -> tuple[tuple[PointCloud, PointCloud], NDArray[np.bool_] | None]:
    """The ground of both clouds in one frame, and which points of the reference's file it is (None: all)."""
    with run.step("read", 0.0, 0.2, "reading") as entry:
        first, second = (read_cloud(path, settings.inputs, progress=run.progress) for path in paths)
        entry["points"] = [len(first.xyz), len(second.xyz)]
        taken = taken_as_ground(first.classification, settings.surface.ground, paths[0])
        first, second = (ground_of(cloud, settings.surface.ground, run.progress) for cloud in (first, second))
        if transform is not None:
            second = replace(second, xyz=transform.apply(second.xyz))
        refuse_other_heights(first, second, _MAX_HEIGHT_OFFSET_M)
    return (first, second), taken


def _scales(
    run: Run, clouds: tuple[PointCloud, PointCloud], parameters: DistanceParameters, *, cores_given: bool
) -> Scales:
    with run.step("scales", 0.2, 0.35, "choosing scales"):
        scales = choose_scales(clouds[0].xyz, clouds[1].xyz, parameters, run.progress)
        for sentence in scales.warnings:
            run.progress.warning(sentence)
    run.facts["scales"] = {**plain(scales), "chosen": _chosen(parameters, cores_given)}
    return scales


def parse_direction(text: str) -> Float:
    """A direction written as x,y,z.

    Raises:
        InputError: it is none.
    """
    try:
        direction = np.array([float(part) for part in text.split(",")])
    except ValueError:
        direction = np.zeros(0)
    if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
        raise InputError(f"orientation is {text!r}; give a direction as x,y,z, such as 0,0,1 for upwards.")
    return direction


def _registration_error(parameters: DistanceParameters, transform_path: Path | None, progress: Progress) -> float:
    stated = given(parameters.registration_error)
    if stated is not None:
        return stated
    known = registration_error(transform_path)
    if known is None:
        progress.warning(
            "The registration's error is not known here and taken as 0, so the level of detection covers the scatter "
            "of the points alone; give the registration_error that the registration reported."
        )
    return known or 0.0


def _chosen(parameters: DistanceParameters, cores_given: bool) -> dict[str, str]:
    """Where each scale comes from."""
    rules = {
        "normal_scale": "25 times the roughness at that scale, or the scale nearest to it",
        "projection_scale": "25 points of the sparser cloud where it is thin (25th percentile of density)",
        "half_length": "twice as far as the surfaces are apart, at least 10 times the roughness",
        "core_spacing": "not above half the projection scale",
    }
    chosen = {name: rule if getattr(parameters, name) == AUTO else "given" for name, rule in rules.items()}
    if parameters.normals != "fitted":
        chosen["normal_scale"] = f"not used, normals are {parameters.normals}"
    if cores_given:
        chosen["core_spacing"] = "core points are given"
    return chosen


def _cores(
    clouds: tuple[PointCloud, PointCloud],
    reference: Path,
    given: Path | None,
    spacing: float,
    inputs: InputParameters,
    progress: Progress,
) -> Cores:
    if given is not None:
        return Cores(read_cloud(given, inputs, progress=progress).xyz, given, None)
    first, later = (cloud.xyz for cloud in clouds)
    keep = spread_cores(first, spacing, overlap_bounds(first, later))
    return Cores(first[keep], reference, keep)


def _of_all(keep: NDArray[np.bool_] | None, taken: NDArray[np.bool_] | None) -> NDArray[np.bool_] | None:
    """``keep`` of the points that were ``taken`` as one of all points of the file."""
    if keep is None or taken is None:
        return keep
    every = taken.copy()
    every[taken] = keep
    return every


def _measure(
    run: Run,
    clouds: tuple[PointCloud, PointCloud],
    cores: Cores,
    scales: Scales,
    settings: DistanceSettings,
    known: _Known,
) -> Distances:
    """Distances and their level at the core points; warns of what they do not show."""
    parameters, progress = settings.distances, run.progress
    radius = scales.projection_scale / 2
    with progress.stage(0.0, 0.4, "fitting normals"):
        normal, slope = _normals(clouds[0].xyz, cores, scales, settings, known.toward, progress)
    first, later = (
        Lattice(cloud.xyz, radius, values=None if cloud.plants is None else cloud.plants.error) for cloud in clouds
    )
    with progress.stage(0.4, 0.95):
        terms = LevelTerms(parameters.minimum_cylinder_points, parameters.confidence, known.registration_error)
        found = m3c2_distances(
            (first, later),
            cores.xyz,
            normal,
            Cylinder(radius, scales.half_length),
            terms,
            spread=parameters.calibrate,
            progress=progress,
        )
    if not found.measured.any():
        raise InputError(
            f"No core point has {parameters.minimum_cylinder_points} points of both surveys in its cylinder of "
            f"{scales.projection_scale:g} m across and {scales.half_length:g} m to both sides; give a larger "
            "--projection-scale or --half-length, or check that the clouds are registered."
        )
    shift = uniform_shift(found.distance[found.measured], found.level[found.measured])
    if parameters.calibrate:
        given = None if known.stable is None else contains_xy(known.stable, *cores.xyz[:, :2].T)
        found = calibrated(found, radius, slope=slope, given=given, uniform=shift is not None)
        report_level(found, progress)
    _warn(found, later, scales, shift, progress)
    return found


def _normals(
    reference: Float, cores: Cores, scales: Scales, settings: DistanceSettings, toward: Float, progress: Progress
) -> tuple[Float, Float | None]:
    """Directions to measure in (m, 3), and the surface's slope (m,) in degrees where these do not determine it."""
    parameters = settings.distances
    if parameters.normals == "given":
        normal = np.stack([read_dimension(cores.path, name).astype(np.float64) for name in _NORMALS], axis=1)
        # another unit stretches the surface along an axis, and its normals the other way
        return np.nan_to_num(normal / np.array(open_cloud(cores.path, settings.inputs)[1].factors)), None
    upright = np.tile([0.0, 0.0, 1.0], (len(cores.xyz), 1))
    if parameters.normals == "vertical" and not parameters.calibrate:
        return upright, None
    lattice = Lattice(reference, scales.normal_scale / 2)
    fitted = fit_planes(lattice, cores.xyz, scales.normal_scale, orientation=toward, progress=progress).normal
    return (upright, slope_of(fitted)) if parameters.normals == "vertical" else (fitted, None)


def _warn(found: Distances, later: Lattice, scales: Scales, shift: float | None, progress: Progress) -> None:
    """Name what the distances do not show; ``shift`` metres: all of them have this one alike."""
    empty = (found.status == Status.NO_POINTS) & (found.moving.count == 0) & (found.reference.count > 0)
    longer = Cylinder(scales.projection_scale / 2, _LONGER_CYLINDER_RATIO * scales.half_length)
    beyond = cylinder_statistics(later, found.core[empty], found.normal[empty], longer).count
    number = int(np.sum(beyond > 0))
    if number > max(3, 0.001 * len(found.core)):
        progress.warning(
            f"{number} core points have points of the later survey only beyond the cylinder, as change of more than "
            f"{scales.half_length:g} m leaves them; give a larger --half-length to measure it."
        )
    if shift is not None:
        progress.warning(
            f"The whole overlap has {'risen' if shift > 0 else 'sunk'} by about {abs(shift):.3f} m along its normals: "
            "a datum or height bias (such as ellipsoidal against orthometric heights), not a deformation. Check the "
            "height systems, or register first."
        )
