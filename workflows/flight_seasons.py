"""Surveys of several dates, by which a planned flight chooses its season."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from ..engine.core.arrays import Bool, Float
from ..engine.core.errors import InputError
from ..engine.core.messages import shown
from ..engine.core.progress import Progress
from ..engine.crs.working_frame import same_horizontal
from ..engine.epochs.epoch import Epoch, parse_date
from ..engine.epochs.manifest import epochs_of
from ..engine.flight.last_survey import even_scatter, scatter_within, seen_by
from ..engine.flight.plan import Plan, expected_of
from ..engine.flight.season import Counted, Season, counted, season_of, strip_counts
from ..engine.flight.terrain import Terrain, terrain_of_points
from ..engine.pointcloud.cloud import PointCloud
from ..engine.pointcloud.reading import read_cloud, read_return_numbers
from ..engine.pointcloud.times import read_flown
from ..interface.dates import date_in_name
from ..interface.parameters import AUTO, FlightParameters, InputParameters, given

GROUND_CLASS = 2
_DENSITIES_APART = 2.0
"""Ratio of the pulses a m² of two surveys from which on a run says that they were not flown alike."""


@dataclass(frozen=True)
class CountedSurvey:
    """A survey with its plants: ``first`` (n,) are the first returns of its pulses."""

    cloud: PointCloud
    first: Bool
    path: Path

    def is_ground(self, remedy: str) -> Bool:
        """Points (n,) of class 2.

        Raises:
            InputError: there are none; ``remedy`` is what to give instead.
        """
        classes = self.cloud.classification
        if classes is None or not (classes == GROUND_CLASS).any():
            raise InputError(f"{shown(self.path)} has no ground points (class 2); give {remedy}.")
        return np.asarray(classes == GROUND_CLASS)


@dataclass(frozen=True)
class Seasons:
    """What surveys say of the season, and what the planned flight would show with the plants of each of them:
    medians over the region of ground returns a m² of map, and of the level of detection, metres.
    """

    season: Season
    paths: tuple[Path, ...]
    ground: tuple[float, ...]
    level: tuple[float, ...]


def dated_surveys(season: Sequence[str]) -> tuple[Epoch, ...]:
    """Surveys given as [DATE=]CLOUD, or as a folder or manifest of them, the earliest first.

    Raises:
        InputError: one has no date, or does not exist.
    """
    found: list[Epoch] = []
    for text in season:
        day, separator, path = text.partition("=")
        if separator and path and not Path(text).exists():
            found.append(Epoch(Path(path), parse_date(day)))
        elif Path(text).is_dir() or Path(text).suffix.lower() == ".csv":
            found += epochs_of(Path(text))
        else:
            named = date_in_name(Path(text))
            if named is None:
                raise InputError(
                    f"The name of {shown(text)} holds no date, or more than one; write --season YYYY-MM-DD=CLOUD."
                )
            found.append(Epoch(Path(text), named))
    return tuple(sorted(found, key=lambda epoch: (epoch.date or date.min, str(epoch.path))))


def counted_survey(path: Path, inputs: InputParameters, terrain: Terrain) -> CountedSurvey:
    """A survey whose pulses can be counted.

    Raises:
        InputError: it is of another reference system than the terrain, or has no first returns.
    """
    cloud = read_cloud(path, inputs)
    if not same_horizontal(cloud.crs, terrain.crs):
        raise InputError(
            f"{shown(path)} is in {cloud.crs.name} and the terrain {shown(terrain.path)} in "
            f"{terrain.crs.name}; give both in one reference system."
        )
    first = read_return_numbers(path) == 1
    if not first.any():
        raise InputError(f"{shown(path)} has no first returns, so its pulses cannot be counted; give the raw survey.")
    return CountedSurvey(cloud, first, path)


def seasons_of(
    epochs: Sequence[Epoch], plan: Plan, parameters: FlightParameters, inputs: InputParameters, progress: Progress
) -> Seasons:
    """Compare dated surveys over the places of a plan, one after the other in memory.

    Raises:
        InputError: see ``counted_survey``; a survey has no ground points (class 2).
    """
    grid, region = plan.expected.grid, plan.expected.inside
    own = replace(parameters, ground_share=AUTO)
    surveys: list[Counted] = []
    ground: list[float] = []
    level: list[float] = []
    for epoch in epochs:
        survey = counted_survey(epoch.path, inputs, plan.terrain)
        is_ground = survey.is_ground("the classified survey that `slopewatch ground` writes")
        xyz, below = survey.cloud.xyz, survey.cloud.xyz[is_ground]
        terrain = terrain_of_points(below, survey.cloud.crs, epoch.path, parameters.bridged_terrain)
        plants = xyz[survey.first & ~is_ground]
        assert epoch.date is not None
        source = read_flown(epoch.path).source
        found = counted(epoch.date, grid, xyz[survey.first], below, plants, terrain, region)
        strips = strip_counts(grid, xyz[survey.first], below, source[survey.first], source[is_ground])
        surveys.append(replace(found, strips=strips))
        stated = survey.cloud.plant_error
        error = None if stated is None else stated[is_ground].astype(np.float64)
        wanted = given(parameters.ground_scatter)
        measured = even_scatter(wanted) if wanted is not None else scatter_within(below, plan.region)
        scatter = measured or even_scatter(None)
        seen = seen_by(grid, xyz[survey.first], below, len(survey.cloud), error)
        expected = expected_of(plan.region, plan.terrain, plan.lines, seen, scatter, own).expected
        ground.append(_median(expected.ground[region]))
        level.append(_median(expected.level[region]))
    season = season_of(surveys, grid, region)
    pulses = [survey.pulses for survey in season.surveys]
    if min(pulses) > 0 and max(pulses) > _DENSITIES_APART * min(pulses):
        progress.warning(
            f"The surveys of the seasons have {min(pulses):.0f} to {max(pulses):.0f} pulses a m², so they were not "
            "flown alike; scanner and altitude are in their differences, too."
        )
    if season.best is not None and not math.isfinite(season.strip_ratio):
        progress.warning(
            "None of the surveys of the seasons has two flight strips over the same places, so what the way of a "
            "flight makes of the ground seen is not known and is in the differences, too."
        )
    return Seasons(season, tuple(epoch.path for epoch in epochs), tuple(ground), tuple(level))


def season_figures(found: Seasons) -> dict[str, Any]:
    """For the record: each survey, the months, and the one that is named."""
    season = found.season
    return {
        "surveys": [
            {
                "date": survey.day.isoformat(),
                "file": path.name,
                "pulses_per_m2": survey.pulses,
                "ground_per_m2": survey.ground,
                "ground_share": survey.share,
                "without_ground_share": survey.without_ground,
                "plant_height_m": survey.plants,
                "planned_ground_per_m2": ground,
                "planned_level_m": level,
            }
            for survey, path, ground, level in zip(season.surveys, found.paths, found.ground, found.level, strict=True)
        ],
        "ground_share_by_month": {str(month): share for month, share in season.months.items()},
        "best_month": season.best,
        "worst_month": season.worst,
        "as_good": list(season.also),
        "ratio": season.ratio if math.isfinite(season.ratio) else None,
        "difference_error": season.error if math.isfinite(season.error) else None,
        "strip_ratio": season.strip_ratio if math.isfinite(season.strip_ratio) else None,
        "reason": season.reason,
        "area_m2": season.area,
    }


def _median(values: Float) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else math.nan
