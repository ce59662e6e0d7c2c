"""The command `register`: two clouds in, the moving one on the reference out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..engine.core import cancellation
from ..engine.core.checksums import sha256
from ..engine.core.errors import InputError
from ..engine.core.json_values import plain
from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..engine.core.staged_outputs import refuse_other_than_cloud, refuse_unwritable
from ..engine.epochs.comparability import require_comparable, require_two_clouds
from ..engine.geometry.rigid_transform import RigidTransform
from ..engine.ground.raw_survey import refuse_raw
from ..engine.pointcloud.cloud import PointCloud
from ..engine.pointcloud.header import preflight
from ..engine.pointcloud.in_parts import CloudFile
from ..engine.pointcloud.moving import copy_moved
from ..engine.pointcloud.reading import open_cloud, read_cloud
from .known_registration import ALIGNED_SHA256
from .pair import SPOOL, Cloud, ground_of, ground_on_disk, is_large, register_pair
from .run import Run, record_name_of
from .settings import Settings, groups


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
) -> RunResult:
    """Register ``moving`` to ``reference``, or apply the transform ``given``; write the moved cloud."""
    refuse_other_than_cloud(output)
    targets = [output] + ([transform_path] if transform_path else [])
    for target in targets:
        refuse_unwritable(target)
    require_two_clouds(reference, moving, contents=given is None)
    inputs = [("reference", reference), ("moving", moving), ("transform", given), ("stable", stable)]
    run = Run("register", groups(settings, "inputs", "surface", "registration"), inputs, progress)
    run.refuse_outputs(targets)
    if invert and given is None:
        raise InputError("--invert was given without --apply; name the transform.json that is to be inverted.")
    transform = None if given is None else RigidTransform.load(given)
    require_comparable(reference, moving, settings.inputs)
    if transform is None:
        refuse_raw((reference, moving), settings.surface.ground, settings.inputs)
    run.hash_inputs()
    others = [transform_path.absolute().parent] if transform_path else []
    with run.writing(output.absolute().parent, record_name=record_name_of(output), others=others) as stage:
        stated: dict[str, Any] = {}
        with cancellation.temporary(stage.folder / SPOOL) as spool:
            if transform is not None:
                _look_through(run, (reference, moving), settings)
                transform = transform.inverse() if invert else transform
            else:
                transform, stated = _registered(run, (reference, moving), settings, stable, spool)
        with run.step("write", 0.8, 1.0, "writing"):
            copy_moved(moving, stage.path(output.name), transform, settings.inputs)
        run.facts["transform"] = transform.matrix
        run.facts[ALIGNED_SHA256] = sha256(stage.path(output.name))
        if stated:
            run.facts["registration"] = stated | {"centre": transform.centre}
        run.outputs |= {"aligned": stage.final(output.name), "run": run.record_path}
        if transform_path is not None:
            directory = run.stage_in(transform_path.absolute().parent)
            crs = open_cloud(reference, settings.inputs)[1].crs
            transform.save(directory.path(transform_path.name), crs, facts=stated)
            run.outputs["transform"] = directory.final(transform_path.name)
    return run.result()


def _look_through(run: Run, paths: tuple[Path, Path], settings: Settings) -> None:
    """Read both clouds for what is wrong with them."""
    with run.step("read", 0.0, 0.2, "reading") as entry:
        entry["points"] = [
            sum(len(part) for part in CloudFile.of(path, settings.inputs).parts(run.progress)) for path in paths
        ]


def _registered(
    run: Run, paths: tuple[Path, Path], settings: Settings, stable: Path | None, spool: Path
) -> tuple[RigidTransform, dict[str, Any]]:
    """The motion of the later cloud, and what its file states of it."""
    ground = settings.surface.ground
    clouds: list[Cloud]
    with run.step("read", 0.0, 0.2, "reading") as entry:
        if is_large(paths):
            clouds = [ground_on_disk(path, spool, ground, settings.inputs, run.progress) for path in paths]
        else:
            clouds = [read_cloud(path, settings.inputs, progress=run.progress) for path in paths]
        entry["points"] = [preflight(path).count for path in paths]
    with run.step("registration", 0.2, 0.8, "registering") as entry:
        first, second = (
            ground_of(cloud, ground, run.progress) if isinstance(cloud, PointCloud) else cloud for cloud in clouds
        )
        result = register_pair(first, second, settings.registration, stable, run.progress)
        entry.update(plain(result.summary()))
    run.figures = result.figures()
    return result.transform, result.stated()
