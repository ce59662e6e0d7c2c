"""The command `demchange`: elevation models of two or more dates in, change, level of detection and zones out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from shapely import box

from ..engine.change.difference import cells_inside
from ..engine.core.arrays import Bool
from ..engine.core.errors import InputError
from ..engine.core.messages import shown
from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..engine.elevation_models.checks import refuse_other_ground, refuse_other_systems
from ..engine.elevation_models.comparison import ModelChange, TakenOff, compare_models
from ..engine.elevation_models.coregistration import MIN_EQUATIONS, TooFewCells
from ..engine.elevation_models.model import ElevationModel, read_model
from ..engine.elevation_models.one_grid import on_one_grid
from ..engine.elevation_models.sentences import coregistration_facts, stable_doubt, trend_warning
from ..engine.epochs.epoch import Epoch, parse_date, same_content
from ..engine.geometry.rigid_transform import RigidTransform
from ..engine.maps.relief import shaded_relief
from ..engine.maps.top_view import TopView
from ..engine.zones.profile_lines import ProfileLine, given_lines
from ..engine.zones.profiles import PROFILE_OUTPUTS
from ..interface.dates import date_in_name
from ..interface.parameters import given
from .layer_files import NO_LAYERS, LayerFiles
from .layers import read_layers
from .pair import stable_area
from .products.change import CHANGE_OUTPUTS, Context, write_products
from .products.classes import CLASS_OUTPUTS
from .products.demchange import DEM_OUTPUTS, Pair, write_pairs, write_statistics
from .run import Run
from .settings import ModelSettings, Settings, groups

_METHOD = "difference of elevation models"
_NOT_WRITTEN = {"point_counts.tif"}


def parse_model(text: str) -> Epoch:
    """An elevation model written as YYYY-MM-DD=DEM, or as DEM, whose name may hold the date.

    Raises:
        InputError: what stands before the sign is no date.
    """
    day, separator, path = text.partition("=")
    if separator and path and not Path(text).is_file():
        return Epoch(Path(path), parse_date(day))
    return Epoch(Path(text), date_in_name(Path(text)))


def demchange_step(
    models: Sequence[Epoch],
    output_dir: Path,
    settings: ModelSettings,
    *,
    stable: Path | None = None,
    profiles: Path | None = None,
    layers: LayerFiles = NO_LAYERS,
    overwrite: bool = False,
    progress: Progress,
) -> RunResult:
    """Change between elevation models: the products of the first and the last, and of three or more their series."""
    _refuse(models)
    names = _names(models)
    inputs: list[tuple[str, Path | None]] = [(f"epoch {n}", m.path) for n, m in zip(names, models, strict=True)]
    words = ("inputs", "elevation_models", "zones", "road", "assets", "heatmap", "report", "details")
    inputs += [("stable", stable), ("profiles", profiles), *layers.inputs]
    run = Run("demchange", groups(settings, *words), inputs, progress)
    outputs = ["report.pdf", *(name for name in CHANGE_OUTPUTS if name not in _NOT_WRITTEN)]
    others = (*outputs, *(name for name in DEM_OUTPUTS if name != "pairs.csv"), *PROFILE_OUTPUTS, *CLASS_OUTPUTS)
    brief = settings.elevation_models.statistics_only
    run.refuse_folder(output_dir, ("run.json", "pairs.csv", *others), overwrite=overwrite)
    if brief and any((output_dir / name).exists() for name in others):
        raise InputError(f"{shown(output_dir)} holds rasters or zones; give statistics alone a folder of their own.")
    run.read_reviews(output_dir, ("zones.gpkg",))
    hashes = run.hash_inputs()[: len(models)]
    with run.writing(output_dir, report=not brief):
        with run.step("read", 0.0, 0.15, "reading"):
            read = _read(run, models, settings)
        crs, grid = read[0].crs, read[0].grid
        area = stable_area(stable, crs, run.progress)
        lines = given_lines(profiles, crs, settings.report.profile_field, run.progress)
        run.related = read_layers(layers, (settings.road, settings.assets), crs, box(*grid.bounds), run.progress)
        given_cells = None if area is None else cells_inside(area, grid)
        if given_cells is not None and not given_cells.any():
            raise InputError(
                f"{shown(stable or '')} holds no whole cell of {grid.cell:g} m of the models' common part."
            )
        with run.step("change", 0.15, 0.7, "comparing"):
            pairs = _compare(run, read, _dated(models, names), settings, given_cells)
        whole = next(pair for pair in pairs if pair.indices == (0, len(models) - 1))
        if brief:
            write_statistics(run, pairs, whole)
        else:
            with run.step("products", 0.7, 0.99, "writing outputs"):
                _write_products(run, pairs, whole, hashes, settings, lines)
            run.finish_reviews()
        run.outputs["run"] = run.record_path
    return run.result()


def _write_products(
    run: Run,
    pairs: Sequence[Pair],
    whole: Pair,
    hashes: tuple[str, ...],
    settings: ModelSettings,
    lines: Sequence[ProfileLine],
) -> None:
    context = Context(
        first=whole.first,
        second=whole.second,
        crs=whole.crs,
        transform=_transform(whole.found),
        input_hashes=hashes,
        method=_METHOD,
        run_id=run.run_id(hashes),
        counted=False,
        several=True,
    )
    bundle = replace(Settings(), zones=settings.zones, heatmap=settings.heatmap, report=settings.report)
    view = TopView(_relief(whole.found), whole.change.grid, "height")
    write_products(run, whole.change, view, context, bundle, lines)
    write_pairs(run, pairs, whole, context)
    run.facts["run_id"] = context.run_id


def _refuse(models: Sequence[Epoch]) -> None:
    if len(models) < 2:
        raise InputError(f"{len(models)} elevation model was given; give two or more, the earliest first.")
    for model in models:
        if not model.path.is_file():
            raise InputError(f"{shown(model.path)} does not exist or is not a file; check the path.")
    for before, after in pairwise([model for model in models if model.date]):
        if before.date and after.date and before.date >= after.date:
            raise InputError(
                f"{shown(after.path)} is of {after.date}, not later than {shown(before.path)} of {before.date}; give "
                "the models in order, the earliest first."
            )
    for i, first in enumerate(models):
        for second in models[i + 1 :]:
            if same_content(first.path, second.path):
                raise InputError(
                    f"{shown(first.path)} and {shown(second.path)} are the same file; give elevation models of two "
                    "dates."
                )


def _names(models: Sequence[Epoch]) -> list[str]:
    """By their days where all are known, else by their files, which differ."""
    if all(model.date for model in models):
        return [model.name for model in models]
    names = [model.path.stem for model in models]
    return names if len(set(names)) == len(names) else [f"{i} {name}" for i, name in enumerate(names, 1)]


def _dated(models: Sequence[Epoch], names: Sequence[str]) -> list[Epoch]:
    """With a path whose stem is the name, as an epoch without a day is called by it."""
    return [
        model if model.date else replace(model, path=Path(f"{name}.tif"))
        for model, name in zip(models, names, strict=True)
    ]


def _read(run: Run, models: Sequence[Epoch], settings: ModelSettings) -> list[ElevationModel]:
    """All models on one grid, checked against the first."""
    read = []
    for number, model in enumerate(models):
        run.progress.update(number / len(models), f"reading {model.path.name}")
        read.append(read_model(model.path, settings.inputs))
    notes = [note for model in read for note in model.notes]
    notes += [note for model in read[1:] if (note := refuse_other_systems(read[0], model))]
    aligned, sentences = on_one_grid(read, given(settings.elevation_models.cell))
    sentences = [*(model.regridded for model in read if model.regridded), *sentences]
    for before, after in pairwise(aligned):
        refuse_other_ground(before, after, settings.elevation_models.maximum_bias)
    for note in dict.fromkeys(notes):
        run.progress.warning(note)
    for sentence in sentences:
        run.progress.info(sentence)
    run.facts["elevation_models"] = [
        {
            "file": own.path.name,
            "cell_m": own.grid.cell,
            "rows": own.grid.rows,
            "columns": own.grid.columns,
            "vertical_system": own.vertical or None,
            "height_step_m": own.step,
            "unknown_cells": own.holes,
        }
        for own in read
    ]
    run.facts["one_grid"] = sentences
    return aligned


def _compare(
    run: Run, models: Sequence[ElevationModel], epochs: Sequence[Epoch], settings: ModelSettings, stable: Bool | None
) -> list[Pair]:
    """Each model against the first, and against the one before."""
    indices = dict.fromkeys([*((0, i) for i in range(1, len(models))), *pairwise(range(len(models)))])
    pairs = []
    for number, (i, j) in enumerate(indices):
        first, second = models[i], models[j]
        run.progress.update(number / len(indices), f"comparing {epochs[i].name} and {epochs[j].name}")
        try:
            found = compare_models(
                first.heights,
                second.heights,
                first.grid,
                confidence=settings.elevation_models.confidence,
                stable=stable,
                taken_off=TakenOff(settings.elevation_models.plan_shift, settings.elevation_models.tilt),
                steps=(first.step, second.step),
            )
        except TooFewCells as error:
            raise InputError(
                f"{shown(first.path)} and {shown(second.path)} have fewer than {MIN_EQUATIONS} common cells of stable "
                "ground; give models with a larger common part, or a larger --stable area."
            ) from error
        pair = Pair((i, j), epochs[i], epochs[j], first.crs, found)
        pairs.append(pair)
        facts = coregistration_facts(found, pair.first.name, pair.second.name)
        for sentence in facts["sentences"]:
            run.progress.info(sentence)
        said = (warning(found, pair.first.name, pair.second.name) for warning in (stable_doubt, trend_warning))
        for doubt in (*said, *found.notes):
            if doubt:
                run.progress.warning(doubt)
    return pairs


def _transform(found: ModelChange) -> RigidTransform:
    """What moves the later model onto the earlier."""
    c = found.coregistration
    return RigidTransform(np.eye(3), -np.array([c.east, c.north, c.bias]), np.zeros(3))


def _relief(found: ModelChange) -> np.ndarray:
    """The later model's hillshade (rows, columns, 4), transparent where nothing is known."""
    heights = found.change.height_to
    rgba = np.zeros((*heights.shape, 4), dtype=np.uint8)
    rgba[..., :3] = np.clip(np.rint(shaded_relief(heights, found.change.grid.cell)), 0, 255)
    rgba[..., 3] = np.where(np.isfinite(heights), 255, 0)
    return rgba
