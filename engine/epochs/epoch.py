"""An epoch: a cloud and the date it was flown."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from ...interface.dates import date_in_name
from ..core.checksums import sha256
from ..core.errors import InputError
from ..core.messages import shown

YEARS = range(1900, 2200)
_WRITTEN = re.compile(r"([0-9]{4})-([0-9]{2})-([0-9]{2})")
_SHOWN = 40  # characters of what is no date


@dataclass(frozen=True)
class Epoch:
    """``date`` is None where it is not known; then no rates are known."""

    path: Path
    date: date | None

    @property
    def name(self) -> str:
        return self.date.isoformat() if self.date else self.path.stem


def parse_date(text: str) -> date:
    """A date of a survey, written as YYYY-MM-DD.

    Raises:
        InputError: it is not one, or of a year that no survey by UAV can be of: days are counted on from it.
    """
    # other writings that Python knows depend on its version, and its digits are not only 0 to 9
    written = _WRITTEN.fullmatch(text)
    try:
        day = date(*(int(part) for part in written.groups())) if written else None
    except ValueError:
        day = None
    if day is None:
        raise InputError(f"{shown(text[:_SHOWN])} is not a date; write it as YYYY-MM-DD.")
    if day.year not in YEARS:
        raise InputError(f"{shown(text)} is no day of a survey; give a year from {YEARS[0]} to {YEARS[-1]}.")
    return day


def parse_epoch(text: str) -> Epoch:
    """An epoch written as YYYY-MM-DD=CLOUD, or as CLOUD, whose name then holds the date.

    Raises:
        InputError: it is not written so, or the name holds no date, or more than one.
    """
    day, separator, path = text.partition("=")
    if separator and path and not Path(text).is_file():  # a name may hold the sign, too
        return Epoch(Path(path), parse_date(day))
    if not text or (separator and not path) or _WRITTEN.fullmatch(text):
        raise InputError(f"--epoch {shown(text)} is not understood; write it as YYYY-MM-DD=CLOUD.")
    named = date_in_name(Path(text))
    if named is None:
        raise InputError(f"The name of {shown(text)} holds no date, or more than one; write it as YYYY-MM-DD=CLOUD.")
    return Epoch(Path(text), named)


def same_content(first: Path, second: Path) -> bool:
    """Whether two files hold the same bytes."""
    return first.stat().st_size == second.stat().st_size and sha256(first) == sha256(second)


def check_pair(first: Epoch, second: Epoch) -> None:
    """Refuse a pair that cannot be compared.

    Raises:
        InputError: equal or reversed dates, or the same file twice (by content).
    """
    if first.date and second.date and first.date >= second.date:
        what = "have the same date" if first.date == second.date else "are in reversed order"
        raise InputError(
            f"The epochs {first.name} and {second.name} {what}; give the earlier one first, each with its own date."
        )
    for epoch in (first, second):
        if not epoch.path.is_file():
            raise InputError(f"{epoch.path} does not exist or is not a file; check the path.")
    if same_content(first.path, second.path):
        raise InputError(f"{first.path} and {second.path} are the same cloud; give two different epochs.")
