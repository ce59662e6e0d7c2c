"""Set up engine through the real qgis_process, with an index of two tiny wheels, in an empty data folder."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
from pathlib import Path

import pytest
from slopewatch.tests.builders.engine_setup import make_wheel, make_whole_plugin
from slopewatch.tests.builders.qgis import QgisProcess, processes_with, wait_until


@pytest.fixture(scope="module")
def fresh(tmp_path_factory: pytest.TempPathFactory) -> QgisProcess:
    """A QGIS whose plugin has no engine, and whose pip knows only the index."""
    folder = tmp_path_factory.mktemp("fresh")
    process = QgisProcess(folder / "qgis", make_whole_plugin(folder / "the plugin", folder / "index"))
    for name in ("SLOPEWATCH_PYTHON", "PIP_INDEX_URL", "PIP_EXTRA_INDEX_URL"):
        process.environment.pop(name, None)
    process.environment.update(
        SLOPEWATCH_DATA=str(folder / "its data"),
        PIP_CONFIG_FILE=os.devnull,
        PIP_NO_INDEX="1",
        PIP_FIND_LINKS=str(folder / "index"),
    )
    return process


def refused(done: subprocess.CompletedProcess[str]) -> str:
    assert done.returncode == 1
    return done.stderr


def test_from_the_missing_engine_to_one_that_is_used(fresh: QgisProcess) -> None:
    data = Path(fresh.environment["SLOPEWATCH_DATA"])
    said = refused(fresh.attempt("checkenvironment"))
    assert "The SlopeWatch engine is missing; set it up with the algorithm Set up engine" in said
    # a Python that is none
    said = refused(fresh.attempt("setupengine", PYTHON=shutil.which("false")))
    assert "false does not start); install Python 3.12 from https://www.python.org/downloads/" in said
    # without an index
    said = refused(fresh("--json", "run", "slopewatch:setupengine", PIP_FIND_LINKS=""))
    assert "Downloading tiny-one 1.0 failed: there is no ready build" in said
    assert set(os.listdir(data)) <= {"downloads", "set-up.lock", "set-up.log"}
    results = fresh.run("setupengine")
    assert results["FOLDER"] == str(data)
    assert results["ENGINE"].startswith(results["FOLDER"])
    assert not results["SCREENING_READY"]
    assert Path(results["ENGINE"]).is_file()
    checked = fresh.run("checkenvironment")
    assert checked["ENGINE"] == results["ENGINE"]
    manifest = Path(fresh.environment["QGIS_PLUGINPATH"]) / "slopewatch" / "metadata.txt"
    assert f"\nversion={checked['VERSION']}\n" in manifest.read_text(encoding="utf-8")
    # a second time it stands, and is repaired only where that is asked for
    assert fresh.run("setupengine")["ENGINE"] == results["ENGINE"]
    assert fresh.run("setupengine", REPAIR="true")["ENGINE"] != results["ENGINE"]


def test_killed_with_qgis_it_is_done_again(fresh: QgisProcess, tmp_path: Path) -> None:
    fresh.environment["SLOPEWATCH_DATA"] = str(tmp_path / "killed")
    process = fresh.start("setupengine")
    try:
        wait_until(lambda: list(tmp_path.glob("killed/environment-*")))
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
    wait_until(lambda: not processes_with(str(tmp_path / "killed")))
    results = fresh.run("setupengine")
    assert len(list(tmp_path.glob("killed/environment-*"))) == 1
    state = json.loads((tmp_path / "killed" / "engine.json").read_text())
    assert results["ENGINE"].startswith(str(tmp_path / "killed" / state["environment"]))


def test_a_folder_of_wheels_needs_no_index(fresh: QgisProcess, tmp_path: Path) -> None:
    for name in ("tiny_one", "tiny_two"):
        make_wheel(tmp_path / "wheels", name, "1.0")
    fresh.environment["SLOPEWATCH_DATA"] = str(tmp_path / "offline")
    done = fresh("run", "slopewatch:setupengine", f"--WHEELS={tmp_path / 'wheels'}", PIP_FIND_LINKS="")
    assert done.returncode == 0, done.stderr
    assert "The engine stands: Python 3" in done.stdout
