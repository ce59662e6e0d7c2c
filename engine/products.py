"""From a change to the files a GIS takes: rasters, zones, heatmap, and the main figures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS
from scipy import ndimage

from . import heatmap, rasters, styles, top_view, vectors, zones
from .change import Change
from .clouds import PointCloud
from .epochs import Epoch
from .gridding import Float, Grid, snapped_grid
from .outputs import Stage
from .parameters import HeatmapParameters, ZoneParameters
from .progress import Progress
from .transform import RigidTransform
from .version import VERSION

_Z95 = 1.959963984540054


@dataclass(frozen=True)
class Context:
    """What the products say about their origin. ``transform`` is None where nothing was registered by SlopeWatch."""

    first: Epoch
    second: Epoch
    crs: CRS
    transform: RigidTransform | None
    input_hashes: tuple[str, ...]
    method: str
    run_id: str


def write_products(
    change: Change,
    picture: PointCloud,
    context: Context,
    zone_parameters: ZoneParameters,
    heatmap_parameters: HeatmapParameters,
    stage: Stage,
    progress: Progress,
) -> tuple[dict[str, Path], dict[str, Any]]:
    """Write the outputs of one change into ``stage``.

    Args:
        picture: the cloud that the top view shows (the later epoch with its vegetation).

    Returns:
        The final paths by name, and the main figures.
    """
    tags = _tags(change, context)
    progress.update(0.0, "writing rasters")
    arrays = {
        "elevation_change": (change.dz, "Elevation change, second epoch minus first"),
        "level_of_detection": (change.level, f"Level of detection at {change.confidence:.0%} confidence"),
        "significant_change": (
            np.where(change.significant, change.dz, np.nan),
            "Elevation change beyond the level of detection",
        ),
    }
    outputs = {}
    for name, (array, description) in arrays.items():
        rasters.write_raster(
            stage.path(f"{name}.tif"), array, change.grid, context.crs, description=description, tags=tags
        )
        outputs[name] = stage.final(f"{name}.tif")
    limit = styles.colour_limit(change.dz, heatmap_parameters.colour_range)
    styles.write_raster_styles(stage.folder, change, limit)

    progress.update(0.3, "outlining zones")
    found = zones.extract_zones(
        change,
        context.crs,
        zone_parameters,
        slope=slope_degrees(change.height_to, change.grid.cell),
        epochs=(context.first.date, context.second.date),
        method=context.method,
        run_id=context.run_id,
    )
    vectors.write_layer(stage.path("zones.gpkg"), found, "zones", style=styles.zones_style())
    outputs["zones"] = stage.final("zones.gpkg")

    progress.update(0.5, "drawing the heatmap")
    view = top_view.top_view(picture, picture_grid(change.grid, heatmap_parameters.top_view_pixel))
    rasters.write_rgba(stage.path("top_view.tif"), view.rgba, view.grid, context.crs, tags=tags)
    heatmap.write_heatmap(
        stage.path("heatmap.png"),
        stage.path("heatmap.tif"),
        change,
        view,
        found,
        context.crs,
        heatmap_parameters,
        limit=limit,
        epochs=(context.first.name, context.second.name),
        tags=tags,
    )
    for name, file in (("heatmap", "heatmap.png"), ("heatmap_raster", "heatmap.tif"), ("top_view", "top_view.tif")):
        outputs[name] = stage.final(file)
    progress.update(1.0, "drawing the heatmap")
    return outputs, main_figures(change, found)


def main_figures(change: Change, found: Any) -> dict[str, Any]:
    """The figures that a user reads first; lengths in metres, areas in m², volumes in m³."""
    dz = change.dz[change.valid]
    area = change.grid.cell**2
    significant = change.dz[change.significant]
    return {
        "common_cell_rate": change.common_cell_rate,
        "common_area_m2": float(change.valid.sum() * area),
        "lod_median_m": change.median_level,
        "confidence": change.confidence,
        "registration_error_m": change.registration_error,
        "dz_median_m": float(np.median(dz)),
        "dz_nmad_m": float(1.4826 * np.median(np.abs(dz - np.median(dz)))),
        "significant_area_m2": float(significant.size * area),
        "zone_count": len(found),
        "zone_area_m2": float(found["area_m2"].sum()),
        "vol_loss_m3": float(found["vol_loss_m3"].sum()),
        "vol_gain_m3": float(found["vol_gain_m3"].sum()),
        "largest_sink_m": float(min(found["dz_min_m"].min(), 0.0)) if len(found) else 0.0,
        "largest_rise_m": float(max(found["dz_max_m"].max(), 0.0)) if len(found) else 0.0,
    }


def picture_grid(grid: Grid, pixel: float) -> Grid:
    """The grid of the top view over the same ground."""
    west, south, east, north = grid.bounds
    return snapped_grid((west, south, east - 1e-3 * pixel, north - 1e-3 * pixel), pixel)


def slope_degrees(height: Float, cell: float, *, smoothing: float = 0.5) -> Float:
    """Slope of the surface in degrees, from heights (rows, columns) averaged over ``smoothing`` metres; NaN: no data."""
    known = np.isfinite(height)
    sigma = max(smoothing / cell, 1.0)
    weight = ndimage.gaussian_filter(known.astype(float), sigma, mode="constant")
    level = float(np.nanmedian(height))
    total = ndimage.gaussian_filter(np.where(known, height - level, 0.0), sigma, mode="constant")
    with np.errstate(invalid="ignore", divide="ignore"):
        smooth = np.where(weight > 1e-3, total / weight, np.nan)
    if min(smooth.shape) < 2:
        return np.full(height.shape, np.nan)
    down, right = np.gradient(smooth, cell)
    return np.where(known, np.degrees(np.arctan(np.hypot(down, right))), np.nan)


def _tags(change: Change, context: Context) -> dict[str, str]:
    shift = np.zeros(3) if context.transform is None else context.transform.translation
    return {
        "EPOCH_FROM": context.first.name,
        "EPOCH_TO": context.second.name,
        "LOD95_MEDIAN": f"{_Z95 * float(np.nanmedian(change.error)):.4f}",
        "COREG_DX": f"{shift[0]:.4f}",
        "COREG_DY": f"{shift[1]:.4f}",
        "COREG_DZ": f"{shift[2]:.4f}",
        "SOFTWARE": f"SlopeWatch {VERSION}",
        "INPUT_SHA256": " ".join(context.input_hashes),
    }
