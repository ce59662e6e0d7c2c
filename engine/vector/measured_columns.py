"""Measured figures of a GeoPackage that nobody changes by mistake: triggers that refuse it, whatever program tries."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Collection

from .review_fields import LOCATION, ON_ROAD, REVIEW_FIELDS

_NAME = "slopewatch_{}_measured"


def guard_table(database: sqlite3.Connection, table: str, free: Collection[str]) -> None:
    """Have SQLite refuse changes of the columns of ``table`` other than ``free``, and rows that come or go.

    Programs write whole rows back, GDAL among them, so an update is refused only where a value differs. Rows are what
    was measured: one that is deleted would come back unreviewed with the next run, where one marked as rejected stays
    so. Dropping the table, copies of it, and columns that people add are not hindered.
    """
    columns = [row[1] for row in database.execute(f"PRAGMA table_info({_quoted(table)})")]
    measured = [_quoted(name) for name in columns if name not in free]
    changed = " OR ".join(f"OLD.{name} IS NOT NEW.{name}" for name in measured)
    refusal = f"The table {table} was measured and cannot be edited"
    entered = [name for name in REVIEW_FIELDS if name in free and name in columns]
    if entered:
        refusal = f"Measured columns of {table} cannot be edited; enter your review in {', '.join(entered)}"
    kept = "mark a zone as rejected instead of deleting it" if entered else "make the run again to replace them"
    name = _NAME.format(table)
    for ending, event, condition, sentence in (
        ("", f"UPDATE OF {', '.join(measured)}", f"WHEN {changed} ", refusal),
        ("_delete", "DELETE", "", f"Rows of {table} cannot be deleted; {kept}"),
        ("_insert", "INSERT", "", f"Rows of {table} are measured and cannot be added; use a layer of your own"),
    ):
        database.execute(
            f"CREATE TRIGGER {_quoted(name + ending)} BEFORE {event} ON {_quoted(table)} FOR EACH ROW {condition}"
            f"BEGIN SELECT RAISE(ABORT, '{sentence.replace(chr(39), chr(39) * 2)}'); END"
        )
    placed = [_quoted(name) for name in ON_ROAD if name in entered and LOCATION in columns]
    if placed:
        changed = " OR ".join(f"OLD.{name} IS NOT NEW.{name}" for name in placed)
        database.execute(
            f"CREATE TRIGGER {_quoted(f'{name}_place')} BEFORE UPDATE OF {', '.join(placed)} ON {_quoted(table)} FOR "
            f"EACH ROW WHEN OLD.{LOCATION} <> '' AND ({changed}) BEGIN SELECT RAISE(ABORT, 'Route, chainage and side "
            "come from the centreline; correct that and make the run again'); END"
        )


def guarded_columns(database: sqlite3.Connection, table: str) -> frozenset[str]:
    """The columns that ``guard_table`` guards in a table; none where it was not called."""
    found = database.execute(
        "SELECT sql FROM sqlite_master WHERE type = 'trigger' AND name = ?", (_NAME.format(table),)
    ).fetchone()
    if found is None:
        return frozenset()
    listed = found[0].partition("UPDATE OF ")[2].partition(" ON ")[0]
    return frozenset(name.replace('""', '"') for name in re.findall(r'"((?:[^"]|"")*)"', listed))


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'
