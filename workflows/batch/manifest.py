"""The manifest of a corridor: a table, a layer of polygons or a folder, into slopes and what is wrong with its rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import date
from functools import partial
from pathlib import Path
from typing import TypeVar

from ...engine.core.errors import InputError
from ...engine.core.messages import quoted, shown
from ...engine.epochs.epoch import parse_date
from .jobs import Corridor, Problem, Slope, Survey
from .manifest_rows import rows_of
from .manifest_table import Row, Table
from .settings import read_option, specifications

FILES = ("roi", "stable", "alerts", "centreline", "classes", "corrections")
_KNOWN = ("slope", "date", "file", "profile", *FILES)
_LONGEST_NAME = 100
T = TypeVar("T")


def read_manifest(source: Path, regions: Path) -> Corridor:
    """The slopes of a manifest.

    What is wrong with a row is a problem of its slope, which is then left out, and no other.

    Args:
        source: CSV with the columns slope, date, file and roi, a layer of polygons with slope, date and file, or a
            folder that holds a folder of dated clouds for each slope. Relative paths start at its folder.
        regions: folder that the polygons of a layer are written to, one file a slope.

    Raises:
        InputError: it cannot be read at all, holds no row, or lacks a column.
    """
    table = rows_of(source)
    options = [name for name in table.columns if name in specifications()]
    unknown = sorted(set(table.columns) - {*_KNOWN, *options})
    notes = [f"The columns {', '.join(unknown)} of the manifest are no settings and are left out."] if unknown else []
    problems: list[Problem] = []
    gathered: dict[str, list[Row]] = {}
    wrong_slopes = set()
    for row in table.rows:
        name = row.values.get("slope", "")
        gathered.setdefault(name, []).append(row)
        wrong = row.problem or _wrong_name(name)
        if wrong:
            problems.append(Problem(_printable(name), f"{row.place}: {wrong}"))
            wrong_slopes.add(name)
    slopes: list[Slope] = []
    taken: dict[str, str] = {}
    for name, rows in gathered.items():
        twin = taken.setdefault(name.casefold(), name)
        if name in wrong_slopes:
            continue
        try:
            if twin != name:
                raise InputError(f"{rows[0].place}: the slope differs from {twin} in capitals only; rename one.")
            slopes.append(_slope(name, rows, options, Places(table, regions), notes))
        except InputError as error:
            problems.append(Problem(name, str(error)))
    return Corridor(tuple(slopes), tuple(problems), tuple(notes))


@dataclass(frozen=True)
class Places:
    """``table``: what the rows are of; ``regions``: where polygons of a layer are written to."""

    table: Table
    regions: Path

    @property
    def folder(self) -> Path:
        """Where relative paths start."""
        return self.table.folder


def _wrong_name(name: str) -> str:
    if not name:
        return "the slope is not named; give it a name."
    if len(name) > _LONGEST_NAME:
        return f"the name of the slope has {len(name)} letters; give it at most {_LONGEST_NAME}."
    if not name.isprintable():
        return f"the slope {_printable(name)!r} has characters in its name that cannot be shown; rename it."
    return ""


def _printable(name: str) -> str:
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in name)


def _slope(name: str, rows: Sequence[Row], options: Sequence[str], places: Places, notes: list[str]) -> Slope:
    """One slope of its rows.

    Raises:
        InputError: a day or a file that is none, one day with two files, or values that differ between the rows.
    """
    surveys: dict[date, tuple[Path, Row]] = {}
    for row in rows:
        day, cloud = _survey(row, places.folder)
        other, first = surveys.setdefault(day, (cloud, row))
        if other != cloud:
            raise InputError(f"{row.place}: {first.place} has another file of {day.isoformat()}; remove one of them.")
        if first is not row:
            notes.append(f"{row.place} says the same as {first.place} and is left out.")
    for row in rows:
        for option in options:
            if row.values.get(option, ""):
                _on_row(row, partial(read_option, option, row.values[option]))
    given = {option: _common(rows, option) for option in options}
    files: dict[str, Path | None] = {role: _file(rows, role, places.folder) for role in FILES}
    if files["roi"] is None and places.table.write_region is not None:
        files["roi"] = places.table.write_region(places.regions, name, rows)
    return Slope(
        name,
        tuple(Survey(day, surveys[day][0]) for day in sorted(surveys)),
        **files,
        options={option: read_option(option, text) for option, text in given.items() if text},
        profile=_common(rows, "profile"),
    )


def _survey(row: Row, folder: Path) -> tuple[date, Path]:
    if not row.values.get("date", ""):
        raise InputError(f"{row.place}: the date is missing; give it as YYYY-MM-DD.")
    day = _on_row(row, partial(parse_date, row.values["date"]))
    if not row.values.get("file", "") and row.path is None:
        raise InputError(f"{row.place}: the file is missing; give the survey's LAS or LAZ file.")
    cloud = row.path or _resolved(folder, row.values["file"])
    if not _is_file(cloud):
        raise InputError(f"{row.place}: {shown(cloud)} does not exist or is no file; correct the path.")
    return day, cloud


def _on_row(row: Row, work: Callable[[], T]) -> T:
    try:
        return work()
    except InputError as error:
        raise InputError(f"{row.place}: {error}") from None


def _common(rows: Sequence[Row], column: str) -> str:
    """What the rows of a slope say in a column, where empty ones say nothing."""
    said = {row.values[column]: row for row in rows if row.values.get(column, "")}
    if len(said) > 1:
        first, other = list(said)[:2]
        raise InputError(
            f"{said[other].place}: {column} is {quoted(other)}, and {quoted(first)} on {said[first].place}; give a "
            "slope one."
        )
    return next(iter(said), "")


def _file(rows: Sequence[Row], role: str, folder: Path) -> Path | None:
    text = _common(rows, role)
    if not text:
        return None
    path = _resolved(folder, text)
    if not _is_file(path) and not path.is_dir():  # a file geodatabase is a folder
        raise InputError(f"{rows[0].place}: {role} names {shown(path)}, which does not exist; correct the path.")
    return path


def _resolved(folder: Path, text: str) -> Path:
    if "\0" in text:
        raise InputError(f"{quoted(text)} is no path; correct it.")
    return (folder / text).absolute()


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name that is too long
        return False
