"""The command `change`: two ground clouds in, rasters, zones and figures out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ..engine.change.difference import Areas
from ..engine.change.result import Change
from ..engine.core import cancellation
from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..engine.epochs.comparability import refuse_other_heights, require_comparable
from ..engine.epochs.dating import check_days
from ..engine.epochs.epoch import check_pair
from ..engine.geometry.rigid_transform import RigidTransform
from ..engine.ground.raw_survey import refuse_raw
from ..engine.pointcloud.cloud import PointCloud
from ..engine.pointcloud.header import preflight
from ..engine.pointcloud.in_parts import CloudFile
from ..engine.pointcloud.reading import open_cloud, read_cloud
from ..engine.zones.change_zones import method_name
from ..engine.zones.profile_lines import given_lines
from ..engine.zones.profiles import PROFILE_OUTPUTS
from ..interface.parameters import AUTO
from .early_memory import refuse_grid_early
from .known_registration import KnownRegistration, given_registration
from .layer_files import NO_LAYERS, LayerFiles
from .layers import layers_on_cloud
from .movement import Surveys, moved_zones_of
from .pair import SPOOL, Cloud, compare_pair, dated_pair, ground_of, ground_on_disk, is_large, stable_area
from .products.change import CHANGE_OUTPUTS, ON_REQUEST, Context, write_products
from .products.objects import Classified, write_objects
from .run import Run
from .settings import Settings, groups


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
    layers: LayerFiles = NO_LAYERS,
    overwrite: bool = False,
    progress: Progress,
) -> RunResult:
    """Change between two registered ground clouds, with all its products."""
    epochs = dated_pair(reference, moving, dates)
    check_pair(*epochs)
    optional = [("transform", transform_path), ("profiles", profiles), ("stable", stable), *layers.inputs]
    inputs = [*((f"epoch {e.name}", e.path) for e in epochs), *optional]
    words = (
        "inputs", "dates", "surface", "change", "zones", "movement", "road", "assets", "heatmap", "report", "details",
    )  # fmt: skip
    run = Run("change", groups(settings, *words), inputs, progress)
    run.refuse_folder(output_dir, ("run.json", *CHANGE_OUTPUTS, *ON_REQUEST, *PROFILE_OUTPUTS), overwrite=overwrite)
    run.read_reviews(output_dir, ("zones.gpkg",))
    registered = given_registration(transform_path)
    hashes = run.hash_inputs()[:2]
    registered = registered.or_recorded(moving, hashes, progress)
    _record(run, registered)
    check_days(epochs, trusted=settings.dates.trust_dates, progress=progress)
    require_comparable(reference, moving, settings.inputs)
    refuse_raw((reference, moving), settings.surface.ground, settings.inputs)
    if registered.to_apply is None and settings.surface.ground != "class_2":
        refuse_grid_early((reference, moving), settings.inputs, settings.change, None)
    crs = open_cloud(reference, settings.inputs)[1].crs
    lines = given_lines(profiles, crs, settings.report.profile_field, progress)
    run.related = layers_on_cloud(layers, (settings.road, settings.assets), reference, settings.inputs, progress)
    with run.writing(output_dir, report=True):
        with cancellation.temporary(run.stage.folder / SPOOL) as spool:
            first, second, picture = _read(run, (reference, moving), registered.to_apply, settings, spool)
            change = _difference(run, (first, second), settings, registered, stable)
            context = Context(
                first=epochs[0],
                second=epochs[1],
                crs=first.crs,
                transform=registered.transform,
                input_hashes=hashes,
                method=method_name(settings.change, change.direction),
                run_id=run.run_id(hashes),
            )
            surveys = Surveys(first, second, registered.facts.get("covariance"), registered.centre)
            zones = moved_zones_of(run, change, surveys, context, settings)
        del first, second, surveys
        with run.step("products", 0.5, 0.99, "writing outputs"):
            write_products(run, change, picture, context, settings, lines, zones)
        del picture, change  # the report reads the files
        _objects(run, Classified(reference, moving, registered.to_apply, settings.inputs), context, settings)
        run.outputs["run"] = run.record_path
        run.facts["run_id"] = context.run_id
        run.finish_reviews()
    return run.result()


def _objects(run: Run, clouds: Classified, context: Context, settings: Settings) -> None:
    """Clouds whose class 2 is compared may hold all their returns; others are ground alone."""
    if settings.surface.ground == "class_2":
        write_objects(run, clouds, context)


def _record(run: Run, registered: KnownRegistration) -> None:
    if registered.transform is not None:
        run.facts["transform"] = registered.transform.matrix
        run.facts["registration"] = dict(registered.facts)


def _read(
    run: Run, paths: tuple[Path, Path], transform: RigidTransform | None, settings: Settings, spool: Path
) -> tuple[Cloud, Cloud, PointCloud | CloudFile]:
    """The ground of both clouds in one frame, and the whole later cloud with its colours.

    Large clouds stay on the disk, in the folder ``spool``; cells of one size hold them.
    """
    with run.step("read", 0.0, 0.3, "reading") as entry:
        if is_large(paths) and settings.change.grows:
            ground, inputs = settings.surface.ground, settings.inputs
            a, b = (ground_on_disk(path, spool, ground, inputs, run.progress) for path in paths)
            entry["points"] = [preflight(path).count for path in paths]
            b = b if transform is None else b.moved(transform)
            refuse_other_heights(a, b)
            return a, b, CloudFile.of(paths[1], inputs, transform=transform, colours=True)
        first = read_cloud(paths[0], settings.inputs, progress=run.progress)
        second = read_cloud(paths[1], settings.inputs, colours=True, progress=run.progress)
        entry["points"] = [len(first.xyz), len(second.xyz)]
        if transform is not None:
            second = replace(second, xyz=transform.apply(second.xyz))
        held = [ground_of(cloud, settings.surface.ground, run.progress) for cloud in (first, second)]
        refuse_other_heights(held[0], held[1])
    return held[0], held[1], second


def _difference(
    run: Run,
    clouds: tuple[Cloud, Cloud],
    settings: Settings,
    registered: KnownRegistration,
    stable: Path | None,
) -> Change:
    with run.step("change", 0.3, 0.5, "differencing"):
        error = registered.error
        areas = Areas(stable=stable_area(stable, clouds[0].crs, run.progress))
        change = compare_pair(*clouds, settings.change, areas, error or 0.0, run.progress)
        if error is None and settings.change.registration_error == AUTO:
            run.progress.warning(
                "The registration's error is not known here, so the level of detection covers the scatter of the "
                "points alone; give the registration_error that the registration reported."
            )
        return change
