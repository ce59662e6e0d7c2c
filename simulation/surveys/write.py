"""Writing a simulated pair: two LAZ files, the ROI and the truth next to them."""

from __future__ import annotations

import json
from dataclasses import asdict
from datetime import date, datetime, timezone
from pathlib import Path
from typing import Any

import geopandas
import laspy
import numpy as np
from pyproj import CRS
from shapely import Polygon, contains_xy

from ...engine.core.arrays import Float
from ...engine.core.errors import InputError
from ...engine.core.progress import Progress
from ...engine.core.staged_outputs import atomic_output
from ...engine.grid.geotiff import write_bands, write_raster
from ...engine.grid.grid import Grid, snapped_grid
from ...engine.vector.geopackage import write_layer
from .change import describe
from .scanner import TURF_GROUND, SurveyCloud
from .survey import SimulatedPair, rectangle
from .true_motion import describe_motion, motion_raster, outlines

SCALE = 0.001
TRUTH_CELL = 0.1
MOTION_CELL_M = 0.25
"""Of the raster of true motion."""
GPS_EPOCH = datetime(1980, 1, 6, tzinfo=timezone.utc)


def write_pair(
    pair: SimulatedPair, directory: Path, progress: Progress | None = None, *, compressed: bool = True
) -> dict[str, Path]:
    """Write the pair and its truth into ``directory``, which is made if need be; the clouds as LAZ or LAS.

    Returns:
        Paths of ``first`` and ``second`` (clouds named by date), ``roi`` (GeoPackage), ``truth_dz`` (GeoTIFF, 0.1 m
        cells, mean change of each cell, in the first epoch's frame), ``truth_transform`` (second to first) and
        ``truth`` (seed, parameters, changes, figures). Where ground moved along itself, also ``truth_motion`` (GeoTIFF,
        0.25 m cells, way east, north and up of the first epoch's ground in the middle of each cell, NaN where it is
        buried) and ``truth_zones`` (GeoPackage, outlines of what moved).

    Raises:
        InputError: the directory cannot be made or written.
    """
    directory, progress = Path(directory), progress or Progress()
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"The folder {directory} cannot be made ({error.strerror}); choose another output.") from error
    crs = CRS.from_user_input(pair.crs)
    suffix = ".laz" if compressed else ".las"
    paths = {
        "first": directory / f"{pair.dates[0]}{suffix}",
        "second": directory / f"{pair.dates[1]}{suffix}",
        "roi": directory / "roi.gpkg",
        "truth_dz": directory / "truth_dz.tif",
        "truth_transform": directory / "truth_transform.json",
        "truth": directory / "truth.json",
    }
    for number, (name, cloud) in enumerate((("first", pair.first), ("second", pair.second))):
        progress.update(0.35 * number, f"writing {paths[name].name}")
        write_survey(paths[name], cloud, crs, pair.dates[number])
    progress.update(0.7, "writing the truth")
    write_region(paths["roi"], pair.roi, crs, date.fromisoformat(pair.dates[0]))
    grid, raster = truth_raster(pair)
    write_raster(paths["truth_dz"], raster, grid, crs, description="True change of the cell mean")
    if pair.motions:
        paths |= {"truth_motion": directory / "truth_motion.tif", "truth_zones": directory / "truth_zones.gpkg"}
        coarse = snapped_grid(pair.bounds, MOTION_CELL_M)
        write_bands(paths["truth_motion"], motion_raster(pair.scene, pair.before, coarse), coarse, crs)
        day = date.fromisoformat(pair.dates[1])
        write_layer(paths["truth_zones"], outlines(pair.motions, pair.scene, crs), "motions", stamp=day)
    pair.transform.save(paths["truth_transform"], crs)
    write_json(paths["truth"], _truth(pair))
    progress.update(1.0, "written")
    return paths


def write_region(path: Path, ring: Float, crs: CRS, day: date) -> None:
    """Write the ring (n, 2) of the region of interest as the only polygon of a GeoPackage."""
    region = geopandas.GeoDataFrame({"name": ["slope"]}, geometry=[Polygon(ring)], crs=crs)
    write_layer(path, region, "roi", stamp=day)


def write_json(path: Path, values: dict[str, Any]) -> None:
    """Write a JSON file, indented."""
    with atomic_output(path) as partial:
        partial.write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")


def truth_raster(pair: SimulatedPair) -> tuple[Grid, Float]:
    """The true change on a snapped grid over the surveyed area, NaN outside it (rows, columns), m."""
    grid = snapped_grid(pair.bounds, TRUTH_CELL)
    raster = pair.true_change_raster(grid)
    x = grid.west + (np.arange(grid.columns) + 0.5) * grid.cell
    y = grid.north - (np.arange(grid.rows) + 0.5) * grid.cell
    area = Polygon(rectangle(pair.area, pair.scene.frame))
    raster[~contains_xy(area, *np.meshgrid(x, y))] = np.nan
    return grid, raster


def write_survey(path: Path, cloud: SurveyCloud, crs: CRS, day: str) -> None:
    """Write one epoch as LAS 1.4, point format 7 (LAZ if ``path`` ends so), with an extra dimension ``truth_ground``.

    Time is adjusted standard GPS time of a flight at 08:00 UTC on ``day`` (YYYY-MM-DD).
    """
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales = np.full(3, SCALE)
    header.offsets = np.floor(cloud.xyz.min(axis=0) / 100.0) * 100.0 if len(cloud) else np.zeros(3)
    header.add_crs(crs)
    header.system_identifier = "SlopeWatch simulation"
    header.generating_software = "SlopeWatch"
    flown = datetime.fromisoformat(f"{day}T08:00:00+00:00")
    # laspy puts today's date otherwise, and the same seed would not give the same bytes.
    header.creation_date = flown.date()
    header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
    header.add_extra_dim(laspy.ExtraBytesParams("truth_ground", np.uint8, "1: echo of the ground"))
    las = laspy.LasData(header)
    las.x, las.y, las.z = cloud.xyz.T
    las.red, las.green, las.blue = (cloud.rgb.astype(np.uint16) * 257).T
    las.intensity = cloud.intensity
    las.return_number = cloud.return_number
    las.number_of_returns = cloud.number_of_returns
    las.gps_time = (flown - GPS_EPOCH).total_seconds() - 1e9 + cloud.gps_time
    las.scan_angle = np.round(cloud.scan_angle / 0.006).astype(np.int16)
    las.point_source_id = cloud.line
    las.truth_ground = cloud.truth_ground
    with atomic_output(path) as partial:
        las.write(str(partial))


def _truth(pair: SimulatedPair) -> dict[str, Any]:
    region = Polygon(pair.roi)
    u0, v0, u1, v1 = pair.scene.slope
    return {
        "parameters": asdict(pair.parameters),
        "crs": pair.crs,
        "frame": asdict(pair.scene.frame),
        "slope_rectangle_m": [u0, v0, u1, v1],
        "vegetation_cover_of_slope": pair.canopy.cover(pair.scene.slope),
        "turf_counts_as_ground_up_to_m": TURF_GROUND,
        "changes": [describe(change, pair.scene.frame) for change in pair.changes],
        "motions": [describe_motion(motion, pair.scene) for motion in pair.motions],
        "volume_raised_m3": sum(change.volumes[0] for change in pair.changes),
        "volume_lowered_m3": sum(change.volumes[1] for change in pair.changes),
        "epochs": [
            {
                "date": day,
                "points": len(cloud),
                "ground_points": int(cloud.truth_ground.sum()),
                "points_in_roi": int(contains_xy(region, cloud.xyz[:, 0], cloud.xyz[:, 1]).sum()),
            }
            for day, cloud in zip(pair.dates, (pair.first, pair.second), strict=True)
        ],
    }
