"""Series of simulated surveys of one slope whose zones rise, sink or slide by known laws of time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from datetime import date, timedelta
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from pyproj import CRS

from ...engine.core.arrays import Float
from ...engine.core.progress import Progress
from ...engine.geometry.rigid_transform import RigidTransform
from ...engine.grid.geotiff import write_bands
from ...engine.grid.grid import Grid, snapped_grid
from ...interface.parameters import SurveyParameters
from ..frame import Frame
from ..motion.moved_ground import SurfaceMotion
from .change import Bump, Cone, Plateau, Slump, true_change_raster
from .layers import Landscape
from .plants import cover_of
from .scanner import SurveyCloud, survey
from .scene import Relief, Scene
from .survey import CRS as SURVEY_CRS
from .survey import built_slope, known_offset, motions_of, rectangle, slope_of, survey_area, weathered
from .true_motion import change_raster, describe_motion, motion_raster
from .vegetation import Canopy
from .write import MOTION_CELL_M, write_json, write_region, write_survey

_UNIT_WAY_M = 0.01
"""Of the motions before they are scaled to their law; short, so that no soft edge refuses it."""
_RATE_DAYS = 0.1
"""Over which the velocity at the last survey is taken."""


class Law(Protocol):
    """Displacement over time, metres, and when the motion ends in failure (days; None: never)."""

    @property
    def failure(self) -> float | None: ...

    def displacement(self, days: float) -> float: ...


@dataclass(frozen=True)
class Creep:
    """Rest until ``onset`` (days), then ``rate`` (metres a day)."""

    rate: float
    onset: float = 0.0
    failure: float | None = None

    def displacement(self, days: float) -> float:
        return self.rate * max(days - self.onset, 0.0)


@dataclass(frozen=True)
class Settling:
    """Decelerating: ``total`` metres in the end, with a time constant of ``decay`` days."""

    total: float
    decay: float
    failure: float | None = None

    def displacement(self, days: float) -> float:
        return self.total * (1.0 - math.exp(-days / self.decay))


@dataclass(frozen=True)
class Fukuzono:
    """Accelerating with 1/v = (failure - t) / scale (alpha = 2); ``scale`` in metres."""

    scale: float
    failure: float | None = 120.0

    def displacement(self, days: float) -> float:
        end = self.failure or math.inf
        return -self.scale * math.log((end - days) / end)


Shape = Bump | Cone | Plateau | Slump
"""Of ground that rises or sinks."""


@dataclass(frozen=True)
class Motion:
    """Ground that moves: where (``shape``, whose height is the displacement per metre of the ``law``), and how."""

    shape: Shape
    law: Law

    def at(self, days: float) -> Shape:
        """The change of the ground until then."""
        return self.scaled(self.law.displacement(days))

    def scaled(self, factor: float) -> Shape:
        """The shape with ``factor`` times its height."""
        match self.shape:
            case Cone():
                return replace(self.shape, peak=self.shape.peak * factor)
            case Slump():
                return replace(self.shape, depth=self.shape.depth * factor)
            case _:
                return replace(self.shape, height=self.shape.height * factor)


@dataclass(frozen=True)
class AlongSurface:
    """Ground that moves along itself: where and how far for a way of 1 m (``shape``), and the way until when."""

    shape: SurfaceMotion
    law: Law

    def at(self, days: float) -> SurfaceMotion:
        """The motion until then, along the surface whatever the law's sign."""
        return self.shape.scaled(abs(self.law.displacement(days)) / self.shape.amount)


@dataclass(frozen=True)
class SimulatedSeries:
    """Surveys of one slope and the truth about them.

    ``transforms`` map each survey's coordinates to the first one's; ``roi`` is a closed ring in the first one's;
    ``grounds`` are the ground at each survey, in the first one's coordinates.
    """

    parameters: SurveyParameters
    dates: tuple[date, ...]
    clouds: tuple[SurveyCloud, ...]
    transforms: tuple[RigidTransform, ...]
    motions: tuple[Motion, ...] | tuple[AlongSurface, ...]
    grounds: tuple[Scene, ...]
    canopy: Canopy
    roi: Float
    crs: str = SURVEY_CRS

    @property
    def days(self) -> Float:
        return np.array([(d - self.dates[0]).days for d in self.dates], dtype=np.float64)

    @property
    def scene(self) -> Scene:
        """The ground of the first survey."""
        return self.grounds[0]

    @property
    def slides(self) -> bool:
        """Whether the zones move along the surface."""
        return any(isinstance(motion, AlongSurface) for motion in self.motions)

    def true_change(self, survey: int, grid: Grid, subsamples: int = 8) -> Float:
        """Mean true change of each cell until a survey, in the first one's coordinates (rows, columns), m."""
        after = self.grounds[survey]
        if after.motions or after.base is not self.scene.base:
            return change_raster(after, self.scene, grid, subsamples)
        return true_change_raster(after.changes, self.scene.frame, grid, subsamples)

    def true_velocity(self, motion: int, grid: Grid, subsamples: int = 8) -> Float:
        """Vertical velocity of each cell by one motion at the last survey (rows, columns), metres a day.

        Raises:
            ValueError: the zones move along the surface; see ``true_velocities``.
        """
        moving, last = self.motions[motion], float(self.days[-1])
        if isinstance(moving, AlongSurface):
            raise ValueError("a zone that moves along the surface has no vertical velocity alone")
        rate = (moving.law.displacement(last) - moving.law.displacement(last - 1e-3)) / 1e-3
        return true_change_raster([moving.scaled(rate)], self.scene.frame, grid, subsamples)

    def true_velocities(self, grid: Grid) -> dict[str, Float]:
        """Velocity east, north and up at the last survey of the ground that was in the middle of each cell at the first
        (rows, columns), metres a day, by the name of the band; NaN where it is buried.
        """
        last, ground = float(self.days[-1]), self.grounds[-1]
        then, before = (
            motion_raster(ground.with_motions(_along_surface(self.motions, days)), self.scene, grid)
            for days in (last, last - _RATE_DAYS)
        )
        names = (f"True velocity {name.rsplit(' ', 1)[1]}" for name in then)
        return {
            name: (now - was) / _RATE_DAYS for name, now, was in zip(names, then.values(), before.values(), strict=True)
        }


def _along_surface(motions: Sequence[Motion | AlongSurface], days: float) -> tuple[SurfaceMotion, ...]:
    return tuple(motion.at(days) for motion in motions if isinstance(motion, AlongSurface))


def simulate_series(
    parameters: SurveyParameters,
    dates: Sequence[date],
    laws: Sequence[Law],
    *,
    half_axes: tuple[float, float] = (2.0, 1.6),
    shapes: Sequence[Shape] = (),
    progress: Progress | None = None,
    plants: Sequence[SurveyParameters] = (),
    roi_buffer: float = 0.0,
) -> SimulatedSeries:
    """Surveys of one slope on ``dates``; its zones lie side by side and move by ``laws`` (negative: lowering).

    ``parameters.offset`` is the norm of each later survey's own rigid offset; ``points`` are those of one survey;
    ``amplitude`` has no effect. Plants are the same in all surveys, but closed grass has grown anew, or is mown. Where
    the parameters name a motion along the surface, the zones' ground moves by the laws' displacements, whatever
    their sign. Erosion adds up from survey to survey; short grass grows once, in other patches at each survey.

    Args:
        half_axes: of each zone along and up the slope, metres; of zones that rise or sink.
        shapes: of these zones instead, one for each law, placed as the others are.
        plants: parameters of the plants in each survey; ``parameters`` in all where none are given.
        roi_buffer: how far the region reaches beyond the cut face, metres.

    Raises:
        TooFarError: ground would move too far for its soft edge.
    """
    progress = progress or Progress()
    seed, plants = parameters.seed, plants or (parameters,) * len(dates)
    slope = built_slope(parameters, Relief(), Frame(), roi_buffer, progress)
    scene = slope.scene
    motions = _motions(parameters, laws, shapes or [Bump(0.0, 0.0, *half_axes, 1.0)] * len(laws))
    first = Landscape(scene, slope.canopy, cover_of(plants[0], scene, 0))
    area, pulses = survey_area(first, slope.plan, slope.roi, parameters)
    clouds, transforms, grounds, rested = [], [], [], scene
    for number, day in enumerate(dates):
        with progress.stage(number / len(dates), (number + 1) / len(dates), f"scanning on {day}") as stage:
            days = float((day - dates[0]).days)
            if number:
                rested = weathered(replace(rested, turf=scene.turf), parameters, Relief(), number)
            changed = rested.with_motions(_along_surface(motions, days))
            changed = changed.with_changes(tuple(m.at(days) for m in motions if isinstance(m, Motion)))
            grounds.append(changed)
            transform = (
                known_offset(scene, parameters.offset, np.random.default_rng([seed, 4, number]))
                if number
                else RigidTransform.identity()
            )
            landscape = Landscape(changed, slope.canopy, cover_of(plants[number], scene, number))
            cloud = survey(landscape, slope.plan, area, pulses, parameters.range_noise, (seed, 11 + number), stage)
            clouds.append(replace(cloud, xyz=transform.inverse().apply(cloud.xyz)))
            transforms.append(transform)
    ring = rectangle(slope.roi, scene.frame)
    return SimulatedSeries(
        parameters, tuple(dates), tuple(clouds), tuple(transforms), motions, tuple(grounds), slope.canopy, ring
    )


def _motions(
    parameters: SurveyParameters, laws: Sequence[Law], of_zones: Sequence[Shape]
) -> tuple[Motion, ...] | tuple[AlongSurface, ...]:
    """A zone for each law, side by side along the slope."""
    if parameters.motion != "none":
        shapes = motions_of(parameters, _UNIT_WAY_M, len(laws))
        return tuple(AlongSurface(shape, law) for shape, law in zip(shapes, laws, strict=True))
    rng, run = np.random.default_rng([parameters.seed, 3]), slope_of(parameters)[3]
    zones = []
    for number, (law, shape) in enumerate(zip(laws, of_zones, strict=True)):
        u = parameters.length * (number + 0.5) / len(laws) + rng.uniform(-0.2, 0.2)
        v = run * rng.uniform(0.45, 0.55)
        zones.append(Motion(replace(shape, u=float(u), v=float(v)), law))
    return tuple(zones)


def survey_days(count: int, every: int, first: date = date(2024, 5, 1)) -> tuple[date, ...]:
    """``count`` days, ``every`` so many days apart."""
    return tuple(first + timedelta(days=every * number) for number in range(count))


def write_series(series: SimulatedSeries, directory: Path, *, ground_only: bool = False) -> dict[str, Path]:
    """Write the surveys as DATE.laz, the region and the truth into ``directory``, which is made if need be.

    Args:
        ground_only: only the echoes of the ground, as a perfect ground filter would leave them.
    """
    directory.mkdir(parents=True, exist_ok=True)
    crs = CRS.from_user_input(series.crs)
    paths = {}
    for day, cloud in zip(series.dates, series.clouds, strict=True):
        if ground_only:
            keep = cloud.truth_ground == 1
            cloud = SurveyCloud(**{name: values[keep] for name, values in vars(cloud).items()})
        paths[day.isoformat()] = directory / f"{day.isoformat()}.laz"
        write_survey(paths[day.isoformat()], cloud, crs, day.isoformat())
    paths |= {"roi": directory / "roi.gpkg", "truth": directory / "truth.json"}
    write_region(paths["roi"], series.roi, crs, series.dates[0])
    write_json(paths["truth"], _truth(series))
    if series.slides:
        low, high = series.roi.min(axis=0), series.roi.max(axis=0)
        grid = snapped_grid((float(low[0]), float(low[1]), float(high[0]), float(high[1])), MOTION_CELL_M)
        for day, ground in zip(series.dates[1:], series.grounds[1:], strict=True):
            name = f"truth_motion_{day.isoformat()}"
            paths[name] = directory / f"{name}.tif"
            write_bands(paths[name], motion_raster(ground, series.scene, grid), grid, crs)
    return paths


def _truth(series: SimulatedSeries) -> dict[str, Any]:
    return {
        "parameters": asdict(series.parameters),
        "crs": series.crs,
        "dates": [d.isoformat() for d in series.dates],
        "motions": [
            {
                "law": type(motion.law).__name__,
                **asdict(motion.law),  # type: ignore[call-overload]
                "kind": motion.shape.kind,
                "shape": asdict(motion.shape),  # type: ignore[arg-type]
                "displacement_m": [motion.law.displacement(float(t)) for t in series.days],
            }
            for motion in series.motions
        ],
        "motions_until_last_survey": [describe_motion(m, series.grounds[-1]) for m in series.grounds[-1].motions],
        "transforms": [t.matrix.tolist() for t in series.transforms],
    }
