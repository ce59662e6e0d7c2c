"""The whole flow: raw surveys of one slope in; change, hazard zones and the last survey's screening out."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

from pyproj import CRS

from ..engine.change.difference import Areas
from ..engine.change.result import Change
from ..engine.core import cancellation
from ..engine.core.errors import EngineError, InputError
from ..engine.core.json_values import plain
from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..engine.epochs.comparability import refuse_other_raw_heights, require_comparable
from ..engine.epochs.dating import check_days
from ..engine.epochs.epoch import Epoch, check_pair
from ..engine.geometry.rigid_transform import RigidTransform
from ..engine.ground.corrected_ground import corrected
from ..engine.ground.extraction import extract_ground
from ..engine.ground.result import GroundResult
from ..engine.ground.tiles.memory import shared_memory
from ..engine.pointcloud.cloud import PointCloud
from ..engine.pointcloud.header import preflight
from ..engine.pointcloud.in_parts import CloudFile
from ..engine.pointcloud.moving import copy_moved
from ..engine.pointcloud.pdal_program import Pdal
from ..engine.pointcloud.reading import open_cloud, read_cloud
from ..engine.registration.result import RegistrationResult
from ..engine.report.compose import REPORT
from ..engine.vector.corrections import Corrections
from ..engine.zones.change_zones import method_name
from ..engine.zones.profile_lines import ProfileLine, given_lines
from ..engine.zones.profiles import PROFILE_OUTPUTS
from .corrections import corrections_of
from .early_memory import refuse_grid_early
from .ground_choice import check_ground
from .inspect_motion import measured_motion, write_motion
from .last_epoch import SCREENING_OUTPUTS, EpochScreening, confirmed_by, obstacle, screen_epoch, write_epoch_screening
from .layer_files import NO_LAYERS, LayerFiles
from .layers import layers_on_cloud
from .motion_memory import MotionMemory
from .movement import Surveys, moved_zones_of
from .pair import (
    MAX_HELD_POINTS,
    SPOOL,
    Cloud,
    common_area,
    compare_pair,
    excluded_of_pair,
    ground_on_disk,
    is_large,
    register_pair,
    stable_area,
)
from .products.change import CHANGE_OUTPUTS, ON_REQUEST, Context, write_products
from .products.displacement import DISPLACEMENT_OUTPUTS
from .products.objects import Classified, write_objects
from .run import Run
from .settings import Settings, groups
from .shared_ground import recorded, shared_grounds

_AT_ONCE = 2  # surveys whose ground is found at the same time
MAX_POINTS_AT_ONCE = 8_000_000
"""Points of raw surveys up to which their ground is found at the same time."""
_EVERY_OUTPUT = (*CHANGE_OUTPUTS, *ON_REQUEST, *PROFILE_OUTPUTS, *DISPLACEMENT_OUTPUTS, *SCREENING_OUTPUTS)
_RECORDED = (
    "inputs", "dates", "ground", "registration", "change", "zones", "movement", "displacement_step", "displacement",
    "road", "assets", "heatmap", "screening", "report", "details",
)  # fmt: skip


@dataclass(frozen=True)
class _Inspection:
    """What the steps of one run work on. ``hashes`` are the SHA-256 of the epochs' files."""

    run: Run
    epochs: tuple[Epoch, ...]
    settings: Settings
    hashes: tuple[str, ...]
    roi: Path | None
    stable: Path | None
    corrections: Corrections | None
    lines: tuple[ProfileLine, ...]
    program: Pdal

    @property
    def alone(self) -> bool:
        return len(self.epochs) == 1

    @property
    def pair(self) -> tuple[Epoch, Epoch]:
        return self.epochs[0], self.epochs[1]


def inspect_slope(
    epochs: Sequence[Epoch],
    output_dir: Path,
    settings: Settings,
    *,
    roi: Path | None = None,
    stable: Path | None = None,
    profiles: Path | None = None,
    layers: LayerFiles = NO_LAYERS,
    pdal: Path | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> RunResult:
    """Ground of all epochs; of two registration, motion along the surface, change, zones and heatmap; screening of the
    last; run record.

    Two epochs that cannot be screened get all else, and a warning with the reason.

    Args:
        epochs: the earlier and the later survey, or one, which is screened only.
        output_dir: folder for the outputs; made if missing.
        roi: vector file whose polygons bound the managed slope.
        stable: vector file whose polygons are known to be stable; only they register the epochs.
        profiles: vector file whose lines profiles are taken along.
        layers: the road's centreline, polygons of classes of asset, and corrections by hand.
        pdal: the pdal program, if another than the one found.
        overwrite: replace results that the folder holds, and carry over what people entered in their zones.

    Raises:
        InputError: something given cannot be used; nothing is written then.
    """
    epochs = tuple(epochs)
    if len(epochs) == 2:
        check_pair(*epochs)
    elif len(epochs) != 1:
        raise InputError(f"{len(epochs)} epochs were given; give two, the earlier first, or one to screen it.")
    inputs = [*((f"epoch {e.name}", e.path) for e in epochs), ("roi", roi), ("stable", stable), ("profiles", profiles)]
    inputs += layers.inputs
    run = Run("inspect", groups(settings, *_RECORDED), inputs, progress)
    run.refuse_folder(output_dir, ("run.json", "transform.json", *_EVERY_OUTPUT), overwrite=overwrite)
    replaced = {"zones.gpkg": len(epochs) == 2, "screened_zones.gpkg": settings.screening.screen_last_epoch}
    run.read_reviews(output_dir, [name for name, written in replaced.items() if written])
    program = run.find_pdal(pdal)
    hashes = run.hash_inputs()[: len(epochs)]
    run.facts["run_id"] = run.run_id(hashes)
    _refuse_surveys(run, epochs, settings, roi)
    lines = _profile_lines(run, epochs, settings, profiles)
    if layers.classes is not None and len(epochs) == 1:
        raise InputError("--classes was given with one epoch; the change by class is between two, so give both.")
    related = (settings.road, settings.assets)
    run.related = layers_on_cloud(layers, related, epochs[0].path, settings.inputs, run.progress)
    corrections = corrections_of(layers.corrections, epochs, roi, settings.inputs, run.progress)
    if corrections is not None:
        run.facts["corrections"] = corrections.facts()
    task = _Inspection(run, epochs, settings, hashes, roi, stable, corrections, lines, program)
    screened = _to_be_screened(task)
    with run.writing(output_dir, report=True):
        grounds = _grounds(task)
        if task.alone:
            _screening_of_one(task, grounds[0])
        else:
            grounds = _change_of_two(task, grounds, screened)
        run.outputs["run"] = run.record_path
        for label, ground in zip(("epoch",) if task.alone else ("reference", "moving"), grounds, strict=True):
            run.outputs[f"{label}_ground"] = run.stage.final(f"clouds/{ground.ground.name}")
            run.figures |= {f"{label}_{name}": value for name, value in ground.figures().items()}
        run.finish_reviews()
        _warn_of_older_outputs(run, output_dir)
    return run.result()


def _refuse_surveys(run: Run, epochs: tuple[Epoch, ...], settings: Settings, roi: Path | None) -> None:
    """Raise InputError where the surveys cannot be compared, as far as that can be seen before all work."""
    check_days(epochs, trusted=settings.dates.trust_dates, progress=run.progress)
    check_ground(epochs, settings.ground.ground, run.progress)
    if len(epochs) == 2:
        paths = epochs[0].path, epochs[1].path
        require_comparable(*paths, settings.inputs)
        refuse_other_raw_heights(*paths, settings.inputs, settings.registration)
        refuse_grid_early(paths, settings.inputs, settings.change, roi)


def _profile_lines(
    run: Run, epochs: tuple[Epoch, ...], settings: Settings, profiles: Path | None
) -> tuple[ProfileLine, ...]:
    if profiles is None:
        return ()
    if len(epochs) == 1:
        raise InputError("--profiles was given with one epoch; profiles show the change between two, so give both.")
    crs = open_cloud(epochs[0].path, settings.inputs)[1].crs
    return given_lines(profiles, crs, settings.report.profile_field, run.progress)


def _to_be_screened(task: _Inspection) -> bool:
    """Whether the last epoch is to be screened and can be; reported before any work.

    Raises:
        InputError: it cannot, and there is nothing else to be done, or what was asked for by name is missing.
    """
    if not task.settings.screening.screen_last_epoch:
        if task.alone:
            raise InputError("One epoch can only be screened; ask for it with --screen-last-epoch, or give two epochs.")
        return False
    sentence = obstacle(task.settings.screening)
    if sentence and task.alone:
        raise InputError(sentence)
    if sentence:
        _leave_out_screening(task.run, sentence)
    return not sentence


def _leave_out_screening(run: Run, sentence: str) -> None:
    run.facts["screening_left_out"] = sentence
    run.progress.warning(f"The last survey was not screened. {sentence}")


def _warn_of_older_outputs(run: Run, folder: Path) -> None:
    """Warn of outputs of another run in the folder, which this one does not replace."""
    own = {REPORT, *(path.name for path in run.outputs.values())}
    older = [name for name in _EVERY_OUTPUT if name not in own and (folder / name).exists()]
    if older:
        run.progress.warning(f"The folder {folder} still holds outputs of an earlier run: {', '.join(older)}.")


def _grounds(task: _Inspection) -> list[GroundResult]:
    """All epochs at the same time, as the work is in child processes of one thread each; large ones one by one."""
    run, stage = task.run, task.run.stage
    at_once = surveys_at_once([epoch.path for epoch in task.epochs])
    parameters = shared_memory(task.settings.ground, at_once)

    def ground(epoch: Epoch, share: Progress) -> GroundResult:
        found = extract_ground(
            epoch.path,
            stage.path(f"clouds/{epoch.name}_ground.laz"),
            roi=task.roi,
            parameters=parameters,
            inputs=task.settings.inputs,
            pdal=task.program,
            final=stage.final("clouds"),
            progress=share,
        )
        return found if task.corrections is None else corrected(found, task.corrections.of(epoch.date))

    with run.step("ground", 0.0, 0.6, "extracting the ground") as entry:
        shares = run.progress.split([e.name for e in task.epochs])
        with ThreadPoolExecutor(max_workers=at_once) as pool:
            grounds = list(pool.map(ground, task.epochs, shares))
        entry["epochs"] = recorded(task.epochs, grounds)
    for epoch, found in zip(task.epochs, grounds, strict=True):
        if sentence := found.sentence():
            run.progress.info(f"{epoch.name}: {sentence}")
    return grounds


def surveys_at_once(clouds: Sequence[Path]) -> int:
    """How many surveys' ground is found at the same time: of large ones one, which then has all of the memory."""
    return 1 if sum(preflight(path).count for path in clouds) > MAX_POINTS_AT_ONCE else min(_AT_ONCE, len(clouds))


def _screening_of_one(task: _Inspection, ground: GroundResult) -> None:
    run = task.run
    with run.step("screening", 0.6, 0.95, "screening"):
        found = _screened(task, ground.ground)
    with run.step("products", 0.95, 0.99, "writing outputs"):
        write_epoch_screening(
            run, found, _picture(ground.clipped), task.epochs[0], task.hashes[0], task.settings.screening
        )


def _screened(task: _Inspection, ground: Path) -> EpochScreening:
    run = task.run
    found = screen_epoch(
        ground, task.epochs[-1], task.settings.screening, run_id=run.facts["run_id"], progress=run.progress
    )
    run.facts["model"] = found.screening.model
    return found


def _change_of_two(task: _Inspection, grounds: list[GroundResult], screened: bool) -> list[GroundResult]:
    """Compare two surveys; returns their ground, of which each helped to find the other's."""
    run, settings = task.run, task.settings
    with cancellation.temporary(run.stage.folder / SPOOL) as spool:
        first, second = _ground_clouds(task, grounds, spool)
        registration = _registered(task, first, second)
        transform = registration.transform
        grounds = shared_grounds(run, task.epochs, grounds, settings.ground, transform, task.corrections)
        if any(ground.shared_points for ground in grounds):
            first, second = _ground_clouds(task, grounds, spool)
        moved = _moved(second, registration.transform)
        motion = None
        if settings.displacement_step.displacement:
            memory = MotionMemory.of(settings.change.memory_limit)
            motion = measured_motion(run, (first, moved), settings.displacement, registration, task.stable, memory)
        change = _difference(task, first, moved, registration)
        crs = first.crs
        context = _context(task, change, registration, crs)
        surveys = Surveys(first, moved, registration.covariance, registration.transform.centre)
        vectors = None if motion is None else motion.found
        zones = moved_zones_of(run, change, surveys, context, settings, vectors)
        del first, second, moved, surveys
    later = _write_clouds(task, grounds[1], registration, crs)
    found = _screened_and_confirmed(task, later, change) if screened else None
    with run.step("products", 0.88, 0.99, "writing outputs"):
        picture = _picture(grounds[1].clipped, registration.transform)
        write_products(run, change, picture, context, settings, task.lines, zones)
        run.facts["registration"] = registration.summary()
        run.figures |= registration.figures()
        if motion is not None:
            write_motion(run, motion, settings.displacement, context)
        if found is not None:
            write_epoch_screening(run, found, picture, task.epochs[1], task.hashes[1], settings.screening)
    write_objects(run, Classified(grounds[0].classified, grounds[1].classified, registration.transform), context)
    return grounds


def _context(task: _Inspection, change: Change, registration: RegistrationResult, crs: CRS) -> Context:
    return Context(
        first=task.epochs[0],
        second=task.epochs[1],
        crs=crs,
        transform=registration.transform,
        input_hashes=task.hashes,
        method=f"{method_name(task.settings.change, change.direction)}, {registration.method} registration",
        run_id=task.run.facts["run_id"],
    )


def _ground_clouds(task: _Inspection, grounds: list[GroundResult], spool: Path) -> tuple[Cloud, Cloud]:
    """The ground of both epochs; where it is large and cells grow, it stays on the disk."""
    paths = grounds[0].ground, grounds[1].ground
    if is_large(paths) and task.settings.change.grows:
        first, second = (ground_on_disk(path, spool, "as_is", None, Progress()) for path in paths)
        return first, second
    return read_cloud(paths[0]), read_cloud(paths[1])


def _moved(cloud: Cloud, transform: RigidTransform) -> Cloud:
    if isinstance(cloud, PointCloud):
        return replace(cloud, xyz=transform.apply(cloud.xyz))
    return cloud.moved(transform)


def _picture(cloud: Path, transform: RigidTransform | None = None) -> PointCloud | CloudFile:
    """What the top view shows: a cloud in the first epoch's frame."""
    if preflight(cloud).count > MAX_HELD_POINTS // 2:
        return CloudFile.of(cloud, transform=transform, colours=True)
    picture = read_cloud(cloud, colours=True)
    return picture if transform is None else replace(picture, xyz=transform.apply(picture.xyz))


def _registered(task: _Inspection, first: Cloud, second: Cloud) -> RegistrationResult:
    with task.run.step("registration", 0.6, 0.68, "registering") as entry:
        found = register_pair(first, second, task.settings.registration, task.stable, task.run.progress)
        entry.update(plain(found.summary()))
        task.run.facts["transform"] = found.transform.matrix
    return found


def _difference(task: _Inspection, first: Cloud, moved: Cloud, registration: RegistrationResult) -> Change:
    with task.run.step("change", 0.79, 0.83, "differencing"):
        known = stable_area(task.stable, first.crs, task.run.progress)
        transform = registration.transform
        excluded = excluded_of_pair(task.corrections, task.pair, first, transform)
        areas = Areas(common_area(task.roi, first, transform), known, excluded)
        error = registration.registration_error
        return compare_pair(first, moved, task.settings.change, areas, error, task.run.progress)


def _write_clouds(task: _Inspection, ground: GroundResult, registration: RegistrationResult, crs: CRS) -> Path:
    """Write the transform, and the later ground in the earlier one's frame; returns where that lies until the end."""
    stage = task.run.stage
    registration.transform.save(stage.path("transform.json"), crs, facts=registration.stated())
    name = f"clouds/{task.epochs[1].name}_aligned.laz"
    copy_moved(ground.ground, stage.path(name), registration.transform)
    task.run.outputs |= {"transform": stage.final("transform.json"), "aligned": stage.final(name)}
    return stage.path(name)


def _screened_and_confirmed(task: _Inspection, moved: Path, change: Change) -> EpochScreening | None:
    with task.run.step("screening", 0.83, 0.88, "screening"):
        try:
            return confirmed_by(_screened(task, moved), change, task.pair)
        except (InputError, EngineError) as error:
            _leave_out_screening(task.run, str(error))
    return None
