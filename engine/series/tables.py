"""Tables of a series: one line a zone, and one line a zone and survey."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import date, timedelta
from typing import Any

import geopandas as gpd
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pyproj import CRS

from ...interface.seen import COMPARED, NOT_IN_BOTH, NOT_IN_FIRST, NOT_IN_LATER, TOO_FEW
from ..change.coverage import seen
from ..change.result import Change
from ..core.arrays import Float
from ..core.table_text import cell
from ..crs.working_frame import horizontal
from ..grid.grid import Grid
from ..statistics.normal import Z95
from ..vector.cell_polygons import cell_polygons, field_kinds, inclination, table_column
from ..vector.review_fields import UNREVIEWED
from ..zones.fields import SLIDING
from .motion.zones import MovingGround
from .velocity_classes import velocity_class
from .visits import MIN_VELOCITY_DAYS
from .zone_series import ZoneSeries

ZONE_FIELDS = field_kinds("""
    text: zone_id
    integer: alert_level
    text: alert alert_state alert_since alert_reason action body slope_id route
    real: chain_from chain_to
    text: side carriageway
    real: offset_m offset_mid_m
    text: location location_note epoch_from epoch_to
    integer: days
    text: kind found_by status first_seen last_seen split_from merged
    integer: n_epochs n_epochs_confirmed
    real: rate_mm_day rate_err rate_low rate_high rate_last rate_last_err
    text: velocity_class trend onset_from onset_to
    real: tangent_angle
    text: tangent_level tangent_note failure_from failure_to failure_note
    real: dz_mean_m dz_p95_m area_m2
    integer: n_cells
    real: vol_loss_m3 vol_gain_m3 vol_net_m3 vol_err_m3 vol_measured lod95_m slope_deg
    real: motion_m motion_err_m motion_rate_mm_day motion_rate_err motion_azimuth_deg motion_off_dip_deg
    real: motion_area_m2 motion_p_map
    text: motion_zone review_status reviewer remarks method run_id
""")
SERIES_FIELDS = field_kinds("""
    text: zone_id kind epoch
    integer: days
    real: dz_mean_m dz_err_m lod95_m motion_m motion_err_m
    text: state
    integer: confirmed
    real: area_m2 vol_net_m3 vol_err_m3 vol_measured
    integer: days_before
    real: step_m step_err_m rate_mm_day rate_err
    text: event
    integer: alert_level
    text: alert_state alert_reason
""")


COVERAGE_FIELDS = (
    "epoch", "compared_share", "compared_m2", "only_first_m2", "only_this_m2", "too_few_points_m2", "cell_median_m",
    "points_m2", "first_points_m2", "error_median_m", "vegetation_m2",
)  # fmt: skip


@dataclass(frozen=True)
class About:
    """What the tables state of their origin; ``dates`` of all surveys, the earliest first."""

    dates: tuple[date, ...]
    crs: CRS
    grid: Grid
    method: str
    run_id: str


def zone_frame(zones: Sequence[ZoneSeries], last_change: Float, heights: Float, about: About) -> gpd.GeoDataFrame:
    """One row a zone, the highest alert first, then the fastest.

    Args:
        last_change: (rows, columns) change of the last survey against the first, metres.
        heights: of the last survey, metres.
    """
    rows = [_zone_row(zone, last_change, heights, about) for zone in zones]
    order = sorted(range(len(rows)), key=lambda i: (-rows[i]["alert_level"], -zones[i].fastest))
    columns = {
        name: table_column(_column([rows[i].get(name) for i in order], kind), kind, len(rows))
        for name, kind in ZONE_FIELDS.items()
    }
    shapes = [zone_polygon(zones[i].cells, about.grid) for i in order]
    return gpd.GeoDataFrame(columns, geometry=np.array(shapes, dtype=object), crs=horizontal(about.crs))


def series_frame(zones: Sequence[ZoneSeries], about: About) -> gpd.GeoDataFrame:
    """One row a zone and survey from the second on, with ``time_from`` and ``time_to`` for the temporal controller."""
    rows: list[dict[str, Any]] = []
    shapes: list[Any] = []
    for zone in zones:
        shape = zone_polygon(zone.cells, about.grid)
        for i in range(1, len(about.dates)):
            rows.append(_survey_row(zone, i, about))
            shapes.append(shape)
    columns: dict[str, Any] = {
        name: table_column(_column([r.get(name) for r in rows], kind), kind, len(rows))
        for name, kind in SERIES_FIELDS.items()
    }
    for name in ("time_from", "time_to"):
        columns[name] = pd.Series(pd.to_datetime([r[name] for r in rows]), dtype="datetime64[ms]")
    return gpd.GeoDataFrame(columns, geometry=np.array(shapes, dtype=object), crs=horizontal(about.crs))


def series_csv(frame: gpd.GeoDataFrame) -> str:
    """The table of ``series_frame`` as CSV text, without its shapes."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(SERIES_FIELDS)
    for row in frame[list(SERIES_FIELDS)].itertuples(index=False):
        writer.writerow([_in_cell(value) for value in row])
    return text.getvalue()


def coverage_rows(changes: Iterable[Change], about: About) -> list[dict[str, Any]]:
    """Of each survey from the second on: how much ground was compared with the first survey, and why the rest was not.

    Fields are ``COVERAGE_FIELDS``; areas are on the map. Ground points a m² are those of this survey and of the first
    one on the ground compared; the error is the standard error of a cell's change. ``vegetation_m2`` is change that the
    vegetation may have made.
    """
    rows = []
    for day, change in zip(about.dates[1:], changes, strict=True):
        found, valid = seen(change), change.valid
        compared = found.area(COMPARED)
        density = [float(count[valid].sum()) / max(compared, 1e-9) for count in change.points]
        values = (
            found.share(COMPARED), compared, found.area(NOT_IN_LATER), found.area(NOT_IN_FIRST),
            found.area(TOO_FEW, NOT_IN_BOTH),
            np.median(change.partition.sizes[valid]), density[1], density[0], np.median(change.error[valid]),
            0.0 if change.plant_like is None else np.count_nonzero(change.plant_like) * change.grid.cell**2,
        )  # fmt: skip
        rows.append({"epoch": day.isoformat()} | dict(zip(COVERAGE_FIELDS[1:], map(float, values), strict=True)))
    return rows


def coverage_csv(rows: Sequence[dict[str, Any]]) -> str:
    """``coverage_rows`` as CSV text."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COVERAGE_FIELDS, lineterminator="\n")
    writer.writeheader()
    writer.writerows({k: v if k == "epoch" else round(v, 4) for k, v in row.items()} for row in rows)
    return text.getvalue()


def _in_cell(value: Any) -> Any:
    if isinstance(value, str):
        return cell(value)
    # + 0.0: no minus zero
    return "" if pd.isna(value) else value + 0.0 if isinstance(value, float) else value


def zone_polygon(cells: NDArray[np.int64], grid: Grid) -> Any:
    """Outline of the cells (flat indices) along their edges."""
    row, column = np.divmod(cells, grid.columns)
    top, left = int(row.min()), int(column.min())
    labels = np.zeros((int(row.max()) - top + 1, int(column.max()) - left + 1), dtype=np.int32)
    labels[row - top, column - left] = 1
    part = Grid(grid.west + left * grid.cell, grid.north - top * grid.cell, grid.cell, labels.shape[0], labels.shape[1])
    return cell_polygons(labels, 1, part)[0]


def status_of(zone: ZoneSeries) -> str:
    """active: the last survey confirms it; new: it alone does; quiet: two or more did; unconfirmed: one earlier did."""
    if zone.confirmed[zone.last]:
        return "new" if zone.epochs_confirmed < 2 else "active"
    return "unconfirmed" if np.count_nonzero(zone.confirmed) < 2 else "quiet"


def _column(values: list[Any], kind: str) -> NDArray:
    if kind == "text":
        return np.array([v or "" for v in values], dtype=object)
    if kind == "integer":
        return np.array([pd.NA if v is None else int(v) for v in values], dtype=object)
    return np.array([np.nan if v is None else float(v) for v in values], dtype=np.float64)


def _zone_row(zone: ZoneSeries, last_change: Float, heights: Float, about: About) -> dict[str, Any]:
    last, first = zone.last, about.dates[0]
    values = last_change.ravel()[zone.cells]
    values = values[np.isfinite(values)]
    signed = np.abs(values[values * zone.track.sign > 0])
    owner = np.zeros(len(zone.cells), dtype=np.int64)
    error, volume = float(zone.error[last]), float(zone.means.volume[last])
    seen = [s.epoch for s in (*zone.track.sightings, *(zone.motion.ground.sightings if zone.motion else ()))]
    course, slid = zone.leading, zone.kind == SLIDING
    row: dict[str, Any] = {
        "zone_id": zone.track.zone_id,
        "alert_level": zone.alert.level,
        "alert": zone.alert.name,
        **_alert_columns(zone, about),
        "alert_reason": zone.alert_reason,
        "body": zone.body,
        "action": zone.alert.action,
        "epoch_from": first.isoformat(),
        "epoch_to": about.dates[last].isoformat(),
        "days": (about.dates[last] - first).days,
        "kind": zone.kind,
        "found_by": zone.found_by,
        "status": status_of(zone),
        "first_seen": about.dates[min(seen)].isoformat(),
        "last_seen": about.dates[max(seen)].isoformat(),
        "split_from": zone.track.parent,
        "merged": ", ".join(o for s in zone.track.sightings if s.event == "merged" for o in s.others),
        "n_epochs": int(np.count_nonzero(zone.measured)),
        "n_epochs_confirmed": zone.epochs_confirmed,
        "dz_mean_m": float(zone.change[last]),
        "dz_p95_m": zone.track.sign * float(np.quantile(signed, 0.95)) if len(signed) else None,
        "area_m2": zone.means.area,
        "n_cells": len(values),
        # what slid is still there
        "vol_loss_m3": None if slid else max(-volume, 0.0),
        "vol_gain_m3": None if slid else max(volume, 0.0),
        "vol_net_m3": volume,
        "vol_err_m3": float(zone.means.volume_error[last]),
        "vol_measured": float(zone.measured[last]),
        "lod95_m": Z95 * error,
        "slope_deg": float(inclination(owner, zone.cells, 1, heights.ravel()[zone.cells], about.grid)[0]),
        "review_status": UNREVIEWED,
        "method": about.method,
        "run_id": about.run_id,
        "tangent_angle": course.angle.degrees,
        "tangent_level": course.angle.level,
        "tangent_note": course.angle.reason,
        "failure_note": course.failure.reason,
    }
    if course.failure.earliest is not None and course.failure.latest is not None:
        row["failure_from"] = (first + timedelta(days=int(course.failure.earliest))).isoformat()
        row["failure_to"] = (first + timedelta(days=int(np.ceil(course.failure.latest)))).isoformat()
    row |= _velocity_columns(zone, about) | _motion_columns(zone)
    row["rate_last"], row["rate_last_err"] = _step(zone, last, about)[3:]
    return row


def _alert_columns(zone: ZoneSeries, about: About) -> dict[str, Any]:
    """State of the level, and the survey since which the zone has that level; nothing before it is judged."""
    if zone.history is None:
        return {}
    levels = zone.history.levels
    since = max((i for i in range(1, len(levels)) if levels[i] != levels[i - 1]), default=None)
    state = zone.history.states[-1]
    return {"alert_state": state, "alert_since": about.dates[since].isoformat() if state and since else ""}


def _velocity_columns(zone: ZoneSeries, about: About) -> dict[str, Any]:
    columns: dict[str, Any] = {}
    if zone.velocity is not None:
        columns = {
            "rate_mm_day": 1000 * zone.velocity.rate,
            "rate_err": 1000 * zone.velocity.error,
            "rate_low": 1000 * zone.velocity.low,
            "rate_high": 1000 * zone.velocity.high,
        }
    velocity = zone.leading.velocity
    if velocity is None:
        return columns
    columns |= {
        "velocity_class": velocity_class(1000 * velocity.rate) if velocity.significant else "not determined",
        "trend": velocity.trend,
    }
    if velocity.onset is not None:
        columns["onset_from"], columns["onset_to"] = (about.dates[i].isoformat() for i in velocity.onset)
    return columns


def _motion_columns(zone: ZoneSeries) -> dict[str, Any]:
    """What is known of the motion along the surface until the last survey that measured it."""
    if zone.motion is None:
        return {}
    ground, velocity = zone.motion.ground, zone.motion.course.velocity
    last = int(np.flatnonzero(np.isfinite(ground.along))[-1])
    columns: dict[str, Any] = {
        "motion_m": float(ground.along[last]),
        "motion_err_m": float(ground.along_error[last]),
        "motion_azimuth_deg": float(np.degrees(np.arctan2(ground.direction[0], ground.direction[1])) % 360.0),
        "motion_off_dip_deg": ground.off_dip,
        "motion_area_m2": ground.area,
        "motion_p_map": ground.probability,
        "motion_zone": ground.zone_id,
    }
    if velocity is not None:
        columns |= {"motion_rate_mm_day": 1000 * velocity.rate, "motion_rate_err": 1000 * velocity.error}
    return columns


def _survey_row(zone: ZoneSeries, i: int, about: About) -> dict[str, Any]:
    known = zone.measured[i] > 0
    change, error = (float(zone.change[i]), float(zone.error[i])) if known else (None, None)
    state = "not measured"
    if change is not None and error is not None:
        beyond = abs(change) > Z95 * error
        state = "below its level" if not beyond else "lowered" if change < 0 else "raised"
    before, step, step_error, rate, rate_error = _step(zone, i, about)
    along, along_error = (None, None) if zone.motion is None else _known(zone.motion.ground, i)
    sighting = next((s for s in zone.track.sightings if s.epoch == i), None)
    event = "" if sighting is None else sighting.event
    if sighting is not None and sighting.others:
        event += f" with {', '.join(sighting.others)}"
    return {
        "zone_id": zone.track.zone_id,
        "kind": zone.kind,
        "epoch": about.dates[i].isoformat(),
        "days": (about.dates[i] - about.dates[0]).days,
        "dz_mean_m": change,
        "dz_err_m": error,
        "lod95_m": None if error is None else Z95 * error,
        "motion_m": along,
        "motion_err_m": along_error,
        "state": state,
        "confirmed": int(zone.confirmed[i]),
        "area_m2": zone.means.area,
        "vol_net_m3": float(zone.means.volume[i]) if known else None,
        "vol_err_m3": float(zone.means.volume_error[i]) if known else None,
        "vol_measured": float(zone.measured[i]),
        "days_before": before,
        "step_m": step,
        "step_err_m": step_error,
        "rate_mm_day": rate,
        "rate_err": rate_error,
        "event": event,
        **_level_columns(zone, i),
        "time_from": about.dates[i - 1] + timedelta(days=1),
        "time_to": about.dates[i],
    }


def _level_columns(zone: ZoneSeries, i: int) -> dict[str, Any]:
    """Alert level of the zone after a survey."""
    if zone.history is None:
        return {}
    names = {"alert_level": "levels", "alert_state": "states", "alert_reason": "reasons"}
    return {column: getattr(zone.history, name)[i] for column, name in names.items()}


def _known(ground: MovingGround, i: int) -> tuple[float | None, float | None]:
    """Motion along the surface until a survey and its error, metres."""
    along, error = float(ground.along[i]), float(ground.along_error[i])
    return (along, error) if np.isfinite(along) else (None, None)


def _step(zone: ZoneSeries, i: int, about: About) -> tuple[Any, Any, Any, Any, Any]:
    """Days, change, its error, rate (mm/day) and its error since the survey that measured the zone before.

    Surveys within ``MIN_VELOCITY_DAYS`` have no rate.
    """
    earlier = np.flatnonzero(np.isfinite(zone.change[:i]))
    if not len(earlier) or not np.isfinite(zone.change[i]):
        return None, None, None, None, None
    j = int(earlier[-1])
    days = (about.dates[i] - about.dates[j]).days
    step = float(zone.change[i] - zone.change[j])
    error = float(np.sqrt(zone.variance[i] + zone.variance[j]))
    if days < MIN_VELOCITY_DAYS:
        return days, step, error, None, None
    return days, step, error, 1000 * step / days, 1000 * error / days
