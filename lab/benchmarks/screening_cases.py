"""All hazards of a run as columns, which detectors found them at which level, and shares of them with intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logit
from scipy.stats import binomtest

from ...engine.core.arrays import Bool, Float
from .screening_calibration import fit_platt
from .screening_levels import Measured
from .screening_trials import PlaceResult

LEVELS = ("others", "own", "changed_others", "changed_own")
RESAMPLES = 200
TOLD_SHARE = 0.7
"""Of the hazards at A70 that are to be found."""


@dataclass(frozen=True)
class Cases:
    """Per hazard (n,): place, survey (``group``), kind and density of the place, height (m, without its sign, 0 where
    nothing was put in), diameter (m), A70 (m). ``found[detector][level]`` is (runs, n).
    """

    place: NDArray[np.str_]
    group: NDArray[np.str_]
    kind: NDArray[np.str_]
    density: Float
    height: Float
    diameter: Float
    needed: Float
    found: dict[str, dict[str, Bool]]

    @property
    def ratio(self) -> Float:
        """(n,) height over A70; 0 where A70 is not known."""
        ratio = self.height / self.needed
        return np.where(np.isfinite(ratio), ratio, 0.0)


@dataclass(frozen=True)
class Share:
    """Share found, as the mean over the runs, its 95 % interval by Wilson 1927 (doi:10.1080/01621459.1927.10502953),
    the lowest and the highest run, and of how many hazards.
    """

    value: float
    low: float
    high: float
    least: float
    most: float
    number: int
    runs: int

    def __str__(self) -> str:
        if not self.number:
            return "-"
        seeds = f"; {100 * self.least:.0f} to {100 * self.most:.0f}" if self.runs > 1 else ""
        return f"{100 * self.value:.0f} % ({100 * self.low:.0f} to {100 * self.high:.0f}{seeds})"


def cases(results: Sequence[PlaceResult], measured: Mapping[str, Sequence[Measured]]) -> Cases:
    """All trials of all places."""
    listed = [(one, trial) for one in results for trial in one.trials]
    density = {one.place.name: one.place.density for one in results}
    found = {
        name: {
            level: np.array([np.concatenate([run.found(one.place.name, level) for one in results]) for run in runs])
            for level in LEVELS
        }
        for name, runs in measured.items()
    }
    return Cases(
        np.array([one.place.name for one, _ in listed]),
        np.array([one.place.group for one, _ in listed]),
        np.array([one.place.kind for one, _ in listed]),
        np.array([density[one.place.name] for one, _ in listed]),
        np.array([0.0 if trial.empty else abs(trial.height) for _, trial in listed]),
        np.array([trial.diameter for _, trial in listed]),
        np.array([trial.needed for _, trial in listed]),
        found,
    )


def share(found: Bool) -> Share:
    """Of hazards (runs, n)."""
    runs, number = found.shape
    if not number:
        return Share(math.nan, math.nan, math.nan, math.nan, math.nan, 0, runs)
    by_run = found.mean(axis=1)
    value = float(by_run.mean())
    interval = binomtest(round(value * number), number).proportion_ci(0.95, method="wilson")
    return Share(
        value, float(interval.low), float(interval.high), float(by_run.min()), float(by_run.max()), number, runs
    )


def a70_factor(told: Cases, detector: str, chosen: Bool, seed: int = 0) -> tuple[float, float, float]:
    """What A70 must be multiplied by so that a detector finds 70 % of the ``chosen`` (n,) hazards at it, at the level
    in use, and its 95 % interval by bootstrap over places; NaN where nothing or all is found.

    By a logistic fit of what is found (all runs together) over the logarithm of height over A70.
    """
    use = chosen & (told.ratio > 0)
    level = np.log(told.ratio[use])
    found = told.found[detector]["others"][:, use].mean(axis=0)
    place = told.place[use]
    names = np.unique(place)

    def factor(weight: Float) -> float:
        positive, negative = weight * found, weight * (1.0 - found)
        if not positive.sum() or not negative.sum():
            return math.nan
        fit = fit_platt(level, positive, negative)
        return math.exp(min((logit(TOLD_SHARE) - fit.shift) / fit.scale, 20.0)) if fit.scale > 0 else math.nan

    if not len(level):
        return math.nan, math.nan, math.nan
    value = factor(np.ones(len(level)))
    rng = np.random.default_rng(seed)
    number = np.searchsorted(names, place)
    drawn = []
    for _ in range(RESAMPLES):
        times = np.bincount(rng.integers(len(names), size=len(names)), minlength=len(names))
        drawn.append(factor(times[number].astype(np.float64)) if times[number].any() else math.nan)
    low, high = np.nanquantile(drawn, (0.025, 0.975)) if np.isfinite(drawn).any() else (math.nan, math.nan)
    return value, float(low), float(high)
