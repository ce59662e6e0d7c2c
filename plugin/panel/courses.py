"""The course of a zone through the surveys of a series, from the run's own table."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from datetime import date
from pathlib import Path

TABLE = "series.csv"


@dataclass(frozen=True)
class Survey:
    """Mean change since the first survey with its standard error and level of detection, metres; NaN if unknown."""

    day: date
    change: float
    error: float
    level: float


@dataclass(frozen=True)
class Course:
    """The surveys of a zone in the order of their days; ``begin`` is the day of the first one, without any change."""

    zone: str
    begin: date
    surveys: tuple[Survey, ...]


def course_of(folder: Path, zone: str) -> Course | None:
    """The course of a zone; None where the run has no series or the zone is not in it.

    Raises:
        ValueError: the table is not that of a series.
        OSError: it cannot be read.
    """
    path = folder / TABLE
    if not path.is_file():
        return None
    with path.open(encoding="utf-8", newline="") as file:
        try:
            rows = [row for row in csv.DictReader(file) if row["zone_id"] == zone]
            surveys = tuple(
                Survey(
                    date.fromisoformat(row["epoch"]), *(_number(row[n]) for n in ("dz_mean_m", "dz_err_m", "lod95_m"))
                )
                for row in sorted(rows, key=lambda row: row["epoch"])
            )
            since = [int(float(row["days"])) for row in rows]
        except KeyError as error:
            raise ValueError(f"{path} has no column {error}; run the series again.") from None
    if not surveys:
        return None
    return Course(zone, date.fromordinal(surveys[0].day.toordinal() - min(since)), surveys)


def _number(text: str) -> float:
    return float(text) if text else math.nan
