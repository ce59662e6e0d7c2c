"""The command `change`: two ground clouds in, rasters, zones and figures out."""

from __future__ import annotations

import uuid
from dataclasses import replace
from pathlib import Path

from ..engine.change.difference import difference
from ..engine.change.doubts import warn_of_doubtful_change
from ..engine.core.earlier_results import refuse_results
from ..engine.core.json_values import plain
from ..engine.core.progress import Progress
from ..engine.core.run_record import RunRecord
from ..engine.core.staged_outputs import refuse_inputs_as_outputs, staged_outputs
from ..engine.epochs.comparability import refuse_other_heights, require_comparable
from ..engine.epochs.dating import check_days
from ..engine.epochs.epoch import Epoch, check_pair, parse_date
from ..engine.geometry.rigid_transform import RigidTransform, _registration_facts, registration_error
from ..engine.ground.raw_survey import refuse_raw
from ..engine.pointcloud.reading import open_cloud, read_cloud
from ..engine.zones.earlier_reviews import EarlierReviews
from ..engine.zones.profile_lines import given_lines
from ..engine.zones.profiles import PROFILE_OUTPUTS
from ..interface.dates import date_in_name
from .inspect import CHANGE_OUTPUTS, ON_REQUEST, Outcome
from .pair import known_stable
from .products.change import Context, method_name, write_products
from .run import ground_of
from .settings import Settings
from .write_record_and_report import write_record_and_report


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
