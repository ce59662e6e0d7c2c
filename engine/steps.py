"""The single steps as commands: files in, files out, a run record beside them."""

from __future__ import annotations

import uuid
from dataclasses import replace
from pathlib import Path
from typing import Any

from .change import difference
from .clouds import copy_with, read_cloud
from .epochs import Epoch, check_pair, date_in_name, parse_date
from .errors import InputError
from .ground import extract_ground
from .inspection import CHANGE_OUTPUTS, Outcome, Settings
from .outputs import refuse_inputs_as_outputs, refuse_unwritable, staged_outputs
from .pair import require_same_crs, require_two_clouds, stable_area, warn_of_uniform_shift
from .pdal import find_pdal
from .products import Context, write_products
from .progress import Progress
from .registration import register
from .run_record import RunRecord, plain
from .transform import RigidTransform


def ground_step(
    cloud: Path, output: Path, settings: Settings, *, roi: Path | None, pdal: Path | None, progress: Progress
) -> Outcome:
    """Clip, denoise and extract the ground of one cloud; see ``ground.extract_ground``."""
    refuse_unwritable(output)
    stem = output.stem.removesuffix("_ground") or output.stem
    written = [output, *(output.with_name(f"{stem}_{kind}.laz") for kind in ("clipped", "classified"))]
    refuse_inputs_as_outputs(written, [cloud] + ([roi] if roi else []))
    program = find_pdal(pdal)
    record = RunRecord("ground", {"inputs": settings.inputs, "ground": settings.ground})
    record.facts["pdal"] = {"version": program.version, "path": program.path, "found": program.how}
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
        record.add_input("cloud", cloud)
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
    targets = [output] + ([transform_path] if transform_path else [])
    for target in targets:
        refuse_unwritable(target)
    require_two_clouds(reference, moving)
    refuse_inputs_as_outputs(targets, [p for p in (reference, moving, given, stable) if p])
    if invert and given is None:
        raise InputError("--invert was given without --apply; name the transform.json that is to be inverted.")
    with progress.stage(0.0, 0.2, "reading"):
        first = read_cloud(reference, settings.inputs, progress=progress)
        second = read_cloud(moving, settings.inputs, progress=progress)
    require_same_crs(first, second)
    figures: dict[str, Any] = {}
    if given is not None:
        transform = RigidTransform.load(given)
        transform = transform.inverse() if invert else transform
    else:
        with progress.stage(0.2, 0.8, "registering"):
            result = register(
                first.xyz,
                second.xyz,
                settings.registration,
                stable=stable_area(stable, first.crs, progress),
                progress=progress,
            )
        transform, figures = result.transform, result.figures()
    outputs = {"aligned": output}
    with progress.stage(0.8, 1.0, "writing"):
        copy_with(moving, output, settings.inputs, xyz=transform.apply(second.xyz))
        if transform_path is not None:
            transform.save(transform_path, first.crs, facts=figures)
            outputs["transform"] = transform_path
    return outputs, figures


def change_step(
    reference: Path,
    moving: Path,
    output_dir: Path,
    settings: Settings,
    *,
    dates: tuple[str | None, str | None],
    transform_path: Path | None,
    progress: Progress,
) -> Outcome:
    """Change between two registered ground clouds, with all its products."""
    paths = (reference, moving)
    first, second = (
        Epoch(path, parse_date(given) if given else date_in_name(path))
        for path, given in zip(paths, dates, strict=True)
    )
    check_pair(first, second)
    given_files = [*paths] + ([transform_path] if transform_path else [])
    refuse_inputs_as_outputs([output_dir / name for name in CHANGE_OUTPUTS], given_files)
    record = RunRecord(
        "change",
        {
            "inputs": settings.inputs,
            "change": settings.change,
            "zones": settings.zones,
            "heatmap": settings.heatmap,
        },
    )
    hashes = tuple(record.add_input(f"epoch {e.name}", e.path) for e in (first, second))
    transform = RigidTransform.load(transform_path) if transform_path else None
    with progress.stage(0.0, 0.3, "reading"), record.stage("read") as entry:
        a = read_cloud(reference, settings.inputs, progress=progress)
        b = read_cloud(moving, settings.inputs, colours=True, progress=progress)
        require_same_crs(a, b)
        entry["points"] = [len(a.xyz), len(b.xyz)]
        if transform is not None:
            b = replace(b, xyz=transform.apply(b.xyz))
    with progress.stage(0.3, 0.5, "differencing"), record.stage("change"):
        change = difference(a.xyz, b.xyz, settings.change, progress=progress)
        warn_of_uniform_shift(change, progress)
    context = Context(
        first=first,
        second=second,
        crs=a.crs,
        transform=transform,
        input_hashes=hashes,
        method=f"grid difference ({settings.change.cell_value})",
        run_id=uuid.uuid5(uuid.NAMESPACE_OID, repr((hashes, plain(record.parameters)))).hex[:12],
    )
    with staged_outputs(output_dir) as stage:
        with progress.stage(0.5, 0.99, "writing outputs"), record.stage("products"):
            outputs, record.metrics = write_products(
                change, b, context, settings.zones, settings.heatmap, stage, progress
            )
        outputs["run"] = stage.final("run.json")
        record.facts["run_id"] = context.run_id
        record.write(stage.path("run.json"), progress.warnings, outputs)
    return outputs, record.metrics


def _record_name(output: Path) -> str:
    return f"{output.stem}_run.json"
