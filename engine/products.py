"""From a change to the files a GIS takes: rasters, zones, heatmap, and the main figures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
from pyproj import CRS

from . import heatmap, palette, rasters, styles, top_view, vectors, zones
from .change import Change, compared_share
from .clouds import PointCloud
from .epochs import Epoch
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
    dates = context.first.date, context.second.date
    tags = rasters.raster_tags(
        epochs=dates,
        median_level=_Z95 * float(np.nanmedian(change.error)),
        translation=None if context.transform is None else context.transform.translation,
        software=f"SlopeWatch {VERSION}",
        input_sha256=" ".join(context.input_hashes),
    )
    progress.update(0.0, "writing rasters")
    limit = palette.colour_limit(
        change.dz[change.significant], heatmap_parameters.colour_range, level=change.median_level
    )
    outputs = _write_rasters(change, context.crs, tags, limit, stage)

    progress.update(0.3, "outlining zones")
    found = zones.extract_zones(
        change.dz,
        change.significant & (change.uniform_dz is None),
        _Z95 * change.error,  # ``lod95_m`` is at 95 % whatever confidence was asked for
        change.error,
        np.minimum(change.count_from, change.count_to),
        change.grid,
        context.crs,
        zone_parameters,
        registration_error=change.registration_error,
        heights=change.height_to,
        epochs=dates,
        method=context.method,
        run_id=context.run_id,
    )
    vectors.write_zones(stage.path("zones.gpkg"), found.frame, stamp=dates[1])
    outputs["zones"] = stage.final("zones.gpkg")

    progress.update(0.5, "drawing the heatmap")
    view = top_view.top_view(picture, top_view.top_view_grid(change.grid, heatmap_parameters.top_view_pixel))
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
    return outputs, main_figures(change, found.frame)


def main_figures(change: Change, found: gpd.GeoDataFrame) -> dict[str, Any]:
    """The figures that a user reads first; lengths in metres, areas in m², volumes in m³."""
    dz = change.dz[change.valid]
    area = change.grid.cell**2
    significant = change.dz[change.significant]
    return {
        "common_cell_rate": change.common_cell_rate,
        "common_area_m2": float(change.valid.sum() * area),
        "compared_share": compared_share(change),
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


def _write_rasters(change: Change, crs: CRS, tags: dict[str, str], limit: float, stage: Stage) -> dict[str, Path]:
    level = change.median_level
    layers = (
        ("elevation_change", change.dz, "Elevation change, later minus earlier", styles.change_qml(limit, level)),
        (
            "level_of_detection",
            change.level,
            f"Level of detection, {change.confidence:.4g} confidence",
            styles.level_qml(float(np.nanpercentile(change.level, 98))),
        ),
        (
            "significant_change",
            np.where(change.significant, change.dz, np.nan),
            "Elevation change beyond the level of detection",
            styles.change_qml(limit),
        ),
    )
    outputs = {}
    for name, array, description, qml in layers:
        path = stage.path(f"{name}.tif")
        rasters.write_raster(path, array, change.grid, crs, description=description, tags=tags)
        styles.write_qml_beside(path, qml)
        outputs[name] = stage.final(path.name)
    return outputs
