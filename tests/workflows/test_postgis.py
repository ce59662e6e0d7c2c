"""A run in a PostGIS schema of a server that the test starts: rows against the run's own files, and what is refused."""

from __future__ import annotations

import importlib.util
import json
import logging
import subprocess
import sys
import traceback
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
import pytest
import shapely
from pyproj import Transformer
from slopewatch.engine.core.errors import Cancelled, InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.core.run_result import RunResult
from slopewatch.interface.parameters import HandoverParameters
from slopewatch.tests.builders.handed_over import pit
from slopewatch.tests.builders.held_tables import corridor, edited, series
from slopewatch.tests.builders.postgres import PASSWORD, Server, server
from slopewatch.workflows.exportgis import export_step


@pytest.fixture(scope="module")
def database() -> Iterator[Server]:
    with server() as made:
        yield made


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return pit(tmp_path_factory.mktemp("run"))


@pytest.fixture
def schema() -> str:
    return f"t{uuid.uuid4().hex[:8]}"


def give(run: Path, address: str, schema: str = "slopewatch", *, fields: Path | None = None, srid: int = 0,
         output: Path | None = None, progress: Progress | None = None) -> RunResult:  # fmt: skip
    parameters = HandoverParameters.build({"schema": schema, "srid": srid, "formats": "csv"})
    return export_step(run, output, parameters, address=address, fields=fields, progress=progress or Progress())


def states(database: Server, schema: str) -> list[tuple[Any, ...]]:
    return database.run(
        f"SELECT zone_id, e.state, h.state, h.reviewer, h.remarks, h.run_id FROM {schema}.events e "
        f"JOIN {schema}.event_history h ON h.event = e.id ORDER BY h.id"
    )


def test_zones_are_those_of_the_run(database: Server, run: Path, schema: str) -> None:
    done = give(run, database.address(), schema)
    zones = gpd.read_file(run / "zones.gpkg", layer="zones")
    assert done.outputs == {}
    assert done.figures["database_zones"] == len(zones) == 1
    found = database.run(
        f"SELECT zone_id, kind, area_m2, vol_net_m3, vol_err_m3, epoch_to, review_status, (fields->>'days')::int, "
        f"ST_AsBinary(shape), ST_SRID(shape), run_id FROM {schema}.zones"
    )
    record = json.loads((run / "run.json").read_text(encoding="utf-8"))
    zone = zones.iloc[0]
    (row,) = found
    assert row[:5] == (zone.zone_id, zone.kind, zone.area_m2, zone.vol_net_m3, zone.vol_err_m3)
    assert str(row[5] or "") == zone.epoch_to
    assert row[6] == "unreviewed"
    assert shapely.from_wkb(row[8]).equals(zone.geometry)
    assert row[9] == zones.crs.to_epsg()
    assert row[10] == record["run_id"]
    ((kept, command),) = database.run(f"SELECT record, command FROM {schema}.runs")
    assert kept["parameters"] == record["parameters"]
    assert command == "demchange"


@pytest.mark.parametrize("of", ["run", "corridor", "series"])
def test_twice_the_same_leaves_the_same_rows(database: Server, run: Path, schema: str, tmp_path: Path, of: str) -> None:
    folder = {"run": lambda: run, "corridor": lambda: corridor(tmp_path, 3), "series": lambda: series(tmp_path)}[of]()
    give(folder, database.address(), schema)
    before = database.content(schema)
    done = give(folder, database.address(), schema)
    assert database.content(schema) == before  # with ids, times and places in the file: nothing was even rewritten
    assert all(before.values())
    assert done.figures["database_history"] == 0


def test_what_people_entered_is_added_to_the_history(database: Server, schema: str, tmp_path: Path) -> None:
    folder = series(tmp_path)
    give(folder, database.address(), schema)
    edited(folder / "series.gpkg", "zones", 0, review_status="confirmed", reviewer="A. Sato", remarks="crack; 裂缝")
    give(folder, database.address(), schema)
    edited(folder / "series.gpkg", "zones", 0, review_status="rejected")
    give(folder, database.address(), schema)
    first = [row for row in states(database, schema) if row[0] == "S001"]
    assert [row[2:5] for row in first] == [
        ("raised", "", ""), ("acknowledged", "A. Sato", "crack; 裂缝"), ("closed", "A. Sato", "crack; 裂缝"),
    ]  # fmt: skip
    assert len([row for row in states(database, schema) if row[0] == "S002"]) == 1
    assert database.run(f"SELECT DISTINCT review_status FROM {schema}.zones WHERE zone_id = 'S001'") == [("rejected",)]


def test_a_later_run_of_a_series_goes_on_with_its_zones_and_an_earlier_one_does_not_undo_it(
    database: Server, schema: str, tmp_path: Path
) -> None:
    first = series(tmp_path / "a")
    later = series(tmp_path / "b", run_id="later0000000", started="2026-01-01T00:00:00+00:00", levels=(3, 0))
    give(first, database.address(), schema)
    ids = database.run(f"SELECT id FROM {schema}.zones ORDER BY zone_id")
    give(later, database.address(), schema)
    after = database.content(schema)
    assert database.run(f"SELECT id FROM {schema}.zones ORDER BY zone_id") == ids
    asked = f"SELECT zone_id, attention, state, run_id FROM {schema}.events ORDER BY zone_id"
    assert database.run(asked) == [("S001", 3, "raised", "later0000000"), ("S002", 0, "closed", "later0000000")]
    progress = Progress()
    done = give(first, database.address(), schema, progress=progress)
    assert database.content(schema) == after
    assert done.figures["database_newer"] == 4
    assert "are of a later run in the database" in progress.warnings[0]


def test_alerts_of_a_corridor_are_its_events(database: Server, schema: str, tmp_path: Path) -> None:
    folder = corridor(tmp_path, 3)
    give(folder, database.address(), schema)
    rows = database.run(
        f"SELECT e.zone_id, z.zone_id, e.attention, e.raised_on::text FROM {schema}.events e "
        f"JOIN {schema}.zones z ON z.id = e.zone ORDER BY 1"
    )
    alerts = gpd.read_file(folder / "corridor.gpkg", layer="alerts").sort_values("zone_id")
    expected = zip(alerts.zone_id, alerts.zone_id, alerts.attention, alerts.raised_on, strict=True)
    assert rows == list(expected)
    edited(folder / "corridor.gpkg", "alerts", 0, state="Closed", state_reason="cleared", remarks="done")
    give(folder, database.address(), schema)
    last = f"SELECT state, state_reason, remarks FROM {schema}.event_history ORDER BY id DESC LIMIT 1"
    assert database.run(last) == [("closed", "cleared", "done")]


def test_the_view_of_gdms_has_points_on_the_road(database: Server, schema: str, tmp_path: Path) -> None:
    folder = corridor(tmp_path, 3, road=True)
    give(folder, database.address(), schema)
    rows = database.run(
        f"SELECT road_section, rmms_category, side, snapped, easting, northing, start_chainage_m, edited_by_run, "
        f"description FROM {schema}.gdms_events ORDER BY description"
    )
    zones = gpd.read_file(folder / "corridor.gpkg", layer="zones")
    assert [row[0] for row in rows] == ["S1"] * 3
    assert [row[1] for row in rows] == ["2.1", "1", "1"]  # attention 2, 3, 4
    assert {row[2:4] for row in rows} == {("Left", True)}
    # the road is straight along y = 3500000
    assert [row[4] for row in rows] == pytest.approx(zones.geometry.centroid.x.tolist(), abs=1e-6)
    assert {row[5] for row in rows} == {3_500_000.0}
    assert rows[0][8].startswith("A000; uplift; ")
    (folder / "road.gpkg").unlink()
    progress = Progress()
    give(folder, database.address(), f"{schema}x", progress=progress)
    assert database.run(f"SELECT DISTINCT snapped FROM {schema}x.gdms_events") == [(False,)]
    assert "The centreline of the run is gone" in progress.warnings[0]


def test_other_reference_systems_are_transformed_to_that_of_the_schema(
    database: Server, run: Path, schema: str
) -> None:
    give(run, database.address(), schema, srid=4326)
    ((wkb, srid),) = database.run(f"SELECT ST_AsBinary(shape), ST_SRID(shape) FROM {schema}.zones")
    zone = gpd.read_file(run / "zones.gpkg", layer="zones")
    move = Transformer.from_crs(4326, zone.crs, always_xy=True)
    back = shapely.transform(shapely.from_wkb(wkb), lambda xy: np.column_stack(move.transform(*xy.T)))
    assert srid == 4326
    assert back.symmetric_difference(zone.geometry[0]).area < 1e-3 * zone.geometry[0].area
    with pytest.raises(InputError, match=r"has the reference system 4326, not 27700; leave --srid out"):
        give(run, database.address(), schema, srid=27700)
    with pytest.raises(InputError, match=r"^The database does not know the reference system 12; give another"):
        give(run, database.address(), f"{schema}x", srid=12)


def test_an_agency_reads_its_own_names(database: Server, run: Path, schema: str, tmp_path: Path) -> None:
    names = tmp_path / "names.csv"
    names.write_text('ours,theirs\nzone_id,ASSET_REF\nzones.kind,"Movement; DROP TABLE"\n', encoding="utf-8")
    give(run, database.address(), schema, fields=names)
    ours = database.run(f"SELECT zone_id, kind FROM {schema}.zones")
    assert database.run(f'SELECT "ASSET_REF", "Movement; DROP TABLE" FROM {schema}.agency_zones') == ours
    assert database.run(f'SELECT "ASSET_REF", kind FROM {schema}.agency_events') == ours
    names.write_text("ours,theirs\nzone_id,kind\n", encoding="utf-8")
    before = database.content(schema)
    with pytest.raises(InputError, match=r"gives two fields of zones the one name kind; keep one"):
        give(run, database.address(), schema, fields=names)
    assert database.content(schema) == before


def test_a_schema_may_have_any_name(database: Server, run: Path) -> None:
    give(run, database.address(), 'A "b"; DROP SCHEMA public')
    assert database.run('SELECT count(*) FROM "A ""b""; DROP SCHEMA public".zones') == [(1,)]
    assert database.run("SELECT count(*) FROM pg_namespace WHERE nspname = 'public'") == [(1,)]
    for name in ("", "pg_mine", "a\nb", "x" * 64):
        with pytest.raises(InputError, match=r"^schema is "):
            give(run, database.address(), name)


def test_the_password_is_nowhere(
    database: Server, run: Path, schema: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    said = []
    address = database.address()
    for given, output in ((address, "a"), (database.address(password=PASSWORD + "x"), "b")):
        options = ["exportgis", str(run), "--to", given, "--schema", schema, "--output", str(tmp_path / output)]
        command = [sys.executable, "-m", "slopewatch.cli", *options, "--formats", "csv", "--debug"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        said.append(done.stdout + done.stderr)
        assert done.returncode == (0 if output == "a" else 2), said[-1]
    for given in (f"{address}%zz", f"{address}?nonsense=1", address.replace("roads", "none"), address[:-12] + " "):
        with pytest.raises(InputError) as refused:
            give(run, given, schema, output=tmp_path / "c")
        said.append("".join(traceback.format_exception(refused.value)))
    record = (tmp_path / "a" / "run.json").read_text(encoding="utf-8")
    assert json.loads(record)["database"]["schema"] == schema
    files = "".join(p.read_text("utf-8", "replace") for p in tmp_path.rglob("*") if p.is_file())
    in_database = str(database.content(schema))
    secret = address.split("@")[0].rsplit(":", 1)[1]
    for text in (*said, files, in_database, caplog.text):
        assert PASSWORD not in text
        assert secret not in text
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a"]


def test_the_password_may_come_from_elsewhere(
    database: Server, run: Path, schema: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bare = database.address(password="")
    monkeypatch.setenv("PGPASSFILE", str(tmp_path / "none"))
    with pytest.raises(InputError, match=r"does not take the user's password, or was given none; put it into"):
        give(run, bare, schema)
    monkeypatch.setenv("PGPASSWORD", PASSWORD)
    assert give(run, bare, schema).figures["database_zones"] == 1
    monkeypatch.delenv("PGPASSWORD")
    secret = PASSWORD.replace("\\", "\\\\").replace(":", "\\:")
    (tmp_path / "pgpass").write_text(f"*:*:*:keeper:{secret}\n", encoding="utf-8")
    (tmp_path / "pgpass").chmod(0o600)
    monkeypatch.setenv("PGPASSFILE", str(tmp_path / "pgpass"))
    assert give(run, bare, schema).figures["database_zones"] == 1


def test_a_database_that_cannot_take_it_is_one_sentence_and_stays_as_it_is(
    database: Server, run: Path, schema: str
) -> None:
    address = database.address()
    give(run, address, schema)
    before = database.content(schema)
    database.run(
        "CREATE DATABASE bare", "CREATE DATABASE still",
        f"CREATE ROLE reader LOGIN PASSWORD '{PASSWORD}'", f"GRANT USAGE ON SCHEMA {schema} TO reader",
        f"GRANT SELECT ON ALL TABLES IN SCHEMA {schema} TO reader",
    )  # fmt: skip
    database.run("CREATE EXTENSION postgis", "ALTER DATABASE still SET default_transaction_read_only = on",
                 database="still")  # fmt: skip
    database.run(f"CREATE SCHEMA {schema}old", f"CREATE SCHEMA {schema}other",
                 f"CREATE TABLE {schema}other.zones (a int)")  # fmt: skip
    give(run, address, f"{schema}later")
    database.run(f"UPDATE {schema}later.schema_version SET version = 2")
    down = address.replace("%2Fpg", "%2Fno")
    for given, name, sentence in (
        (down, schema, "cannot be reached"),
        ("postgresql://keeper@127.0.0.1:1/roads", schema, "cannot be reached"),
        (database.address("none"), schema, "cannot be reached"),
        (database.address(password="wrong"), schema, "does not take the user's password"),
        (database.address("bare"), schema, "The database has no PostGIS; have its administrator run: CREATE EXT"),
        (database.address("still"), schema, "is read-only, so nothing was handed over"),
        (database.address(user="reader"), schema, "lacks a right"),
        (database.address(user="reader"), f"{schema}new", "lacks a right"),
        (address, f"{schema}other", "holds a table zones that is not SlopeWatch's"),
        (address, f"{schema}later", "is of version 2, and this release writes version 1"),
        ("mysql://a@b/c", schema, "--to is no address of a database"),
    ):
        with pytest.raises(InputError, match=sentence) as refused:
            give(run, given, name)
        assert "\n" not in str(refused.value)
        assert "?" not in str(refused.value)
        assert PASSWORD not in str(refused.value)
    assert database.content(schema) == before
    assert database.run(f"SELECT count(*) FROM pg_tables WHERE schemaname = '{schema}other'") == [(1,)]
    assert database.run(f"SELECT nspname FROM pg_namespace WHERE nspname = '{schema}new'") == []


class _Stopped(Progress):
    def update(self, fraction: float, message: str = "") -> None:
        super().update(fraction, message)
        if message.startswith("handing over events"):
            raise Cancelled("The run was cancelled.")


def test_a_run_that_is_cancelled_or_fails_leaves_nothing(
    database: Server, run: Path, schema: str, tmp_path: Path
) -> None:
    with pytest.raises(Cancelled):
        give(run, database.address(), schema, progress=_Stopped(), output=tmp_path / "out")
    assert database.run(f"SELECT nspname FROM pg_namespace WHERE nspname = '{schema}'") == []
    assert not (tmp_path / "out" / "run.json").exists()


def test_without_the_driver_nothing_is_begun(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    known = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda n, *a: None if n == "psycopg" else known(n, *a))
    with pytest.raises(InputError, match=r"^The package psycopg, which writes to PostgreSQL, is not installed; ins"):
        give(run, "postgresql://a@b/c")


def test_somewhere_it_must_go(run: Path) -> None:
    with pytest.raises(InputError, match=r"^Neither --output nor --to was given; say where the results are to go"):
        export_step(run, None, HandoverParameters(), progress=Progress())
