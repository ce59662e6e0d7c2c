"""The files of a series: rasters with the days that they are shown on, zones and their time series, the figures."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np

from ...engine.change.coverage import seen
from ...engine.change.result import Change
from ...engine.core.arrays import Float
from ...engine.core.staged_outputs import Stage
from ...engine.core.version import VERSION
from ...engine.grid import geotiff
from ...engine.maps import palette, qgis_styles
from ...engine.maps.series_picture import write_series_picture
from ...engine.series.alerts import AlertLevel, alerts_csv
from ...engine.series.analysis import Analysis
from ...engine.series.tables import (
    ZONE_FIELDS,
    About,
    coverage_csv,
    coverage_rows,
    series_csv,
    series_frame,
    zone_frame,
)
from ...engine.series.velocity import CellVelocity
from ...engine.series.visits import detectable_rates
from ...engine.series.zone_series import FOUND_BY
from ...engine.statistics.normal import Z95
from ...engine.vector import geopackage
from ...engine.vector.review_fields import is_located, own_columns
from ...engine.zones.change_zones import change_zones
from ...engine.zones.not_seen import not_seen_frame
from ..run import Run
from .classes import Compared, write_class_budgets
from .masked_raster import Legend, write_masked_raster
from .seen import write_seen

SERIES_OUTPUTS = (
    "velocity.tif",
    "velocity_error.tif",
    "epochs_confirmed.tif",
    "series.gpkg",
    "series.csv",
    "coverage.csv",
    "series.png",
    "alerts_used.csv",
    "report.html",
    "report.pdf",
    "run.json",
)


def raster_names(kind: str, begin: date, end: date) -> tuple[str, ...]:
    """Files of the change, of its level of detection and of what was seen; ``kind`` is cumulative or incremental."""
    span = f"{begin.isoformat()}_{end.isoformat()}"
    return tuple(f"{kind}/{name}_{span}.tif" for name in ("elevation_change", "level_of_detection", "seen"))


def write_epoch_rasters(run: Run, kind: str, changes: Sequence[Change], about: About, hashes: Sequence[str]) -> None:
    """The change, its level and what was seen of each survey from the second on, against the first or the one before.

    The record gets the shares of what was seen. All of a kind have one colour range. Each is shown by the temporal
    controller from the day after the survey before until the day of its own survey.
    """
    moved = np.concatenate([c.dz[c.significant] for c in changes])
    level = float(np.median([c.median_level for c in changes]))
    limit = palette.colour_limit(moved, level=level)
    highest = max(float(np.nanpercentile(c.level, 98)) for c in changes)
    stage, shares = run.stage, run.facts.setdefault("seen_of_pairs", {})
    for number, change in enumerate(changes, 1):
        run.progress.update((number - 1) / len(changes), f"writing {kind} rasters")
        end, before = about.dates[number], about.dates[number - 1]
        begin = about.dates[0] if kind == "cumulative" else before
        tags = geotiff.raster_tags(
            epochs=(begin, end),
            median_level=Z95 * float(np.nanmedian(change.error)),
            software=f"SlopeWatch {VERSION}",
            input_sha256=f"{hashes[0] if kind == 'cumulative' else hashes[number - 1]} {hashes[number]}",
        )
        change_name, level_name, seen_name = raster_names(kind, begin, end)
        span = f"{begin.isoformat()} to {end.isoformat()}"
        legend = Legend(f"Elevation change, {span}", limit, shown=(before, end))
        place = about.grid, about.crs
        path = stage.path(change_name)
        write_masked_raster(path, change.dz, change.significant, *place, legend, tags)
        path, words = stage.path(level_name), f"Level of detection, {change.confidence:.4g} confidence, {span}"
        geotiff.write_raster(path, change.level, *place, description=words, tags=tags)
        qgis_styles.write_qml_next_to(path, qgis_styles.level_qml(highest, shown=(before, end)))
        of_slope = seen(change)
        write_seen(stage.path(seen_name), of_slope, *place, tags, shown=(before, end))
        shares[span] = of_slope.shares()
        for what, name in (("change", change_name), ("level", level_name), ("seen", seen_name)):
            run.outputs[f"{kind}_{what}_{number:03d}"] = stage.final(name)


def write_summary_rasters(
    velocity: CellVelocity,
    confirmed: np.ndarray,
    measured: np.ndarray,
    about: About,
    hashes: Sequence[str],
    stage: Stage,
) -> dict[str, Path]:
    """Velocity, its error, and how many comparisons in a row confirm each cell."""
    tags = geotiff.raster_tags(
        epochs=(about.dates[0], about.dates[-1]), software=f"SlopeWatch {VERSION}", input_sha256=" ".join(hashes)
    )
    rate, error = 1000 * velocity.rate, 1000 * velocity.error
    level = Z95 * float(np.nanmedian(error))
    with np.errstate(invalid="ignore"):
        beyond = np.abs(rate) > Z95 * error
    limit = palette.colour_limit(rate[beyond], level=level)
    path, legend = stage.path("velocity.tif"), Legend("Velocity by regression", limit, "mm/day")
    write_masked_raster(path, rate, beyond, about.grid, about.crs, legend, tags)
    outputs = {"velocity": stage.final(path.name)}
    layers: tuple[tuple[str, Float, str, str, str], ...] = (
        (
            "velocity_error",
            error,
            "Standard error of the velocity",
            "mm/day",
            qgis_styles.level_qml(float(np.nanpercentile(error, 98)), unit="mm/day"),
        ),
        (
            "epochs_confirmed",
            np.where(measured, confirmed, np.nan),
            "Comparisons in a row beyond the level of detection with one sign",
            "",
            qgis_styles.confirmed_qml(int(confirmed.max(initial=0))),
        ),
    )
    for name, array, words, unit, qml in layers:
        path = stage.path(f"{name}.tif")
        geotiff.write_raster(path, array, about.grid, about.crs, description=words, unit=unit, tags=tags)
        qgis_styles.write_qml_next_to(path, qml)
        outputs[name] = stage.final(path.name)
    return outputs


def write_tables(
    run: Run,
    analysis: Analysis,
    velocity: CellVelocity,
    about: About,
    alerts: Sequence[AlertLevel],
    footer: str,
) -> tuple[gpd.GeoDataFrame, gpd.GeoDataFrame]:
    """Zones and their series as GeoPackage and CSV, the picture, and the alert table as it was used.

    Zones get what people entered in those of an earlier run.

    Returns:
        The table of the zones and that of their series.
    """
    stage, zones, last = run.stage, analysis.zones, analysis.cumulative[-1]
    table = zone_frame(zones, last.dz, last.height_to, about)
    if run.reviews is not None:
        table = run.reviews.carried_to(table, "series.gpkg", ZONE_FIELDS, persistent_ids=True)
    table = run.related.placed(table, run.progress)
    series = series_frame(zones, about)
    of_slope = seen(last)
    not_seen = not_seen_frame(of_slope, about.grid, about.crs)
    style = qgis_styles.series_zones_qml(alerts, located=is_located(table))
    geopackage.write_layers(
        stage.path("series.gpkg"),
        [
            geopackage.Layer(table, "zones", style, "MultiPolygon", own_columns(table, ZONE_FIELDS), guarded=True),
            geopackage.Layer(series, "series", qgis_styles.states_qml(), "MultiPolygon", guarded=True),
            geopackage.Layer(not_seen, "not_seen", qgis_styles.not_seen_qml(), "MultiPolygon", guarded=True),
        ],
        stamp=about.dates[-1],
    )
    stage.path("series.csv").write_text(series_csv(series), encoding="utf-8")
    stage.path("alerts_used.csv").write_text(alerts_csv(alerts), encoding="utf-8")
    write_series_picture(stage.path("series.png"), zones, velocity, about, footer, of_slope.unseen)
    names = {"series_zones": "series.gpkg", "series_table": "series.csv", "series_picture": "series.png"}
    run.outputs |= {key: stage.final(name) for key, name in {**names, "alerts_used": "alerts_used.csv"}.items()}
    return table, series


def write_coverage(run: Run, analysis: Analysis, about: About) -> None:
    """The table of the ground that each survey compared, as CSV and for the record and the report."""
    rows = coverage_rows(analysis.cumulative, about)
    run.stage.path("coverage.csv").write_text(coverage_csv(rows), encoding="utf-8")
    run.outputs["coverage"] = run.stage.final("coverage.csv")
    run.facts["coverage"] = rows
    run.figures["compared_share"] = rows[-1]["compared_share"]
    run.figures["least_compared_share"] = min(row["compared_share"] for row in rows)


def write_class_table(run: Run, analysis: Analysis, about: About) -> None:
    """Where classes of asset were given: their change since the first survey, the last first, and step by step."""
    if run.related.classes is None:
        return
    days = [day.isoformat() for day in about.dates]
    spans = [(days[0], day, change) for day, change in zip(days[1:], analysis.cumulative, strict=True)]
    spans.reverse()
    if len(days) > 2:
        spans += [(a, b, c) for a, b, c in zip(days[1:], days[2:], list(analysis.incremental)[1:], strict=False)]
    pairs = [Compared(a, b, change, change_zones(change, about.crs).correlation) for a, b, change in spans]
    write_class_budgets(run, pairs, run.related.classes, about.crs, about.dates[-1])


def series_figures(
    table: gpd.GeoDataFrame, cumulative: Sequence[Change], incremental: Sequence[Change], about: About
) -> dict[str, Any]:
    """The figures that a user reads first; lengths in metres, rates in millimetres a day."""
    _, detectable = detectable_rates(incremental, about.dates)
    by_heights = table[table["found_by"] != FOUND_BY[1]]
    rates = by_heights["rate_mm_day"].abs()
    return {
        "epoch_count": len(about.dates),
        "days": (about.dates[-1] - about.dates[0]).days,
        "lod_median_m": cumulative[-1].median_level,
        "detectable_rate_mm_day": float(np.median(detectable)),
        "zone_count": len(table),
        "confirmed_zone_count": int((table["n_epochs_confirmed"] >= 2).sum()),
        "highest_alert": int(table["alert_level"].max()) if len(table) else 0,
        # a body of several zones has one alert
        "alerted_zone_count": int((table["alert_level"] > 0)[table["body"] == table["zone_id"]].sum()),
        "fastest_rate_mm_day": float(rates.max()) if rates.notna().any() else None,
        "zone_area_m2": float(table["area_m2"].sum()),
        "failure_interval_count": int((table["failure_from"] != "").sum()),
    }
