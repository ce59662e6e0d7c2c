"""The whole flow: raw surveys of one slope in; change, hazard zones and the last survey's screening out."""

from __future__ import annotations

import uuid
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pyproj import CRS

from ..engine.change.difference import difference
from ..engine.change.doubts import warn_of_doubtful_change
from ..engine.core.arrays import Float
from ..engine.core.earlier_results import refuse_results
from ..engine.core.errors import EngineError, InputError
from ..engine.core.json_values import plain
from ..engine.core.progress import Progress
from ..engine.core.run_record import RunRecord
from ..engine.core.staged_outputs import Stage, refuse_inputs_as_outputs, staged_outputs
from ..engine.epochs.comparability import refuse_other_raw_heights, require_comparable
from ..engine.epochs.dating import check_days
from ..engine.epochs.epoch import Epoch, check_pair
from ..engine.ground.cover import cover_sentence
from ..engine.ground.extraction import GroundResult, extract_ground
from ..engine.pointcloud.pdal_program import Pdal, find_pdal
from ..engine.pointcloud.reading import open_cloud, read_cloud
from ..engine.pointcloud.writing import copy_with
from ..engine.registration.result import RegistrationResult
from ..engine.zones.earlier_reviews import EarlierReviews
from ..engine.zones.profile_lines import ProfileLine, given_lines
from ..engine.zones.profiles import PROFILE_OUTPUTS
from .early_memory import refuse_grid_early
from .last_epoch import SCREENING_OUTPUTS, EpochScreening, confirmed_by, obstacle, screen_epoch, write_epoch_screening
from .pair import common_area, known_stable, register_pair
from .products.change import Context, method_name, write_products
from .settings import Settings
from .write_record_and_report import write_record_and_report

CHANGE_OUTPUTS = (
    "elevation_change.tif",
    "level_of_detection.tif",
    "significant_change.tif",
    "zones.gpkg",
    "volumes.csv",
    "heatmap.png",
    "heatmap.tif",
    "top_view.tif",
    "surface_heights.tif",
    "point_counts.tif",
    "report.html",
)
ON_REQUEST = ("cell_size.tif", "change_probability.tif", "plant_error.tif", "plant_change.tif")
"""Outputs of a change with some parameters only, or of ground that tells of plants."""
_EVERY_OUTPUT = (*CHANGE_OUTPUTS, *ON_REQUEST, *PROFILE_OUTPUTS, *SCREENING_OUTPUTS)


Outcome = tuple[dict[str, Path], dict[str, Any]]


def inspect_slope(
    epochs: Sequence[Epoch],
    output_dir: Path,
    settings: Settings,
    *,
    roi: Path | None = None,
    stable: Path | None = None,
    profiles: Path | None = None,
    pdal: Path | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Outcome:
    """Ground of all epochs; of two registration, change, zones and heatmap; screening of the last; run record.

    Two epochs that cannot be screened get all else, and a warning that says why.

    Args:
        epochs: the earlier and the later survey, or one, which is screened only.
        output_dir: folder for the outputs; made if missing.
        roi: vector file whose polygons bound the managed slope.
        stable: vector file whose polygons are known to be stable; only they register the epochs.
        profiles: vector file whose lines profiles are taken along.
        pdal: the pdal program, if another than the one found.
        overwrite: replace results that the folder holds, and carry over what people entered in their zones.

    Returns:
        Paths of the outputs by name, and the main figures.

    Raises:
        InputError: something given cannot be used; nothing is written then.
    """
    progress = progress or Progress()
    epochs = tuple(epochs)
    if len(epochs) == 2:
        check_pair(*epochs)
    elif len(epochs) != 1:
        raise InputError(f"{len(epochs)} epochs were given; give two, the earlier first, or one to screen it.")
    given = [e.path for e in epochs] + [p for p in (roi, stable, profiles) if p is not None]
    refuse_inputs_as_outputs([output_dir / name for name in _EVERY_OUTPUT], given)
    refuse_results(output_dir, ("run.json", "transform.json", *_EVERY_OUTPUT), overwrite=overwrite)
    replaced = {"zones.gpkg": len(epochs) == 2, "screened_zones.gpkg": settings.screening.screen_last_epoch}
    reviews = EarlierReviews(output_dir, [name for name, written in replaced.items() if written])
    program = find_pdal(pdal)
    record = RunRecord("inspect", settings.groups())
    record.facts["pdal"] = {"version": program.version, "path": program.path, "found": program.how}
    hashes = tuple(record.add_input(f"epoch {e.name}", e.path) for e in epochs)
    for role, path in (("roi", roi), ("stable", stable), ("profiles", profiles)):
        if path is not None:
            record.add_input(role, path)
    record.facts["run_id"] = uuid.uuid5(uuid.NAMESPACE_OID, repr((hashes, plain(record.parameters)))).hex[:12]
    check_days(epochs, trusted=settings.dates.trust_dates, progress=progress)
    if len(epochs) == 2:
        require_comparable(epochs[0].path, epochs[1].path, settings.inputs)
        refuse_other_raw_heights(epochs[0].path, epochs[1].path, settings.inputs, settings.registration)
        refuse_grid_early([e.path for e in epochs], settings.inputs, settings.change, roi)
    lines: tuple[ProfileLine, ...] = ()
    if profiles is not None and len(epochs) == 1:
        raise InputError("--profiles was given with one epoch; profiles show the change between two, so give both.")
    if profiles is not None:
        crs = open_cloud(epochs[0].path, settings.inputs)[1].crs
        lines = given_lines(profiles, crs, settings.report.profile_field, progress)
    run = _Run(epochs, settings, hashes, record, roi, stable, lines, program, reviews, progress)
    screened = _to_be_screened(run)
    with staged_outputs(output_dir) as stage:
        with progress.stage(0.0, 0.6, "extracting the ground"), record.stage("ground") as entry:
            grounds = _grounds(epochs, stage, settings, roi, program, progress)
            entry["epochs"] = {e.name: plain(g) for e, g in zip(epochs, grounds, strict=True)}
        for epoch, ground in zip(epochs, grounds, strict=True):
            if ground.cover is not None:
                progress.info(f"{epoch.name}: {cover_sentence(ground.cover)}")
        work = _change_of_two if len(epochs) == 2 else _screening_of_one
        outputs, figures = work(run, grounds, stage, screened)
        outputs |= {"run": stage.final("run.json")}
        record.metrics = figures
        labels = ("reference", "moving") if len(epochs) == 2 else ("epoch",)
        for label, result in zip(labels, grounds, strict=True):
            outputs[f"{label}_ground"] = stage.final(f"clouds/{result.ground.name}")
            record.metrics |= {f"{label}_{name}": value for name, value in result.figures().items()}
        record.facts["reviews"] = reviews.finish(stage, outputs, progress)
        _tell_what_is_older(output_dir, outputs, progress)
        write_record_and_report(record, stage, progress, outputs)
    return outputs, record.metrics


def _tell_what_is_older(folder: Path, outputs: dict[str, Path], progress: Progress) -> None:
    """Warn of outputs of another run in the folder, which this one does not replace."""
    own = {path.name for path in outputs.values()}
    older = [name for name in _EVERY_OUTPUT if name not in own and (folder / name).exists()]
    if older:
        progress.warning(f"The folder {folder} still holds outputs of an earlier run: {', '.join(older)}.")


@dataclass(frozen=True)
class _Run:
    epochs: tuple[Epoch, ...]
    settings: Settings
    hashes: tuple[str, ...]
    record: RunRecord
    roi: Path | None
    stable: Path | None
    lines: tuple[ProfileLine, ...]
    program: Pdal
    reviews: EarlierReviews
    progress: Progress


def _to_be_screened(run: _Run) -> bool:
    """Whether the last epoch is to be screened and can be; said before any work.

    Raises:
        InputError: it cannot, and there is nothing else to be done, or what was asked for by name is missing.
    """
    alone = len(run.epochs) == 1
    if not run.settings.screening.screen_last_epoch:
        if alone:
            raise InputError("One epoch can only be screened; ask for it with --screen-last-epoch, or give two epochs.")
        return False
    sentence = obstacle(run.settings.screening)
    if sentence and alone:
        raise InputError(sentence)
    if sentence:
        _leave_out(run, sentence)
    return not sentence


def _leave_out(run: _Run, sentence: str) -> None:
    run.record.facts["screening_left_out"] = sentence
    run.progress.warning(f"The last survey was not screened. {sentence}")


def _screening_of_one(run: _Run, grounds: list[GroundResult], stage: Stage, _: bool) -> Outcome:
    epoch, progress, record = run.epochs[0], run.progress, run.record
    with progress.stage(0.6, 0.95, "screening"), record.stage("screening"):
        found = _screened(run, grounds[0].ground)
    with progress.stage(0.95, 0.99, "writing outputs"), record.stage("products"):
        picture = read_cloud(grounds[0].clipped, colours=True)
        return write_epoch_screening(found, picture, epoch, run.hashes[0], run.settings.screening, stage, run.reviews)


def _change_of_two(run: _Run, grounds: list[GroundResult], stage: Stage, screened: bool) -> Outcome:
    settings, progress, record = run.settings, run.progress, run.record
    epochs = run.epochs[0], run.epochs[1]
    first, second = (read_cloud(g.ground) for g in grounds)
    with progress.stage(0.6, 0.76, "registering"), record.stage("registration") as entry:
        registration = register_pair(first, second, settings.registration, run.stable, progress)
        aligned = registration.transform.apply(second.xyz)
        entry.update(plain(registration.summary()))
        record.facts["transform"] = registration.transform.matrix
    with progress.stage(0.76, 0.82, "differencing"), record.stage("change"):
        change = difference(
            first.xyz,
            aligned,
            settings.change,
            registration_error=registration.registration_error,
            area=common_area(run.roi, first, registration.transform),
            stable_area=known_stable(run.stable, first),
            plants=(first.plants, second.plants),
            progress=progress,
        )
        warn_of_doubtful_change(change, progress, may_grow=not settings.change.adaptive)
    outputs, moved = _write_clouds(epochs, grounds, aligned, registration, first.crs, stage)
    found: EpochScreening | None = None
    if screened:
        with progress.stage(0.82, 0.88, "screening"), record.stage("screening"):
            try:
                found = confirmed_by(_screened(run, moved), change, epochs)
            except (InputError, EngineError) as error:
                _leave_out(run, str(error))
    with progress.stage(0.88, 0.99, "writing outputs"), record.stage("products"):
        picture = read_cloud(grounds[1].clipped, colours=True)
        picture = replace(picture, xyz=registration.transform.apply(picture.xyz))
        context = Context(
            first=epochs[0],
            second=epochs[1],
            crs=first.crs,
            transform=registration.transform,
            input_hashes=run.hashes,
            method=f"{method_name(settings.change, change.direction)}, {registration.method} registration",
            run_id=record.facts["run_id"],
        )
        products = write_products(
            change,
            picture,
            context,
            settings.zones,
            settings.heatmap,
            stage,
            progress,
            lines=run.lines,
            report_parameters=settings.report,
            reviews=run.reviews,
        )
        outputs |= products.outputs
        record.facts |= products.facts
        record.facts["registration"] = registration.summary()
        figures = products.figures | registration.figures()
        if found is not None:
            files, more = write_epoch_screening(
                found, picture, epochs[1], run.hashes[1], settings.screening, stage, run.reviews
            )
            outputs |= files
            figures |= more
    return outputs, figures


def _screened(run: _Run, ground: Path) -> EpochScreening:
    found = screen_epoch(
        ground, run.epochs[-1], run.settings.screening, run_id=run.record.facts["run_id"], progress=run.progress
    )
    run.record.facts["model"] = found.screening.model
    return found


def _grounds(
    epochs: tuple[Epoch, ...],
    stage: Stage,
    settings: Settings,
    roi: Path | None,
    program: Pdal,
    progress: Progress,
) -> list[GroundResult]:
    """All epochs at the same time: the work is in child processes of one thread each."""

    def ground(epoch: Epoch, share: Progress) -> GroundResult:
        return extract_ground(
            epoch.path,
            stage.path(f"clouds/{epoch.name}_ground.laz"),
            roi=roi,
            parameters=settings.ground,
            inputs=settings.inputs,
            pdal=program,
            final=stage.final("clouds"),
            progress=share,
        )

    shares = progress.split([e.name for e in epochs])
    with ThreadPoolExecutor(max_workers=2) as pool:
        return list(pool.map(ground, epochs, shares))


def _write_clouds(
    epochs: tuple[Epoch, Epoch],
    grounds: list[GroundResult],
    aligned: Float,
    registration: RegistrationResult,
    crs: CRS,
    stage: Stage,
) -> tuple[dict[str, Path], Path]:
    """The transform, and the later ground moved into the earlier one's frame, and where that lies until the end."""
    registration.transform.save(stage.path("transform.json"), crs, facts=registration.figures())
    name = f"clouds/{epochs[1].name}_aligned.laz"
    moved = stage.path(name)
    copy_with(grounds[1].ground, moved, xyz=aligned)
    return {"transform": stage.final("transform.json"), "aligned": stage.final(name)}, moved
