"""More than two surveys of one slope: change in steps and in all, velocities, zones through time, alert levels."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date
from itertools import pairwise
from pathlib import Path
from typing import Any

from geopandas import GeoDataFrame
from shapely.geometry.base import BaseGeometry

from ..engine.core import cancellation
from ..engine.core.arrays import Float
from ..engine.core.earlier_results import earlier_series, refuse_another_series, refuse_results
from ..engine.core.json_values import plain
from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..engine.epochs.comparability import require_comparable
from ..engine.epochs.dating import check_days
from ..engine.epochs.epoch import Epoch
from ..engine.epochs.manifest import check_series
from ..engine.report.facts import ROAD_WORDS, course_rows, zone_rows
from ..engine.series.alerts import AlertLevel, read_alerts
from ..engine.series.analysis import Analysis, analyse, limits_of, with_ground
from ..engine.series.comparisons import GriddedEpoch
from ..engine.series.first_grid import held_whole
from ..engine.series.tables import About
from ..engine.series.tracking import Track
from ..engine.series.velocity import cell_velocity
from ..engine.vector.corrections import Corrections
from ..interface.parameters import GridChangeParameters
from .corrections import corrections_of, refuse_forced_ground
from .early_memory import refuse_grid_early
from .ground_choice import check_ground, with_one_ground
from .layer_files import NO_LAYERS, LayerFiles
from .layers import layers_on_cloud
from .motion_memory import MotionMemory
from .odd_surveys import comparisons_of, one_a_day, overlapping, say_days, say_odd_comparisons
from .pair import SPOOL, stable_area
from .products.classes import CLASS_OUTPUTS
from .products.series import (
    SERIES_OUTPUTS,
    raster_names,
    series_figures,
    write_class_table,
    write_coverage,
    write_epoch_rasters,
    write_summary_rasters,
    write_tables,
)
from .products.series_motion import SERIES_MOTION_OUTPUTS, motion_figures, write_motion
from .run import Run
from .series_continued import say_changed_figures, say_recomputed
from .series_motion import SeriesMotion, measure_motion
from .series_preparation import Task, prepare_epochs
from .settings import SeriesSettings, groups

REPORTED = (
    "found_by",
    "motion_zone",
    "status",
    "alert",
    "alert_state",
    "alert_since",
    "alert_reason",
    "body",
    "action",
    "trend",
    "velocity_class",
    "first_seen",
    "last_seen",
    "failure_from",
    "failure_to",
    "failure_note",
    *ROAD_WORDS,
)
"""Fields with words that the run record and the report have of each zone."""
_RECORDED = (
    "inputs", "dates", "ground", "registration", "change", "zones", "road", "assets", "series", "displacement_step",
    "details",
)  # fmt: skip


def monitor_series(
    epochs: Sequence[Epoch],
    output_dir: Path,
    settings: SeriesSettings | None = None,
    *,
    roi: Path | None = None,
    stable: Path | None = None,
    alerts: Path | None = None,
    layers: LayerFiles = NO_LAYERS,
    pdal: Path | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> RunResult:
    """Bring all surveys to the first one's frame and grid, and report what moved, how fast, and how certain that is.

    Ground, registration and cells of each survey are kept in the folder ``work`` of the outputs and used again by a
    later run with the same parameters, so that for a further survey only that one is computed.

    Args:
        epochs: the surveys, the earliest first (see ``manifest.epochs_of``).
        output_dir: folder for the outputs; made if missing.
        roi: vector file whose polygons bound the managed slope.
        stable: vector file whose polygons are known to be stable.
        alerts: alert table, if another than the one that comes with SlopeWatch.
        layers: the road's centreline, polygons of classes of asset, and corrections by hand.
        pdal: the pdal program, if another than the one found.
        overwrite: replace whatever results the folder holds. A series that this one goes on with, by more surveys and
            with the same settings, is replaced without it, because that is how a series is kept. What people entered
            in its zones is carried over either way.

    Raises:
        InputError: something given cannot be used; nothing is written then.
    """
    settings, progress = with_one_ground(settings or SeriesSettings()), progress or Progress()
    check_series(epochs)
    epochs = one_a_day(epochs, None if overwrite else earlier_series(output_dir), progress)
    table = read_alerts(alerts)
    inputs = [*((f"epoch {e.name}", e.path) for e in epochs), ("roi", roi), ("stable", stable), ("alerts", alerts)]
    inputs += layers.inputs
    run = Run("series", groups(settings, *_RECORDED), inputs, progress)
    earlier = _earlier_series(run, output_dir, _dates(epochs), overwrite=overwrite)
    run.read_reviews(output_dir, ("series.gpkg",))
    program = None if settings.series.ground_ready else run.find_pdal(pdal)
    hashes, (roi_hash, stable_hash) = (every := run.hash_inputs())[: len(epochs)], every[len(epochs) : len(epochs) + 2]
    epochs, hashes = _of_one_slope(run, epochs, hashes, settings, roi, earlier)
    if earlier is not None:
        refuse_another_series(output_dir, earlier, run.record)
    say_days(dates := _dates(epochs), run.progress)
    corrections = _given_layers(run, layers, epochs, settings, roi)
    refuse_grid_early([epochs[0].path], settings.inputs, held_whole(settings.change), roi)
    with run.writing(output_dir, report=True) as stage, cancellation.temporary(stage.folder / SPOOL) as spool:
        task = Task(epochs, hashes, settings, roi, stable, roi_hash, stable_hash, program, stage, corrections)
        with run.step("surveys", 0.0, 0.6) as entry:
            gridded, grid, crs, choice = prepare_epochs(task, spool, run.progress)
            entry["epochs"] = {g.epoch.name: g.facts | {"made": g.made} for g in gridded}
            say_recomputed(gridded, earlier, run.progress)
        area = stable_area(stable, crs, run.progress)
        with run.step("change", 0.6, 0.7, "comparing"):
            analysis = analyse(
                gridded, grid, (settings.change, settings.zones), table, spool, stable=area, progress=run.progress
            )
        say_odd_comparisons(dates, comparisons_of(analysis.cumulative), run.progress)
        about = About(dates, crs, grid, method_of(settings.change), run.run_id(hashes))
        motion = _motion(run, task, gridded, analysis.stack.days, area)
        if motion is not None:
            analysis = with_ground(analysis, motion.ground, motion.layout, grid, settings.zones, table)
        frame, course = write_products(run, analysis, about, table, task.hashes, settings.series.rasters_each_survey)
        run.finish_reviews()
        run.figures = series_figures(frame, analysis.cumulative, analysis.incremental, about)
        if motion is not None:
            run.outputs |= write_motion(motion, analysis.zones, about, hashes, stage)
            run.figures |= motion_figures(motion, frame)
        write_coverage(run, analysis, about)
        run.figures["dropped_zones"] = analysis.unconfirmed
        transforms = {g.epoch.name: g.transform.matrix for g in gridded}
        run.facts |= {"cell": choice.facts()} | series_facts(analysis, about, table, transforms, motion)
        run.facts |= zone_facts(analysis, about, frame, course)
        _say(run, earlier)
    return run.result()


def _given_layers(
    run: Run, layers: LayerFiles, epochs: tuple[Epoch, ...], settings: SeriesSettings, roi: Path | None
) -> Corrections | None:
    """Read what zones and change are related to, and the corrections by hand, which it returns."""
    related = (settings.road, settings.assets)
    run.related = layers_on_cloud(layers, related, epochs[0].path, settings.inputs, run.progress)
    corrections = corrections_of(layers.corrections, epochs, roi, settings.inputs, run.progress)
    if corrections is not None:
        refuse_forced_ground(corrections, settings.ground.ground)
        run.facts["corrections"] = corrections.facts()
    return corrections


def method_of(parameters: GridChangeParameters) -> str:
    """How the change was taken, for the zones' column ``method``."""
    return "series (cells that grow)" if parameters.grows else f"series ({parameters.cell_value} cells)"


def _say(run: Run, earlier: dict[str, Any] | None) -> None:
    for sentence in run.facts["limits"]:
        run.progress.info(sentence)
    say_changed_figures(run.facts, earlier, run.progress)


def _dates(epochs: Sequence[Epoch]) -> tuple[date, ...]:
    return tuple(e.date for e in epochs if e.date is not None)


def _of_one_slope(
    run: Run,
    epochs: tuple[Epoch, ...],
    hashes: tuple[str, ...],
    settings: SeriesSettings,
    roi: Path | None,
    earlier: dict[str, Any] | None,
) -> tuple[tuple[Epoch, ...], tuple[str, ...]]:
    """The surveys that can be compared, with their hashes; the others are no inputs of the run."""
    check_days(epochs, trusted=settings.dates.trust_dates, progress=run.progress)
    for epoch in epochs[1:]:
        require_comparable(epochs[0].path, epoch.path, settings.inputs)
    offset = 0.0 if settings.registration.method == "none" else settings.registration.maximum_offset
    kept = overlapping(epochs, settings.inputs, roi, offset, run.progress, earlier=earlier)
    check_ground(kept, settings.ground.ground, run.progress)
    left = {f"epoch {e.name}" for e in epochs if e not in kept}
    run.record.inputs = [i for i in run.record.inputs if i["role"] not in left]
    return kept, tuple(h for e, h in zip(epochs, hashes, strict=True) if e in kept)


def _earlier_series(run: Run, folder: Path, dates: tuple[date, ...], *, overwrite: bool) -> dict[str, Any] | None:
    """The record of the series in the folder that this one may go on with; other results there are refused."""
    run.refuse_outputs(_targets(folder, dates))
    earlier = None if overwrite else earlier_series(folder)
    if earlier is None:
        refuse_results(folder, (*SERIES_OUTPUTS, *SERIES_MOTION_OUTPUTS), overwrite=overwrite)
    return earlier


def _motion(
    run: Run, task: Task, gridded: Sequence[GriddedEpoch], days: Float, stable: BaseGeometry | None
) -> SeriesMotion | None:
    """Motion along the surface, where it is asked for and the ground allows it."""
    if not task.settings.displacement_step.displacement:
        return None
    with run.step("displacement", 0.7, 0.88, "measuring motion along the surface") as entry:
        memory = MotionMemory.of(task.settings.change.memory_limit)
        motion = measure_motion(gridded, days, task.stage, stable, memory, run.progress)
        entry["windows"] = 0 if motion is None else len(motion.layout.cell)
    return motion


def write_products(
    run: Run,
    analysis: Analysis,
    about: About,
    alerts: tuple[AlertLevel, ...],
    hashes: Sequence[str],
    every_raster: bool,
) -> tuple[GeoDataFrame, GeoDataFrame]:
    """Write rasters, tables and picture; the table of the zones and that of their series.

    Args:
        hashes: SHA-256 of the surveys.
        every_raster: also those of each survey against the first and the one before.
    """
    with run.step("products", 0.88, 0.99, "writing outputs"):
        if every_raster:
            for kind, changes in (("cumulative", analysis.cumulative), ("incremental", analysis.incremental)):
                write_epoch_rasters(run, kind, changes, about, hashes)
        stack = analysis.stack
        velocity = cell_velocity(stack.days, list(stack.change), list(stack.variance))
        run.outputs |= write_summary_rasters(
            velocity, analysis.confirmed, velocity.count >= 2, about, hashes, run.stage
        )
        write_class_table(run, analysis, about)
        footer = limits_of(analysis, about.dates)[0]
        return write_tables(run, analysis, velocity, about, alerts, footer)


def series_facts(
    analysis: Analysis,
    about: About,
    alerts: tuple[AlertLevel, ...],
    transforms: dict[str, Float],
    motion: SeriesMotion | None,
) -> dict[str, Any]:
    """What the record and the report state about the surveys."""
    return {
        "run_id": about.run_id,
        "reference_system": {"name": about.crs.name, "epsg": about.crs.to_epsg()},
        "limits": limits_of(analysis, about.dates, None if motion is None else motion.sentence()),
        "motion": None if motion is None else motion.facts(),
        "alerts": [plain(row) for row in alerts],
        "transforms": transforms,
        "dates": [d.isoformat() for d in about.dates],
    }


def zone_facts(analysis: Analysis, about: About, frame: GeoDataFrame, course: GeoDataFrame) -> dict[str, Any]:
    """What the record and the report state about the zones."""
    zones = zone_rows(frame, REPORTED)
    return {
        "zones": zones,
        "course": course_rows(course, [row["zone_id"] for row in zones]),
        "seasons": {
            d.isoformat(): c.season.facts()
            for d, c in zip(about.dates[1:], analysis.cumulative, strict=True)
            if c.season is not None
        },
        "zone_history": {t.zone_id: _history(t, about.dates) for t in analysis.tracks},
    }


def _history(track: Track, dates: tuple[date, ...]) -> dict[str, Any]:
    return {
        "merged_into": track.merged_into,
        "split_from": track.parent,
        "surveys": [
            {"epoch": dates[s.epoch].isoformat(), "event": s.event, "others": list(s.others), "cells": len(s.cells)}
            for s in track.sightings
        ],
    }


def _targets(folder: Path, dates: tuple[date, ...]) -> list[Path]:
    names = [*SERIES_OUTPUTS, *CLASS_OUTPUTS, *SERIES_MOTION_OUTPUTS]
    for before, end in pairwise(dates):
        names += raster_names("cumulative", dates[0], end) + raster_names("incremental", before, end)
    return [folder / name for name in names]
