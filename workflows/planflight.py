"""``slopewatch planflight``: a region and the ground in, flight lines and what they will show out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from ..engine.core.arrays import Float
from ..engine.core.errors import InputError
from ..engine.core.messages import shown
from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..engine.crs.working_frame import same_horizontal
from ..engine.elevation_models.model import read_model
from ..engine.epochs.epoch import Epoch
from ..engine.flight.last_survey import Scatter, Seen, even_scatter, scatter_within, seen_by
from ..engine.flight.lines import Line, clearance_of, line_azimuth, lines_along, plan_lines
from ..engine.flight.plan import MAX_PLACES, Plan, expected_of, place_grid
from ..engine.flight.terrain import Terrain, terrain_of_model, terrain_of_points
from ..engine.flight.wpml import refuse_mission, refuse_ways
from ..engine.pointcloud.reading import read_cloud
from ..engine.vector.area import read_roi
from ..engine.vector.geopackage import has_shapes, read_layer
from ..interface.parameters import FlightParameters, InputParameters, MissionParameters, given
from .flight_seasons import GROUND_CLASS, Seasons, counted_survey, dated_surveys, season_figures, seasons_of
from .products.planflight import PLAN_OUTPUTS, write_missions, write_plan, write_seasons
from .run import Run

_CLOUDS = (".las", ".laz")


@dataclass(frozen=True)
class Ground:
    """What is known of the ground: its terrain, and where it was given as a cloud its points (n, 3) and their errors by
    plants (n,), metres, where these are known.
    """

    terrain: Terrain
    points: Float | None
    plant_error: Float | None = None


def planflight_step(
    terrain: Path,
    roi: Path,
    output_dir: Path,
    parameters: FlightParameters,
    inputs: InputParameters,
    *,
    mission: MissionParameters | None = None,
    survey: Path | None = None,
    plan: Path | None = None,
    season: Sequence[str] = (),
    overwrite: bool = False,
    progress: Progress,
) -> RunResult:
    """Plan the flight of the next survey, and say what it will show place by place.

    Args:
        terrain: an elevation model (GeoTIFF), the ``surface_heights.tif`` of a run, or the last survey's ground (LAS,
            LAZ).
        roi: vector file whose polygons are to be surveyed.
        survey: the last survey with its plants, by which the share of pulses that reach the ground is known.
        plan: GeoPackage of an earlier plan, whose lines are flown again.
        mission: the aircraft for which mission files are written; None or aircraft 0: none is.
        season: surveys of several dates, each as [DATE=]CLOUD, or a folder or manifest of them: by how much ground
            they saw, the best season is named.

    Raises:
        InputError: something given cannot be used; nothing is written then.
    """
    mission = mission or MissionParameters()
    epochs = dated_surveys(season)
    files = [("terrain", terrain), ("roi", roi), ("survey", survey), ("plan", plan)]
    files += [(f"season {number}", epoch.path) for number, epoch in enumerate(epochs, 1)]
    run = Run("planflight", {"flight": parameters, "mission": mission, "inputs": inputs}, files, progress)
    run.refuse_folder(output_dir, ("run.json", *PLAN_OUTPUTS), overwrite=overwrite)
    if mission.wpml_drone:
        refuse_mission(mission, parameters)
    run.hash_inputs()
    with run.step("read", 0.0, 0.4, "reading the terrain"):
        ground = read_ground(terrain, inputs, parameters.bridged_terrain, progress)
        area = read_roi(roi, ground.terrain.crs)
        for sentence in area.notes:
            progress.warning(sentence)
        grid = place_grid(area.geometry, parameters)
        if grid.rows * grid.columns > MAX_PLACES:
            raise InputError(f"{grid.rows} by {grid.columns} places are too many; give a larger --place-size.")
        seen, points = None, ground.points
        if survey is not None:
            seen, tops, points = read_survey(survey, inputs, ground, grid)
            ground = Ground(ground.terrain.with_tops(tops), points)
        scatter = _scatter(points, area.geometry, parameters, progress)
    with run.step("lines", 0.4, 0.5, "laying the lines"):
        if plan is None:
            line_azimuth(area.geometry, ground.terrain)
            lines = plan_lines(area.geometry, ground.terrain, parameters)
        else:
            lines = lines_along(read_tracks(plan, ground.terrain), ground.terrain, parameters)
        if mission.wpml_drone:
            refuse_ways(lines, ground.terrain, parameters)
    with run.step("expected", 0.5, 0.6 if epochs else 0.8, "adding up returns"):
        made = expected_of(area.geometry, ground.terrain, lines, seen, scatter, parameters)
        _say(made, seen, parameters, progress)
    seasons = _seasons(run, epochs, made, parameters, inputs)
    with run.writing(output_dir):
        with run.step("products", 0.8, 1.0, "writing the plan"):
            write_plan(run, made, parameters, output_dir.name)
            write_missions(run, made, mission, parameters)
            write_seasons(run, seasons)
        run.facts["ground_scatter"] = {"side_m": list(scatter.side), "deviation_m": list(scatter.deviation)}
        run.figures = plan_figures(made, seen) | ({} if seasons is None else {"season": season_figures(seasons)})
    return run.result()


def _seasons(
    run: Run, epochs: Sequence[Epoch], made: Plan, parameters: FlightParameters, inputs: InputParameters
) -> Seasons | None:
    if not epochs:
        return None
    with run.step("season", 0.6, 0.8, "comparing the seasons"):
        return seasons_of(epochs, made, parameters, inputs, run.progress)


def read_ground(path: Path, inputs: InputParameters, bridged: float, progress: Progress) -> Ground:
    """The terrain of an elevation model, or of a ground cloud (its class 2 where it has others, too)."""
    if path.suffix.lower() not in _CLOUDS:
        model = read_model(path, inputs, later_surface=True)
        for sentence in model.notes:
            progress.warning(sentence)
        if model.regridded:
            progress.info(model.regridded)
        return Ground(terrain_of_model(model, bridged), None)
    cloud = read_cloud(path, inputs, progress=progress)
    points = cloud.xyz
    error = None if cloud.plant_error is None else cloud.plant_error.astype(np.float64)
    if cloud.classification is not None and (cloud.classification == GROUND_CLASS).any():
        chosen = cloud.classification == GROUND_CLASS
        points, error = points[chosen], None if error is None else error[chosen]
    return Ground(terrain_of_points(points, cloud.crs, path, bridged), points, error)


def read_survey(path: Path, inputs: InputParameters, ground: Ground, grid: Any) -> tuple[Seen, Float, Float]:
    """What the last survey shows of each place, all its points, and its ground points.

    Raises:
        InputError: it is of another reference system, has no first returns, or no ground is known of it.
    """
    survey = counted_survey(path, inputs, ground.terrain)
    points, error = ground.points, ground.plant_error
    if points is None:
        remedy = "its ground, as `slopewatch ground` writes it, as the terrain instead of the elevation model"
        points, error = survey.cloud.xyz[survey.is_ground(remedy)], None
    first = survey.cloud.xyz[survey.first]
    return seen_by(grid, first, points, len(survey.cloud), error), survey.cloud.xyz, points


def read_tracks(path: Path, terrain: Terrain) -> list[Float]:
    """The lines of an earlier plan in plan (k, 2), in the order in which they are flown.

    Raises:
        InputError: no plan, in another reference system, or with a line that leaves the terrain's extent.
    """
    frame = read_layer(path, "lines")
    if "line" not in frame.columns or not has_shapes(frame):
        raise InputError(f"{shown(path)} holds no flight lines; give the plan.gpkg of an earlier plan.")
    if frame.crs is None or not same_horizontal(frame.crs, terrain.crs):
        raise InputError(
            f"The plan {shown(path)} is in another reference system than the terrain {shown(terrain.path)}; give a "
            "terrain in that of the plan."
        )
    ordered = frame.sort_values("line")
    tracks = [shapely.get_coordinates(geometry)[:, :2] for geometry in ordered.geometry]
    grid = terrain.grid
    west, north = grid.west, grid.north
    extent = shapely.box(west, north - grid.rows * grid.cell, west + grid.columns * grid.cell, north)
    if not all(shapely.intersects_xy(extent, track).all() for track in tracks):
        raise InputError(
            f"A line of the plan {shown(path)} leaves the terrain {shown(terrain.path)}; give a terrain that reaches "
            "farther."
        )
    return tracks


def _scatter(
    points: Float | None, region: Polygon | MultiPolygon, parameters: FlightParameters, progress: Progress
) -> Scatter:
    wanted = given(parameters.ground_scatter)
    if wanted is not None or points is None:
        return even_scatter(wanted)
    found = scatter_within(points, region)
    if found is None:
        progress.warning("The last survey's ground is too sparse to show its scatter; 0.03 m is taken for it.")
    return found or even_scatter(None)


def _say(made: Plan, seen: Seen | None, parameters: FlightParameters, progress: Progress) -> None:
    expected = made.expected
    if seen is None and given(parameters.ground_share) is None:
        progress.warning(
            "Bare ground is assumed, as no last survey was given; under plants fewer returns are of the ground, and "
            "the level is larger. Give --survey or --ground-share."
        )
    unseen = expected.inside & ~(expected.ground > 0)
    if unseen.any():
        share = unseen.sum() / expected.inside.sum()
        progress.warning(
            f"{100 * share:.0f} % of the region gets no return of the ground: it faces away from the lines, is hidden "
            "or lies beyond their strips; raise --margin or --altitude, or give another --azimuth."
        )
    bridged = _bridged_metres(made)
    if bridged:
        progress.warning(
            f"{bridged:.0f} m of the lines lie over ground that the terrain does not know; heights there are those of "
            "the ground around, so look for poles, wires and trees before the flight."
        )


def _bridged_metres(made: Plan) -> float:
    grid, known = made.terrain.grid, made.terrain.known
    total = 0
    for line in made.lines:
        row = np.clip(((grid.north - line.track[:, 1]) / grid.cell).astype(int), 0, grid.rows - 1)
        column = np.clip(((line.track[:, 0] - grid.west) / grid.cell).astype(int), 0, grid.columns - 1)
        total += int((~known[row, column]).sum())
    return float(total)


def plan_figures(made: Plan, seen: Seen | None) -> dict[str, Any]:
    """The figures that are read first; densities and levels are medians over the places of the region."""
    expected, lines = made.expected, made.lines
    inside = expected.inside

    def middle(values: Float) -> float | None:
        known = values[inside & np.isfinite(values)]
        return float(np.median(known)) if known.size else None

    over = np.concatenate([line.over_ground for line in lines])
    return {
        "line_count": len(lines),
        "waypoint_count": sum(len(line.xyz) for line in lines),
        "line_length_m": made.effort.length,
        "flight_time_s": made.effort.seconds,
        "battery_count": made.effort.batteries,
        "region_area_m2": float(made.region.area),
        "altitude_lowest_m": float(over.min()),
        "altitude_highest_m": float(over.max()),
        "clearance_m": min(clearance_of(line, made.terrain) for line in lines),
        "steepest_climb_deg": max(_steepest(line) for line in lines),
        "pulses_surface_per_m2": middle(expected.pulses_surface),
        "returns_per_m2": middle(expected.returns),
        "ground_per_m2": middle(expected.ground),
        "ground_surface_per_m2": middle(expected.ground_surface),
        "ground_share": middle(expected.share),
        "last_survey": seen is not None,
        "slope_deg": middle(expected.slope),
        "incidence_deg": middle(expected.incidence),
        "level_m": middle(expected.level),
        "level_direction": expected.direction,
        "motion_m": middle(expected.motion),
        "unseen_share": float((inside & ~(expected.ground > 0)).sum() / max(int(inside.sum()), 1)),
    }


def _steepest(line: Line) -> float:
    way = np.diff(line.xyz, axis=0)
    return math.degrees(float(np.max(np.abs(np.arctan2(way[:, 2], np.hypot(way[:, 0], way[:, 1]))))))
