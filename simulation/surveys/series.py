"""Series of simulated surveys of one slope whose zones move by known laws of time."""

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
from ...engine.grid.grid import Grid
from ...interface.parameters import SurveyParameters
from ..frame import Frame
from .change import Bump, true_change_raster
from .layers import Landscape
from .plants import cover_of
from .scanner import SurveyCloud, survey
from .scene import Relief, Scene
from .survey import CRS as SURVEY_CRS
from .survey import built_slope, known_offset, rectangle, survey_area
from .vegetation import Canopy
from .write import write_json, write_region, write_survey


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


@dataclass(frozen=True)
class Motion:
    """Ground that moves: where (``shape``, whose height is the displacement per metre of the ``law``), and how."""

    shape: Bump
    law: Law

    def at(self, days: float) -> Bump:
        """The change of the ground until then."""
        return replace(self.shape, height=self.shape.height * self.law.displacement(days))


@dataclass(frozen=True)
class SimulatedSeries:
    """Surveys of one slope and the truth about them.

    ``transforms`` map each survey's coordinates to the first one's; ``roi`` is a closed ring in the first one's.
    """

    parameters: SurveyParameters
    dates: tuple[date, ...]
    clouds: tuple[SurveyCloud, ...]
    transforms: tuple[RigidTransform, ...]
    motions: tuple[Motion, ...]
    scene: Scene
    canopy: Canopy
    roi: Float
    crs: str = SURVEY_CRS

    @property
    def days(self) -> Float:
        return np.array([(d - self.dates[0]).days for d in self.dates], dtype=np.float64)

    def true_change(self, survey: int, grid: Grid, subsamples: int = 8) -> Float:
        """Mean true change of each cell until a survey, in the first one's coordinates (rows, columns), m."""
        changes = [m.at(float(self.days[survey])) for m in self.motions]
        return true_change_raster(changes, self.scene.frame, grid, subsamples)

    def true_velocity(self, motion: int, grid: Grid, subsamples: int = 8) -> Float:
        """Velocity of each cell by one motion at the last survey (rows, columns), metres a day."""
        law, shape, last = self.motions[motion].law, self.motions[motion].shape, float(self.days[-1])
        rate = (law.displacement(last) - law.displacement(last - 1e-3)) / 1e-3
        return true_change_raster([replace(shape, height=shape.height * rate)], self.scene.frame, grid, subsamples)


def simulate_series(
    parameters: SurveyParameters,
    dates: Sequence[date],
    laws: Sequence[Law],
    *,
    half_axes: tuple[float, float] = (2.0, 1.6),
    progress: Progress | None = None,
) -> SimulatedSeries:
    """Surveys of one slope on ``dates``; its zones lie side by side and move by ``laws`` (negative: lowering).

    ``parameters.offset`` is the norm of each later survey's own rigid offset; ``points`` are those of one survey;
    ``amplitude`` has no effect. Plants are the same in all surveys, but closed grass has grown anew, or is mown.

    Args:
        half_axes: of each zone along and up the slope, metres.
    """
    progress = progress or Progress()
    seed = parameters.seed
    slope = built_slope(parameters, Relief(), Frame(), 0.0, progress)
    scene, run = slope.scene, slope.roi[3]
    rng = np.random.default_rng([seed, 3])
    motions = []
    for number, law in enumerate(laws):
        u = parameters.length * (number + 0.5) / len(laws) + rng.uniform(-0.2, 0.2)
        v = run * rng.uniform(0.45, 0.55)
        motions.append(Motion(Bump(float(u), float(v), *half_axes, 1.0), law))
    first = Landscape(scene, slope.canopy, cover_of(parameters, scene, 0))
    area, pulses = survey_area(first, slope.plan, slope.roi, parameters)
    clouds, transforms = [], []
    for number, day in enumerate(dates):
        with progress.stage(number / len(dates), (number + 1) / len(dates), f"scanning on {day}") as stage:
            changed = scene.with_changes(tuple(m.at(float((day - dates[0]).days)) for m in motions))
            transform = (
                known_offset(scene, parameters.offset, np.random.default_rng([seed, 4, number]))
                if number
                else RigidTransform.identity()
            )
            landscape = Landscape(changed, slope.canopy, cover_of(parameters, scene, number))
            cloud = survey(landscape, slope.plan, area, pulses, parameters.range_noise, (seed, 11 + number), stage)
            clouds.append(replace(cloud, xyz=transform.inverse().apply(cloud.xyz)))
            transforms.append(transform)
    ring = rectangle(slope.roi, scene.frame)
    return SimulatedSeries(
        parameters, tuple(dates), tuple(clouds), tuple(transforms), tuple(motions), scene, slope.canopy, ring
    )


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
                "shape": asdict(motion.shape),
                "displacement_m": [motion.law.displacement(float(t)) for t in series.days],
            }
            for motion in series.motions
        ],
        "transforms": [t.matrix.tolist() for t in series.transforms],
    }
