"""When a cloud was flown by its own witnesses, and whether the days that were given agree.

The GPS times of the points come first, then a date in the file's name, then the day on which the file was created,
which can only be too late. Seconds of a week give no day, as many files that declare them hold something else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date, timedelta
from pathlib import Path

import numpy as np
from laspy import DecompressionSelection
from numpy.typing import NDArray

from ...interface.dates import date_in_name
from ..core.errors import InputError
from ..core.messages import shown
from ..core.progress import Progress
from ..pointcloud.header import CloudHeader, preflight
from ..pointcloud.records import read_records, record_dtype
from .epoch import Epoch

_GPS_ORIGIN = date(1980, 1, 6)
_ADJUSTMENT_S = 1e9
"""s that adjusted standard GPS time leaves out."""
_MIN_GPS_TIME_S = 3e6
"""s: what is smaller is more often a counter or seconds of a week under a wrong flag than a flight of autumn 2011."""
_FIRST_YEAR = 1990
_MIN_SOUND_SHARE = 0.9
_MIN_DAY_SHARE = 0.01
"""Days with fewer of the times are taken for strays."""
_STRETCHES = 12
_MAX_DIFFERENCE = timedelta(days=3)
_MAX_TIME_ZONE_SHIFT = timedelta(days=1)
"""How far a time zone can shift a day."""


@dataclass(frozen=True)
class Evidence:
    """What a file itself states: ``flown`` from and to (by GPS times), ``named`` and ``created``; None: nothing."""

    flown: tuple[date, date] | None = None
    named: date | None = None
    created: date | None = None

    @property
    def days(self) -> tuple[date, date] | None:
        """First and last day by the strongest witness that names one."""
        if self.flown is not None:
            return self.flown
        return None if self.named is None else (self.named, self.named)

    def words(self) -> str:
        """What follows the file's name in a sentence."""
        if self.flown is not None:
            first, last = self.flown
            return f"its GPS times are of {first}{'' if first == last else f' to {last}'}"
        if self.named is not None:
            return f"its name says {self.named}"
        return f"its header says that it was created on {self.created}"

    def contradicts(self, day: date) -> bool:
        """Whether the strongest evidence contradicts ``day``, by more than a time zone or some days of flying."""
        if self.days is not None:
            return not self.days[0] - _MAX_DIFFERENCE <= day <= self.days[1] + _MAX_DIFFERENCE
        return self.created is not None and day > self.created + _MAX_TIME_ZONE_SHIFT


def evidence(path: Path) -> Evidence:
    """Ask a cloud file when it was flown; some stretches of its points are read.

    Raises:
        InputError: see ``preflight``; damaged points.
    """
    header = preflight(path)
    return Evidence(_flown(header), date_in_name(path), _created(header))


def check_days(epochs: Sequence[Epoch], *, trusted: bool, progress: Progress) -> None:
    """Compare the days of surveys, the earliest first, with what their files state; warn of those that differ.

    Args:
        trusted: also only warn of surveys whose order contradicts their files.

    Raises:
        InputError: a survey is, by its file, later than one that is given after it.
    """
    found = [evidence(epoch.path) for epoch in epochs]
    inverted = _inverted(epochs, found)
    if inverted is not None:
        first, second = inverted
        sentence = (
            f"The files say that the surveys are in reversed order: {_claim(epochs[first], 'earlier')} but "
            f"{found[first].words()}, {_claim(epochs[second], 'later')} but {found[second].words()}"
        )
        if not trusted:
            raise InputError(
                f"{sentence}; swap the two or correct their days, or give --trust-dates if they are right as given."
            )
        progress.warning(f"{sentence}; the days are taken as given, and signs are wrong if they are not right.")
    for number, (epoch, dated) in enumerate(zip(epochs, found, strict=True)):
        if inverted is not None and number in inverted:
            continue
        if epoch.date is not None and dated.contradicts(epoch.date):
            progress.warning(
                f"{shown(epoch.path)} is given as flown on {epoch.date}, but {dated.words()}; check the day, on which "
                "rates depend, and whether it is the right file."
            )


def _claim(epoch: Epoch, place: str) -> str:
    return f"{shown(epoch.path)} is given as {epoch.date or f'the {place} one'}"


def _inverted(epochs: Sequence[Epoch], found: Sequence[Evidence]) -> tuple[int, int] | None:
    """Numbers of two surveys of which the first is later by their files."""
    latest: tuple[int, date, bool] | None = None
    for number, dated in enumerate(found):
        if dated.days is None:
            continue
        start, end = dated.days
        timed = dated.flown is not None
        if latest is not None and latest[1] > end + (timedelta() if latest[2] == timed else _MAX_TIME_ZONE_SHIFT):
            return latest[0], number
        if latest is None or start > latest[1]:
            latest = number, start, timed
    for second in range(1, len(found)):
        for first in range(second):
            if _created_in_reverse(epochs[first], epochs[second], found[first], found[second]):
                return first, second
    return None


def _created_in_reverse(earlier: Epoch, later: Epoch, first: Evidence, second: Evidence) -> bool:
    """Whether files that state only when they were created fit their days only if these are swapped."""
    if first.days or second.days or not (first.created and second.created and earlier.date and later.date):
        return False
    return earlier.date <= second.created < later.date - _MAX_TIME_ZONE_SHIFT and first.created >= later.date


def _flown(header: CloudHeader) -> tuple[date, date] | None:
    """First and last day of the points' GPS times, where the file declares that they are adjusted standard times."""
    fields = record_dtype(header.point_format).names or ()
    if not header.standard_time or "gps_time" not in fields:
        return None
    wanted = DecompressionSelection.XY_RETURNS_CHANNEL | DecompressionSelection.GPS_TIME
    times = [r["gps_time"] for r in read_records(header, selection=wanted, stretches=_STRETCHES)]
    return days_of(np.concatenate(times))


def days_of(times: NDArray[np.float64]) -> tuple[date, date] | None:
    """First and last day of adjusted standard GPS times (n,), s; None where they are no such times."""
    last = (date.today() - _GPS_ORIGIN).days + 1
    first = (date(_FIRST_YEAR, 1, 1) - _GPS_ORIGIN).days
    with np.errstate(invalid="ignore", over="ignore"):
        day = np.floor((times + _ADJUSTMENT_S) / 86400.0)
        sound = np.isfinite(times) & (np.abs(times) > _MIN_GPS_TIME_S) & (day >= first) & (day <= last)
    if not len(times) or sound.mean() < _MIN_SOUND_SHARE:
        return None
    days, count = np.unique(day[sound].astype(np.int64), return_counts=True)
    days = days[count >= _MIN_DAY_SHARE * count.sum()]
    if not len(days):
        return None
    return _GPS_ORIGIN + timedelta(days=int(days[0])), _GPS_ORIGIN + timedelta(days=int(days[-1]))


def _created(header: CloudHeader) -> date | None:
    day, year = header.created
    if not (_FIRST_YEAR <= year <= date.today().year and 1 < day <= 366):  # 1 January is what some programs put
        return None
    return date(year, 1, 1) + timedelta(days=day - 1)
