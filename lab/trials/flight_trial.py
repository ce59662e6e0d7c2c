"""Whether planned flights keep what they promise: scenes are flown along the planned lines, and compared.

    .venv/bin/python lab/trials/flight_trial.py FOLDER [SCENE ...]

Each scene is surveyed once as the simulation flies by itself; `slopewatch ground` extracts its ground. The plan is made
of that ground and that survey. Then two surveys are flown along the plan's lines, at its pulse rate; `ground`,
`register` and `change` run on both, and the densities and levels measured are set against the plan's, at the median and
place by place.
"""

from __future__ import annotations

import json
import math
import sys
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

import numpy as np
import shapely
from pyproj import CRS
from slopewatch import api
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.grid.geotiff import read_raster
from slopewatch.engine.grid.grid import cell_index
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.engine.vector.geopackage import read_layer
from slopewatch.interface.parameters import SurveyParameters
from slopewatch.simulation.frame import Frame
from slopewatch.simulation.surveys.layers import Landscape
from slopewatch.simulation.surveys.pattern import Scanner, WaypointFlight
from slopewatch.simulation.surveys.plants import cover_of
from slopewatch.simulation.surveys.scanner import SurveyCloud, scan
from slopewatch.simulation.surveys.scene import Relief
from slopewatch.simulation.surveys.survey import BuiltSlope, built_slope, expand, rectangle, survey_area
from slopewatch.simulation.surveys.write import write_region, write_survey

CRS_NAME = "EPSG:32651"


@dataclass(frozen=True)
class Trial:
    """A scene, and how it is flown the second time."""

    survey: SurveyParameters
    flight: dict[str, object]
    sweeps: float = 0.0


_SMALL = {"points": 250_000, "length": 36.0, "height": 18.0, "offset": 0.0, "amplitude": 0.0}
TRIALS = {
    "bare": Trial(SurveyParameters(seed=3, vegetation=0.0, angle=39.0, **_SMALL), {"pulse_rate": 16000.0}, 60.0),
    "plants": Trial(SurveyParameters(seed=4, vegetation=0.7, angle=39.0, **_SMALL), {"pulse_rate": 30000.0}, 60.0),
    "steep": Trial(
        SurveyParameters(seed=5, vegetation=0.4, angle=52.0, **_SMALL),
        {"pulse_rate": 25000.0, "scan_pattern": "rosette", "altitude": 50.0},
    ),
    "bench": Trial(
        SurveyParameters(seed=6, vegetation=0.5, angle=45.0, benches=1, **_SMALL),
        {"pulse_rate": 8000.0, "altitude": 30.0, "flying_speed": 4.0},
        60.0,
    ),
    # not looked at while the plan was built: other altitudes, overlaps, sweeps and plants
    "high": Trial(
        SurveyParameters(seed=21, vegetation=0.6, angle=35.0, **_SMALL),
        {"pulse_rate": 60000.0, "altitude": 70.0, "flying_speed": 5.0, "side_overlap": 0.3},
        100.0,
    ),
    "low": Trial(
        SurveyParameters(seed=22, vegetation=0.3, angle=43.0, **_SMALL),
        {"pulse_rate": 8000.0, "altitude": 25.0, "side_overlap": 0.7},
        40.0,
    ),
    "dense": Trial(
        SurveyParameters(seed=23, vegetation=0.9, angle=33.0, **_SMALL),
        {"pulse_rate": 40000.0, "flying_speed": 6.0, "field_of_view": 90.0},
        80.0,
    ),
    "turning": Trial(
        SurveyParameters(seed=24, vegetation=0.2, angle=48.0, **_SMALL),
        {"pulse_rate": 30000.0, "scan_pattern": "rosette", "altitude": 60.0, "side_overlap": 0.6},
    ),
}


def fly(slope: BuiltSlope, landscape: Landscape, lines: list[np.ndarray], scanner: Scanner, seed: int) -> SurveyCloud:
    """A survey along lines (k, 3) in the world, at the scanner's full rate."""
    frame = slope.scene.frame
    flight = WaypointFlight(tuple(frame.to_local(line) for line in lines), scanner, phase=17.0 * seed)
    area = expand(slope.roi, 3.0)
    return scan(landscape, flight, area, math.ceil(flight.pulses), 0.02, (seed, 1))


def run_trial(name: str, trial: Trial, folder: Path) -> dict[str, object]:
    """One scene; figures promised and reached."""
    folder.mkdir(parents=True, exist_ok=True)
    parameters = trial.survey
    slope = built_slope(parameters, Relief(), Frame(), 0.0, Progress())
    landscape = Landscape(slope.scene, slope.canopy, cover_of(parameters, slope.scene, 0))
    crs = CRS.from_user_input(CRS_NAME)
    roi = folder / "roi.gpkg"
    write_region(roi, rectangle(slope.roi, slope.scene.frame), crs, _day(0))
    area, pulses = survey_area(landscape, slope.plan, slope.roi, parameters)
    last = scan(landscape, slope.plan, area, pulses, parameters.range_noise, (parameters.seed, 11))
    write_survey(folder / "last.laz", last, crs, "2024-05-01")
    # wider than the region, so that the terrain reaches under the outermost lines
    wide = folder / "wide.gpkg"
    write_region(wide, rectangle(expand(slope.roi, 3.0), slope.scene.frame), crs, _day(0))
    api.extract_ground(folder / "last.laz", folder / "last_ground.laz", roi=wide)
    api.plan_flight(
        folder / "last_ground.laz", roi, folder / "plan", survey=folder / "last.laz", overwrite=True, **trial.flight
    )
    plan = json.loads((folder / "plan" / "run.json").read_text(encoding="utf-8"))
    used = plan["parameters"]["flight"]
    lines = [
        shapely.get_coordinates(line, include_z=True)
        for line in read_layer(folder / "plan" / "plan.gpkg", "lines").sort_values("line").geometry
    ]
    scanner = replace(
        Scanner(),
        altitude=used["altitude"],
        speed=used["flying_speed"],
        pulse_rate=used["pulse_rate"],
        field_of_view=used["field_of_view"],
        sweeps=trial.sweeps,
    )
    grounds = []
    for epoch in (0, 1):
        cloud = fly(slope, landscape, lines, scanner, parameters.seed + 100 + epoch)
        raw, ground = folder / f"epoch{epoch}.laz", folder / f"ground{epoch}.laz"
        write_survey(raw, cloud, crs, f"202{5 + epoch}-05-01")
        api.extract_ground(raw, ground, roi=roi)
        grounds.append(ground)
    aligned, transform = folder / "aligned.laz", folder / "transform.json"
    api.register(*grounds, aligned, transform=transform)
    days = tuple(_day(1 + epoch) for epoch in (0, 1))
    api.change(grounds[0], grounds[1], folder / "change", transform=transform, dates=days, overwrite=True)
    return compared(folder, plan)


def compared(folder: Path, plan: dict) -> dict[str, object]:
    """Promised and reached: medians over the places that lie within the region as a whole, and place by place."""
    promised = read_raster(folder / "plan" / "expected_ground.tif")
    grid = promised.grid
    region = shapely.union_all(read_layer(folder / "roi.gpkg").geometry.values)
    rows, columns = np.nonzero(np.isfinite(promised.array))
    west, north = grid.west + columns * grid.cell, grid.north - rows * grid.cell
    whole = shapely.contains(region, shapely.box(west, north - grid.cell, west + grid.cell, north))
    rows, columns = rows[whole], columns[whole]

    def density(path: Path, first: bool = False) -> np.ndarray:
        cloud = read_cloud(path)
        place = cell_index(cloud.xyz, grid)
        counts = np.bincount(place[place >= 0], minlength=grid.rows * grid.columns)
        return counts.reshape(grid.shape)[rows, columns] / grid.cell**2

    ground = np.mean([density(folder / f"ground{epoch}.laz") for epoch in (0, 1)], axis=0)
    returns = np.mean([density(folder / f"epoch{epoch}.laz") for epoch in (0, 1)], axis=0)
    wanted = promised.array[rows, columns]
    wanted_returns = read_raster(folder / "plan" / "expected_returns.tif").array[rows, columns]
    level = read_raster(folder / "change" / "level_of_detection.tif")
    levels = level.array[np.isfinite(level.array)]
    record = json.loads((folder / "change" / "run.json").read_text(encoding="utf-8"))
    wanted_level = read_raster(folder / "plan" / "expected_level.tif").array[rows, columns]
    pairs = _level_by_place(level, grid, rows, columns)
    known = np.isfinite(pairs) & np.isfinite(wanted_level)
    return {
        "places": len(rows),
        "returns_promised": float(wanted_returns.mean()),
        "returns_reached": float(returns.mean()),
        "ground_promised": float(wanted.mean()),
        "ground_reached": float(ground.mean()),
        "ground_ratio": float(ground.mean() / wanted.mean()),
        "ground_ratio_median_of_places": float(np.median(ground[wanted > 1] / wanted[wanted > 1])),
        "level_promised": float(np.nanmedian(wanted_level)),
        "level_reached_cells": float(np.median(levels)),
        "level_reached_places": float(np.nanmedian(pairs)),
        "level_ratio": float(np.nanmedian(pairs) / np.nanmedian(wanted_level)),
        "level_ratio_median_of_places": float(np.median(pairs[known] / wanted_level[known])),
        "registration_error": record["metrics"].get("registration_error_m"),
        "cell": record.get("cell", {}).get("cell_m"),
        "scatter": plan["ground_scatter"],
        "lines": plan["metrics"]["line_count"],
    }


def _level_by_place(level, grid, rows, columns) -> np.ndarray:  # type: ignore[no-untyped-def]
    """Median level of the cells of each place (n,)."""
    r, c = np.nonzero(np.isfinite(level.array))
    x = level.grid.west + (c + 0.5) * level.grid.cell
    y = level.grid.north - (r + 0.5) * level.grid.cell
    place = cell_index(np.column_stack([x, y]), grid)
    values = level.array[r, c]
    order = np.argsort(place, kind="stable")
    place, values = place[order], values[order]
    found = np.full(grid.rows * grid.columns, np.nan)
    edges = np.flatnonzero(np.diff(place)) + 1
    for part, own in zip(np.split(values, edges), np.split(place, edges), strict=True):
        if own[0] >= 0:
            found[own[0]] = np.median(part)
    return found.reshape(grid.shape)[rows, columns]


def _day(years: int) -> date:
    return date(2024 + years, 5, 1)


if __name__ == "__main__":
    out = Path(sys.argv[1])
    for wanted in sys.argv[2:] or TRIALS:
        found = run_trial(wanted, TRIALS[wanted], out / wanted)
        (out / f"{wanted}.json").write_text(json.dumps(found, indent=1), encoding="utf-8")
        print(wanted, json.dumps(found, indent=1), flush=True)
