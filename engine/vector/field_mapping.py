"""An agency's own names of fields, from a file: ours on one side, theirs on the other."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...interface.input_files import FIELD_NAMES
from ..core.errors import InputError
from ..core.input_files import read_input
from ..core.json_shapes import parse_json
from ..core.messages import quoted, shown

ANY = ""
"""The table of names that hold for all tables."""
_RESERVED = ("fid", "geom", "geometry", "ogc_fid")
_MAX_NAME_CHARACTERS = 63
"""Of a field's name: as many as PostgreSQL keeps."""


@dataclass(frozen=True)
class FieldMapping:
    """``names`` is by table, then by our name; ``ANY`` holds for the tables that do not name the field themselves."""

    names: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    path: Path | None = None

    def theirs(self, ours: str, table: str = ANY) -> str:
        """Their name of a field of ours; ours where there is none."""
        return self.given(ours, table) or ours

    def given(self, ours: str, table: str = ANY) -> str | None:
        """Their name as the file has it; None where it does not name the field."""
        return self.names.get(table, {}).get(ours) or self.names.get(ANY, {}).get(ours)

    @property
    def flat(self) -> dict[str, str]:
        """Their name by our name, or by ``table.name`` where it holds for one table."""
        return {f"{t}.{ours}" if t else ours: name for t, own in self.names.items() for ours, name in own.items()}

    def renamed(self, ours: Iterable[str], table: str = ANY) -> dict[str, str]:
        """Their name of each field.

        Raises:
            InputError: two fields would have one name.
        """
        found = {name: self.theirs(name, table) for name in ours}
        taken: dict[str, str] = {}
        for name, other in found.items():
            if other.lower() in taken:
                raise InputError(
                    f"The field names {shown(self.path or '')} give {taken[other.lower()]} and {name} the one name "
                    f"{other}; give each a name of its own."
                )
            taken[other.lower()] = name
        return found


def read_field_mapping(path: Path | None) -> FieldMapping:
    """The names of a file; none without one.

    JSON: an object of our names and theirs, ``{"route": "ROAD_NO"}``; an object in the place of a name holds those of
    one table, ``{"zones": {"route": "ROAD_NO"}}``, as ``{"zones.route": "ROAD_NO"}`` does. CSV: the columns ``ours``
    and ``theirs``, and ``table`` where names differ by table. UTF-8.

    Raises:
        InputError: missing, neither of both, or with a name that no field can have.
    """
    if path is None:
        return FieldMapping()
    name = shown(path)
    try:
        data = read_input(path, FIELD_NAMES)
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"The field names {name} are no text in UTF-8; save them so.") from error
    rows = _of_json(data, name) if path.suffix.lower() == ".json" else _of_csv(text, name)
    names: dict[str, dict[str, str]] = {}
    for table, ours, theirs in rows:
        if not isinstance(theirs, str) or not theirs.strip() or not ours.strip():
            raise InputError(f"The field names {name} have {quoted(theirs)} for {quoted(ours)}; give a name.")
        if theirs.strip().lower() in _RESERVED:
            raise InputError(
                f"The field names {name} call {ours} {theirs}, which layers keep for themselves; rename it."
            )
        if len(theirs.strip()) > _MAX_NAME_CHARACTERS or not theirs.strip().isprintable() or '"' in theirs:
            raise InputError(
                f"The field names {name} have {quoted(theirs)}, which is no field's name; give one of at most "
                f"{_MAX_NAME_CHARACTERS} characters without quotes."
            )
        if "." in ours and not table.strip():
            table, ours = ours.split(".", 1)
        own = names.setdefault(table.strip(), {})
        if own.get(ours.strip(), theirs.strip()) != theirs.strip():
            raise InputError(
                f"The field names {name} give {ours} two names, {own[ours.strip()]} and {theirs}; keep one."
            )
        own[ours.strip()] = theirs.strip()
    if not names:
        raise InputError(f"The field names {name} hold no name; give our name and theirs, such as route and ROAD_NO.")
    return FieldMapping(names, path)


def _of_json(data: bytes, name: str) -> list[tuple[str, str, Any]]:
    try:
        document = parse_json(data)
    except ValueError as error:
        raise InputError(f"The field names {name} are no JSON ({error}); correct it.") from error
    if not isinstance(document, dict):
        raise InputError(f'The field names {name} are no object of names; write {{"route": "ROAD_NO"}}.')
    rows: list[tuple[str, str, Any]] = []
    for ours, theirs in document.items():
        if isinstance(theirs, dict):
            rows += [(ours, inner, value) for inner, value in theirs.items()]
        else:
            rows.append((ANY, ours, theirs))
    return rows


def _of_csv(text: str, name: str) -> list[tuple[str, str, Any]]:
    try:
        reader = csv.DictReader(io.StringIO(text), strict=True)
        columns = {str(c).strip().lower(): c for c in reader.fieldnames or ()}
        if not {"ours", "theirs"} <= columns.keys():
            raise InputError(
                f"The field names {name} have no columns ours and theirs; give them (and table where names differ by "
                "table), or a JSON object."
            )
        table = columns.get("table")
        return [
            ((row.get(table) or "") if table else ANY, row[columns["ours"]] or "", row[columns["theirs"]])
            for row in reader
            if any(row.values())
        ]
    except csv.Error as error:
        raise InputError(f"The field names {name} are no CSV that can be read ({error}); save them again.") from error
