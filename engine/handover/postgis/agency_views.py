"""Views of zones and events under an agency's own names of fields."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from ...core.errors import InputError
from .schema import EVENTS, ZONES

if TYPE_CHECKING:
    import psycopg

VIEWS = {"zones": ("agency_zones", ZONES), "events": ("agency_events", EVENTS)}


def write_views(connection: psycopg.Connection, names: Mapping[str, str]) -> None:
    """Make ``agency_zones`` and ``agency_events`` with all columns, those in ``names`` under theirs.

    A view that has these columns already is left as it is.

    Args:
        names: their name by our name, or by ``table.name`` where it holds for one table.

    Raises:
        InputError: two columns would have one name.
    """
    from psycopg import sql

    for table, (view, columns) in VIEWS.items():
        wanted = {name: names.get(f"{table}.{name}", names.get(name, name)) for name in columns}
        if len(set(wanted.values())) < len(wanted):
            twice = next(name for name in wanted.values() if list(wanted.values()).count(name) > 1)
            raise InputError(f"The mapping file gives two fields of {table} the one name {twice}; keep one.")
        query = (
            "SELECT attname FROM pg_attribute WHERE attrelid = to_regclass(%s) AND attnum > 0 AND NOT attisdropped "
            "ORDER BY attnum"
        )
        if [row[0] for row in connection.execute(query, [view])] == list(wanted.values()):
            continue
        parts = sql.SQL(", ").join(
            sql.SQL("{} AS {}").format(sql.Identifier(ours), sql.Identifier(theirs)) for ours, theirs in wanted.items()
        )
        connection.execute(sql.SQL("DROP VIEW IF EXISTS {}").format(sql.Identifier(view)))
        made = sql.SQL("CREATE VIEW {} AS SELECT {} FROM {}")
        connection.execute(made.format(sql.Identifier(view), parts, sql.Identifier(table)))
