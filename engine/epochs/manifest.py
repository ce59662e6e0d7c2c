"""The surveys of a series: from a folder of dated clouds, a manifest, or one by one; and what must hold for them."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from datetime import date
from itertools import pairwise
from pathlib import Path

from ...interface.dates import date_in_name
from ...interface.input_files import TABLE
from ..core.checksums import sha256
from ..core.errors import InputError
from ..core.input_files import read_input
from ..core.messages import shown
from .epoch import Epoch, parse_date

CLOUD_ENDINGS = (".las", ".laz")
COLUMNS = ("date", "path")
_NO_TEXT = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f\ufffe\uffff]")
"""Characters that no text holds, and that XML, such as QGIS's styles, cannot hold."""
_SHOWN = 300  # characters of a name
_MAX_CELLS = 2_000_000


def epochs_of(source: Path) -> tuple[Epoch, ...]:
    """The surveys that a folder or a manifest holds, the earliest first.

    Raises:
        InputError: it does not exist, or see ``epochs_in_folder`` and ``read_manifest``.
    """
    if source.is_dir():
        return epochs_in_folder(source)
    if source.suffix.lower() in CLOUD_ENDINGS:
        raise InputError(f"{shown(source)} is one cloud; give the folder of all surveys, or a manifest.")
    if not source.is_file():
        raise InputError(f"{shown(source)} does not exist; give a folder of dated clouds or a manifest (CSV).")
    return read_manifest(source)


def epochs_in_folder(folder: Path) -> tuple[Epoch, ...]:
    """One survey a cloud in ``folder`` (not in its subfolders), dated by its name, the earliest first.

    Raises:
        InputError: no cloud, or one whose name does not hold exactly one date.
    """
    clouds = sorted(p for p in folder.iterdir() if p.is_file() and p.suffix.lower() in CLOUD_ENDINGS)
    if not clouds:
        raise InputError(f"The folder {shown(folder)} holds no LAS or LAZ file; give the folder of the surveys.")
    epochs = []
    for path in clouds:
        day = date_in_name(path)
        if day is None:
            raise InputError(
                f"The name of {shown(path)} does not hold exactly one date; rename it, such as 2024-05-01.laz, move "
                "it out of the folder, or give a manifest."
            )
        epochs.append(Epoch(path, day))
    return tuple(sorted(epochs, key=_day))


def read_manifest(path: Path) -> tuple[Epoch, ...]:
    """The surveys of a CSV file with the columns ``date`` (YYYY-MM-DD) and ``path``; others are ignored.

    A path that is not absolute starts at the manifest's folder. Separators may be semicolons.

    Raises:
        InputError: not a text in UTF-8, a column missing, a line without a date or a path, or a cloud that is missing.
    """
    name = shown(path)
    rows = read_table(path, "manifest")
    if not rows:
        raise InputError(f"The manifest {name} is empty; give a line date,path and one line for each survey.")
    head = [cell.strip().lower() for cell in rows[0][1]]
    missing = [column for column in COLUMNS if column not in head]
    if missing:
        raise InputError(
            f"The manifest {name} has no column {missing[0]} in its first line; name its columns date,path."
        )
    epochs = []
    for number, cells in rows[1:]:
        values = dict(zip(head, (c.strip() for c in cells), strict=False))
        day, file = values.get("date", ""), values.get("path", "")
        if not day or not file:
            raise InputError(f"Line {number} of the manifest {name} lacks its {'path' if day else 'date'}; add it.")
        try:
            when = parse_date(day)
        except InputError as error:
            raise InputError(f"Line {number} of the manifest {name}: {error}") from None
        cloud = path.parent / file
        if not _is_file(cloud):
            raise InputError(
                f"Line {number} of the manifest {name} names {shown(cloud.as_posix()[:_SHOWN])}, which does not exist; "
                "correct the path."
            )
        epochs.append(Epoch(cloud, when))
    return tuple(epochs)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name that no file can have
        return False


def read_table(path: Path, what: str) -> list[tuple[int, list[str]]]:
    """Lines of a CSV file that are not empty, with their numbers; ``what`` names it in messages.

    Raises:
        InputError: it cannot be read as text in UTF-8.
    """
    try:
        text = read_input(path, TABLE).decode("utf-8-sig")
        if _NO_TEXT.search(text):
            raise ValueError
    except ValueError as error:
        raise InputError(f"The {what} {shown(path)} is no text in UTF-8; save it as CSV in UTF-8.") from error
    if sum(map(text.count, ",;\n\r")) > _MAX_CELLS:
        raise InputError(
            f"The {what} {shown(path)} has more than {_MAX_CELLS:,} cells; check that it is the right one."
        )
    first = text.partition("\n")[0]
    reader = csv.reader(io.StringIO(text), delimiter=";" if first.count(";") > first.count(",") else ",")
    try:
        return [(reader.line_num, cells) for cells in reader if any(cell.strip() for cell in cells)]
    except csv.Error as error:
        raise InputError(
            f"Line {reader.line_num} of the {what} {shown(path)} is broken ({error}); correct it."
        ) from error


def check_series(epochs: Sequence[Epoch]) -> None:
    """Refuse surveys that make no series.

    Raises:
        InputError: fewer than two, a file that is missing, one without a date, dates not in order, or a cloud that is
            given twice (by content).
    """
    if len(epochs) < 2:
        raise InputError(
            f"{'One survey was' if epochs else 'No survey was'} given; a series takes at least two. For one survey "
            "alone there is slopewatch screen."
        )
    for epoch in epochs:
        if not epoch.path.is_file():
            raise InputError(f"{shown(epoch.path)} does not exist or is not a file; check the path.")
        if epoch.date is None:
            raise InputError(f"{shown(epoch.path)} has no date; give one.")
    for before, after in pairwise(epochs):
        if _day(before) > _day(after):
            raise InputError(
                f"The surveys of {before.name} and {after.name} are in reversed order; give the earliest first."
            )
    sizes: dict[int, list[Path]] = {}
    for epoch in epochs:
        sizes.setdefault(epoch.path.stat().st_size, []).append(epoch.path)
    seen: dict[str, Path] = {}
    for paths in sizes.values():
        for path in paths if len(paths) > 1 else ():
            other = seen.setdefault(sha256(path), path)
            if other is not path:
                raise InputError(f"{shown(other)} and {shown(path)} are the same cloud; give each survey's own cloud.")


def _day(epoch: Epoch) -> date:
    return epoch.date or date.min
