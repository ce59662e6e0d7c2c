"""A PostgreSQL server with PostGIS of the tests' own: in a folder, on a socket there, without a port."""

from __future__ import annotations

import contextlib
import os
import pwd
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest

PASSWORD = "se cr@t/%41"  # not of this world, and with what an address must quote
_NEVER_ROOT = ("postgres", "nobody")


@dataclass(frozen=True)
class Server:
    """``folder`` holds the socket; its superuser is ``keeper``."""

    folder: Path

    def address(self, database: str = "roads", user: str = "keeper", password: str = PASSWORD) -> str:
        secret = f":{quote(password, safe='')}" if password else ""
        return f"postgresql://{user}{secret}@{quote(str(self.folder), safe='')}/{database}"

    def run(self, *statements: str, database: str = "roads") -> list[tuple[Any, ...]]:
        """Run statements; the rows of the last."""
        import psycopg

        with psycopg.connect(self.address(database), autocommit=True) as connection:
            for statement in statements:
                cursor = connection.execute(statement)
            return cursor.fetchall() if cursor.description else []

    def content(self, schema: str = "slopewatch") -> dict[str, list[str]]:
        """All rows of the schema's tables, with ids, times of entry and their places in the file."""
        tables = ("schema_version", "runs", "zones", "events", "event_history")
        return {
            t: [r[0] for r in self.run(f"SELECT (t.ctid, t.xmin, t.*)::text FROM {schema}.{t} t ORDER BY 1")]
            for t in tables
        }


def _programs() -> Path:
    """The folder of initdb and postgres, of the newest version; a skip where there is none, or no PostGIS."""
    found = [p.parent for p in Path("/usr/lib/postgresql").glob("*/bin/initdb")]
    on_path = shutil.which("initdb")
    found = sorted(found, key=lambda p: int(p.parent.name)) or ([Path(on_path).parent] if on_path else [])
    for folder in reversed(found):
        shared = subprocess.run([folder / "pg_config", "--sharedir"], capture_output=True, text=True, check=False)
        places = [Path(shared.stdout.strip() or "/nowhere"), Path(f"/usr/share/postgresql/{folder.parent.name}")]
        if any((p / "extension" / "postgis.control").is_file() for p in places):
            return folder
    pytest.skip("no PostgreSQL with PostGIS here; Debian: postgresql-15-postgis-3, or that of its version")


@contextlib.contextmanager
def server() -> Iterator[Server]:
    """A server, for as long as the block lasts."""
    pytest.importorskip("psycopg", reason="psycopg is not installed; install slopewatch[postgis]")
    programs = _programs()
    as_user: dict[str, Any] = {}
    # short: a socket's path has at most 107 characters
    with tempfile.TemporaryDirectory(prefix="pg", ignore_cleanup_errors=True) as place:
        folder = Path(place)
        secret = folder / "secret"
        secret.write_text(PASSWORD, encoding="utf-8")
        if os.geteuid() == 0:
            names = {user.pw_name: user for user in pwd.getpwall()}
            user = next((names[name] for name in _NEVER_ROOT if name in names), None)
            if user is None:
                pytest.skip("PostgreSQL does not run as root, and there is no user postgres or nobody")
            as_user = {"user": user.pw_uid, "group": user.pw_gid, "extra_groups": []}
            for path in (folder, secret):
                os.chown(path, user.pw_uid, user.pw_gid)
        data = folder / "data"
        subprocess.run(
            [programs / "initdb", "-D", data, "-U", "keeper", "-A", "scram-sha-256", "--pwfile", secret, "-E", "UTF8",
             "--locale=C", "--no-sync"],
            check=True, capture_output=True, cwd=folder, **as_user,
        )  # fmt: skip
        control = [programs / "pg_ctl", "-D", data, "-w", "-t", "60"]
        settings = f"-c listen_addresses='' -c unix_socket_directories='{folder}' -c fsync=off -c shared_buffers=16MB"
        subprocess.run(
            [*control, "-l", folder / "log", "-o", settings, "start"],
            check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=folder, **as_user,
        )  # fmt: skip
        try:
            made = Server(folder)
            made.run("CREATE DATABASE roads", database="postgres")
            made.run("CREATE EXTENSION postgis")
            yield made
        finally:
            subprocess.run(
                [*control, "-m", "immediate", "stop"], check=True, capture_output=True, cwd=folder, **as_user
            )
