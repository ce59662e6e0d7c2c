"""The surveys of a series made comparable: ground, registration to the first, cells on one grid; kept and reused."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from pyproj import CRS
from shapely.geometry.base import BaseGeometry

from ..engine.change.epoch_cells import epoch_cells, epoch_moments
from ..engine.core.arrays import Float
from ..engine.core.errors import InputError
from ..engine.core.json_values import plain
from ..engine.core.messages import shown
from ..engine.core.named_progress import NamedProgress
from ..engine.core.progress import Progress
from ..engine.core.staged_outputs import Stage
from ..engine.displacement.registered import Registered
from ..engine.epochs.epoch import Epoch
from ..engine.geometry.rigid_transform import RigidTransform, registration_facts
from ..engine.grid.cell_statistics import CellStatistics
from ..engine.grid.chosen_cell import CellChoice
from ..engine.grid.grid import Grid
from ..engine.grid.kept_moments import KeptMoments
from ..engine.ground.corrected_ground import correct_ground
from ..engine.ground.extraction import extract_ground
from ..engine.ground.shared_ground import shared_ground
from ..engine.ground.tiles.memory import shared_memory
from ..engine.pointcloud.in_parts import SpooledCloud, spool
from ..engine.pointcloud.pdal_program import Pdal
from ..engine.pointcloud.reading import open_cloud, read_cloud
from ..engine.series.comparisons import GriddedEpoch
from ..engine.series.first_grid import grid_of
from ..engine.vector.area import read_roi
from ..engine.vector.corrections import Corrections
from ..interface.corrections import EXCLUDE, NOT_GROUND
from .pair import Cloud, common_area, excluded_area, is_large, register_pair, survey_of
from .series_store import Entry, Store, key_of, load_cells, save_cells
from .settings import SeriesSettings
from .shared_ground import ClassifiedSurvey, load_found, save_found, write_completed

GROUND = "ground.laz"
_AT_ONCE = 2  # surveys whose ground is found at the same time


@dataclass(frozen=True)
class Task:
    """What the surveys are prepared with. ``hashes`` are those of the clouds."""

    epochs: tuple[Epoch, ...]
    hashes: tuple[str, ...]
    settings: SeriesSettings
    roi: Path | None
    stable: Path | None
    roi_hash: str
    stable_hash: str
    program: Pdal | None
    stage: Stage
    corrections: Corrections | None = None

    def corrected(self, number: int) -> Corrections | None:
        """The corrections that hold for a survey; None without any."""
        found = None if self.corrections is None else self.corrections.of(self.epochs[number].date)
        return found if found is not None and found.areas else None


def prepare_epochs(task: Task, folder: Path, progress: Progress) -> tuple[list[GriddedEpoch], Grid, CRS, CellChoice]:
    """Every survey's cells, the first one's grid, the reference system, and how the cell came about.

    Args:
        folder: for the points of large surveys while they are in use.

    Raises:
        InputError: a cloud cannot be used, or it does not overlap the first; the message names it.
    """
    store = Store(task.stage)
    names = [e.name for e in task.epochs]
    shares: list[Progress] = [NamedProgress(s, n) for s, n in zip(progress.split(names), names, strict=True)]
    with progress.stage(0.0, 0.6, "extracting the ground"):
        grounds = _grounds(task, store, shares)
    paths = [e.path if g is None else g.path for e, g in zip(task.epochs, grounds, strict=True)]
    # of two surveys at a time, as everywhere
    spool_folder = folder if any(is_large([path, path]) for path in paths) else None
    first = _ground_cloud(task, 0, grounds[0], spool_folder, shares[0])
    xyz, plants = survey_of(first)
    with_plants = first.values > 0 if isinstance(first, SpooledCloud) else plants is not None
    grid, choice = grid_of(xyz, task.settings.change, with_plants=with_plants, progress=progress)
    kept = _Kept(grounds, first, grid, store, spool_folder)
    found = []
    for number in range(len(task.epochs)):
        low, high = (0.6 + 0.4 * n / len(task.epochs) for n in (number, number + 1))
        with progress.stage(low, high, f"{task.epochs[number].name}: registering and gridding"):
            found.append(_gridded(task, number, kept, shares[number]))
    return found, grid, first.crs, choice


@dataclass(frozen=True)
class _Kept:
    """What is there for every survey: the grounds, the first one's points and grid, the entries, and where points go
    that stay on the disk (None: they are held).
    """

    grounds: Sequence[Entry | None]
    first: Cloud
    grid: Grid
    store: Store
    folder: Path | None


def _grounds(task: Task, store: Store, shares: list[Progress]) -> list[Entry | None]:
    """The ground of every survey, two at a time; None where the cloud itself is the ground."""
    if task.settings.series.ground_ready:
        return [None] * len(task.epochs)

    parameters = shared_memory(task.settings.ground, min(_AT_ONCE, len(task.epochs)))

    def ground(number: int) -> Entry:
        def make(path: Path) -> dict[str, Any]:
            result = extract_ground(
                task.epochs[number].path,
                path,
                roi=task.roi,
                parameters=parameters,
                inputs=task.settings.inputs,
                pdal=task.program,
                final=task.stage.final(path.parent.name),
                progress=shares[number],
            )
            if sentence := result.sentence():
                shares[number].info(sentence)
            return ground_facts(result.figures(), plain(result), f"{path.parent.name}/{result.classified.name}")

        found = store.entry(GROUND, _ground_key(task, number, corrected=False), make, shares[number])
        corrections = task.corrected(number)
        return found if corrections is None else _corrected(task, number, found, corrections, store, shares[number])

    with ThreadPoolExecutor(max_workers=_AT_ONCE) as pool:
        return list(pool.map(ground, range(len(task.epochs))))


def _corrected(
    task: Task, number: int, found: Entry, corrections: Corrections, store: Store, progress: Progress
) -> Entry:
    """The ground of a survey as corrected; what the extraction found is kept apart, so that it is not made again."""
    classified = found.path.parent / Path(found.facts["classified"]).name
    clipped = classified.with_name(classified.name.replace("classified", "clipped"))

    def make(path: Path) -> dict[str, Any]:
        of_path = path.with_name(path.name.replace("ground", "classified"))
        scatter, threshold = (float(found.facts[name]) for name in ("scatter", "threshold"))
        correct_ground((clipped, classified), (of_path, path), corrections, scatter=scatter, threshold=threshold)
        facts = {name: value for name, value in found.facts.items() if name != "warnings"}
        return facts | {"classified": f"{path.parent.name}/{of_path.name}"}

    return store.entry(GROUND, _ground_key(task, number), make, progress)


def ground_facts(figures: dict[str, Any], result: dict[str, Any], classified: str) -> dict[str, Any]:
    """What is kept with the ground of a survey.

    Args:
        figures: of the extraction, by name.
        result: the extraction as plain values.
        classified: name of the classified cloud.
    """
    return figures | {"warnings": result["warnings"], "cover": result["cover"], "classified": classified}


def _ground_key(task: Task, number: int, *, corrected: bool = True) -> str:
    settings, program = task.settings, task.program
    key = ground_key(
        task.hashes[number],
        task.roi_hash,
        asdict(settings.inputs),
        None if settings.series.ground_ready else asdict(settings.ground),
        None if program is None else program.version,
    )
    corrections = task.corrected(number) if corrected else None
    if corrections is None:
        return key
    shapes = [(area.action, area.shape.wkt) for area in corrections.areas]
    return key_of(ground=key, corrections=shapes)


def ground_key(cloud: str, roi: str, inputs: dict[str, Any], ground: dict[str, Any] | None, pdal: str | None) -> str:
    """What the ground of a survey depends on: hashes of cloud and region, all parameters, and the version of PDAL.

    In tiles the ground is the same but for a few points at their edges, so the memory that it may take is no part.

    Args:
        ground: None where the cloud is the ground.
    """
    if ground is not None:
        ground = {name: value for name, value in ground.items() if name != "ground_memory"}
    return key_of(cloud=cloud, roi=roi, inputs=inputs, ground=ground, pdal=pdal)


def _ground_cloud(task: Task, number: int, ground: Entry | None, folder: Path | None, progress: Progress) -> Cloud:
    """The ground of a survey, in memory, or in a ``folder`` on the disk."""
    path = task.epochs[number].path if ground is None else ground.path
    inputs = task.settings.inputs if ground is None else None
    area = _area(task, number, path, progress) if ground is None else None
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        stored = spool(path, inputs, folder / f"{number}.points", area=area, progress=progress)
        _refuse_empty(len(stored), path, task)
        return stored
    cloud = read_cloud(path, inputs, progress=progress)
    if area is None:
        return cloud
    shapely.prepare(area)
    inside = shapely.contains_xy(area, cloud.xyz[:, 0], cloud.xyz[:, 1])
    _refuse_empty(int(np.count_nonzero(inside)), path, task)
    plants = (None if v is None else v[inside] for v in (cloud.plant_error, cloud.plant_height))
    error, height = plants
    return replace(cloud, xyz=cloud.xyz[inside], classification=None, plant_error=error, plant_height=height)


def _area(task: Task, number: int, path: Path, progress: Progress) -> BaseGeometry | None:
    """Where the points of a ground cloud are taken; None for everywhere."""
    area, corrections = None, task.corrected(number)
    if task.roi is not None:
        region = read_roi(task.roi, open_cloud(path, task.settings.inputs)[1].crs)
        for note in region.notes:
            progress.warning(note)
        area = region.geometry
    return area if corrections is None else corrections.outside(area, EXCLUDE, NOT_GROUND)


def _refuse_empty(points: int, path: Path, task: Task) -> None:
    if points:
        return
    if task.roi is not None:
        raise InputError(
            f"{shown(path)} has no point inside the region {shown(task.roi)}; check both and their systems."
        )
    assert task.corrections is not None
    raise InputError(f"The corrections {shown(task.corrections.path)} leave no ground; make their areas smaller.")


def _gridded(task: Task, number: int, kept: _Kept, progress: Progress) -> GriddedEpoch:
    epoch, settings, ground, first = task.epochs[number], task.settings, kept.grounds[number], kept.first
    made = [] if ground is None or ground.reused else ["ground"]
    own: list[Cloud] = [first] if number == 0 else []

    def cloud() -> Cloud:
        """Read only where something has to be computed from it."""
        if not own:
            own.append(_ground_cloud(task, number, ground, kept.folder, progress))
        return own[0]

    transform, error, facts, key = RigidTransform.identity(), 0.0, {}, _ground_key(task, number)
    registered = Registered.shift(0.0, 0.0)
    if number:
        key = _registration_key(task, number)
        entry = _registration(task, number, first, cloud, kept.store, progress)
        transform = RigidTransform.load(entry.path)
        error, facts = float(registration_facts(entry.path)["registration_error_m"]), dict(entry.facts)
        registered = Registered.of_transform(entry.path)
        made += [] if entry.reused else ["registration"]
        completed = _completed(task, number, kept, transform, progress)
        if completed is not ground:
            ground = completed
            own.clear()

    def grid_cells(path: Path) -> dict[str, Any]:
        xyz, plants = survey_of(cloud())
        moved = xyz.moved(transform) if isinstance(xyz, SpooledCloud) else transform.apply(xyz)
        if settings.change.grows:
            save_cells(path, epoch_moments(moved, kept.grid, plants))
        else:
            save_cells(path, epoch_cells(moved, kept.grid, settings.change, plants))
        return {"points": len(xyz)}

    entry = kept.store.entry("cells.npz", _cells_key(task, number, kept.grid, key), grid_cells, progress)
    made += [] if entry.reused else ["cells"]
    facts |= {"ground_points": entry.facts["points"]}
    if ground is not None:
        # for the report; what an older version kept has no cover
        kept_facts = ("classified", "cover", "shared_points")
        facts |= {name: ground.facts[name] for name in kept_facts if ground.facts.get(name)}
    if number and own and isinstance(own[0], SpooledCloud):
        own[0].file.unlink()
    return GriddedEpoch(
        epoch=epoch,
        transform=transform,
        registration_error=error,
        registered=registered,
        load=partial(load_cells, entry.path),
        points=partial(_points, task, number, ground, transform),
        stored=partial(_stored, task, number, ground, transform),
        ground=epoch.path if ground is None else ground.path,
        key=key_of(ground=_ground_key(task, number), transform=key),
        area=common_area(task.roi, first, transform),
        excluded=excluded_area(task.corrected(number), first, transform),
        facts={k: v for k, v in facts.items() if k != "warnings"},
        made=tuple(made),
    )


def _cells_key(task: Task, number: int, grid: Grid, transform: str) -> str:
    """What the cells of a survey depend on; ``transform`` is the key of its own."""
    change = task.settings.change
    return key_of(
        ground=_ground_key(task, number),
        transform=transform,
        grid=asdict(grid),
        cell_value=change.cell_value,
        arrays=[f.name for f in fields(KeptMoments if change.grows else CellStatistics)],
    )


def _completed(task: Task, number: int, kept: _Kept, transform: RigidTransform, progress: Progress) -> Entry | None:
    """The ground of a survey completed with the first one's; as it is if that adds nothing. The first one's stays."""
    first, ground = kept.grounds[0], kept.grounds[number]
    parameters = task.settings.ground
    if first is None or ground is None or parameters.ground != "extract" or not parameters.refine:
        return ground
    classified = [entry.path.parent / Path(entry.facts["classified"]).name for entry in (first, ground)]
    if is_large(classified):
        return ground
    key = key_of(shared=_registration_key(task, number))

    def find(path: Path) -> dict[str, Any]:
        other = ClassifiedSurvey(classified[0], RigidTransform.identity(), task.corrected(0)).read(parameters)
        own = ClassifiedSurvey(classified[1], transform, task.corrected(number)).read(parameters)
        found = shared_ground(own, other, parameters.class_threshold)
        save_found(path, found)
        return {"points": len(found.index)}

    added = kept.store.entry("shared.npz", key, find, progress)
    if not added.facts["points"]:
        return ground

    def write(path: Path) -> dict[str, Any]:
        of_path = path.with_name(path.name.replace("ground", "classified"))
        write_completed(classified[1], (of_path, path), load_found(added.path))
        facts = {name: value for name, value in ground.facts.items() if name != "warnings"}
        return facts | {"classified": f"{path.parent.name}/{of_path.name}", "shared_points": added.facts["points"]}

    return kept.store.entry(GROUND, key, write, progress)


def _points(task: Task, number: int, ground: Entry | None, transform: RigidTransform) -> Float:
    """The ground of a survey in the frame of the first one (n, 3), metres, read anew; not for large surveys."""
    return transform.apply(np.asarray(survey_of(_ground_cloud(task, number, ground, None, Progress()))[0]))


def _stored(task: Task, number: int, ground: Entry | None, transform: RigidTransform, folder: Path) -> SpooledCloud:
    """The same in a ``folder`` on the disk."""
    cloud = _ground_cloud(task, number, ground, folder, Progress())
    assert isinstance(cloud, SpooledCloud)
    return cloud.moved(transform)


def _registration_key(task: Task, number: int) -> str:
    return key_of(
        first=_ground_key(task, 0),
        moving=_ground_key(task, number),
        registration=asdict(task.settings.registration),
        stable=task.stable_hash,
    )


def _registration(
    task: Task, number: int, first: Cloud, cloud: Callable[[], Cloud], store: Store, progress: Progress
) -> Entry:
    """The transform of a survey to the first one; ``cloud`` reads its ground, where it must be made."""
    epoch, parameters = task.epochs[number], task.settings.registration

    def register(path: Path) -> dict[str, Any]:
        try:
            result = register_pair(first, cloud(), parameters, task.stable, progress)
        except InputError as wrong:
            raise InputError(f"{epoch.name}: {wrong}") from wrong
        result.transform.save(path, first.crs, facts=plain(result.summary()))
        return result.figures() | {"warnings": list(result.warnings)}

    return store.entry("transform.json", _registration_key(task, number), register, progress)
