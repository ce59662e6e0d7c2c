"""Series of small simulated surveys: creep, motions that slow down, nothing at all, and motions that end in failure."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date, timedelta
from pathlib import Path

import geopandas
import numpy as np
import rasterio
from affine import Affine
from rasterio.features import geometry_mask

from ...engine.epochs.epoch import Epoch
from ...engine.grid.grid import Grid
from ...engine.series.inverse_velocity import failure_time
from ...engine.series.velocity import zone_velocity
from ...interface.parameters import (
    DisplacementStepParameters,
    GridChangeParameters,
    SeriesParameters,
    SurveyParameters,
)
from ...simulation.surveys.series import (
    Creep,
    Fukuzono,
    Law,
    Settling,
    SimulatedSeries,
    simulate_series,
    survey_days,
    write_series,
)
from ...workflows.series import monitor_series
from ...workflows.settings import SeriesSettings
from .series_grounds import ground_rows
from .table import Row

_FIRST = date(2024, 5, 1)
_MONTHLY = survey_days(6, 30)
_NEARING = tuple(_FIRST + timedelta(days=d) for d in (0, 30, 55, 75, 90, 100))
_FAILURE = 110.0
_SETTINGS = SeriesSettings(
    change=GridChangeParameters(cell=0.25),
    series=SeriesParameters(ground_ready=True, rasters_each_survey=False),
    displacement_step=DisplacementStepParameters(displacement=False),  # heights alone are measured here
)


@dataclass(frozen=True)
class Slope:
    """A series, its zones as they were written, the true velocity of each (mm/day), and the seconds it took."""

    series: SimulatedSeries
    zones: geopandas.GeoDataFrame
    velocities: list[float]
    seconds: float


def rows() -> list[Row]:
    """Velocities and their intervals, failure times, false zones, and what one more survey costs."""
    creep = [
        _slope(seed, _MONTHLY, (Creep(-0.002, 15.0), Creep(0.005, 45.0), Creep(-0.01, 15.0))) for seed in range(1, 5)
    ]
    settling = [_slope(seed, _MONTHLY, (Settling(-0.5, 40.0), Settling(0.3, 60.0))) for seed in (21,)]
    still = [_slope(seed, _MONTHLY, ()) for seed in (31, 32)]
    ending = [_slope(seed, _NEARING, (Fukuzono(-0.15, _FAILURE), Fukuzono(-0.3, _FAILURE))) for seed in (41, 42)]
    return [
        *_velocity_rows(creep),
        _no_failure("decelerating zones with a failure time", settling),
        Row(
            f"unchanged slopes ({len(still)}), zones confirmed by two comparisons",
            f"{sum(int((s.zones['n_epochs_confirmed'] >= 2).sum()) for s in still)}",
            "0",
            f"zones with one: {sum(int((s.zones['n_epochs_confirmed'] == 1).sum()) for s in still)}",
            not any((s.zones["n_epochs_confirmed"] >= 2).any() for s in still),
        ),
        _no_failure("unchanged slopes, failure times", still),
        _failure_row(ending),
        *_statistical_rows(),
        *ground_rows(),
        _one_more(creep[0].series),
    ]


def _slope(seed: int, dates: Sequence[date], laws: Sequence[Law]) -> Slope:
    parameters = SurveyParameters(
        seed=seed, points=36_000, length=24.0, height=9.0, angle=39.0, vegetation=0.3, offset=0.05
    )
    series = simulate_series(parameters, dates, laws)
    with tempfile.TemporaryDirectory() as name:
        paths = write_series(series, Path(name), ground_only=True)
        start = time.perf_counter()
        outputs = monitor_series(_epochs(series, paths), Path(name) / "out", _SETTINGS, roi=paths["roi"]).outputs
        seconds = time.perf_counter() - start
        zones = geopandas.read_file(outputs["series_zones"], layer="zones")
        with rasterio.open(outputs["velocity"]) as raster:
            known = raster.read_masks(1) > 0
            grid = Grid(raster.transform.c, raster.transform.f, raster.transform.a, *raster.shape)
    moving = np.sum([series.true_velocity(k, grid) for k in range(len(laws))], axis=0)
    true = []
    for shape in zones.geometry:
        inside = known & geometry_mask([shape], grid.shape, Affine(*grid.affine), invert=True)
        true.append(1000 * float(np.mean(moving[inside])))
    return Slope(series, zones, true, seconds)


def _epochs(series: SimulatedSeries, paths: dict[str, Path]) -> list[Epoch]:
    return [Epoch(paths[day.isoformat()], day) for day in series.dates]


def _velocity_rows(slopes: list[Slope]) -> list[Row]:
    held, errors, stated, zones = 0, [], [], 0
    for slope in slopes:
        for (_, zone), true in zip(slope.zones.iterrows(), slope.velocities, strict=True):
            zones += 1
            held += zone["rate_low"] <= true <= zone["rate_high"]
            errors.append(abs(zone["rate_mm_day"] - true))
            stated.append(zone["rate_err"])
    expected = sum(len(s.series.motions) for s in slopes)
    ours, plain = _shares()
    return [
        Row(
            "creep of 2, 5, 10 mm/day after onset, six monthly surveys: zones whose 95 % interval holds the velocity",
            f"{held} of {zones}",
            ">= 90 %",
            f"{expected} zones moved",
            held >= 0.9 * zones and zones >= expected,
        ),
        Row(
            "1200 zone series of that creep, errors of 6 mm: intervals that hold the velocity",
            f"{ours:.1f} %",
            ">= 90 %",
            f"plain line through all surveys {plain:.1f} %",
            ours >= 90,
        ),
        Row(
            "velocity's error, median",
            f"{np.median(errors):.3f} mm/day",
            "",
            f"stated standard error {np.median(stated):.3f} mm/day",
        ),
    ]


def _no_failure(figure: str, slopes: list[Slope]) -> Row:
    computed = sum(int((s.zones["failure_from"] != "").sum()) for s in slopes)
    zones = sum(len(s.zones) for s in slopes)
    return Row(figure, f"{computed} of {zones}", "0", "", computed == 0)


def _failure_row(slopes: list[Slope]) -> Row:
    when = (_FIRST + timedelta(days=_FAILURE)).isoformat()
    computed = [z for s in slopes for _, z in s.zones.iterrows() if z["failure_from"]]
    held = sum(z["failure_from"] <= when <= z["failure_to"] for z in computed)
    widths = [(date.fromisoformat(z["failure_to"]) - date.fromisoformat(z["failure_from"])).days for z in computed]
    width = f", {np.median(widths):.0f} days wide (median)" if widths else ""
    moved = sum(len(s.series.motions) for s in slopes)
    return Row(
        "Fukuzono's law, failure 10 days after the last survey: intervals that hold it",
        f"{held} of {len(computed)}{width}",
        "most",
        f"{moved - len(computed)} of {moved} zones not computable",
        bool(computed) and held > len(computed) / 2,
    )


def _statistical_rows() -> list[Row]:
    """Zone series with normal errors, many of each kind: no clouds, the laws and the errors alone."""
    count, sigma = 500, 0.006
    rng = np.random.default_rng(7)
    variance = np.full(6, sigma**2)

    def intervals(dates: Sequence[date], law: Law) -> tuple[int, int]:
        days = np.array([(d - dates[0]).days for d in dates], dtype=np.float64)
        motion = np.array([law.displacement(float(t)) for t in days])
        known = held = 0
        for _ in range(count):
            y = motion + rng.normal(0, sigma, 6)
            found = failure_time(days, y - y[0], variance)
            if found.earliest is not None and found.latest is not None:
                known += 1
                held += found.earliest <= (law.failure or np.inf) <= found.latest
        return known, held

    known, held = intervals(_NEARING, Fukuzono(-0.15, _FAILURE))
    wrong = {
        "decelerating": intervals(_MONTHLY, Settling(-0.5, 40.0))[0],
        "nothing but noise": intervals(_MONTHLY, Creep(0.0))[0],
        "steady 5 mm/day": intervals(_MONTHLY, Creep(-0.005))[0],
    }
    share = held / max(known, 1)
    return [
        Row(
            f"{count} zone series of Fukuzono's law, errors of {1000 * sigma:.0f} mm: failure interval holds the truth",
            f"{100 * share:.1f} % of {known}",
            ">= 90 %",
            f"{count - known} not computable",
            share >= 0.9,
        ),
        Row(
            f"{count} zone series each without acceleration: failure times",
            ", ".join(f"{name} {number}" for name, number in wrong.items()),
            "0 for decelerating and noise",
            "",
            wrong["decelerating"] == wrong["nothing but noise"] == 0,
        ),
    ]


def _shares(count: int = 400, sigma: float = 0.006) -> tuple[float, float]:
    """How often the interval holds the velocity after onset, in percent: SlopeWatch's and that of a plain line."""
    rng = np.random.default_rng(8)
    days = np.array([(d - _MONTHLY[0]).days for d in _MONTHLY], dtype=np.float64)
    held = np.zeros(2)
    laws = (Creep(-0.002, 15.0), Creep(0.005, 45.0), Creep(-0.01, 15.0))
    for law in laws:
        for _ in range(count):
            y = np.array([law.displacement(float(t)) for t in days]) + rng.normal(0, sigma, 6)
            found = zone_velocity(days, y - y[0], np.full(6, sigma**2))
            held[0] += found is not None and found.low <= law.rate <= found.high
            error = sigma / np.sqrt(np.sum((days - days.mean()) ** 2))
            held[1] += abs(np.polyfit(days, y, 1)[0] - law.rate) <= 1.96 * error
    return tuple(100 * held / (count * len(laws)))


def _one_more(series: SimulatedSeries) -> Row:
    """Raw surveys: all at once, and all but the last before and then that one."""
    with tempfile.TemporaryDirectory() as name:
        paths = write_series(series, Path(name))
        epochs = _epochs(series, paths)[:4]
        settings = SeriesSettings(
            change=GridChangeParameters(cell=0.25), displacement_step=DisplacementStepParameters(displacement=False)
        )
        seconds = {}
        for label, surveys in (("before", epochs[:-1]), ("added", epochs)):
            start = time.perf_counter()
            monitor_series(surveys, Path(name) / "out", settings, roi=paths["roi"])
            seconds[label] = time.perf_counter() - start
        start = time.perf_counter()
        monitor_series(epochs, Path(name) / "fresh", settings, roi=paths["roi"])
        whole = time.perf_counter() - start
    return Row(
        "a fourth raw survey added to three",
        f"{seconds['added']:.1f} s",
        "",
        f"all four from the start {whole:.1f} s",
    )
