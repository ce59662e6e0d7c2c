"""More than two surveys of one slope: change in steps and in all, velocities, zones through time, alert levels."""

from __future__ import annotations

import uuid
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from .alerts import AlertLevel, read_alerts
from .cell_variance import pooled_variance
from .change import Change, difference_of_cells
from .dating import check_days
from .earlier_results import earlier_series, refuse_another_series, refuse_results
from .earlier_reviews import EarlierReviews
from .early_memory import refuse_grid_early
from .epochs import Epoch
from .errors import InputError
from .gridding import Grid
from .manifest import check_series
from .outputs import refuse_inputs_as_outputs, staged_outputs
from .pair import require_comparable, stable_area, warn_of_doubtful_change
from .pdal import find_pdal
from .progress import Progress
from .report import write_record_and_report
from .report_facts import course_rows, zone_rows
from .run_record import RunRecord, plain
from .series_epochs import GriddedEpoch, NamedProgress, SeriesSettings, Task, prepare_epochs
from .series_persistence import confirmed_cells
from .series_products import (
    SERIES_OUTPUTS,
    raster_names,
    series_figures,
    write_epoch_rasters,
    write_summary_rasters,
    write_tables,
)
from .series_tables import About
from .series_tracking import Track, track_zones
from .series_velocity import cell_velocity, own_variances
from .series_zones import Stack, ZoneSeries, zone_series
from .zones import label_groups

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


@dataclass(frozen=True)
class Analysis:
    """What the gridded surveys tell. Changes have one entry a survey from the second on.

    ``confirmed`` (rows, columns) counts comparisons in a row that show a cell changed within a group of at least the
    least area: a single cell that the first survey's noise lifted would stand out in all comparisons.
    """

    cumulative: list[Change]
    incremental: list[Change]
    stack: Stack
    tracks: tuple[Track, ...]
    zones: tuple[ZoneSeries, ...]
    confirmed: NDArray[np.int64]
    unconfirmed: int


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


def analyse(
    gridded: Sequence[GriddedEpoch],
    grid: Grid,
    settings: SeriesSettings,
    alerts: tuple[AlertLevel, ...],
    *,
    stable: BaseGeometry | None = None,
    progress: Progress | None = None,
) -> Analysis:
    """Differences, zones and their series of surveys that are on one grid; the first one's own transform is none.

    A survey whose whole overlap rose or sank alike (a datum or bias, see ``change.uniform_shift``) makes no zones and
    tells no velocity.
    """
    progress = progress or Progress()
    names = [g.epoch.name for g in gridded]
    shares = [NamedProgress(s, n) for s, n in zip(progress.split(names), names, strict=True)]
    first = gridded[0]
    cumulative, incremental = [], []
    for number, (before, later) in enumerate(pairwise(gridded), 1):
        progress.update(number / len(gridded), f"comparing {later.epoch.name}")
        try:
            cumulative.append(_difference(first, later, grid, settings, stable))
            # all along the direction of the first comparison
            settings = replace(settings, change=replace(settings.change, direction=cumulative[0].direction))
            incremental.append(cumulative[0] if number == 1 else _difference(before, later, grid, settings, stable))
        except InputError as wrong:
            raise InputError(f"{later.epoch.name}: {wrong}") from wrong
        warn_of_doubtful_change(cumulative[-1], shares[number], may_grow=False)
    stack = _stack(gridded, cumulative, grid)
    reach = int(settings.zones.bridged_gap / (2.0 * grid.cell) + 1e-6)
    groups = []
    for number, change in enumerate(cumulative, 1):
        plants = None if change.plants is None else change.plants.error
        labels = label_groups(change.dz, stack.significant[number], grid, settings.zones, plants=plants)[0]
        groups.append((number, labels, np.sign(np.nan_to_num(change.dz)).astype(np.int8)))
    tracks = track_zones(groups, max(1, reach))
    living = [t for t in tracks if not t.merged_into and len(t.footprint)]
    found = zone_series(living, stack, alerts, minimum_area=settings.zones.minimum_area, bridged=max(2, 2 * reach))
    zones = tuple(z for z in found if z.epochs_confirmed > 0)
    grouped = [np.where(labels > 0, c.level, np.inf) for (_, labels, _), c in zip(groups, cumulative, strict=True)]
    confirmed = confirmed_cells([c.dz for c in cumulative], grouped)
    return Analysis(cumulative, incremental, stack, tracks, zones, confirmed, len(found) - len(zones))


def _difference(
    a: GriddedEpoch, b: GriddedEpoch, grid: Grid, settings: SeriesSettings, stable: BaseGeometry | None
) -> Change:
    area = a.area if b.area is None else b.area if a.area is None else a.area.intersection(b.area)
    error = float(np.hypot(a.registration_error, b.registration_error))
    return difference_of_cells(
        a.cells, b.cells, grid, settings.change, registration_error=error, area=area, stable_area=stable
    )


def _stack(gridded: Sequence[GriddedEpoch], cumulative: Sequence[Change], grid: Grid) -> Stack:
    sampling = [g.cells.on_grid(g.cells.leverage * pooled_variance(g.cells)) for g in gridded]
    usable = [c.uniform_dz is None for c in cumulative]
    shared = [0.0, *(c.registration_error for c in cumulative)]
    nothing = np.zeros(grid.shape)
    plants = [nothing if c.plants is None else np.nan_to_num(c.plants.error_to) for c in cumulative]
    of_first = nothing if cumulative[0].plants is None else np.nan_to_num(cumulative[0].plants.error_from)
    without = [
        np.sqrt(np.maximum(c.error**2 - p**2 - of_first**2, 0.0)) for c, p in zip(cumulative, plants, strict=True)
    ]
    own = own_variances(without, shared[1:], sampling[0], sampling[1:])
    start = np.where(np.isfinite(own[0]), 0.0, np.nan)
    first = gridded[0].epoch.date or date.min
    return Stack(
        days=np.array([((g.epoch.date or first) - first).days for g in gridded], dtype=np.float64),
        change=[start, *(np.where(ok, c.dz, np.nan) for ok, c in zip(usable, cumulative, strict=True))],
        variance=own,
        shared=shared,
        significant=[
            np.zeros(grid.shape, dtype=bool),
            *(c.significant & ok for ok, c in zip(usable, cumulative, strict=True)),
        ],
        cell=grid.cell,
        plants=[of_first, *plants],
    )


def limits_of(analysis: Analysis, dates: tuple[date, ...]) -> list[str]:
    """Sentences on what the series cannot tell."""
    steps = [(b - a).days for a, b in pairwise(dates)]
    rates = [1000 * c.median_level / days for c, days in zip(analysis.incremental, steps, strict=True)]
    low, high = min(rates), max(rates)
    apart = f"{min(steps)}" if min(steps) == max(steps) else f"{min(steps)} to {max(steps)}"
    span = f"{low:.2g}" if f"{low:.2g}" == f"{high:.2g}" else f"{low:.2g} to {high:.2g}"
    seen = (
        f"Between two of these surveys, {apart} days apart, a cell must move by {span} mm/day to "
        "be seen: this screens trends, it is no alarm."
    )
    unseen = (
        "Movement between surveys, along the surface, under ground that no pulse reached, or slower than that stays "
        "unseen; no change above the level of detection is no statement about stability."
    )
    return [seen, unseen]


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
