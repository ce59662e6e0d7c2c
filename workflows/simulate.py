"""``slopewatch simulate survey`` and ``series``: a simulated pair, or a series, in an output folder."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from pyproj import CRS

from ..engine.core.errors import InputError
from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..engine.grid.geotiff import write_bands, write_raster
from ..engine.grid.grid import snapped_grid
from ..interface.parameters import CreepParameters, SurveyParameters
from ..simulation.motion.gliding import TooFarError
from ..simulation.surveys.series import Creep, SimulatedSeries, simulate_series, survey_days, write_series
from ..simulation.surveys.survey import motions_of, simulate_pair
from ..simulation.surveys.write import write_pair
from .run import Run

_NAMES = {"first": "reference", "second": "cloud"}
_HALF_AXES = (2.0, 1.6)
_MIN_ROOM_M = 0.8
"""Least room (m) between two zones of a series, their places being drawn within it."""
_MAX_DISPLACEMENT_M = 5.0
_TRUTH_CELL_M = 0.25


def survey_step(
    parameters: SurveyParameters, output_dir: Path, progress: Progress, *, overwrite: bool = False
) -> RunResult:
    """Simulate a pair of surveys and write it with its truth; nothing is left when it fails.

    Returns:
        The outputs ``reference`` and ``cloud`` are the earlier and the later survey, the rest as in ``write_pair``.

    Raises:
        InputError: the ground cannot move so far along the surface.
    """
    _refuse_folds(parameters, parameters.motion_amount)
    run = Run("simulate survey", {parameters.record_name: parameters}, progress=progress)
    run.refuse_folder(output_dir, ("run.json", "truth.json"), overwrite=overwrite)
    with run.writing(output_dir) as stage:
        with run.step("simulate", 0.0, 0.8, "simulating"):
            pair = simulate_pair(parameters, progress)
        with run.step("write", 0.8, 1.0, "writing"):
            written = write_pair(pair, stage.folder, progress)
        run.outputs |= {_NAMES.get(name, name): stage.final(path.name) for name, path in written.items()}
        run.figures = {
            "points_reference": len(pair.first),
            "points_cloud": len(pair.second),
            "ground_share": float(pair.first.truth_ground.mean()),
            "ground_share_cloud": float(pair.second.truth_ground.mean()),
            "vegetation_cover": pair.canopy.cover(pair.scene.slope),
            "changes": len(pair.changes),
            "motions": len(pair.motions),
            "largest_motion_m": max((motion.amount for motion in pair.motions), default=0.0),
            "volume_raised_m3": sum(change.volumes[0] for change in pair.changes),
            "volume_lowered_m3": sum(change.volumes[1] for change in pair.changes),
        }
    return run.result()


def series_step(
    parameters: CreepParameters, output_dir: Path, progress: Progress, *, overwrite: bool = False
) -> RunResult:
    """Simulate a series of surveys and write it with a manifest and the truth; nothing is left when it fails.

    Returns:
        The outputs are ``manifest``, ``roi``, ``truth``, ``truth_velocity``, each survey by its day, and ``run``.

    Raises:
        InputError: the velocities cannot be read, are too many for the slope's length, or lead too far.
    """
    laws = creep_laws(parameters)
    run = Run("simulate series", {parameters.record_name: parameters}, progress=progress)
    run.refuse_folder(output_dir, ("run.json", "truth.json", "surveys.csv"), overwrite=overwrite)
    with run.writing(output_dir) as stage:
        with run.step("simulate", 0.0, 0.9, "simulating"):
            days = survey_days(parameters.surveys, parameters.interval)
            series = simulate_series(parameters, days, laws, half_axes=_HALF_AXES, progress=progress)
        with run.step("write", 0.9, 1.0, "writing"):
            written = write_series(series, stage.folder, ground_only=parameters.ground_only)
            written["truth_velocity"] = stage.path("truth_velocity.tif")
            _write_velocity(series, written["truth_velocity"])
            written["manifest"] = stage.path("surveys.csv")
            lines = ["date,path", *(f"{day},{written[day.isoformat()].name}" for day in days)]
            written["manifest"].write_text("\n".join(lines) + "\n", encoding="utf-8")
        run.outputs |= {name: stage.final(path.name) for name, path in written.items()}
        run.figures = {
            "surveys": len(days),
            "days": (days[-1] - days[0]).days,
            "points": sum(len(cloud) for cloud in series.clouds),
            "zones": len(laws),
            "vegetation_cover": series.canopy.cover(series.scene.slope),
        }
    return run.result()


def creep_laws(parameters: CreepParameters) -> tuple[Creep, ...]:
    """One law of motion for each of the velocities (mm/day in the middle of the zone).

    Raises:
        InputError: see ``series_step``.
    """
    try:
        values = [float(word) for word in parameters.velocities.split(",") if word.strip()]
    except ValueError:
        values = [math.nan]
    if not all(math.isfinite(v) for v in values):
        raise InputError(
            f"velocities is {parameters.velocities!r}; give numbers (mm a day) separated by commas, such as -10, 5."
        )
    room = 2 * _HALF_AXES[0] + _MIN_ROOM_M
    if len(values) * room > parameters.length:
        raise InputError(
            f"velocities names {len(values)} zones, which need {len(values) * room:.0f} m of slope; give a length "
            "of at least that, or fewer."
        )
    run = parameters.height / math.tan(math.radians(parameters.angle))
    if values and run < 2.5 * _HALF_AXES[1]:
        raise InputError(
            f"The slope is {run:.1f} m wide on the map, too little for zones of {2 * _HALF_AXES[1]:g} m; give a larger "
            "height or a smaller angle."
        )
    moving = max(0.0, parameters.interval * (parameters.surveys - 1) - parameters.onset)
    farthest = max((abs(v) / 1000 * moving for v in values), default=0.0)
    if farthest > _MAX_DISPLACEMENT_M:
        raise InputError(
            f"At these velocities the ground would move by {farthest:.1f} m until the last survey; give slower ones, "
            f"or fewer days, for at most {_MAX_DISPLACEMENT_M:g} m."
        )
    _refuse_folds(parameters, farthest, len(values))
    return tuple(Creep(v / 1000, parameters.onset) for v in values)


def _refuse_folds(parameters: SurveyParameters, amount: float, count: int | None = None) -> None:
    try:
        motions_of(parameters, amount, count)
    except TooFarError as error:
        raise InputError(
            f"The ground that moves would fold over itself at its soft edge: it can move by at most {error.most:.2f} m "
            f"on this slope, not by {amount:.2f} m; give a shorter way, or slower velocities of a series."
        ) from error


def _write_velocity(series: SimulatedSeries, path: Path) -> None:
    """The true velocity at the last survey (mm/day) of each cell over the slope, in the first survey's coordinates:
    vertical, or east, north and up of ground that moves along the surface.
    """
    west, south = series.roi.min(axis=0)
    east, north = series.roi.max(axis=0)
    grid = snapped_grid((float(west), float(south), float(east), float(north)), _TRUTH_CELL_M)
    crs = CRS.from_user_input(series.crs)
    if series.slides:
        bands = {name: 1000 * values for name, values in series.true_velocities(grid).items()}
        write_bands(path, bands, grid, crs, unit="mm/day")
        return
    velocity = np.zeros(grid.shape)
    for number in range(len(series.motions)):
        velocity += 1000 * series.true_velocity(number, grid)
    write_raster(path, velocity, grid, crs, description="True vertical velocity", unit="mm/day")
