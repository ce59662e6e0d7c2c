"""Other names of fields, as an agency agreed on them: a small JSON or CSV file, our name to theirs."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from ..core.errors import InputError
from ..core.json_shapes import parse_json
from ..core.messages import shown

_MAX_FILE_B = 1_000_000
_MAX_NAME_CHARACTERS = 63
"""Of a field's name: as many as PostgreSQL keeps."""
_TAKEN = ("fid", "geom", "geometry")
"""Names that a GeoPackage's own columns have."""


def read_field_mapping(path: Path) -> dict[str, str]:
    """Our name of each field to theirs.

    Args:
        path: a JSON object of names, or a CSV file of two columns, ``our`` and ``theirs``. A name may say of which
            layer the field is, as in ``zones.kind``.

    Raises:
        InputError: it cannot be read, is neither, or a name is empty, too long, given twice or taken.
    """
    try:
        data = path.read_bytes() if path.stat().st_size <= _MAX_FILE_B else b""
        text = data.decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{shown(path)} cannot be read ({error.strerror}); check the path.") from error
    except ValueError as error:
        raise InputError(f"{shown(path)} is no text in UTF-8; save it as such.") from error
    pairs = _of_json(data, path) if text.lstrip().startswith("{") else _of_csv(text, path)
    return _checked(pairs, path)


def _of_json(data: bytes, path: Path) -> list[tuple[str, str]]:
    try:
        document = parse_json(data)
    except ValueError as error:
        raise InputError(f"{shown(path)} is no JSON object of names ({error}); correct it.") from error
    if not all(isinstance(value, str) for value in document.values()):
        raise InputError(f"{shown(path)} has a name that is no text; write each as a text in quotes.")
    return list(document.items())


def _of_csv(text: str, path: Path) -> list[tuple[str, str]]:
    try:
        rows = [row for row in csv.reader(io.StringIO(text), strict=True) if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise InputError(f"{shown(path)} is no CSV file ({error}); correct it.") from error
    if not rows or [cell.strip().lower() for cell in rows[0]] != ["our", "theirs"]:
        raise InputError(f"{shown(path)} does not begin with the columns our,theirs; add that line.")
    short = next((number for number, row in enumerate(rows, 1) if len(row) != 2), None)
    if short is not None:
        raise InputError(f"{shown(path)} has a row of other than two columns (row {short}); correct it.")
    return [(ours, theirs) for ours, theirs in rows[1:]]


def _checked(pairs: list[tuple[str, str]], path: Path) -> dict[str, str]:
    found: dict[str, str] = {}
    for ours, theirs in ((ours.strip(), theirs.strip()) for ours, theirs in pairs):
        if not ours or not theirs:
            raise InputError(f"{shown(path)} has an empty name next to {shown(ours or theirs)}; fill it in.")
        if ours in found:
            raise InputError(f"{shown(path)} names the field {shown(ours)} twice; keep one of them.")
        if len(theirs) > _MAX_NAME_CHARACTERS or not theirs.isprintable() or '"' in theirs:
            raise InputError(
                f"{shown(path)} has the name {shown(theirs)}, which is no field's name; give one of at most "
                f"{_MAX_NAME_CHARACTERS} characters without quotes."
            )
        if theirs.lower() in _TAKEN:
            raise InputError(f"{shown(path)} has the name {theirs}, which tables keep for themselves; choose another.")
        found[ours] = theirs
    if not found:
        raise InputError(f"{shown(path)} names no field; give our name and theirs of each.")
    return found
