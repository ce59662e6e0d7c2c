"""The single steps as commands: files in, files out, a run record beside them."""

from __future__ import annotations

import contextlib
import json
import math
import uuid
from dataclasses import replace
from pathlib import Path
from typing import Any

from .change import difference
from .classified_ground import warn_of_classes
from .clouds import PointCloud, copy_with, open_cloud, read_cloud
from .dating import check_days
from .earlier_results import refuse_results
from .earlier_reviews import EarlierReviews
from .epochs import Epoch, check_pair, date_in_name, parse_date
from .errors import InputError
from .ground import extract_ground
from .ground_cover import cover_sentence, cover_table
from .inspection import CHANGE_OUTPUTS, ON_REQUEST, Outcome, Settings
from .outputs import refuse_inputs_as_outputs, refuse_other_than_cloud, refuse_unwritable, staged_outputs
from .pair import (
    known_stable,
    refuse_other_heights,
    register_pair,
    require_comparable,
    require_two_clouds,
    warn_of_doubtful_change,
)
from .pdal import find_pdal
from .products import Context, method_name, write_products
from .profile_lines import given_lines
from .profiles import PROFILE_OUTPUTS
from .progress import Progress
from .raw_survey import refuse_raw, taken_as_ground
from .report import write_record_and_report
from .run_record import RunRecord, plain
from .transform import RigidTransform


def ground_step(
    cloud: Path, output: Path, settings: Settings, *, roi: Path | None, pdal: Path | None, progress: Progress
) -> Outcome:
    """Clip, denoise and extract the ground of one cloud; see ``ground.extract_ground``."""
    refuse_other_than_cloud(output)
    refuse_unwritable(output)
    stem = output.stem.removesuffix("_ground") or output.stem
    written = [output, *(output.with_name(f"{stem}_{kind}.laz") for kind in ("clipped", "classified"))]
    refuse_inputs_as_outputs(written, [cloud] + ([roi] if roi else []))
    program = find_pdal(pdal)
    record = RunRecord("ground", {"inputs": settings.inputs, "ground": settings.ground})
    record.facts["pdal"] = {"version": program.version, "path": program.path, "found": program.how}
    record.add_input("cloud", cloud)
    if roi is not None:
        record.add_input("roi", roi)
    with staged_outputs(output.absolute().parent, last=_record_name(output)) as stage:
        with record.stage("ground") as entry:
            result = extract_ground(
                cloud,
                stage.path(output.name),
                roi=roi,
                parameters=settings.ground,
                inputs=settings.inputs,
                pdal=program,
                final=stage.directory,
                progress=progress,
            )
            entry.update(plain(result))
        if result.cover is not None:
            for line in (cover_sentence(result.cover), *cover_table(result.cover)):
                progress.info(line)
        outputs = {
            "ground": stage.final(output.name),
            "clipped": stage.final(result.clipped.name),
            "run": stage.final(_record_name(output)),
        }
        record.metrics = result.figures()
        record.write(stage.path(_record_name(output)), progress.warnings, outputs)
    return outputs, record.metrics


def register_step(
    reference: Path,
    moving: Path,
    output: Path,
    settings: Settings,
    *,
    transform_path: Path | None,
    given: Path | None,
    invert: bool,
    stable: Path | None,
    progress: Progress,
) -> Outcome:
    """Register ``moving`` to ``reference``, or apply the transform ``given``; write the moved cloud."""
    refuse_other_than_cloud(output)
    targets = [output] + ([transform_path] if transform_path else [])
    for target in targets:
        refuse_unwritable(target)
    require_two_clouds(reference, moving, contents=given is None)
    files = {"reference": reference, "moving": moving, "transform": given, "stable": stable}
    refuse_inputs_as_outputs(targets, [p for p in files.values() if p])
    if invert and given is None:
        raise InputError("--invert was given without --apply; name the transform.json that is to be inverted.")
    transform = None if given is None else RigidTransform.load(given)
    require_comparable(reference, moving, settings.inputs)
    if transform is None:
        refuse_raw((reference, moving), settings.surface.ground, settings.inputs)
    record = RunRecord(
        "register",
        {"inputs": settings.inputs, "surface": settings.surface, "registration": settings.registration},
    )
    for role, path in files.items():
        if path is not None:
            record.add_input(role, path)
    with contextlib.ExitStack() as stack:
        stage = stack.enter_context(staged_outputs(output.absolute().parent, last=_record_name(output)))
        with progress.stage(0.0, 0.2, "reading"), record.stage("read") as entry:
            first = read_cloud(reference, settings.inputs, progress=progress)
            second = read_cloud(moving, settings.inputs, progress=progress)
            entry["points"] = [len(first.xyz), len(second.xyz)]
        if transform is not None:
            transform = transform.inverse() if invert else transform
        else:
            with progress.stage(0.2, 0.8, "registering"), record.stage("registration") as entry:
                a, b = (ground_of(cloud, settings.surface.ground, progress) for cloud in (first, second))
                result = register_pair(a, b, settings.registration, stable, progress)
                entry.update(plain(result.summary()))
            transform, record.metrics = result.transform, result.figures()
        outputs = {"aligned": stage.final(output.name), "run": stage.final(_record_name(output))}
        with progress.stage(0.8, 1.0, "writing"), record.stage("write"):
            copy_with(moving, stage.path(output.name), settings.inputs, xyz=transform.apply(second.xyz))
        record.facts["transform"] = transform.matrix
        if transform_path is not None:
            # perhaps in another folder
            beside = stack.enter_context(staged_outputs(transform_path.absolute().parent))
            transform.save(beside.path(transform_path.name), first.crs, facts=record.metrics)
            outputs["transform"] = beside.final(transform_path.name)
        record.write(stage.path(_record_name(output)), progress.warnings, outputs)
    return outputs, record.metrics


def change_step(
    reference: Path,
    moving: Path,
    output_dir: Path,
    settings: Settings,
    *,
    dates: tuple[str | None, str | None],
    transform_path: Path | None,
    profiles: Path | None = None,
    stable: Path | None = None,
    overwrite: bool = False,
    progress: Progress,
) -> Outcome:
    """Change between two registered ground clouds, with all its products."""
    paths = (reference, moving)
    first, second = (
        Epoch(path, parse_date(given) if given else date_in_name(path))
        for path, given in zip(paths, dates, strict=True)
    )
    check_pair(first, second)
    given_files = [*paths] + [p for p in (transform_path, profiles, stable) if p]
    written = (*CHANGE_OUTPUTS, *ON_REQUEST, *PROFILE_OUTPUTS)
    refuse_inputs_as_outputs([output_dir / name for name in written], given_files)
    refuse_results(output_dir, ("run.json", *written), overwrite=overwrite)
    reviews = EarlierReviews(output_dir, ("zones.gpkg",))
    record = RunRecord(
        "change",
        {
            "inputs": settings.inputs,
            "dates": settings.dates,
            "surface": settings.surface,
            "change": settings.change,
            "zones": settings.zones,
            "heatmap": settings.heatmap,
            "report": settings.report,
        },
    )
    hashes = tuple(record.add_input(f"epoch {e.name}", e.path) for e in (first, second))
    transform = RigidTransform.load(transform_path) if transform_path else None
    if transform is not None and transform_path is not None:
        record.add_input("transform", transform_path)
        record.facts["transform"] = transform.matrix
        record.facts["registration"] = _registration_facts(transform_path)
    for role, path in (("profiles", profiles), ("stable", stable)):
        if path is not None:
            record.add_input(role, path)
    check_days((first, second), trusted=settings.dates.trust_dates, progress=progress)
    require_comparable(reference, moving, settings.inputs)
    refuse_raw(paths, settings.surface.ground, settings.inputs)
    crs = open_cloud(reference, settings.inputs)[1].crs
    lines = given_lines(profiles, crs, settings.report.profile_field, progress)
    with staged_outputs(output_dir) as stage:
        with progress.stage(0.0, 0.3, "reading"), record.stage("read") as entry:
            a = read_cloud(reference, settings.inputs, progress=progress)
            b = read_cloud(moving, settings.inputs, colours=True, progress=progress)
            entry["points"] = [len(a.xyz), len(b.xyz)]
            if transform is not None:
                b = replace(b, xyz=transform.apply(b.xyz))
            picture = b
            a, b = (ground_of(cloud, settings.surface.ground, progress) for cloud in (a, b))
            refuse_other_heights(a, b)
        with progress.stage(0.3, 0.5, "differencing"), record.stage("change"):
            error = registration_error(transform_path)
            change = difference(
                a.xyz,
                b.xyz,
                settings.change,
                registration_error=error or 0.0,
                stable_area=known_stable(stable, a),
                plants=(a.plants, b.plants),
                progress=progress,
            )
            if error is None and settings.change.registration_error < 0:
                progress.warning(
                    "The registration's error is not known here, so the level of detection covers the scatter of the "
                    "points alone; give the registration_error that the registration reported."
                )
            warn_of_doubtful_change(change, progress, may_grow=not settings.change.adaptive)
        context = Context(
            first=first,
            second=second,
            crs=a.crs,
            transform=transform,
            input_hashes=hashes,
            method=method_name(settings.change, change.direction),
            run_id=uuid.uuid5(uuid.NAMESPACE_OID, repr((hashes, plain(record.parameters)))).hex[:12],
        )
        with progress.stage(0.5, 0.99, "writing outputs"), record.stage("products"):
            products = write_products(
                change,
                picture,
                context,
                settings.zones,
                settings.heatmap,
                stage,
                progress,
                lines=lines,
                report_parameters=settings.report,
                reviews=reviews,
            )
        del a, b, picture, change  # the report reads the files
        outputs = products.outputs | {"run": stage.final("run.json")}
        record.metrics = products.figures
        record.facts |= products.facts | {"run_id": context.run_id}
        record.facts["reviews"] = reviews.finish(stage, outputs, progress)
        write_record_and_report(record, stage, progress, outputs)
    return outputs, record.metrics


def ground_of(cloud: PointCloud, ground: str, progress: Progress) -> PointCloud:
    """The points of a cloud that ``SurfaceParameters.ground`` takes, without colours; warns where they are no surface.

    Raises:
        InputError: there is none, or those of class 2 contradict each other.
    """
    mask = taken_as_ground(cloud.classification, ground, cloud.path)
    taken = cloud if mask is None else PointCloud(cloud.xyz[mask], cloud.crs, cloud.path)
    if ground == "class_2":
        warn_of_classes(taken.path, taken.xyz, progress)
    return taken


def registration_error(transform_path: Path | None) -> float | None:
    """Standard error of the registration in height (m), where the transform's file tells it."""
    if transform_path is None:
        return None
    known = _registration_facts(transform_path).get("registration_error_m")
    if isinstance(known, (int, float)) and math.isfinite(known) and known >= 0:
        return float(known)
    return None


def _registration_facts(transform_path: Path) -> dict[str, Any]:
    """What the transform's file tells of the registration that found it."""
    facts = json.loads(transform_path.read_text(encoding="utf-8")).get("registration")
    return facts if isinstance(facts, dict) else {}


def _record_name(output: Path) -> str:
    return f"{output.stem}_run.json"
