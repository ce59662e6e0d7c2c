"""More than two surveys of one slope: change in steps and in all, velocities, zones through time, alert levels."""

from __future__ import annotations

import uuid
from collections.abc import Sequence
from datetime import date
from itertools import pairwise
from pathlib import Path
from typing import Any

from ..engine.core.earlier_results import earlier_series, refuse_another_series, refuse_results
from ..engine.core.errors import InputError
from ..engine.core.json_values import plain
from ..engine.core.progress import Progress
from ..engine.core.run_record import RunRecord
from ..engine.core.staged_outputs import refuse_inputs_as_outputs, staged_outputs
from ..engine.epochs.comparability import require_comparable
from ..engine.epochs.dating import check_days
from ..engine.epochs.epoch import Epoch
from ..engine.epochs.manifest import check_series
from ..engine.pointcloud.pdal_program import find_pdal
from ..engine.report.facts import course_rows, zone_rows
from ..engine.series.alerts import read_alerts
from ..engine.series.analysis import analyse, limits_of
from ..engine.series.settings import SeriesSettings
from ..engine.series.tables import About
from ..engine.series.tracking import Track
from ..engine.series.velocity import cell_velocity
from ..engine.zones.earlier_reviews import EarlierReviews
from .early_memory import refuse_grid_early
from .pair import stable_area
from .products.series import (
    SERIES_OUTPUTS,
    raster_names,
    series_figures,
    write_epoch_rasters,
    write_summary_rasters,
    write_tables,
)
from .series_preparation import Task, prepare_epochs
from .write_record_and_report import write_record_and_report

REPORTED = (
    "status",
    "alert",
    "alert_reason",
    "action",
    "trend",
    "velocity_class",
    "first_seen",
    "last_seen",
    "failure_from",
    "failure_to",
    "failure_note",
)
"""Fields with words that the run record and the report have of each zone."""

Outcome = tuple[dict[str, Path], dict[str, Any]]


def monitor_series(
    epochs: Sequence[Epoch],
    output_dir: Path,
    settings: SeriesSettings | None = None,
    *,
    roi: Path | None = None,
    stable: Path | None = None,
    alerts: Path | None = None,
    pdal: Path | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Outcome:
    """Bring all surveys to the first one's frame and grid, and tell what moved, how fast, and how surely.

    Ground, registration and cells of each survey are kept in the folder ``work`` of the outputs and used again by a
    later run with the same parameters, so that another survey costs no more than itself.

    Args:
        epochs: the surveys, the earliest first (see ``manifest.epochs_of``).
        output_dir: folder for the outputs; made if missing.
        roi: vector file whose polygons bound the managed slope.
        stable: vector file whose polygons are known to be stable.
        alerts: alert table, if another than the one that comes with SlopeWatch.
        pdal: the pdal program, if another than the one found.
        overwrite: replace whatever results the folder holds. A series that this one goes on with, by more surveys and
            with the same settings, is replaced without it, because that is how a series is kept. What people entered
            in its zones is carried over either way.

    Returns:
        Paths of the outputs by name, and the main figures.

    Raises:
        InputError: something given cannot be used; nothing is written then.
    """
    settings, progress, epochs = settings or SeriesSettings(), progress or Progress(), tuple(epochs)
    check_series(epochs)
    table = read_alerts(alerts)
    if settings.change.grows:
        raise InputError(
            "Cells that grow (adaptive) are not for a series: all its surveys share one grid; "
            "give GridChangeParameters, or adaptive=False."
        )
    given = [p for p in (roi, stable, alerts) if p is not None]
    dates = tuple(e.date for e in epochs if e.date is not None)
    refuse_inputs_as_outputs(_targets(output_dir, dates), [*(e.path for e in epochs), *given])
    earlier = None if overwrite else earlier_series(output_dir)
    if earlier is None:
        refuse_results(output_dir, SERIES_OUTPUTS, overwrite=overwrite)
    reviews = EarlierReviews(output_dir, ("series.gpkg",))
    program = None if settings.series.ground_ready else find_pdal(pdal)
    record = RunRecord("series", settings.groups())
    if program is not None:
        record.facts["pdal"] = {"version": program.version, "path": program.path, "found": program.how}
    hashes = tuple(record.add_input(f"epoch {e.name}", e.path) for e in epochs)
    others = {role: record.add_input(role, p) if p else "" for role, p in (("roi", roi), ("stable", stable))}
    if alerts is not None:
        record.add_input("alerts", alerts)
    if earlier is not None:
        refuse_another_series(output_dir, earlier, record)
    run_id = uuid.uuid5(uuid.NAMESPACE_OID, repr((hashes, plain(record.parameters)))).hex[:12]
    check_days(epochs, trusted=settings.dates.trust_dates, progress=progress)
    for epoch in epochs[1:]:
        require_comparable(epochs[0].path, epoch.path, settings.inputs)
    refuse_grid_early([epochs[0].path], settings.inputs, settings.change, roi)
    with staged_outputs(output_dir) as stage:
        task = Task(epochs, hashes, settings, roi, stable, others["roi"], others["stable"], program, stage)
        with progress.stage(0.0, 0.7), record.stage("surveys") as entry:
            gridded, grid, crs, choice = prepare_epochs(task, progress)
            entry["epochs"] = {g.epoch.name: g.facts | {"made": g.made} for g in gridded}
        area = stable_area(stable, crs, progress)
        with progress.stage(0.7, 0.85, "comparing"), record.stage("change"):
            analysis = analyse(gridded, grid, settings, table, stable=area, progress=progress)
        about = About(dates, crs, grid, f"series ({settings.change.cell_value} cells)", run_id)
        with progress.stage(0.85, 0.99, "writing outputs"), record.stage("products"):
            outputs: dict[str, Path] = {}
            if settings.series.rasters_each_survey:
                for kind, changes in (("cumulative", analysis.cumulative), ("incremental", analysis.incremental)):
                    outputs |= write_epoch_rasters(kind, changes, about, hashes, stage, progress)
            stack = analysis.stack
            velocity = cell_velocity(stack.days, list(stack.change), stack.cell_variance)
            outputs |= write_summary_rasters(velocity, analysis.confirmed, velocity.count >= 2, about, hashes, stage)
            limits = limits_of(analysis, dates)
            files, frame, course = write_tables(
                analysis.zones, analysis.cumulative[-1], velocity, about, table, limits[0], stage, reviews
            )
            outputs |= files
        record.facts["reviews"] = reviews.finish(stage, outputs, progress)
        record.metrics = series_figures(frame, analysis.cumulative, analysis.incremental, about)
        record.metrics["dropped_zones"] = analysis.unconfirmed
        zones = zone_rows(frame, REPORTED)
        record.facts |= {
            "run_id": run_id,
            "cell": choice.facts(),
            "limits": limits,
            "alerts": [plain(row) for row in table],
            "transforms": {g.epoch.name: g.transform.matrix for g in gridded},
            "dates": [d.isoformat() for d in dates],
            "zones": zones,
            "course": course_rows(course, [row["zone_id"] for row in zones]),
            "seasons": {
                d.isoformat(): c.season.facts()
                for d, c in zip(dates[1:], analysis.cumulative, strict=True)
                if c.season is not None
            },
            "zone_history": {t.zone_id: _history(t, dates) for t in analysis.tracks},
        }
        outputs["run"] = stage.final("run.json")
        for sentence in limits:
            progress.info(sentence)
        write_record_and_report(record, stage, progress, outputs)
    return outputs, record.metrics


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
    names = [*SERIES_OUTPUTS]
    for before, end in pairwise(dates):
        names += raster_names("cumulative", dates[0], end) + raster_names("incremental", before, end)
    return [folder / name for name in names]
