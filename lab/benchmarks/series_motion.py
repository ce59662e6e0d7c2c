"""Series of surveys whose ground creeps along its surface: velocity vectors, false zones, and what heights alone see.

Six surveys 60 days apart, simulated and of a dense real cloud (``series_motion_cases``); surveys of the real one share
one scan, so that this is what the relief allows. From the ground on: registration, grid, heights, motion and alerts.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import shapely
from shapely.affinity import scale

from ...interface.parameters import DisplacementStepParameters, SeriesParameters
from ...workflows.series import monitor_series
from ...workflows.series_store import FOLDER
from ...workflows.settings import SeriesSettings
from .kept_cases import KeptCases
from .real_data import DENSE
from .series_motion_cases import DAYS, Case, real, simulated
from .table import Row, say

# Simulated series 1 and 2 and the real ones 1 and 31 gave reason for rules, so that they are no test of these.
SEEDS, REAL_SEEDS = range(21, 26), range(32, 37)
RATES_MM_DAY = (1.0, 0.6)
REAL_RATES_MM_DAY = (0.5, 0.8)
_EARLY_SEEDS = (SEEDS[0], REAL_SEEDS[0])  # whose series are run after each survey, which costs twice the time
_LEAST_SURVEYS = 3  # after which alerts are looked at
_MARGIN_M = 1.25  # taken off a zone before its motion is fitted

Key = tuple[str, int, tuple[float, ...]]
"""Simulated or real, the seed, and the rates of the places that move, mm a day; none of a still series."""


@dataclass
class Outcome:
    """What became of series, as plain values: ``off`` errors of the zones' velocities (east, north, up) and ``stated``
    their standard errors, mm a day, ``share`` their length by the true one, ``uneven`` the part of their errors that
    unevenness makes, as a share of the velocity, ``false`` zones where nothing moved, ``alerts`` of each place that
    moves its rate and the surveys after which it had an alert (None: never), with motion and by heights alone.
    """

    off: list[list[float]] = field(default_factory=list)
    stated: list[list[float]] = field(default_factory=list)
    share: list[float] = field(default_factory=list)
    uneven: list[float] = field(default_factory=list)
    false: int = 0
    still_series: int = 0
    still_with_zone: int = 0
    alerts: list[tuple[float, int | None, int | None]] = field(default_factory=list)

    def add(self, other: Outcome) -> None:
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)


def judge(case: Case, folder: Path, *, early: bool = True) -> Outcome:
    """Run the series as its surveys come in, with motion and by heights alone.

    Args:
        early: look for alerts after each survey; without it only all surveys together are run, with motion.
    """
    outcome = Outcome()
    first: dict[bool, dict[int, int]] = {True: {}, False: {}}
    for motion in (True, False) if early else (True,):
        out = folder / f"motion_{motion}"
        if not motion:
            if not case.outlines:
                continue
            shutil.copytree(folder / "motion_True" / FOLDER, out / FOLDER)
        for count in range(_LEAST_SURVEYS if early and case.outlines else len(DAYS), len(DAYS) + 1):
            zones = _zones(_run(case, count, out, displacement=motion), "series_zones")
            asking = zones[zones["alert_level"] > 0]
            for number, shape in enumerate(case.outlines):
                core = scale(shape, 0.5, 0.5)
                if asking.intersects(core).any():
                    first[motion].setdefault(number, count)
    if early:
        outcome.alerts = [(r, first[True].get(k), first[False].get(k)) for k, r in enumerate(case.rates)]
    moving = _zones({"series_zones": folder / "motion_True" / "displacement.gpkg"}, "series_zones")
    latest = moving[moving["epoch"] == DAYS[-1].isoformat()]
    if not case.outlines:
        outcome.still_series, outcome.still_with_zone = 1, int(len(latest) > 0)
        return outcome
    for _, zone in latest.iterrows():
        _compare(outcome, case, zone)
    return outcome


def _run(case: Case, count: int, folder: Path, *, displacement: bool) -> Mapping[str, Path]:
    settings = SeriesSettings(
        series=SeriesParameters(ground_ready=True, rasters_each_survey=False),
        displacement_step=DisplacementStepParameters(displacement=displacement),
    )
    return monitor_series(case.epochs[:count], folder, settings).outputs


def _zones(outputs: Mapping[str, Path], key: str) -> geopandas.GeoDataFrame:
    return geopandas.read_file(outputs[key], layer="zones")


def _compare(outcome: Outcome, case: Case, zone: Any) -> None:
    """Put a zone's velocity next to the true mean over what was fitted."""
    inner = zone.geometry.buffer(-_MARGIN_M)
    inner = zone.geometry if inner.is_empty else inner
    low = np.floor(inner.bounds[:2])
    x, y = np.meshgrid(*(np.arange(a, b, 0.1) for a, b in zip(low, inner.bounds[2:], strict=True)))
    places = np.column_stack([x.ravel(), y.ravel()])
    places = places[shapely.contains_xy(inner, places[:, 0], places[:, 1])]
    true = 1000 * np.nanmean(case.velocity(places), axis=0)
    if not any(zone.geometry.intersects(shape) for shape in case.outlines):
        outcome.false += 1
        return
    found = np.array([zone[f"velocity_{axis}_mm_day"] for axis in ("east", "north", "up")])
    outcome.off.append((found - true).tolist())
    outcome.stated.append([float(zone[f"velocity_{axis}_err_mm_day"]) for axis in ("east", "north", "up")])
    outcome.share.append(float(np.linalg.norm(found) / np.linalg.norm(true)))
    outcome.uneven.append(float(zone["uneven_share"]))


def keys() -> list[Key]:
    """All series, those of each kind in turns, so that a run cut short has some of all; a seed's moving and still one
    follow each other, because they share their ground.
    """
    made = [("simulated", seed, RATES_MM_DAY) for seed in SEEDS]
    dealt = [("real", seed, REAL_RATES_MM_DAY) for seed in REAL_SEEDS] if DENSE.exists() else []
    seeds = [one for both in zip_longest(dealt, made) for one in both if one is not None]
    return [(kind, seed, rates) for kind, seed, moving in seeds for rates in (moving, ())]


def measured(key: Key) -> Outcome:
    """One series from its surveys to the outcome."""
    kind, seed, rates = key
    early = seed in _EARLY_SEEDS
    with tempfile.TemporaryDirectory() as folder:
        return judge((simulated if kind == "simulated" else real)(seed, rates, Path(folder)), Path(folder), early=early)


def rows(store: Path | None = None) -> list[Row]:
    """The figures with their targets; series that ``store`` holds are not measured again."""
    cases = KeptCases(store and store.with_suffix(".jsonl"))
    found: dict[Key, Outcome] = {}
    for key in keys():
        name = f"{key[0]} {key[1]}, {'moving' if key[2] else 'still'}"
        found[key] = Outcome(**cases.get(name, partial(_kept, key)))
        say(name)
    return table(found)


def _kept(key: Key) -> dict[str, Any]:
    return vars(measured(key))


def table(kept: Mapping[Key, Outcome]) -> list[Row]:
    """The figures of the series that were measured, simulated and real apart."""
    found: list[Row] = []
    for name in ("simulated", "real"):
        outcome = Outcome()
        for key, one in kept.items():
            if key[0] == name:
                outcome.add(one)
        found += _rows(name, outcome)
    return found


def _rows(name: str, outcome: Outcome) -> Iterator[Row]:
    if not outcome.off:
        return
    off, stated = np.array(outcome.off), np.array(outcome.stated)
    inside = np.abs(off) < 2 * stated
    share = 100 * float(inside.mean())
    whole = 100 * float(inside.all(axis=1).mean())
    yield Row(
        f"{name}: components of the zones' velocities within two standard errors ({len(off)} zones)",
        f"{share:.0f} %", "≥ 90 %", f"{whole:.0f} % of the vectors in all three components", share >= 90,
    )  # fmt: skip
    rms = np.sqrt((off**2).mean(axis=0))
    yield Row(
        f"{name}: rms error of the zones' velocities east / north / up",
        " / ".join(f"{v:.3f}" for v in rms) + " mm/day", "",
        "stated " + " / ".join(f"{v:.3f}" for v in np.sqrt((stated**2).mean(axis=0))),
    )  # fmt: skip
    yield Row(f"{name}: length by the true one, mean", f"{100 * (np.mean(outcome.share) - 1):+.1f} %")
    yield Row(f"{name}: zones of motion where nothing moved, moving series", f"{outcome.false}")
    yield Row(f"{name}: still series with a zone of motion", f"{outcome.still_with_zone} of {outcome.still_series}")
    for rate in sorted({r for r, _, _ in outcome.alerts}):
        with_motion, heights = ([times[k] for r, *times in outcome.alerts if r == rate] for k in (0, 1))
        yield Row(
            f"{name}: surveys until an alert at {rate:g} mm/day, with motion",
            _counts(with_motion), "", f"by heights alone: {_counts(heights)}",
        )  # fmt: skip


def _counts(values: Sequence[int | None]) -> str:
    return ", ".join("none" if v is None else str(v) for v in values)
