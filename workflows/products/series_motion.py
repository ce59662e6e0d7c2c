"""The files of a series' motion along the surface: vectors survey by survey, velocities, zones, and rasters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import timedelta
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
import pandas as pd
import shapely

from ...engine.core.arrays import Bool, Float
from ...engine.core.staged_outputs import Stage
from ...engine.core.version import VERSION
from ...engine.crs.working_frame import horizontal
from ...engine.displacement.vectors import Vectors, confidence_of_each, threshold
from ...engine.grid import geotiff
from ...engine.grid.grid import on_grid
from ...engine.maps import displacement_styles
from ...engine.series.motion.field import Field
from ...engine.series.motion.zones import MovingGround
from ...engine.series.tables import About
from ...engine.series.zone_series import ZoneSeries
from ...engine.vector.cell_polygons import cell_polygons
from ...engine.vector.geopackage import Layer, write_layers
from ..series_motion import SeriesMotion
from .displacement import DISPLACEMENT_OUTPUTS, directions, write_rasters

SERIES_MOTION_OUTPUTS = DISPLACEMENT_OUTPUTS


def write_motion(
    motion: SeriesMotion, zones: Sequence[ZoneSeries], about: About, hashes: Sequence[str], stage: Stage
) -> dict[str, Path]:
    """Write all of them; the paths by key. Rasters are of the last survey against the first.

    Args:
        zones: of the series, whose ids the zones of motion have.
    """
    field, crs = motion.field, about.crs
    last = field.vectors(field.motion[:, -1], field.covariance[:, -1])
    tags = geotiff.raster_tags(
        epochs=(about.dates[0], about.dates[-1]), software=f"SlopeWatch {VERSION}", input_sha256=" ".join(hashes)
    )
    limit = threshold(confidence_of_each(motion.parameters.vector_confidence, field.widths))
    moving = field.significant[-1]
    spacing = field.layout.grid.cell
    shown = last.measured & (moving | (np.nan_to_num(last.statistic) > limit))
    outputs = write_rasters(last, last.smallest, shown, (field.layout.grid, field.layout.cell), crs, tags, stage)
    times = displacement_styles.magnification(last.motion[shown], spacing)
    velocity = field.vectors(field.velocity, field.velocity_covariance)
    fast = np.nan_to_num(velocity.statistic) > limit
    times_a_day = displacement_styles.magnification(velocity.motion[fast], spacing)
    ids = {z.motion.ground.zone_id: z.track.zone_id for z in zones if z.motion is not None}
    layers = [
        # the first has no times: GDAL would write those of the first layer alone with a Z
        Layer(_velocities(velocity, fast, field.widths, about), "velocities",
              displacement_styles.velocities_qml(times_a_day), "Point"),
        Layer(_moves(field, field.motion, field.covariance, moving, limit, about), "vectors",
              displacement_styles.vectors_qml(times, temporal=True), "Point"),
        Layer(_moves(field, field.step, field.step_covariance, moving, limit, about), "steps",
              displacement_styles.vectors_qml(times, temporal=True), "Point"),
        Layer(_zones(motion.ground, field, ids, about), "zones",
              displacement_styles.moving_zones_qml(times, temporal=True), "MultiPolygon"),
    ]  # fmt: skip
    write_layers(stage.path("displacement.gpkg"), layers, stamp=about.dates[-1])
    return outputs | {"displacement_vectors": stage.final("displacement.gpkg")}


def motion_figures(motion: SeriesMotion, table: gpd.GeoDataFrame) -> dict[str, Any]:
    """The figures that a user reads first; lengths in metres, rates in millimetres a day.

    Args:
        table: of the zones, see ``tables.zone_frame``.
    """
    facts, rates = motion.facts(), table["motion_rate_mm_day"].abs()
    return {
        "moving_zone_count": len(motion.ground),
        "moving_area_m2": float(sum(zone.area for zone in motion.ground)),
        "fastest_motion_mm_day": float(rates.max()) if rates.notna().any() else None,
        "motion_measured_share": facts["measured_share"],
        "smallest_motion_median_m": facts["smallest_motion_median_m"],
    }


def _time(about: About, survey: int) -> dict[str, Any]:
    """The columns by which QGIS's temporal controller shows a survey: from the day after the one before until it."""
    return {
        "epoch": about.dates[survey].isoformat(),
        "days": (about.dates[survey] - about.dates[0]).days,
        "time_from": about.dates[survey - 1] + timedelta(days=1),
        "time_to": about.dates[survey],
    }


def _in_time(frame: pd.DataFrame) -> pd.DataFrame:
    for name in ("time_from", "time_to"):
        frame[name] = pd.Series(pd.to_datetime(frame[name]), dtype="datetime64[ms]")
    return frame


def _moves(
    field: Field, motion: Float, covariance: Float, moving: Bool, limit: float, about: About
) -> gpd.GeoDataFrame:
    """One row a window and survey, where the motion (n, surveys, 3) is significant or the window moves at all."""
    tables, places = [], []
    for survey in range(1, len(about.dates)):
        vectors = field.vectors(motion[:, survey], covariance[:, survey])
        significant = np.nan_to_num(vectors.statistic) > limit
        use = np.flatnonzero(vectors.measured & (significant | moving))
        table = pd.DataFrame(_columns(vectors, use, field.widths) | {"significant": significant[use].astype(np.int64)})
        tables.append(table.assign(**_time(about, survey)))
        places.append(vectors.places[use, :2])
    return gpd.GeoDataFrame(
        _in_time(pd.concat(tables, ignore_index=True)),
        geometry=shapely.points(np.concatenate(places)),
        crs=horizontal(about.crs),
    )


def _columns(vectors: Vectors, use: Any, widths: int) -> dict[str, Float]:
    errors = np.sqrt(np.einsum("nii->ni", vectors.in_plane_covariance[use]))
    plane = vectors.in_plane[use]
    return directions(vectors.motion[use], vectors.covariance[use]) | {
        "along_dip_m": plane[:, 0],
        "across_m": plane[:, 1],
        "normal_m": plane[:, 2],
        "along_dip_err_m": errors[:, 0],
        "across_err_m": errors[:, 1],
        "normal_err_m": errors[:, 2],
        "p_value": vectors.p_value(widths)[use],
        "window_m": vectors.width[use],
    }


def _velocities(velocity: Vectors, fast: Bool, widths: int, about: About) -> gpd.GeoDataFrame:
    """One row a window whose velocity is significant, millimetres a day."""
    use = np.flatnonzero(fast)
    columns = _columns(velocity, use, widths)
    table = {name: value for name, value in columns.items() if not name.endswith("_m")}
    for name, value in columns.items():
        if name.endswith("_m") and name != "window_m":
            table[f"{name.removesuffix('_m')}_mm_day"] = 1000 * value
    table["window_m"] = columns["window_m"]
    frame = pd.DataFrame(table).assign(epoch_from=about.dates[0].isoformat(), epoch_to=about.dates[-1].isoformat())
    return gpd.GeoDataFrame(frame, geometry=shapely.points(velocity.places[use, :2]), crs=horizontal(about.crs))


def _zones(ground: Sequence[MovingGround], field: Field, ids: Mapping[str, str], about: About) -> gpd.GeoDataFrame:
    """One row a zone and survey: its motion until then, since the survey before, and its velocity."""
    rows, shapes = [], []
    for zone in ground:
        labels = on_grid(field.layout.cell[zone.windows], np.int32(1), field.layout.grid.shape, np.int32(0))
        shape = cell_polygons(labels, 1, field.layout.grid)[0]
        for survey in range(1, len(about.dates)):
            if np.isfinite(zone.motion[survey]).all():
                rows.append(_zone_row(zone, survey, ids) | _time(about, survey))
                shapes.append(shape)
    if not rows:
        rows = [_zone_row(_nothing(len(about.dates)), 1, {}) | _time(about, 1)]
    frame = _in_time(pd.DataFrame(rows))
    return gpd.GeoDataFrame(
        frame.iloc[: len(shapes)], geometry=np.array(shapes, dtype=object), crs=horizontal(about.crs)
    )


def _nothing(surveys: int) -> MovingGround:
    """Ground that is none, for the names of the columns."""
    zero = np.zeros(3)
    return MovingGround(
        "", np.zeros(0, np.int64), 0.0, 0.0, zero, np.eye(3), np.zeros((surveys, 3)),
        np.zeros((surveys, 3, surveys, 3)), zero, np.eye(3), 0.0, 0.0, 0, np.array([1.0, 0.0, 0.0]), (), "",
    )  # fmt: skip


def _zone_row(zone: MovingGround, survey: int, ids: Mapping[str, str]) -> dict[str, Any]:
    motion, covariance = zone.motion[survey], zone.covariance[survey, :, survey]
    step, step_covariance = zone.step(survey)
    plane, plane_errors = zone.axes @ motion, np.sqrt(np.diag(zone.axes @ covariance @ zone.axes.T))
    found = {name: float(value[0]) for name, value in directions(motion[None], covariance[None]).items()}
    found |= {f"{name}_m": float(value) for name, value in zip(("along_dip", "across", "normal"), plane, strict=True)}
    found |= {
        f"{name}_err_m": float(value)
        for name, value in zip(("along_dip", "across", "normal"), plane_errors, strict=True)
    }
    for name, vector, error in (
        ("step", step, step_covariance),
        ("velocity", zone.velocity, zone.velocity_covariance),
    ):
        unit, factor = ("mm_day", 1000.0) if name == "velocity" else ("m", 1.0)
        for axis, part, own in zip(("east", "north", "up"), vector, np.sqrt(np.diag(error)), strict=True):
            found[f"{name}_{axis}_{unit}"] = factor * float(part)
            found[f"{name}_{axis}_err_{unit}"] = factor * float(own)
    return {
        "zone_id": ids.get(zone.zone_id, zone.zone_id),
        "motion_zone": zone.zone_id,
        "area_m2": zone.area,
        "fitted_area_m2": zone.fitted_area,
        **found,
        "along_m": float(zone.along[survey]),
        "along_err_m": float(zone.along_error[survey]),
        "off_dip_deg": zone.off_dip,
        "uneven_share": zone.unevenness,
        "p_map": zone.probability,
    }
