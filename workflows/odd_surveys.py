"""Surveys that do not fit into their series: left out or named, each in one sentence, so that the rest stays right."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import date
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from ..engine.change.result import Change
from ..engine.change.season import Season
from ..engine.core.checksums import sha256
from ..engine.core.errors import InputError
from ..engine.core.messages import shown
from ..engine.core.progress import Progress
from ..engine.epochs.epoch import Epoch
from ..engine.pointcloud.header import preflight
from ..engine.pointcloud.reading import open_cloud, sample_cloud
from ..engine.series.visits import MIN_VELOCITY_DAYS
from ..engine.vector.area import read_roi
from ..interface.parameters import InputParameters

_MIN_OVERLAP_SHARE = 0.1  # of the smaller one of two surveys
_LONG_GAP_DAYS = 365
_MIN_GAP_RATIO = 3.0  # times the median interval: a gap stands out from the surveys' own rhythm
_SPARSE_SHARE = 0.25  # of the median density of the other surveys
_MIN_SEASON_DAYS = 75  # from the middle of the other surveys' season
_MIN_SEASONS_DAYS = 300  # from the first to the last of the other surveys: one season of several years
_YEAR_DAYS = 365.25


def one_a_day(epochs: Sequence[Epoch], earlier: dict[str, Any] | None, progress: Progress) -> tuple[Epoch, ...]:
    """The surveys with one for each day; a warning names every other one.

    The survey that an earlier run used stays, so that no earlier figure changes; else the one with most points: a
    flight is repeated because the one before was incomplete.

    Args:
        epochs: in the order of their days.
        earlier: record of the series that this one goes on with.

    Raises:
        InputError: all are of one day, or a cloud cannot be read.
    """
    used = {i["sha256"] for i in (earlier or {}).get("inputs", ()) if i["role"].startswith("epoch ") and "sha256" in i}
    kept = []
    for day, of_day in groupby(epochs, key=lambda epoch: epoch.date):
        same = list(of_day)
        if len(same) > 1:
            best = max(same, key=lambda epoch: (sha256(epoch.path) in used, preflight(epoch.path).count))
            for other in same:
                if other is not best:
                    progress.warning(
                        f"{shown(other.path)} is left out: {shown(best.path)} is of the same day, {day}; merge the two "
                        "if each shows a part of the slope."
                    )
            same = [best]
        kept += same
    if len(kept) < 2 <= len(epochs):
        raise InputError(f"All surveys have the same date, {epochs[0].name}; a series takes at least two dates.")
    return tuple(kept)


def overlapping(
    epochs: Sequence[Epoch],
    inputs: InputParameters,
    roi: Path | None,
    offset: float,
    progress: Progress,
    *,
    earlier: dict[str, Any] | None = None,
) -> tuple[Epoch, ...]:
    """The surveys that overlap the reference survey, which is the first of them; a warning names every other one.

    The reference is that of the earlier run, else the survey that overlaps most others, the earliest of these. The
    hulls of samples are compared.

    Args:
        roi: vector file with the slope; a survey outside of it does not overlap.
        offset: metres between surveys before their registration.
        earlier: record of the series that this one goes on with.

    Raises:
        InputError: no two of them overlap, or a file cannot be read.
    """
    area = None if roi is None else read_roi(roi, open_cloud(epochs[0].path, inputs)[1].crs).geometry
    progress.update(0.0, "checking the overlap of the surveys")
    hulls = [_hull(epoch.path, inputs) for epoch in epochs]
    shares = np.array([[_overlap(a, b, area, offset) for b in hulls] for a in hulls])
    found = shares >= _MIN_OVERLAP_SHARE
    names, before = [f"epoch {epoch.name}" for epoch in epochs], [i["role"] for i in (earlier or {}).get("inputs", ())]
    known = next((names.index(role) for role in before if role in names), None)
    reference = int(np.argmax(found.sum(axis=1))) if known is None else known
    kept = [e for e, overlaps in zip(epochs, found[reference], strict=True) if overlaps]
    if len(kept) < 2:
        _refuse(epochs, hulls, found)
        return tuple(epochs)
    for epoch, share in zip(epochs, shares[reference], strict=True):
        if epoch not in kept:
            progress.warning(
                f"{shown(epoch.path)} is left out: it shares {100 * share:.0f} % of its extent with the survey of "
                f"{epochs[reference].name}; check that it is of this slope and in the same system."
            )
    return tuple(kept)


def _hull(path: Path, inputs: InputParameters) -> BaseGeometry:
    xy = sample_cloud(path, inputs)[:, :2]
    return shapely.convex_hull(shapely.multipoints(xy))


def _overlap(first: BaseGeometry, second: BaseGeometry, area: BaseGeometry | None, offset: float) -> float:
    """Common share of the smaller one of two hulls; 0 if the common part is outside of ``area``."""
    common = first.intersection(second.buffer(offset))
    if common.is_empty or (area is not None and not common.buffer(offset).intersects(area)):
        return 0.0
    smaller = min(first.area, second.area)
    return min(1.0, common.area / smaller) if smaller else 1.0


def _refuse(epochs: Sequence[Epoch], hulls: Sequence[BaseGeometry], found: NDArray[np.bool_]) -> None:
    """Refuse surveys of which no two overlap; a region without points is refused where the ground is read."""
    apart = next((n for n in range(1, len(epochs)) if not found[0, n] and hulls[0].disjoint(hulls[n])), None)
    if apart is None:
        return
    a, b = hulls[0].bounds, hulls[apart].bounds
    raise InputError(
        f"The surveys of {epochs[0].name} and {epochs[apart].name} do not overlap: {shown(epochs[0].path)} spans "
        f"{_extent(a)}, {shown(epochs[apart].path)} {_extent(b)}; check that both are of the same slope and in the "
        "same system."
    )


def _extent(bounds: tuple[float, float, float, float]) -> str:
    return f"x {bounds[0]:.1f} to {bounds[2]:.1f}, y {bounds[1]:.1f} to {bounds[3]:.1f}"


def say_days(dates: Sequence[date], progress: Progress) -> None:
    """Name surveys a few days apart, which give no velocity, and gaps of years."""
    days = [(day - dates[0]).days for day in dates]
    steps = np.diff(days)
    close = [f"{a} and {b}" for (a, b), step in zip(pairwise(dates), steps, strict=True) if step < MIN_VELOCITY_DAYS]
    if days[-1] < MIN_VELOCITY_DAYS:
        progress.warning(f"All surveys lie within {MIN_VELOCITY_DAYS} days: no velocity of a zone is given.")
    elif close:
        progress.warning(
            f"The surveys of {', '.join(close)} are less than {MIN_VELOCITY_DAYS} days apart: they count as one for "
            "velocities and alerts."
        )
    usual = _MIN_GAP_RATIO * float(np.median(steps))
    for (before, after), step in zip(pairwise(dates), steps, strict=True):
        if step >= max(_LONG_GAP_DAYS, usual):
            progress.warning(
                f"No survey was flown for {step / _YEAR_DAYS:.1f} years, from {before} to {after}: motion in that time "
                "is known as a mean only."
            )


@dataclass(frozen=True)
class Compared:
    """A survey against the first: ratio of their point densities, median side of the cells (m), and the season."""

    density_ratio: float
    cell: float
    season: Season | None


def comparisons_of(changes: Iterable[Change]) -> list[Compared]:
    """What ``say_odd_comparisons`` needs of each change against the first survey."""
    found = []
    for change in changes:
        before, after = (float(points[change.valid].sum()) for points in change.points)
        sizes = change.partition.sizes[change.valid]
        side = float(np.median(sizes)) if sizes.size else change.grid.cell
        found.append(Compared(after / before if before else 1.0, side, change.season))
    return found


def say_odd_comparisons(dates: Sequence[date], found: Sequence[Compared], progress: Progress) -> None:
    """Name surveys with few points, and those of another season."""
    ratios = np.array([1.0, *(one.density_ratio for one in found)])
    for number, ratio in enumerate(ratios):
        usual = float(np.median(np.delete(ratios, number)))
        if len(dates) < 3 or ratio >= _SPARSE_SHARE * usual:
            continue
        cells = [one.cell for other, one in enumerate(found, 1) if number in (0, other)]
        progress.warning(
            f"The survey of {dates[number]} has {100 * ratio / usual:.0f} % of the point density of the others: "
            f"its comparisons have cells of {max(cells):.2g} m, and small zones are missed there."
        )
    if any(one.season is not None for one in found):
        _say_seasons(dates, [one.season for one in found], progress)
    elif (odd := _alone_in_season(dates)) is not None:
        progress.warning(
            f"Only the survey of {dates[odd]} is of another season, and the vegetation is not known: it may explain "
            "the change of this survey."
        )


def _say_seasons(dates: Sequence[date], seasons: Sequence[Season | None], progress: Progress) -> None:
    odd = [(day, season) for day, season in zip(dates[1:], seasons, strict=True) if season and season.differs]
    if len(odd) == len(seasons) > 1:
        season = odd[0][1]
        progress.warning(
            f"The first survey, {dates[0]}, is of another season than all others (vegetation of "
            f"{season.height_from:.2f} m against {season.height_to:.2f} m): no change counts that vegetation can "
            "explain; leave it out if you can."
        )
        return
    for day, season in odd:
        progress.warning(
            f"The survey of {day} is of another season than the first one (vegetation of {season.height_to:.2f} m "
            f"against {season.height_from:.2f} m): it does not count where vegetation can explain its change."
        )


def _alone_in_season(dates: Sequence[date]) -> int | None:
    """Number of the survey that is of another season than all others, which are of one season of several years."""
    angles = np.array([2.0 * np.pi * day.timetuple().tm_yday / _YEAR_DAYS for day in dates])
    for number in range(len(dates)):
        others = [day for n, day in enumerate(dates) if n != number]
        middle = np.angle(np.exp(1j * np.delete(angles, number)).mean())
        away = np.abs(np.angle(np.exp(1j * (angles - middle)))) * _YEAR_DAYS / (2.0 * np.pi)
        alike = bool(np.all(np.delete(away, number) <= _MIN_SEASON_DAYS / 2))
        if alike and away[number] > _MIN_SEASON_DAYS and (others[-1] - others[0]).days >= _MIN_SEASONS_DAYS:
            return number
    return None
