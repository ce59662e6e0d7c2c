"""The command `register`: two clouds in, the moving one on the reference out."""

from __future__ import annotations

import contextlib
from pathlib import Path

from ..engine.core.errors import InputError
from ..engine.core.json_values import plain
from ..engine.core.progress import Progress
from ..engine.core.run_record import RunRecord
from ..engine.core.staged_outputs import (
    refuse_inputs_as_outputs,
    refuse_other_than_cloud,
    refuse_unwritable,
    staged_outputs,
)
from ..engine.epochs.comparability import require_comparable, require_two_clouds
from ..engine.geometry.rigid_transform import RigidTransform
from ..engine.ground.raw_survey import refuse_raw
from ..engine.pointcloud.reading import read_cloud
from ..engine.pointcloud.writing import copy_with
from .inspect import Outcome
from .pair import register_pair
from .run import _record_name, ground_of
from .settings import Settings


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
