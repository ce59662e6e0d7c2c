"""Alerts and slides of still slopes, each survey as a cloud through the whole workflow with its default settings."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import date, timedelta
from pathlib import Path

import geopandas
import laspy
import numpy as np
from pyproj import CRS

from ...engine.core.arrays import Float
from ...engine.epochs.epoch import Epoch
from ...engine.pointcloud.cloud import PointCloud
from ...engine.pointcloud.writing import write_cloud
from ...interface.parameters import SurveyParameters
from ...simulation.surveys.series import SimulatedSeries, simulate_series, survey_days, write_series
from ...workflows.series import monitor_series
from .real_data import DATA, dense_cloud
from .table import Row, say

GRASS_SERIES, STILL_SERIES = 10, 18
_FIRST_SEED, _FIRST_STILL_SEED = 2100, 2300
_RETURNS_PER_M2 = 250
_LENGTH_M, _HEIGHT_M, _ANGLES_DEG = 16.0, 8.0, (30.0, 35.0, 39.0, 45.0)
_OFFSET_M = 0.05
_PLACES = ((0.7, "left", 0.0), (0.6, "patches", 0.0), (1.0, "left", 4.0), (0.5, "left", 0.0), (1.0, "left", 0.0))
"""Share of grass, its layout, and how far the region reaches beyond the slope (the road lies below), m."""
_YEARS_DAYS = 730
_SPRING, _AUTUMN = 60, 300  # days of the year from which the grass grows, and until which
_LOWEST_M = 0.15
_CUT_DAYS = 35  # that a meadow looks mown
_REAL_DAYS_APART = 60
_MAIN_LINES = 6  # of the forest's flight; the others cross it


@dataclass(frozen=True)
class Still:
    """What a series on ground that did not move was said to do.

    ``levels``: highest level that each zone ever had; ``slid``: zones found by their motion along the surface.
    """

    name: str
    surveys: int
    levels: tuple[int, ...]
    slid: int
    reasons: tuple[str, ...]

    @property
    def alerts(self) -> int:
        return sum(level > 0 for level in self.levels)


def rows() -> list[Row]:
    grass = list(judged(GRASS_SERIES, with_grass, _FIRST_SEED))
    still = list(judged(STILL_SERIES, without_grass, _FIRST_STILL_SEED))
    real = list(judged_real())
    return [
        _row("still slopes with seasonal grass, two years, clouds", grass),
        _row("still slopes without grass, clouds", still),
        _row("real ground that did not move", real),
    ]


def _row(figure: str, found: Sequence[Still]) -> Row:
    alerted = [one for one in found if one.alerts]
    slid = sum(one.slid for one in found)
    names = "; ".join(f"{one.name}: levels {one.levels}" for one in alerted)
    return Row(
        f"{figure} ({len(found)} series, {sum(one.surveys for one in found)} surveys): zones with an alert at any time",
        f"{sum(one.alerts for one in found)} of {sum(len(one.levels) for one in found)}; {slid} slid",
        "0; 0",
        names,
        not alerted and not slid,
    )


def grass_plan(seed: int) -> tuple[tuple[date, ...], tuple[SurveyParameters, ...], float]:
    """Days of 6 to 8 surveys over two years, the plants at each of them, and the region's buffer (m)."""
    rng = np.random.default_rng([17, seed])
    share, layout, buffer = _PLACES[seed % len(_PLACES)]
    angle = _ANGLES_DEG[seed // len(_PLACES) % len(_ANGLES_DEG)]
    count = int(rng.integers(6, 9))
    days = np.linspace(0, _YEARS_DAYS, count) + rng.uniform(-25, 25, count)
    first = date(2023, 1, 1) + timedelta(days=int(rng.integers(0, 365)))
    dates = tuple(first + timedelta(days=int(day - days[0])) for day in days)
    highest, cut = rng.uniform(0.4, 0.9), int(rng.integers(170, 230))
    area = _LENGTH_M * _HEIGHT_M / np.tan(np.radians(angle))
    parameters = SurveyParameters(
        seed=seed, points=int(_RETURNS_PER_M2 * area), length=_LENGTH_M, height=_HEIGHT_M, angle=angle,
        vegetation=0.0, offset=_OFFSET_M, grass=share, layout=layout,
    )  # fmt: skip
    return dates, tuple(_in_season(parameters, day, highest, cut) for day in dates), buffer


def _in_season(parameters: SurveyParameters, day: date, highest: float, cut: int) -> SurveyParameters:
    """The plants on a day: grass that grows to ``highest`` (m) in summer and is cut once, on the day ``cut``."""
    of_year = day.timetuple().tm_yday
    if cut <= of_year < cut + _CUT_DAYS:
        return replace(parameters, mown="both")
    since = cut if of_year >= cut else _SPRING
    grown = np.clip((of_year - since) / 90.0, 0.0, 1.0) * (0.5 if of_year >= cut else 1.0)
    if not _SPRING < of_year < _AUTUMN:
        grown = 0.0
    return replace(parameters, grass_height=float(_LOWEST_M + grown * (highest - _LOWEST_M)))


def with_grass(seed: int, folder: Path) -> tuple[list[Epoch], Path]:
    """Surveys of a still slope whose grass grows and is cut, and its outline."""
    dates, plants, buffer = grass_plan(seed)
    paths = write_series(grown_series(dates, plants, buffer), folder)
    return [Epoch(paths[day.isoformat()], day) for day in dates], paths["roi"]


def grown_series(
    dates: Sequence[date], plants: Sequence[SurveyParameters], roi_buffer: float, points: int | None = None
) -> SimulatedSeries:
    """Surveys of ground that rests under ``plants``, with another number of ``points`` if given."""
    parameters = plants[0] if points is None else replace(plants[0], points=points)
    return simulate_series(parameters, dates, (), plants=plants, roi_buffer=roi_buffer)


def without_grass(seed: int, folder: Path) -> tuple[list[Epoch], Path]:
    """Four surveys of a still slope with shrubs and trees."""
    rng = np.random.default_rng([19, seed])
    angle = _ANGLES_DEG[seed % len(_ANGLES_DEG)]
    area = _LENGTH_M * _HEIGHT_M / np.tan(np.radians(angle))
    parameters = SurveyParameters(
        seed=seed, points=int(rng.uniform(150, 400) * area), length=_LENGTH_M, height=_HEIGHT_M, angle=angle,
        vegetation=float(rng.uniform(0.0, 0.6)), offset=_OFFSET_M,
    )  # fmt: skip
    dates = survey_days(4, int(rng.integers(25, 61)))
    paths = write_series(simulate_series(parameters, dates, ()), folder)
    return [Epoch(paths[day.isoformat()], day) for day in dates], paths["roi"]


Surveyed = Callable[[int, Path], tuple[list[Epoch], Path]]


def judged(count: int, surveyed: Surveyed, first_seed: int) -> Iterator[Still]:
    """``count`` series one after the other."""
    for seed in range(first_seed, first_seed + count):
        with tempfile.TemporaryDirectory() as name:
            epochs, roi = surveyed(seed, Path(name))
            yield judge(f"seed {seed}", epochs, roi, Path(name) / "out")


def judged_real() -> Iterator[Still]:
    """Real clouds dealt out to surveys of ground that cannot have moved between them."""
    for name, crs, parts in real_surveys():
        with tempfile.TemporaryDirectory() as folder:
            days = survey_days(len(parts), _REAL_DAYS_APART)
            epochs = [Epoch(Path(folder) / f"{day.isoformat()}.laz", day) for day in days]
            for epoch, xyz in zip(epochs, parts, strict=True):
                write_cloud(epoch.path, PointCloud(xyz, CRS.from_user_input(crs), epoch.path))
            yield judge(name, epochs, None, Path(folder) / "out")


def real_surveys() -> Iterator[tuple[str, str, list[Float]]]:
    """Name, coordinate system and the points (n, 3) of each survey, of the real clouds that there are."""
    cloud = dense_cloud()
    if cloud is not None:
        for seed in (31, 32):
            dealt = np.random.default_rng(seed).permutation(len(cloud)) % 5
            yield f"dense cloud in fifths, {seed}", "EPSG:32614", [cloud[dealt == part] for part in range(5)]
    pair = DATA / "forest_pair"
    if (path := pair / "uav_2020-09-22.laz").is_file():
        las = laspy.read(path)
        xyz, line = np.array(las.xyz), np.asarray(las.point_source_id)
        lines, counts = np.unique(line, return_counts=True)
        of_odd = np.isin(line, np.sort(lines[np.argsort(counts)[-_MAIN_LINES:]])[::2])
        dealt = np.random.default_rng(33).permutation(len(xyz)) % 2
        parts = [xyz[(of_odd == odd) & (dealt == half)] for half in (0, 1) for odd in (True, False)]
        parts.append(np.array(laspy.read(pair / "als_2020-09-19.laz").xyz))
        yield "forest, halves of odd and of even flight lines, and an airplane", "EPSG:6341", parts


def judge(name: str, epochs: Sequence[Epoch], roi: Path | None, folder: Path) -> Still:
    """A series through the workflow with its default settings."""
    done = monitor_series(epochs, folder, roi=roi)
    zones = geopandas.read_file(done.outputs["series_zones"], layer="zones")
    surveys = geopandas.read_file(done.outputs["series_zones"], layer="series")
    levels = tuple(int(surveys.loc[surveys["zone_id"] == zone, "alert_level"].max()) for zone in zones["zone_id"])
    found = Still(
        name, len(epochs), levels, int((zones["found_by"] != "heights").sum()), tuple(zones["alert_reason"].fillna(""))
    )
    say(f"{found}")
    return found
