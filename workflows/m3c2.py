"""M3C2 as a command: two clouds in; core points, rasters, zones and a run record out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from shapely import contains_xy
from shapely.geometry.base import BaseGeometry

from ..engine.change.difference import uniform_shift
from ..engine.core import cancellation
from ..engine.core.arrays import Float
from ..engine.core.earlier_results import refuse_results
from ..engine.core.errors import InputError
from ..engine.core.json_values import plain
from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..engine.core.staged_outputs import refuse_other_than_cloud, refuse_unwritable
from ..engine.epochs.comparability import require_comparable
from ..engine.epochs.dating import check_days
from ..engine.epochs.epoch import Epoch, check_pair
from ..engine.ground.raw_survey import refuse_raw
from ..engine.m3c2.distances import Distances
from ..engine.m3c2.level import calibrated, level_facts, report_level
from ..engine.m3c2.measuring import Measuring, beyond_cylinder, measure
from ..engine.m3c2.scales import Scales, choose_scales
from ..engine.m3c2.surveys import Survey
from ..engine.pointcloud.reading import open_cloud, read_dimension
from ..engine.pointcloud.writing import copy_with
from ..interface.parameters import AUTO, DistanceParameters, given
from .known_registration import KnownRegistration, given_registration
from .m3c2_clouds import Clouds, Cores, choose_cores, read_clouds, refuse_memory_early
from .pair import SPOOL, dated_pair, stable_area
from .products.change import Context
from .products.m3c2 import MAPS, dimensions, main_figures, write_maps
from .run import Run, pdf_name_of, record_name_of, report_name_of
from .settings import DistanceSettings, groups
from .topview import region_of

METHOD = "distance along the normal (M3C2)"
_NORMALS = ("NormalX", "NormalY", "NormalZ")


@dataclass(frozen=True)
class Known:
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
    roi: Path | None = None,
    stable: Path | None = None,
    overwrite: bool = False,
    progress: Progress,
) -> RunResult:
    """Distances along the normal of ``moving`` from ``reference``, at core points, as rasters, and zones of change.

    Args:
        output: the core points, .laz; ``NAME_run.json`` and its report are written next to it.
        raster_dir: folder of the rasters and zones; that of ``output`` by default.
        core: cloud of the core points; by default points of the reference, evenly spread.
        transform_path: transform.json to apply to ``moving`` first.
        roi: polygons of the slope; core points outside are left out.
        stable: polygons known to be stable, on which the level is calibrated; found in the distances without.
        overwrite: replace files that ``raster_dir`` holds. Other results there are not touched, nor asked about.

    Raises:
        InputError: see the readers; clouds that do not overlap; no core point that can be measured.
    """
    parameters = settings.distances
    toward = parse_direction(parameters.orientation)
    epochs = dated_pair(reference, moving, dates)
    refuse_other_than_cloud(output)
    refuse_unwritable(output)
    folder, record_name = output.absolute().parent, record_name_of(output)
    refuse_results(raster_dir or folder, MAPS, overwrite=overwrite or raster_dir is None)
    raster_dir = folder if raster_dir is None else raster_dir.absolute()
    layers = [("core", core), ("transform", transform_path), ("roi", roi), ("stable", stable)]
    inputs = [*((f"epoch {e.name}", e.path) for e in epochs), *layers]
    run = Run("m3c2", groups(settings, "inputs", "dates", "surface", "distances", "zones", "details"), inputs, progress)
    own = [output, *(folder / name for name in (record_name, report_name_of(record_name), pdf_name_of(record_name)))]
    run.refuse_outputs([*own, *(raster_dir / name for name in MAPS)])
    _check_given(parameters, core, stable, progress)
    check_pair(*epochs)
    region = region_of(roi, reference, settings.inputs, progress)
    registered = given_registration(transform_path)
    _refuse_clouds(run, epochs, core, settings)
    registered = registered.or_recorded(moving, hashes := run.hash_inputs()[:2], progress)
    if registered.transform is not None:
        run.facts["transform"] = registered.transform.matrix
    error = _registration_error(parameters, registered, progress)
    with (
        run.writing(folder, record_name=record_name, others=[raster_dir], report=True, pictures=raster_dir) as stage,
        cancellation.temporary(stage.folder / SPOOL) as spool,
    ):
        clouds = read_clouds(run, spool, (reference, moving), settings, registered.to_apply, region)
        scales = _scales(run, clouds, parameters)
        with run.step("distances", 0.35, 0.85, "measuring") as entry:
            cores, scales = choose_cores(clouds, reference, core, scales, settings, progress)
            run.facts["scales"] = {**plain(scales), "chosen": _chosen(parameters, core is not None)}
            known = Known(toward, error, stable_area(stable, clouds.crs, run.progress))
            pair, normals = clouds.next_to(len(cores.xyz)), _given_normals(cores, settings)
            found = measured(pair, cores.xyz, scales, parameters, known, normals, progress)
            entry["core_points"] = len(cores.xyz)
        with run.step("write", 0.85, 1.0, "writing"):
            copied = stage.path(output.name)
            copy_with(cores.path, copied, settings.inputs, keep=cores.keep, dimensions=dimensions(found))
            run.outputs["points"] = stage.final(output.name)
            cell = given(parameters.distance_cell) or scales.core_spacing
            context = Context(*epochs, clouds.crs, registered.transform, hashes, METHOD, run.run_id(hashes))
            run.figures = _figures(found, scales, parameters)
            write_maps(run, found, cell, context, settings.zones, raster_dir)
        run.facts |= {"run_id": context.run_id, "registration": dict(registered.facts)} | _level(found, parameters)
    return run.result()


def _check_given(parameters: DistanceParameters, core: Path | None, stable: Path | None, progress: Progress) -> None:
    """Refuse or warn of what does not go together."""
    if parameters.normals == "given" and core is None:
        raise InputError(f"--normals given needs --core, a cloud with the dimensions {', '.join(_NORMALS)}.")
    if stable is not None and not parameters.calibrate:
        progress.warning(
            "--stable has no effect with --no-calibrate: only the calibration of the level of detection uses its "
            "polygons; leave one of the two out."
        )


def _refuse_clouds(run: Run, epochs: tuple[Epoch, Epoch], core: Path | None, settings: DistanceSettings) -> None:
    """Raise InputError where headers, days or classes show that the clouds cannot be compared."""
    reference, moving = (e.path for e in epochs)
    for other in (moving, core):
        if other is not None:
            require_comparable(reference, other, settings.inputs)
    refuse_memory_early((reference, moving), core, settings.distances)
    check_days(epochs, trusted=settings.dates.trust_dates, progress=run.progress)
    refuse_raw((reference, moving), settings.surface.ground, settings.inputs)


def _level(found: Distances, parameters: DistanceParameters) -> dict[str, Any]:
    return {"level_of_detection": level_facts(found, calibrate=parameters.calibrate)}


def _figures(found: Distances, scales: Scales, parameters: DistanceParameters) -> dict[str, Any]:
    return {
        **main_figures(found),
        "normal_scale_m": None if parameters.normals != "fitted" else scales.normal_scale,
        "projection_scale_m": scales.projection_scale,
        "half_length_m": scales.half_length,
    }


def _scales(run: Run, clouds: Clouds, parameters: DistanceParameters) -> Scales:
    with run.step("scales", 0.2, 0.35, "choosing scales"):
        scales = choose_scales(*clouds.surveys, parameters, run.progress, clouds.area)
        for sentence in scales.warnings:
            run.progress.warning(sentence)
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


def _registration_error(parameters: DistanceParameters, registered: KnownRegistration, progress: Progress) -> float:
    stated = given(parameters.registration_error)
    if stated is not None:
        return stated
    known = registered.error
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


def measured(
    clouds: tuple[Survey, Survey],
    core: Float,
    scales: Scales,
    parameters: DistanceParameters,
    known: Known,
    normals: Float | None,
    progress: Progress,
) -> Distances:
    """Distances and their level at core points (m, 3); warns of what they do not show.

    Args:
        normals: (m, 3) directions to measure in, where they are given.
    """
    how = Measuring(parameters, scales, known.toward, known.registration_error, normals)
    with progress.stage(0.0, 0.95):
        found, slope = measure(clouds, core, how, progress)
    if not found.measured.any():
        raise InputError(
            f"No core point has {parameters.minimum_cylinder_points} points of both surveys in its cylinder of "
            f"{scales.projection_scale:g} m across and {scales.half_length:g} m to both sides; give a larger "
            "--projection-scale or --half-length, or check that the clouds are registered."
        )
    shift = uniform_shift(found.distance[found.measured], found.level[found.measured])
    if parameters.calibrate:
        given = None if known.stable is None else contains_xy(known.stable, *core[:, :2].T)
        found = calibrated(found, how.cylinder.radius, slope=slope, given=given, uniform=shift is not None)
        report_level(found, progress)
    _warn(found, beyond_cylinder(clouds[1], found, how.cylinder), scales, shift, progress)
    return found


def _given_normals(cores: Cores, settings: DistanceSettings) -> Float | None:
    """Directions to measure in (m, 3), where they are given."""
    if settings.distances.normals != "given":
        return None
    normal = np.stack([read_dimension(cores.path, name).astype(np.float64) for name in _NORMALS], axis=1)
    # another unit stretches the surface along an axis, and its normals the other way
    normal = np.nan_to_num(normal / np.array(open_cloud(cores.path, settings.inputs)[1].factors))
    return normal if cores.keep is None else normal[cores.keep]


def _warn(found: Distances, beyond: int, scales: Scales, shift: float | None, progress: Progress) -> None:
    """Name what the distances do not show.

    Args:
        beyond: core points whose later points are beyond their cylinder.
        shift: metres that all of them have alike.
    """
    if beyond > max(3, 0.001 * len(found.core)):
        progress.warning(
            f"{beyond} core points have points of the later survey only beyond the cylinder, as change of more than "
            f"{scales.half_length:g} m leaves them; give a larger --half-length to measure it."
        )
    if shift is not None:
        progress.warning(
            f"The whole overlap has {'risen' if shift > 0 else 'sunk'} by about {abs(shift):.3f} m along its normals: "
            "a datum or height bias (such as ellipsoidal against orthometric heights), not a deformation. Check the "
            "height systems, or register first."
        )
