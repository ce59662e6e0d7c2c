"""Rows into the schema: new ones, those that differ, and what became of events; the same again changes nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import geopandas as gpd
import shapely
from pyproj import CRS

from ...core.errors import InputError
from ...core.progress import Progress
from .address import Database, transaction
from .agency_views import write_views
from .schema import EVENTS, RUNS, ZONES, check_name, prepared

if TYPE_CHECKING:
    import psycopg
    from psycopg import sql

_AT_ONCE_ROWS = 500
_SHAPES = ("shape", "road_point")
_HISTORY = """
INSERT INTO event_history (event, run_id, software, day, state, state_reason, reviewer, remarks)
SELECT e.id, e.run_id, r.software, e.last_on, e.state, e.state_reason, e.reviewer, e.remarks
FROM events e JOIN runs r USING (run_id)
LEFT JOIN LATERAL (SELECT * FROM event_history WHERE event = e.id ORDER BY id DESC LIMIT 1) h ON true
WHERE e.run_id = %s AND (h.id IS NULL OR (h.state, h.state_reason, h.reviewer, h.remarks)
    IS DISTINCT FROM (e.state, e.state_reason, e.reviewer, e.remarks))
ORDER BY e.id
"""
_NEWER = "SELECT count(*) FROM {} WHERE id = ANY(%s) AND started > %s"
_CALM = """
UPDATE events SET run_id = %(run_id)s, started = %(started)s, attention = 0, state = 'closed', ended_on = %(day)s,
    state_reason = %(why)s
WHERE zone = ANY(%(zones)s) AND state NOT IN ('closed', 'withdrawn') AND started <= %(started)s
"""


@dataclass(frozen=True)
class Rows:
    """What is handed over: rows by column of ``RUNS``, ``ZONES`` and ``EVENTS``, shapes in ``crs``.

    ``calm`` are ids of zones that ask for nothing now; an event that one had is closed with the sentence ``why``.
    """

    run: Mapping[str, Any]
    zones: Sequence[Mapping[str, Any]]
    events: Sequence[Mapping[str, Any]]
    crs: CRS
    calm: Sequence[Any] = ()
    why: str = ""


@dataclass(frozen=True)
class Counts:
    """Rows that were handed over, history that was added, and rows that a later run holds in the database."""

    zones: int
    events: int
    history: int
    newer: int


def hand_over(
    database: Database,
    rows: Rows,
    schema: str,
    srid: int,
    *,
    names: Mapping[str, str] | None = None,
    progress: Progress,
) -> Counts:
    """Write all rows in one transaction.

    Args:
        srid: EPSG code of a schema that is made; 0: that of the rows.
        names: an agency's names of fields, for the views; see ``write_views``.

    Raises:
        InputError: the database cannot be used; it is then as it was.
    """
    check_name(schema)
    with transaction(database) as connection:
        kept = prepared(connection, schema, srid, rows.crs.to_epsg())
        zones, events = (_placed(part, rows.crs, kept) for part in (rows.zones, rows.events))
        _put(connection, "runs", RUNS, [rows.run], kept)
        newer = sum(_newer(connection, table, part, rows) for table, part in (("zones", zones), ("events", events)))
        total = max(len(zones) + len(events), 1)
        done = 0
        for table, columns, part in (("zones", ZONES, zones), ("events", EVENTS, events)):
            for start in range(0, len(part), _AT_ONCE_ROWS):
                progress.update(done / total, f"handing over {table}")
                chunk = part[start : start + _AT_ONCE_ROWS]
                _put(connection, table, columns, chunk, kept)
                done += len(chunk)
        if rows.calm:
            day = rows.run["days"][-1] if rows.run["days"] else None
            given = {"zones": list(rows.calm), "why": rows.why, "day": day}
            connection.execute(_CALM, given | {name: rows.run[name] for name in ("run_id", "started")})
        added = connection.execute(_HISTORY, [rows.run["run_id"]]).rowcount
        if names:
            write_views(connection, names)
        progress.update(1.0)
    return Counts(len(zones), len(events), added, newer)


def _placed(rows: Sequence[Mapping[str, Any]], crs: CRS, srid: int) -> list[Mapping[str, Any]]:
    """The rows with their shapes as bytes, in the schema's reference system."""
    moved = [dict(row) for row in rows]
    for name in _SHAPES:
        shapes = gpd.GeoSeries([row[name] for row in rows], crs=crs)
        if crs.to_epsg() != srid:
            shapes = shapes.to_crs(epsg=srid)
        for row, shape in zip(moved, shapes, strict=True):
            row[name] = None if shape is None or shape.is_empty else shapely.to_wkb(shape)
            if shape is not None and not shapely.is_empty(shape) and not _is_finite(shape):
                raise InputError(
                    f"The zone {row['zone_id']} lies where the reference system {srid} has no coordinates; give "
                    "another with --srid."
                )
    return list(moved)


def _is_finite(shape: Any) -> bool:
    return all(abs(value) < float("inf") for value in shape.bounds)


def _newer(connection: psycopg.Connection, table: str, part: Sequence[Mapping[str, Any]], rows: Rows) -> int:
    from psycopg import sql

    query = sql.SQL(_NEWER).format(sql.Identifier(table))
    row = connection.execute(query, [[row["id"] for row in part], rows.run["started"]]).fetchone()
    return 0 if row is None else int(row[0])


def _put(
    connection: psycopg.Connection,
    table: str,
    columns: Mapping[str, str],
    rows: Sequence[Mapping[str, Any]],
    srid: int,
) -> None:
    """Insert rows; of those that are there, change the ones that differ and are not of a later run."""
    from psycopg.types.json import Jsonb

    values = [
        [Jsonb(row[name]) if kind.startswith("jsonb") else row[name] for name, kind in columns.items()] for row in rows
    ]
    with connection.cursor() as cursor:
        cursor.executemany(_upsert(table, columns, srid), values)


def _upsert(table: str, columns: Mapping[str, str], srid: int) -> sql.Composed:
    from psycopg import sql

    first, *others = (sql.Identifier(name) for name in columns)
    marks = [sql.SQL(f"ST_GeomFromWKB(%s::bytea, {srid})") if name in _SHAPES else sql.SQL("%s") for name in columns]
    comma = sql.SQL(", ")
    return sql.SQL(
        "INSERT INTO {table} ({names}) VALUES ({marks}) ON CONFLICT ({first}) DO UPDATE SET ({others}) = ({given}) "
        "WHERE {table}.started <= excluded.started AND ({old}) IS DISTINCT FROM ({given})"
    ).format(
        table=sql.Identifier(table),
        names=comma.join([first, *others]),
        marks=comma.join(marks),
        first=first,
        others=comma.join(others),
        given=comma.join(sql.SQL("excluded.{}").format(name) for name in others),
        old=comma.join(sql.SQL("{}.{}").format(sql.Identifier(table), name) for name in others),
    )
