"""What the command displacement writes: rasters of the vectors, vectors and zones as layers, and the main figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
import pandas as pd
import shapely
from pyproj import CRS

from ...engine.core.arrays import Bool, Float, Index
from ...engine.core.staged_outputs import Stage
from ...engine.displacement.chance import beyond_chance, chance_vectors, components_beyond_chance
from ...engine.displacement.displacement import Displacement
from ...engine.displacement.status import REASONS, Status
from ...engine.displacement.vectors import Vectors
from ...engine.displacement.zones import MovingZone
from ...engine.grid import geotiff
from ...engine.grid.grid import Grid, on_grid
from ...engine.maps import displacement_styles, opacity_band, qgis_styles
from ...engine.report.motion_facts import off_dip_error
from ...engine.vector.cell_polygons import cell_polygons
from ...engine.vector.geopackage import Layer, write_layers
from ..run import Run

DISPLACEMENT_OUTPUTS = (
    "displacement.tif",
    "smallest_motion.tif",
    "displacement.gpkg",
    "displacement.qml",
    "smallest_motion.qml",
)
"""Of the measurement itself; the command ``displacement`` also writes a report."""
_LIMIT_QUANTILE = 0.98


def write_products(found: Displacement, crs: CRS, tags: dict[str, str], run: Run) -> dict[str, Path]:
    """Write all of them, zones with their places on the run's road; the paths by key."""
    stage = run.stage
    shown = beyond_chance(found)
    outputs = write_rasters(found.vectors, found.smallest, shown, (found.grid, found.cell), crs, tags, stage)
    path = stage.path("displacement.gpkg")
    times = displacement_styles.magnification(found.vectors.motion[shown], found.grid.cell)
    zones = run.related.placed(zones_layer(found, crs), run.progress)
    layers = [
        Layer(
            vectors_layer(found, shown, crs), "vectors", displacement_styles.vectors_qml(times), geometry_type="Point"
        ),
        Layer(
            zones, "zones", displacement_styles.moving_zones_qml(times),
            geometry_type="MultiPolygon",
        ),
        Layer(
            one_direction_layer(found, crs), "one_direction",
            displacement_styles.one_direction_qml(times, found.grid.cell), geometry_type="Point",
        ),
    ]  # fmt: skip
    write_layers(path, layers)
    outputs["displacement_vectors"] = stage.final("displacement.gpkg")
    return outputs


def write_rasters(
    vectors: Vectors,
    smallest: Float,
    significant: Bool,
    at: tuple[Grid, Index],
    crs: CRS,
    tags: dict[str, str],
    stage: Stage,
) -> dict[str, Path]:
    """Write the rasters of vectors; the paths by key.

    Args:
        smallest: (n,) motion that would be seen, metres.
        significant: (n,) which of them QGIS draws in full colours.
        at: a grid, and the flat index (n,) in it of each window.
    """
    grid, cell = at
    shown = opacity_band.opacity(np.where(vectors.measured, 0.0, np.nan), significant)
    _write_displacement(vectors, shown, grid, cell, crs, tags, stage.path("displacement.tif"))
    outputs = {"displacement": stage.final("displacement.tif")}
    smallest = on_grid(cell, smallest, grid.shape)
    path = stage.path("smallest_motion.tif")
    description = "Smallest motion along the surface that can be told from none (3 standard errors)"
    geotiff.write_raster(path, smallest, grid, crs, description=description, tags=tags)
    qgis_styles.write_qml_next_to(path, qgis_styles.level_qml(_limit(smallest, 0.1)))
    return outputs | {"smallest_motion": stage.final("smallest_motion.tif")}


def _limit(values: Float, least: float) -> float:
    known = values[np.isfinite(values)]
    return max(float(np.quantile(known, _LIMIT_QUANTILE)), least) if len(known) else least


def _write_displacement(
    vectors: Vectors, opacity: Float, grid: Grid, cell: Index, crs: CRS, tags: dict[str, str], path: Path
) -> None:
    errors = np.sqrt(np.einsum("nii->ni", vectors.covariance))
    plane_errors = np.sqrt(np.einsum("nii->ni", vectors.in_plane_covariance))
    errors[~vectors.measured], plane_errors[~vectors.measured] = np.nan, np.nan
    values: list[tuple[str, Float, str]] = []
    for k, name in enumerate(("east", "north", "up")):
        values.append((f"motion {name}", vectors.motion[:, k], "m"))
    for k, name in enumerate(("down the dip", "across the dip, to the left looking down", "normal to the surface")):
        values.append((f"motion {name}", vectors.in_plane[:, k], "m"))
    for k, name in enumerate(("east", "north", "up")):
        values.append((f"standard error {name}", errors[:, k], "m"))
    for k, name in enumerate(("down the dip", "across the dip", "normal to the surface")):
        values.append((f"standard error {name}", plane_errors[:, k], "m"))
    values += [
        ("motion along the surface in standard errors", np.sqrt(vectors.statistic), "1"),
        ("share of the window seen in both surveys", vectors.seen, "1"),
        ("width of the window", np.where(vectors.measured, vectors.width, np.nan), "m"),
        ("status: " + ", ".join(f"{s.value} {REASONS[s]}" for s in Status), vectors.status.astype(np.float64), "1"),
        (displacement_styles.OPACITY_NAME, opacity, opacity_band.UNIT),
    ]
    bands = {name: on_grid(cell, band, grid.shape) for name, band, _ in values}
    geotiff.write_bands(path, bands, grid, crs, unit=[unit for *_, unit in values], tags=tags)
    # the first band that is shown is the motion down the dip
    qgis_styles.write_qml_next_to(
        path, displacement_styles.along_dip_qml(_limit(np.abs(bands["motion down the dip"]), 0.05))
    )


def directions(motion: Float, covariance: Float) -> dict[str, Float]:
    """Columns of motions (n, 3) and their covariances (n, 3, 3)."""
    level = np.hypot(motion[:, 0], motion[:, 1])
    length = np.linalg.norm(motion, axis=1)
    unit = motion / np.maximum(length, 1e-12)[:, None]
    values, axes = np.linalg.eigh(covariance[:, :2, :2]) if len(motion) else (np.zeros((0, 2)), np.zeros((0, 2, 2)))
    heading, dive = np.arctan2(motion[:, 0], motion[:, 1]), np.arctan2(-motion[:, 2], level)
    aside = np.column_stack([np.cos(heading), -np.sin(heading), np.zeros(len(motion))])
    below = np.column_stack([-np.sin(heading) * np.sin(dive), -np.cos(heading) * np.sin(dive), -np.cos(dive)])
    return {
        "east_m": motion[:, 0],
        "north_m": motion[:, 1],
        "up_m": motion[:, 2],
        "length_m": length,
        "length_err_m": np.sqrt(np.einsum("ni,nij,nj->n", unit, covariance, unit)),
        "azimuth_deg": np.degrees(heading) % 360.0,
        "azimuth_err_deg": _turn(level, aside, covariance),
        "plunge_deg": np.degrees(dive),
        "plunge_err_deg": _turn(length, below, covariance),
        "err_major_m": np.sqrt(np.maximum(values[:, 1], 0.0)),
        "err_minor_m": np.sqrt(np.maximum(values[:, 0], 0.0)),
        "err_azimuth_deg": np.degrees(np.arctan2(axes[:, 0, 1], axes[:, 1, 1])) % 180.0,
    }


def _turn(length: Float, across: Float, covariance: Float) -> Float:
    """(n,) standard errors (degrees) of the directions of motions, by their error along unit vectors ``across``."""
    error = np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", across, covariance, across), 0.0))
    return np.asarray(np.degrees(np.arctan2(error, length)))


def vectors_layer(found: Displacement, use: Bool, crs: CRS) -> gpd.GeoDataFrame:
    """The vectors ``use`` (n,) as points, one row each."""
    vectors = found.vectors
    errors = np.sqrt(np.einsum("nii->ni", vectors.in_plane_covariance[use]))
    table: dict[str, Any] = directions(vectors.motion[use], vectors.covariance[use]) | {
        "along_dip_m": vectors.in_plane[use, 0],
        "across_m": vectors.in_plane[use, 1],
        "normal_m": vectors.in_plane[use, 2],
        "along_dip_err_m": errors[:, 0],
        "across_err_m": errors[:, 1],
        "normal_err_m": errors[:, 2],
        "p_value": vectors.p_value(1)[use],
        "window_m": vectors.width[use],
        "seen_share": vectors.seen[use],
        "doubtful": found.uphill[use].astype(np.int64),
    }
    return gpd.GeoDataFrame(pd.DataFrame(table), geometry=shapely.points(vectors.places[use, :2]), crs=crs)


def one_direction_layer(found: Displacement, crs: CRS) -> gpd.GeoDataFrame:
    """The components of motion where relief holds one direction only, as points, one row each, beyond chance."""
    use = components_beyond_chance(found)
    parts = found.components
    vector = parts.direction[use] * parts.amount[use, None]
    columns = directions(vector, np.zeros((int(use.sum()), 3, 3)))
    table: dict[str, Any] = {
        name: columns[name] for name in ("east_m", "north_m", "up_m", "length_m", "azimuth_deg", "plunge_deg")
    }
    table |= {
        "length_err_m": parts.error[use],
        "azimuth_err_deg": np.degrees(parts.turn[use]),
        "p_value": parts.p_value[use],
        "window_m": parts.width[use],
        "seen_share": parts.seen[use],
    }
    places = found.vectors.places[parts.number[use], :2]
    return gpd.GeoDataFrame(pd.DataFrame(table), geometry=shapely.points(places), crs=crs)


def zones_layer(found: Displacement, crs: CRS) -> gpd.GeoDataFrame:
    """The zones that move as one, one row each."""
    zones = found.zones
    labels = np.zeros(found.grid.shape, dtype=np.int32)
    for number, zone in enumerate(zones, 1):
        labels.ravel()[found.cell[zone.windows]] = number
    motion = np.array([zone.motion for zone in zones]).reshape(-1, 3)
    covariance = np.array([zone.covariance for zone in zones]).reshape(-1, 3, 3)
    table: dict[str, Any] = {
        "zone_id": [f"M{number:03d}" for number in range(1, len(zones) + 1)],
        "area_m2": [zone.area for zone in zones],
        **directions(motion, covariance),
        "along_dip_m": [zone.in_plane[0] for zone in zones],
        "across_m": [zone.in_plane[1] for zone in zones],
        "normal_m": [zone.in_plane[2] for zone in zones],
        "along_dip_err_m": [_error(zone, 0) for zone in zones],
        "across_err_m": [_error(zone, 1) for zone in zones],
        "normal_err_m": [_error(zone, 2) for zone in zones],
        "off_dip_deg": [zone.off_dip for zone in zones],
        "off_dip_err_deg": [off_dip_error(zone) for zone in zones],
        "p_map": [zone.probability for zone in zones],
        "fitted_area_m2": [zone.fitted_area for zone in zones],
    }
    kinds = dict.fromkeys(table, "float64") | {"zone_id": "str"}  # also where no zone says so
    frame = pd.DataFrame(table).astype(kinds)
    return gpd.GeoDataFrame(frame, geometry=list(cell_polygons(labels, len(zones), found.grid)), crs=crs)


def _error(zone: MovingZone, axis: int) -> float:
    return float(np.sqrt(zone.in_plane_covariance[axis, axis]))


def _length_error(zone: MovingZone) -> float:
    unit = zone.motion / max(float(np.linalg.norm(zone.motion)), 1e-12)
    return float(np.sqrt(unit @ zone.covariance @ unit))


def main_figures(found: Displacement) -> dict[str, Any]:
    """The figures that a user reads first; lengths in metres, shares from 0 to 1."""
    vectors = found.vectors
    count = max(len(found.cell), 1)
    zone = found.zones[0] if found.zones else None
    fastest = max(found.zones, key=lambda zone: float(np.linalg.norm(zone.motion)), default=None)
    expected, most = chance_vectors(found)
    figures: dict[str, Any] = {
        "windows": len(found.cell),
        "measured_share": float(vectors.measured.mean()),
        "significant_vectors": int(found.significant.sum()),
        "chance_vectors": expected,
        "chance_vectors_most": most,
        "one_direction_vectors": int(components_beyond_chance(found).sum()),
        "moving_zone_count": len(found.zones),
        "moving_area_m2": float(sum(zone.area for zone in found.zones)),
        "fastest_zone_m": None if fastest is None else float(np.linalg.norm(fastest.motion)),
        "fastest_zone_err_m": None if fastest is None else _length_error(fastest),
        "largest_zone_off_dip_deg": None if zone is None else zone.off_dip,
        "smallest_motion_median_m": _median(found.smallest[vectors.measured]),
        "points_per_m2": found.points_per_m2,
        "kernel_m": found.kernel,
        "facets": len(found.facets.frames),
        "taken_off_m": [float(part) for part in found.taken_off],
    }
    for status in Status:
        if status != Status.MEASURED:
            figures[f"refused_{status.name.lower()}_share"] = float((vectors.status == status).sum() / count)
    for name, motion in (("common", found.common), ("stable", found.stable)):
        if motion is not None:
            figures[f"{name}_motion_m"] = [float(part) for part in motion.motion]
            figures[f"{name}_motion_err_m"] = [float(part) for part in np.sqrt(np.diag(motion.covariance))]
            figures[f"{name}_share"] = motion.share
            figures[f"{name}_variance_factor"] = motion.factor
    return figures


def step_figures(found: Displacement) -> dict[str, Any]:
    """The figures that a user reads first where the motion is a part of an inspection."""
    figures = main_figures(found)
    taken = (
        "significant_vectors", "chance_vectors",
        "chance_vectors_most", "moving_zone_count", "moving_area_m2", "fastest_zone_m", "fastest_zone_err_m",
        "smallest_motion_median_m",
    )  # fmt: skip
    return {"motion_measured_share": figures["measured_share"]} | {name: figures[name] for name in taken}


def _median(values: Float) -> float | None:
    return float(np.median(values)) if len(values) else None
