"""The tables of a schema, and whether one that is there is ours."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ...core.errors import InputError
from ...core.messages import shown

if TYPE_CHECKING:
    import psycopg

VERSION = 1
TABLES = ("runs", "zones", "events", "event_history")
_MAX_NAME_BYTES = 63
"""Of an identifier in PostgreSQL."""

RUNS = {
    "run_id": "text PRIMARY KEY", "command": "text NOT NULL", "slope": "text NOT NULL", "days": "date[] NOT NULL",
    "software": "text NOT NULL", "started": "timestamptz NOT NULL", "record": "jsonb NOT NULL",
}  # fmt: skip
_ON_ROAD = {
    "route": "text", "carriageway": "text", "chain_from": "double precision", "chain_to": "double precision",
    "side": "text", "offset_m": "double precision", "location": "text",
}  # fmt: skip
_FOLLOWED = {"run_id": "text NOT NULL REFERENCES runs", "started": "timestamptz NOT NULL"}
ZONES = {
    "id": "uuid PRIMARY KEY", **_FOLLOWED, "layer": "text NOT NULL", "zone_id": "text NOT NULL",
    "slope": "text NOT NULL", "source": "text NOT NULL", "made_by": "text", "kind": "text", "severity": "text",
    "attention": "integer NOT NULL", "status": "text", "epoch_from": "date", "epoch_to": "date",
    **dict.fromkeys(
        ("area_m2", "vol_loss_m3", "vol_gain_m3", "vol_net_m3", "vol_err_m3", "dz_mean_m", "dz_p95_m", "lod95_m",
         "motion_m", "motion_err_m", "rate_mm_day", "rate_err"), "double precision"),
    **_ON_ROAD, "review_status": "text", "reviewer": "text", "review_date": "date", "remarks": "text",
    "fields": "jsonb NOT NULL", "shape": "geometry(MultiPolygon, {srid})", "road_point": "geometry(Point, {srid})",
}  # fmt: skip
EVENTS = {
    "id": "uuid PRIMARY KEY", **_FOLLOWED, "zone": "uuid REFERENCES zones", "slope": "text NOT NULL",
    "zone_id": "text NOT NULL", "source": "text NOT NULL", "kind": "text", "attention": "integer NOT NULL",
    "reason": "text", "raised_on": "date", "last_on": "date", "ended_on": "date", "state": "text NOT NULL",
    "state_reason": "text", "reviewer": "text", "remarks": "text", **_ON_ROAD,
    "shape": "geometry(MultiPolygon, {srid})", "road_point": "geometry(Point, {srid})",
}  # fmt: skip
HISTORY = {
    "id": "bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY", "event": "uuid NOT NULL REFERENCES events",
    "run_id": "text NOT NULL REFERENCES runs", "software": "text NOT NULL", "day": "date", "state": "text NOT NULL",
    "state_reason": "text", "reviewer": "text", "remarks": "text", "entered": "timestamptz NOT NULL DEFAULT now()",
}  # fmt: skip
SAFETY_CRITICAL, SEVERE = 3, 2
"""Attention from which an event is proposed as safety critical: inspect within days; and as the worse of the others."""
_MORE = (
    "CREATE INDEX ON zones USING gist (shape)", "CREATE INDEX ON events USING gist (shape)",
    "CREATE INDEX ON event_history (event, id)",
    f"""CREATE VIEW gdms_events AS
    SELECT e.id AS event_id, coalesce(e.road_point, ST_PointOnSurface(e.shape))::geometry(Point, {{srid}}) AS location,
        ST_X(coalesce(e.road_point, ST_PointOnSurface(e.shape))) AS easting,
        ST_Y(coalesce(e.road_point, ST_PointOnSurface(e.shape))) AS northing,
        e.road_point IS NOT NULL AS snapped, e.route AS road_section, e.carriageway, e.chain_from AS start_chainage_m,
        e.chain_to AS end_chainage_m, initcap(e.side) AS side, e.offset_m, e.location AS location_description,
        CASE WHEN e.attention >= {SAFETY_CRITICAL} THEN '1' WHEN e.attention >= {SEVERE} THEN '2.1' ELSE '2.2' END
            AS rmms_category,
        concat_ws('; ', e.slope, nullif(e.kind, ''), nullif(e.reason, ''), nullif(e.remarks, '')) AS description,
        e.raised_on AS date_raised, e.last_on AS date_last_seen, e.ended_on AS date_ended, e.state AS status,
        h.day AS status_survey, h.reviewer AS edited_by, h.entered AS edited, h.run_id AS edited_by_run,
        h.software AS edited_with
    FROM events e
    LEFT JOIN LATERAL (SELECT * FROM event_history WHERE event = e.id ORDER BY id DESC LIMIT 1) h ON true
    WHERE e.attention > 0""",
)  # fmt: skip


def check_name(name: str) -> str:
    """The name of a schema.

    Raises:
        InputError: none can have it.
    """
    odd = not name.strip() or not name.isprintable() or len(name.encode()) > _MAX_NAME_BYTES
    if odd or name.startswith("pg_") or name == "information_schema":
        raise InputError(
            f"schema is {shown(name)}, which no schema can be called; give a name of at most {_MAX_NAME_BYTES} "
            "letters that does not begin with pg_."
        )
    return name


def prepared(connection: psycopg.Connection, name: str, srid: int, own_srid: int | None) -> int:
    """Make the schema where it is not there, and make it the one that statements mean; its SRID.

    Args:
        srid: wished for; 0: that of the schema, else ``own_srid``, that of the results.

    Raises:
        InputError: no PostGIS, or the schema is of another version, SRID or owner.
    """
    from psycopg import sql

    found = connection.execute(
        "SELECT nspname FROM pg_extension JOIN pg_namespace n ON n.oid = extnamespace WHERE extname = 'postgis'"
    ).fetchone()
    if found is None:
        raise InputError(
            "The database has no PostGIS; have its administrator run: CREATE EXTENSION postgis, or give another one."
        )
    # two hand-overs at once take turns
    connection.execute("SELECT pg_advisory_xact_lock(hashtextextended('slopewatch ' || %s, 0))", [name])
    schema = sql.Identifier(name)
    there = _tables(connection, name)
    if not there:
        srid = _known_srid(connection, srid or own_srid, found[0])
        if connection.execute("SELECT 1 FROM pg_namespace WHERE nspname = %s", [name]).fetchone() is None:
            connection.execute(sql.SQL("CREATE SCHEMA {}").format(schema))
    connection.execute(sql.SQL("SET LOCAL search_path TO {}, {}").format(schema, sql.Identifier(found[0])))
    if not there:
        _make(connection, srid)
        return srid
    return _checked(connection, name, there, srid)


def _tables(connection: psycopg.Connection, name: str) -> set[str]:
    """Those of ours, or of our names, that the schema holds."""
    rows = connection.execute(
        "SELECT relname FROM pg_class c JOIN pg_namespace n ON n.oid = relnamespace "
        "WHERE nspname = %s AND relname = ANY(%s)",
        [name, [*TABLES, "schema_version", "gdms_events"]],
    )
    return {row[0] for row in rows}


def _known_srid(connection: psycopg.Connection, srid: int | None, place: str) -> int:
    from psycopg import sql

    if srid is None:
        raise InputError("The reference system of the results has no EPSG code; give one with --srid.")
    query = sql.SQL("SELECT 1 FROM {}.spatial_ref_sys WHERE srid = %s").format(sql.Identifier(place))
    if connection.execute(query, [srid]).fetchone() is None:
        raise InputError(f"The database does not know the reference system {srid}; give another with --srid.")
    return srid


def _make(connection: psycopg.Connection, srid: int) -> None:
    from psycopg import sql

    tables: Mapping[str, Mapping[str, Any]] = dict(zip(TABLES, (RUNS, ZONES, EVENTS, HISTORY), strict=True))
    connection.execute("CREATE TABLE schema_version (version integer NOT NULL, srid integer NOT NULL)")
    connection.execute("INSERT INTO schema_version VALUES (%s, %s)", [VERSION, srid])
    for name, columns in tables.items():
        body = sql.SQL(", ").join(
            sql.SQL("{} {}").format(sql.Identifier(column), sql.SQL(kind.replace("{srid}", str(srid))))
            for column, kind in columns.items()
        )
        connection.execute(sql.SQL("CREATE TABLE {} ({})").format(sql.Identifier(name), body))
    for statement in _MORE:
        connection.execute(sql.SQL(statement.replace("{srid}", str(srid))))


def _checked(connection: psycopg.Connection, name: str, there: set[str], srid: int) -> int:
    if not {*TABLES, "schema_version"} <= there:
        raise InputError(
            f"The schema {shown(name)} holds a table {sorted(there)[0]} that is not SlopeWatch's, or lacks some of "
            "its tables; give another with --schema."
        )
    row = connection.execute("SELECT version, srid FROM schema_version").fetchone()
    version, kept = row if row is not None else (None, 0)
    if version != VERSION:
        raise InputError(
            f"The schema {shown(name)} is of version {version}, and this release writes version {VERSION}; give "
            "another with --schema, or use the release that made it."
        )
    if srid and srid != kept:
        raise InputError(
            f"The schema {shown(name)} has the reference system {kept}, not {srid}; leave --srid out, or give "
            "another --schema."
        )
    return int(kept)
