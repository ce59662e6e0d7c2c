"""What M3C2 writes: the core points with what was measured there, rasters of their means, zones, the main figures."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from ...engine.core.arrays import Float
from ...engine.core.errors import InputError
from ...engine.core.staged_outputs import Stage
from ...engine.grid import geotiff
from ...engine.grid.grid import Grid, cell_index, snapped_grid
from ...engine.m3c2.distances import Distances, Status
from ...engine.maps import palette, qgis_styles
from ...engine.maps.face_picture import write_face_png
from ...engine.report.facts import days_between, zone_rows
from ...engine.statistics.normal import quantile
from ...engine.statistics.robust import nmad
from ...engine.zones.extraction import Origin
from ...engine.zones.face_zones import MAX_OBLIQUE_DEG, FaceZones, face_zones
from ...engine.zones.gcd_table import table_frame, volume_table, write_volume_table
from ...interface.parameters import ZoneParameters
from ..run import Run
from .change import Context
from .masked_raster import Legend, write_masked_raster
from .zones import write_zones, zone_figures

ZONES, VOLUMES, PICTURE = "m3c2_zones.gpkg", "m3c2_volumes.csv", "m3c2_face.png"
RASTERS = ("m3c2_distance", "m3c2_level_of_detection", "m3c2_significant")
MAPS = (*(f"{name}.tif" for name in RASTERS), ZONES, VOLUMES, PICTURE)
_MAX_CELLS = 50_000_000
_MIN_TOLD_SHARE = 0.005
"""Of the core points, one in a hundred when rounded."""


@dataclass(frozen=True)
class DistanceRasters:
    """Means of the measured core points in each cell: ``distance`` and ``level`` of shape ``grid.shape``, metres, NaN
    in cells without any; ``significant`` is the distance where it exceeds the level, else NaN.

    The level is not divided by the number of points, because neighbouring cylinders share theirs.
    """

    grid: Grid
    distance: Float
    level: Float
    significant: Float


def dimensions(found: Distances) -> dict[str, NDArray[np.generic]]:
    """Extra dimensions of the core points, named as PDAL's ``filters.m3c2`` names them where it has the same."""
    values: dict[str, NDArray[np.generic]] = {
        "m3c2_distance": found.distance.astype(np.float32),
        "m3c2_uncertainty": found.level.astype(np.float32),
        "m3c2_significant": found.significant.astype(np.uint8),
        "m3c2_count1": found.reference.count.astype(np.uint32),
        "m3c2_count2": found.moving.count.astype(np.uint32),
        "m3c2_std_dev1": found.reference.std.astype(np.float32),
        "m3c2_std_dev2": found.moving.std.astype(np.float32),
        "m3c2_status": found.status.astype(np.uint8),
    }
    for axis, name in enumerate(("NormalX", "NormalY", "NormalZ")):
        values[name] = found.normal[:, axis].astype(np.float32)
    return values


def rasterise(found: Distances, cell: float) -> DistanceRasters:
    """Mean distance and level of the measured core points in cells of ``cell`` metres, on a snapped grid.

    Raises:
        InputError: the grid would be too large.
    """
    xy = found.core[:, :2]
    grid = snapped_grid((*xy.min(axis=0).tolist(), *xy.max(axis=0).tolist()), cell)
    if grid.rows * grid.columns > _MAX_CELLS:
        raise InputError(
            f"Rasters of {grid.rows} by {grid.columns} cells are too large; give a --distance-cell above {cell:g} m, "
            "or remove stray core points."
        )
    index = cell_index(xy[found.measured], grid)
    cells = grid.rows * grid.columns
    count = np.bincount(index, minlength=cells)
    with np.errstate(invalid="ignore"):
        distance, level = (
            (np.bincount(index, values[found.measured], cells) / count).reshape(grid.shape)
            for values in (found.distance, found.level)
        )
        significant = np.where(np.abs(distance) > level, distance, np.nan)
    return DistanceRasters(grid=grid, distance=distance, level=level, significant=significant)


def write_rasters(
    found: Distances, cell: float, crs: CRS, tags: dict[str, str], stage: Stage
) -> tuple[dict[str, Path], float]:
    """Write the three rasters with their styles into ``stage``; returns the final paths by name, and the end of their
    colours, metres.
    """
    made = rasterise(found, cell)
    limit = palette.colour_limit(made.significant, None, level=float(np.nanmedian(made.level)))
    path, beyond = stage.path(f"{RASTERS[0]}.tif"), np.isfinite(made.significant)
    legend = Legend("Distance along the normal (M3C2), later minus earlier", limit)
    write_masked_raster(path, made.distance, beyond, made.grid, crs, legend, tags)
    outputs = {RASTERS[0]: stage.final(path.name)}
    layers = (
        (
            made.level,
            f"Level of detection of M3C2, {found.confidence:.4g} confidence",
            qgis_styles.level_qml(max(float(np.nanpercentile(made.level, 98)), 1e-3)),
        ),
        (made.significant, "Distance (M3C2) beyond the level of detection", qgis_styles.change_qml(limit)),
    )
    for name, (array, description, qml) in zip(RASTERS[1:], layers, strict=True):
        path = stage.path(f"{name}.tif")
        geotiff.write_raster(path, array, made.grid, crs, description=description, tags=tags)
        qgis_styles.write_qml_next_to(path, qml)
        outputs[name] = stage.final(path.name)
    return outputs, limit


def write_maps(
    run: Run, found: Distances, cell: float, context: Context, parameters: ZoneParameters, folder: Path
) -> None:
    """Write rasters and zones into ``folder``; ``run`` gets their paths and figures.

    Args:
        cell: metres, of the rasters and of the cells on the face.
    """
    tags = context.tags(median_level_95(found))
    stage = run.stage_in(folder)
    outputs, limit = write_rasters(found, cell, context.crs, tags, stage)
    run.outputs |= outputs
    run.progress.update(0.5, "outlining zones")
    origin = Origin(context.dates, context.method, context.run_id)
    zones = face_zones(found, cell, context.crs, parameters, origin=origin)
    run.figures |= _write_zones(run, zones, context.second.date, stage)
    run.progress.update(0.7, "drawing the face")
    names = context.first.name, context.second.name
    write_face_png(stage.path(PICTURE), zones, limit, names, run.progress)
    run.outputs["m3c2_face"] = stage.final(PICTURE)
    plane = zones.face.face
    run.facts |= {
        "days": days_between(context.first, context.second),
        "reference_system": {"name": context.crs.name, "epsg": context.crs.to_epsg()},
        "colour_limit_m": limit,
        "face": {"dip_deg": plane.dip, "azimuth_deg": plane.seen_from, "cell_m": cell},
        "zones": zone_rows(zones.zones.frame),
    }
    if zones.face.left_out >= _MIN_TOLD_SHARE:
        run.progress.warning(
            f"{100 * zones.face.left_out:.0f} % of the measured core points are in no zone and no volume. There the "
            f"face turns by more than {MAX_OBLIQUE_DEG:.0f}° from the plane that fits it best, or its parts lie behind "
            "one another. Measure each of its sides alone, with --roi around it."
        )


def _write_zones(run: Run, found: FaceZones, stamp: date | None, stage: Stage) -> dict[str, Any]:
    """Write zones and table of volumes; ``run`` gets their paths. Returns the main figures."""
    zones = found.zones
    table = volume_table(found.cells, found.significant, zones.volumes, zones.correlation)
    run.facts["volumes"] = table.facts()
    write_zones(
        stage.path(ZONES),
        zones.frame,
        footprints=found.footprints,
        unsure=zones.unsure,
        volumes=table_frame(table),
        stamp=stamp,
    )
    write_volume_table(stage.path(VOLUMES), table)
    run.outputs |= {"m3c2_zones": stage.final(ZONES), "m3c2_volumes": stage.final(VOLUMES)}
    figures = {**zone_figures(zones.frame), "unsure_groups": len(zones.unsure), "left_out_share": found.face.left_out}
    return figures | table.figures()


def median_level_95(found: Distances) -> float:
    """Median level of detection at 95 %, whatever confidence was asked for, metres."""
    return float(np.median(found.level[found.measured])) * quantile(0.95) / quantile(found.confidence)


def main_figures(found: Distances) -> dict[str, Any]:
    """The figures that a user reads first; lengths in metres, shares from 0 to 1."""
    distance, level = found.distance[found.measured], found.level[found.measured]
    beyond = found.distance[found.significant]
    fewest = np.minimum(found.reference.count, found.moving.count)[found.measured]
    middle = float(np.median(distance))
    return {
        "core_points": len(found.core),
        "measured_points": len(distance),
        "few_points": int(np.sum(found.status == Status.FEW_POINTS)),
        "no_points": int(np.sum(found.status == Status.NO_POINTS)),
        "no_normal": int(np.sum(found.status == Status.NO_NORMAL)),
        "distance_median_m": middle,
        "distance_nmad_m": nmad(distance, middle),
        "lod_median_m": float(np.median(level)),
        "confidence": found.confidence,
        "registration_error_m": found.registration_error,
        "significant_points": len(beyond),
        "significant_share": len(beyond) / len(distance),
        "largest_lowering_m": float(min(beyond.min(initial=0.0), 0.0)),
        "largest_raising_m": float(max(beyond.max(initial=0.0), 0.0)),
        "cylinder_points_median": float(np.median(fewest)),
        "cylinders_of_20_points": float(np.mean(fewest >= 20)),
    }
