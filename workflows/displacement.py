"""The command `displacement`: two registered ground clouds in, vectors and zones of motion along the surface out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from pyproj import CRS
from shapely import contains_xy

from ..engine.core import cancellation
from ..engine.core.arrays import Bool, Float
from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..engine.core.version import VERSION
from ..engine.displacement.displacement import Displacement, StablePlaces, measure_displacement
from ..engine.displacement.registered import Registered
from ..engine.displacement.status import REASONS, Status
from ..engine.epochs.comparability import refuse_other_heights, require_comparable
from ..engine.epochs.dating import check_days
from ..engine.epochs.epoch import check_pair
from ..engine.geometry.rigid_transform import RigidTransform
from ..engine.grid import geotiff
from ..engine.ground.raw_survey import refuse_raw
from ..engine.pointcloud.cloud import PointCloud
from ..engine.pointcloud.header import preflight
from ..engine.pointcloud.reading import read_cloud
from ..engine.report.compose import REPORT
from ..engine.report.motion_facts import doubts, motion_facts, refused
from ..interface.parameters import given
from .known_registration import KnownRegistration, given_registration
from .layer_files import NO_LAYERS, LayerFiles
from .layers import layers_on_cloud
from .motion_memory import MotionMemory, measurable, refuse_motion_early
from .pair import SPOOL, Cloud, dated_pair, ground_of, ground_on_disk, stable_area
from .products.displacement import DISPLACEMENT_OUTPUTS, main_figures, write_products
from .run import Run
from .settings import DisplacementSettings, groups

_MIN_TOLD_SHARE = 0.1  # of the ground that one reason refuses, from which it is worth a warning
LEAST_REFUSED_OFFSET_M = 1.0  # of all heights alike: on a slope, windows of both surveys then hold other ground
_MAYBE_FARTHER = frozenset(REASONS[status] for status in (Status.NO_RELIEF, Status.NOT_FOUND))


def displacement_step(
    reference: Path,
    moving: Path,
    output_dir: Path,
    settings: DisplacementSettings,
    *,
    dates: tuple[str | None, str | None],
    transform_path: Path | None,
    stable: Path | None = None,
    layers: LayerFiles = NO_LAYERS,
    overwrite: bool = False,
    progress: Progress,
) -> RunResult:
    """Motion of ``moving`` along the surface against ``reference``, both ground clouds, with its products.

    Args:
        stable: polygons of ground known to be stable; its motion is taken off all vectors.

    Raises:
        InputError: see the readers; clouds without common ground.
    """
    epochs = dated_pair(reference, moving, dates)
    inputs = [*((f"epoch {e.name}", e.path) for e in epochs), ("transform", transform_path), ("stable", stable)]
    inputs += layers.inputs
    recorded = groups(settings, "inputs", "dates", "surface", "displacement", "motion_memory", "road")
    run = Run("displacement", recorded, inputs, progress)
    run.refuse_folder(output_dir, ("run.json", REPORT, *DISPLACEMENT_OUTPUTS), overwrite=overwrite)
    check_pair(*epochs)
    known = given_registration(transform_path)
    require_comparable(reference, moving, settings.inputs)
    memory = MotionMemory.of(settings.motion_memory.memory_limit)
    refuse_motion_early((reference, moving), memory)
    check_days(epochs, trusted=settings.dates.trust_dates, progress=progress)
    refuse_raw((reference, moving), settings.surface.ground, settings.inputs)
    hashes = run.hash_inputs()[:2]
    known = known.or_recorded(moving, hashes, progress)
    if known.transform is not None:
        run.facts["transform"] = known.transform.matrix
    run.related = layers_on_cloud(layers, (settings.road, None), reference, settings.inputs, progress)
    with (
        run.writing(output_dir, report=True) as stage,
        cancellation.temporary(stage.folder / SPOOL) as spool,
    ):
        first, second = _read(run, spool, (reference, moving), settings, known.to_apply)
        registered = _registered(run, settings, known)
        places = stable_places(stable, first.crs, progress)
        with run.step("displacement", 0.2, 0.95, "measuring motion along the surface") as entry:
            with measurable((first, second), memory, settings.displacement.spacing) as ground:
                found = measure_displacement(
                    *ground, settings.displacement, registered, places, progress, threads=memory.threads
                )
            entry["windows"] = len(found.cell)
        tags = geotiff.raster_tags(
            epochs=(epochs[0].date, epochs[1].date),
            translation=None if known.transform is None else known.transform.translation,
            software=f"SlopeWatch {VERSION}",
            input_sha256=" ".join(hashes),
        )
        with run.step("write", 0.95, 1.0, "writing"):
            run.outputs |= write_products(found, first.crs, tags, run)
        run.outputs["run"] = run.record_path
        run.figures = main_figures(found) | {"registration_error_known": registered.known}
        run.facts["displacement"] = motion_facts(
            found, settings.displacement, registered, stable_given=stable is not None
        )
        warn_of_motion(found, settings, stable is not None, progress)
    return run.result()


def _read(
    run: Run,
    folder: Path,
    paths: tuple[Path, Path],
    settings: DisplacementSettings,
    transform: RigidTransform | None,
) -> tuple[Cloud, Cloud]:
    """The ground of both surveys in one frame; it stays on the disk, in ``folder``, where the memory is too small."""
    memory, ground = MotionMemory.of(settings.motion_memory.memory_limit), settings.surface.ground
    with run.step("read", 0.0, 0.2, "reading") as entry:
        counts = [preflight(path).count for path in paths]
        entry["points"] = counts
        clouds: tuple[Cloud, Cloud]
        if memory.holds(sum(counts)):
            clouds = _held(paths, settings, transform, run.progress)
        else:
            entry["in_parts"] = True
            first, second = (ground_on_disk(path, folder, ground, settings.inputs, run.progress) for path in paths)
            clouds = first, second if transform is None else second.moved(transform)
            run.progress.info(
                "The surveys stay on the disk and are measured in parts, which gives the same results; --memory-limit "
                "says how much memory they may take."
            )
        limit = max(LEAST_REFUSED_OFFSET_M, settings.displacement.largest_motion)
        refuse_other_heights(clouds[0], clouds[1], limit)
    return clouds


def _held(
    paths: tuple[Path, Path], settings: DisplacementSettings, transform: RigidTransform | None, progress: Progress
) -> tuple[PointCloud, PointCloud]:
    read = [read_cloud(path, settings.inputs, progress=progress) for path in paths]
    first, second = (ground_of(cloud, settings.surface.ground, progress) for cloud in read)
    return first, second if transform is None else replace(second, xyz=transform.apply(second.xyz))


def _registered(run: Run, settings: DisplacementSettings, known: KnownRegistration) -> Registered:
    """The registration's error: as given, else as it is known, else none with a warning."""
    stated = given(settings.displacement.surface_error)
    if stated is not None:
        return Registered.shift(stated, known.error or stated)
    facts = dict(known.facts)
    run.facts["registration"] = facts
    for direction in facts.get("unobservable") or ():
        run.progress.warning(
            f"The registration does not fix the surveys' {direction}: motion in that direction cannot be told from an "
            "error of the registration; the vectors' errors hold it."
        )
    covariance = facts.get("covariance")
    if known.transform is not None and covariance is not None:
        centre = np.asarray(known.transform.centre)
        return Registered(np.array(covariance, dtype=np.float64), centre, known=True)
    run.progress.warning(
        "The registration's error along the surface is not known here and taken as 0, so that the errors are those of "
        "the relief alone; give the transform of the registration, or --surface-error."
    )
    return Registered.unknown()


def stable_places(path: Path | None, crs: CRS, progress: Progress | None = None) -> StablePlaces | None:
    """Which places lie in the polygons of stable ground; ``progress`` gets the warnings about them."""
    area = stable_area(path, crs, progress)
    if area is None:
        return None

    def inside(xy: Float) -> Bool:
        return np.asarray(contains_xy(area, xy[:, 0], xy[:, 1]), dtype=bool)

    return inside


def warn_of_motion(found: Displacement, settings: DisplacementSettings, asked_stable: bool, progress: Progress) -> None:
    """Say what could not be seen, and what makes the vectors doubtful."""
    unseen = 0.0
    for row in refused(found):
        share, reason = row["share"], row["reason"]
        if share >= _MIN_TOLD_SHARE:
            progress.warning(
                f"On {100 * share:.0f} % of the ground no motion along the surface can be given: {reason}."
            )
            unseen += share if reason in _MAYBE_FARTHER else 0.0
    if unseen:
        progress.warning(
            "Where no relief is shared or no motion is found, the ground may also have moved farther than the "
            f"{settings.displacement.largest_motion:g} m up to which motion is looked for; if that may be, give a "
            "larger --largest-motion."
        )
    for sentence in doubts(found, settings.displacement, stable_given=asked_stable):
        progress.warning(sentence)
