"""Dates in the names of files, as the dialogs and the engine read them."""

from __future__ import annotations

import re
from datetime import date
from pathlib import Path

_DATE = re.compile(r"(?<!\d)(\d{4})[-_.]?(\d{2})[-_.]?(\d{2})(?!\d)")
_YEAR_LAST = re.compile(r"(?<!\d)(\d{2})[-_.](\d{2})[-_.](\d{4})(?!\d)")
_YEARS = range(1990, 2100)
"""Numbers of tiles look like dates of other years."""


def date_in_name(path: Path) -> date | None:
    """The date that a file's name holds, if exactly one: 2024-05-01, 20240501 or, where a month cannot be meant,
    25-05-2024.
    """
    found = {_date(*parts) for parts in _DATE.findall(path.stem)}
    for first, second, year in _YEAR_LAST.findall(_DATE.sub("#", path.stem)):
        orders = {_date(year, second, first), _date(year, first, second)} - {None}
        if len(orders) == 1:  # 01-05-2024 may be of May or of January
            found |= orders
    found.discard(None)
    return found.pop() if len(found) == 1 else None


def _date(year: str, month: str, day: str) -> date | None:
    try:
        return date(int(year), int(month), int(day)) if int(year) in _YEARS else None
    except ValueError:
        return None
