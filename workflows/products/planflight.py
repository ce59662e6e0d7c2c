"""The files of a planned flight."""

from __future__ import annotations

import csv
import math

import geopandas as gpd
import numpy as np
import pandas as pd
import shapely
from pyproj import CRS

from ...engine.core.arrays import Float
from ...engine.core.staged_outputs import atomic_output
from ...engine.core.table_text import cell
from ...engine.core.version import VERSION
from ...engine.flight.kml import write_kml
from ...engine.flight.plan import Expected, Plan
from ...engine.flight.wpml import MAX_MISSIONS, missions_of, write_mission
from ...engine.grid import geotiff
from ...engine.maps import qgis_styles
from ...engine.maps.flight_picture import write_plan_picture
from ...engine.maps.flight_styles import flight_lines_qml, waypoints_qml
from ...engine.maps.picture_words import say
from ...engine.vector.geopackage import Layer, write_layers
from ...interface.parameters import FlightParameters, MissionParameters
from ..flight_seasons import Seasons
from ..run import Run

_RASTERS = (
    ("expected_returns", "returns", "Expected returns per square metre of map", "returns/m²"),
    ("expected_ground", "ground", "Expected ground returns per square metre of map", "returns/m²"),
    ("expected_level", "level", "Expected level of detection", "m"),
    ("expected_motion", "motion", "Smallest motion along the surface that is expected to show", "m"),
)
PLAN_OUTPUTS = (
    "plan.gpkg",
    "plan.kml",
    "plan.png",
    *(f"{name}.tif" for name, *_ in _RASTERS),
    "season.csv",
    *(f"mission_{number}.kmz" for number in range(1, MAX_MISSIONS + 1)),
)
_SEASON_COLUMNS = (
    "month", "date", "file", "pulses_m2", "ground_m2", "ground_share", "without_ground_share", "plant_height_m",
    "planned_ground_m2", "planned_level_m",
)  # fmt: skip


def write_plan(run: Run, plan: Plan, parameters: FlightParameters, name: str) -> None:
    """Write lines, waypoints and places, the rasters and the picture; ``run`` gets their paths."""
    stage, crs = run.stage, plan.terrain.crs
    layers = [
        Layer(lines_frame(plan, parameters, crs), "lines", flight_lines_qml(), "LineString Z"),
        Layer(waypoints_frame(plan, parameters, crs), "waypoints", waypoints_qml(), "Point Z"),
        Layer(places_frame(plan.expected, crs), "places", "", "Polygon"),
    ]
    write_layers(stage.path("plan.gpkg"), layers)
    run.outputs["plan"] = stage.final("plan.gpkg")
    write_kml(stage.path("plan.kml"), plan.lines, crs, name)
    run.outputs["kml"] = stage.final("plan.kml")
    tags = geotiff.raster_tags(software=f"SlopeWatch {VERSION}")
    for key, field, description, unit in _RASTERS:
        values = getattr(plan.expected, field)
        path = stage.path(f"{key}.tif")
        geotiff.write_raster(path, values, plan.expected.grid, crs, description=description, unit=unit, tags=tags)
        known = values[np.isfinite(values)]
        limit = max(float(np.percentile(known, 98)) if known.size else 1.0, 0.01)
        qgis_styles.write_qml_next_to(path, qgis_styles.level_qml(limit, unit=unit))
        run.outputs[key] = stage.final(path.name)
    title = say("{0}: {1} lines, {2} min").format(name, len(plan.lines), f"{plan.effort.seconds / 60:.0f}")
    write_plan_picture(stage.path("plan.png"), plan, title)
    run.outputs["picture"] = stage.final("plan.png")


def write_missions(run: Run, plan: Plan, mission: MissionParameters, parameters: FlightParameters) -> None:
    """Write a mission file for the lines of each battery, where an aircraft was named; those of an earlier plan in the
    same folder go, as nobody must fly them.
    """
    missions = missions_of(plan.lines, plan.effort.battery) if mission.wpml_drone else []
    for number in range(len(missions) + 1, MAX_MISSIONS + 1):
        run.stage.discard(f"mission_{number}.kmz")
    for number, part in enumerate(missions, 1):
        name = f"mission_{number}.kmz"
        write_mission(run.stage.path(name), part, plan.terrain.crs, mission, parameters)
        run.outputs[f"mission_{number}"] = run.stage.final(name)
    if missions:
        run.facts["missions"] = {f"mission_{number}.kmz": list(part.lines) for number, part in enumerate(missions, 1)}


def write_seasons(run: Run, found: Seasons | None) -> None:
    """Write what each survey of the seasons saw, and what the planned flight would show with its plants."""
    if found is None:
        run.stage.discard("season.csv")
        return
    with (
        atomic_output(run.stage.path("season.csv")) as partial,
        partial.open("w", encoding="utf-8", newline="") as stream,
    ):
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(_SEASON_COLUMNS)
        for survey, path, ground, level in zip(
            found.season.surveys, found.paths, found.ground, found.level, strict=True
        ):
            figures = (
                survey.pulses, survey.ground, survey.share, survey.without_ground, survey.plants, ground, level,
            )  # fmt: skip
            shown = [f"{value:.4g}" if math.isfinite(value) else "" for value in figures]
            table.writerow([survey.day.month, survey.day.isoformat(), cell(path.name), *shown])
    run.outputs["season"] = run.stage.final("season.csv")


def lines_frame(plan: Plan, parameters: FlightParameters, crs: CRS) -> gpd.GeoDataFrame:
    """One row a line: number, battery, length, time, heights over the ground."""
    lines = plan.lines
    table = {
        "line": [line.number for line in lines],
        "battery": list(plan.effort.battery),
        "length_m": [line.length for line in lines],
        "time_s": [line.length / parameters.flying_speed for line in lines],
        "speed_m_s": [parameters.flying_speed] * len(lines),
        "over_ground_low_m": [float(line.over_ground.min()) for line in lines],
        "over_ground_high_m": [float(line.over_ground.max()) for line in lines],
        "waypoints": [len(line.xyz) for line in lines],
    }
    return gpd.GeoDataFrame(table, geometry=[shapely.LineString(line.xyz) for line in lines], crs=crs)


def waypoints_frame(plan: Plan, parameters: FlightParameters, crs: CRS) -> gpd.GeoDataFrame:
    """One row a waypoint, in the order flown: height as the terrain counts it, and over the ground."""
    rows = []
    places: list[Float] = []
    for line in plan.lines:
        for number, (place, under) in enumerate(zip(line.xyz, line.under, strict=True), 1):
            rows.append((line.number, number, place[2], place[2] - under, parameters.flying_speed))
            places.append(place)
    table = pd.DataFrame(rows, columns=["line", "waypoint", "height_m", "over_ground_m", "speed_m_s"])
    return gpd.GeoDataFrame(table, geometry=shapely.points(np.array(places)), crs=crs)


def places_frame(expected: Expected, crs: CRS) -> gpd.GeoDataFrame:
    """One row a place of the region."""
    grid = expected.grid
    rows, columns = np.nonzero(expected.inside)
    west, north = grid.west + columns * grid.cell, grid.north - rows * grid.cell
    names = {
        "returns_m2": "returns",
        "ground_m2": "ground",
        "pulses_surface_m2": "pulses_surface",
        "ground_surface_m2": "ground_surface",
        "ground_share": "share",
        "slope_deg": "slope",
        "incidence_deg": "incidence",
        "lines": "lines",
        "level_m": "level",
        "motion_m": "motion",
    }
    table = {name: getattr(expected, field)[rows, columns] for name, field in names.items()}
    squares = shapely.box(west, north - grid.cell, west + grid.cell, north)
    return gpd.GeoDataFrame(table, geometry=squares, crs=crs)
