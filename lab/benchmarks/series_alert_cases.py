"""Displacement series of zones with known truth: what moves, what the surveys measure, and which levels are right.

No clouds: each survey has an error of its registration, which all zones of a slope share, one of its points, and one of
its plants. They are in both intervals that meet at the survey, as on real slopes. Each case can be surveyed anew.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from ...engine.change.season import MAX_EXPLAINED_SHARE
from ...engine.core.arrays import Bool, Float
from ...engine.series.level_history import Displacements
from ...engine.statistics.normal import Z95

REGISTRATION_M, POINTS_M = (0.003, 0.008), (0.001, 0.004)
"""Standard errors of a zone's mean height: UAV-borne surveys of 50 to 400 points a m² over 4 to 100 m²."""
STILL_ZONES = 10
"""Places of a still slope that are judged with the same surveys."""
_NOISE_MISFIT = 0.15  # standard deviation of the logarithm of the true error over the stated one
_MOST = 9
_NUMBERS = 10_000  # more than the cases of a sample


@dataclass(frozen=True)
class Case:
    """A zone through time.

    Attributes:
        kind: of ``KINDS``.
        days: (n,) of the surveys since the first; ``truth`` (n,) displacement, metres.
        stated: (n,) standard error that each survey states of it, metres.
        highest: (n,) the highest level that is right after each survey; ``lowest`` likewise.
        failure: day of the failure; None without.
        unstated: (n,) errors that no survey states, metres: a bad survey, grass.
        missing: (n,) surveys that did not measure the zone.
        area: m².
    """

    kind: str
    number: int
    days: Float
    truth: Float
    stated: Float
    highest: Float
    lowest: Float
    failure: float | None = None
    unstated: Float | None = None
    missing: Bool | None = None
    area: float = 20.0
    along_surface: bool = False

    @property
    def zones(self) -> int:
        return STILL_ZONES if self.kind.startswith("still") else 1

    def surveyed(self, draw: int) -> list[Displacements]:
        """One more drawing of all errors: the zones of the slope."""
        rng = np.random.default_rng([7, self.number, draw])
        n = len(self.days)
        factor = np.exp(rng.normal(0.0, _NOISE_MISFIT))
        common = factor * np.sqrt(0.75) * self.stated * rng.normal(size=n)
        return [self._zone(common + factor * 0.5 * self.stated * rng.normal(size=n)) for _ in range(self.zones)]

    def _zone(self, errors: Float) -> Displacements:
        n = len(self.days)
        change = self.truth + errors + (0.0 if self.unstated is None else self.unstated)
        change = change - change[0]
        if self.missing is not None:
            change[self.missing] = np.nan
        variance = np.where(np.isfinite(change), self.stated**2, np.nan)
        with np.errstate(invalid="ignore"):
            beyond = np.abs(change) > Z95 * np.sqrt(variance + variance[0])
        beyond[0] = False
        sizes = np.where(beyond, np.abs(change), 0.0)
        sign = np.sign(change[int(np.argmax(sizes))])
        confirmed = beyond & (np.sign(change) == sign)
        return Displacements(self.days, change, variance, confirmed, np.full(n, self.area), self.along_surface)


Maker = Callable[[np.random.Generator, int], dict]


CHOSEN, NEW = 3, 23
"""Samples of series: those that rules and thresholds were chosen on, and those that nothing was chosen on."""


def cases(kinds: tuple[str, ...] = (), each: int = 6, sample: int = CHOSEN) -> list[Case]:
    """``each`` series of every kind, with 4 to 20 surveys, of one of the samples."""
    made = []
    for k, (kind, maker) in enumerate(KINDS.items()):
        if kinds and kind not in kinds:
            continue
        for i in range(each):
            rng = np.random.default_rng([sample, k, i])
            least = _LEAST.get(kind, 4)
            n = (least + 1, 6, 8, 10, 14, 20)[i % 6] if i % 6 else least
            values = maker(rng, max(n, least))
            count = len(values["days"])
            stated = values.pop("stated", _stated(rng, count, along=values.get("along_surface", False)))
            values.setdefault("highest", np.zeros(count))
            values.setdefault("lowest", np.zeros(count))
            made.append(Case(kind, _NUMBERS * (sample - CHOSEN) + 100 * k + i, stated=stated, **values))
    return made


def _stated(rng: np.random.Generator, n: int, along: bool = False) -> Float:
    """Standard error of each survey, near one level for a slope."""
    level = np.hypot(rng.uniform(*REGISTRATION_M), rng.uniform(*POINTS_M)) * (1.5 if along else 1.0)
    return level * np.exp(rng.normal(0.0, 0.2, n))


def _days(rng: np.random.Generator, n: int, every: float | None = None) -> Float:
    every = rng.uniform(20.0, 60.0) if every is None else every
    return np.round(np.concatenate([[0.0], np.cumsum(every * rng.uniform(0.8, 1.2, n - 1))]))


def _all(n: int, level: float) -> Float:
    return np.full(n, level)


def _still(rng: np.random.Generator, n: int) -> dict:
    return {"days": (days := _days(rng, n)), "truth": 0 * days, "highest": _all(n, 0)}


def _grass(rng: np.random.Generator, n: int) -> dict:
    """Two years of grass that grows to 0.1 to 0.4 m and lifts the ground by up to a third of its height."""
    days = np.round(np.linspace(0.0, 730.0, max(n, 6)) + rng.uniform(-10, 10, max(n, 6)))
    days -= days[0]
    height = rng.uniform(0.1, 0.4) * np.sin(np.pi * ((days + rng.uniform(0, 365)) / 365.0)) ** 2
    lifted = rng.uniform(0.1, 1 / 3) * height
    grown = height - height[0]
    # what a comparison takes for the plants' is not measured
    explained = (np.abs(grown) > 0.05) & (np.abs(lifted - lifted[0]) <= MAX_EXPLAINED_SHARE * np.abs(grown))
    stated = np.hypot(_stated(rng, len(days)), lifted)
    return {
        "days": days, "truth": 0 * days, "unstated": lifted, "missing": explained, "stated": stated,
    }  # fmt: skip


def _bad_survey(rng: np.random.Generator, n: int) -> dict:
    days, bad = _days(rng, n), int(rng.integers(1, n))
    error = np.zeros(n)
    error[bad] = rng.choice([-1, 1]) * rng.uniform(0.03, 0.1)
    highest = np.zeros(n)
    highest[bad : bad + 2] = 2  # a change of this size in one survey is inspected
    return {"days": days, "truth": 0 * days, "unstated": error, "highest": highest}


def _missing_survey(rng: np.random.Generator, n: int) -> dict:
    days = _days(rng, n)
    missing = np.zeros(n, dtype=bool)
    missing[rng.integers(1, n)] = True
    return {"days": days, "truth": 0 * days, "missing": missing}


def _half_survey(rng: np.random.Generator, n: int) -> dict:
    days = _days(rng, n)
    stated = _stated(rng, n)
    stated[rng.integers(1, n)] *= 3
    return {"days": days, "truth": 0 * days, "stated": stated}


def _noise(rng: np.random.Generator, n: int) -> dict:
    days = _days(rng, n)
    return {"days": days, "truth": 0 * days, "stated": _stated(rng, n) * np.exp(rng.normal(0.0, 0.6, n))}


def _creep(rng: np.random.Generator, n: int, onset: float = -1.0, along: bool = False) -> dict:
    days = _days(rng, n)
    rate = np.exp(rng.uniform(np.log(0.0003), np.log(0.004)))
    return {
        "days": days, "truth": -rate * np.maximum(days - onset * days[-1], 0.0), "highest": _all(n, 2),
        "along_surface": along,
    }  # fmt: skip


def _later_creep(rng: np.random.Generator, n: int) -> dict:
    return _creep(rng, n, rng.uniform(0.0, 0.7))


def _creep_since_first(rng: np.random.Generator, n: int) -> dict:
    """It begins between the first two surveys, so that their velocity is too small by any factor."""
    days = _days(rng, n)
    rate, onset = np.exp(rng.uniform(np.log(0.001), np.log(0.004))), rng.uniform(0.3, 1.0) * days[1]
    return {"days": days, "truth": -rate * np.maximum(days - onset, 0.0), "highest": _all(n, 2)}


def _creep_along(rng: np.random.Generator, n: int) -> dict:
    return _creep(rng, n, 0.0, along=True)


def _seasonal(rng: np.random.Generator, n: int) -> dict:
    """Creep that is fast in the wet season and slow in the dry one, not alike in all years."""
    days = _days(rng, n)
    fine = np.arange(days[-1] + 1)
    year = (fine / 365.25 + rng.uniform()) % 1
    strength = rng.uniform(0.5, 1.5, int(days[-1] // 365) + 2)[(fine // 365).astype(int)]
    speed = rng.uniform(0.0003, 0.0015) * (0.1 + strength * 4 * np.exp(-(((year - 0.5) / 0.12) ** 2)))
    truth = -np.concatenate([[0.0], np.cumsum(speed)])[days.astype(int)]
    return {"days": days, "truth": truth, "highest": _all(n, 3)}


def _steps(rng: np.random.Generator, n: int) -> dict:
    """Rest and slips of 5 to 40 cm, each over 5 to 40 days."""
    days = _days(rng, n)
    truth = np.zeros(n)
    for middle in np.cumsum(rng.uniform(60, 400, 30)) - 60:
        size, time = np.exp(rng.uniform(np.log(0.05), np.log(0.4))), rng.uniform(1.5, 10)
        truth -= size * expit((days - middle) / time)
    return {"days": days, "truth": truth - truth[0], "highest": _all(n, 3)}


def _failing(rng: np.random.Generator, n: int, along: bool = False) -> dict:
    """Slow creep and then Voight's law with an exponent of 1.7 to 2.2, surveyed until less than an interval before."""
    days = _days(rng, n)
    left = rng.uniform(0.05, 1.0) * np.median(np.diff(days))
    failure = float(days[-1] + left)
    power = 1.0 / (rng.uniform(1.7, 2.2) - 1.0)
    rate = np.exp(rng.uniform(np.log(0.1), np.log(0.4))) / 30.0  # 30 days before the failure
    begins = max(0.0, failure - rng.uniform(100.0, 400.0))
    fine = np.linspace(0.0, days[-1], 20_000)
    speed = rate * ((failure - np.maximum(fine, begins)) / 30.0) ** -power
    way = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(fine))])
    lowest = np.zeros(n)
    lowest[-1] = 3
    return {
        "days": days, "truth": -np.interp(days, fine, way), "failure": failure, "lowest": lowest,
        "highest": _all(n, _MOST), "along_surface": along,
    }  # fmt: skip


def _failing_along(rng: np.random.Generator, n: int) -> dict:
    return _failing(rng, n, along=True)


def _stopped(rng: np.random.Generator, n: int) -> dict:
    """5 to 12 mm a day until it stops for good."""
    days, stop = _days(rng, n), int(rng.integers(1, n - 3)) if n > 4 else 1
    end = days[stop] + rng.uniform() * (days[stop + 1] - days[stop])
    highest = _all(n, 3)
    highest[stop + 3 :] = 0
    return {
        "days": days, "truth": -rng.uniform(0.005, 0.012) * np.minimum(days, end), "highest": highest,
    }  # fmt: skip


def _repaired(rng: np.random.Generator, n: int) -> dict:
    """Creep of 2 to 5 mm a day, then filled up again, for the most part or wholly, and at rest since."""
    days, last = _days(rng, n), int(rng.integers(2, n - 2)) if n > 4 else 1
    truth = -rng.uniform(0.002, 0.005) * days
    truth[last + 1 :] = truth[last] * rng.choice([0.0, 0.3])
    highest = _all(n, 3)
    highest[last + 3 :] = 0
    return {"days": days, "truth": truth, "highest": highest}


KINDS: dict[str, Maker] = {
    "still": _still,
    "still, seasonal grass": _grass,
    "still, one bad survey": _bad_survey,
    "still, one survey missing or raised": _missing_survey,
    "still, one survey of half": _half_survey,
    "still, changing noise": _noise,
    "creep from the start": lambda rng, n: _creep(rng, n),
    "creep from later on": _later_creep,
    "creep along the surface": _creep_along,
    "seasonal creep": _seasonal,
    "step-like": _steps,
    "fast, then stopped": _stopped,
    "repaired": _repaired,
    "failing": _failing,
    "failing, along the surface": _failing_along,
    "creep from the first interval on": _creep_since_first,
}
"""A survey that is raised as a whole is refused by the comparison, so that a zone misses it."""
_LEAST = {"failing": 5, "failing, along the surface": 5, "fast, then stopped": 6, "repaired": 6}
