"""A real QGIS without an engine: its message is clicked, the dialog sets the engine up, and the network is offered.

SLOPEWATCH_KEEP_IMAGES=FOLDER keeps the pictures.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

import pytest
from slopewatch.lab.sessions.screenshots import run_session
from slopewatch.tests.builders.engine_setup import make_whole_plugin


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    for program in ("qgis", "xvfb-run"):
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed")
    folder = tmp_path_factory.mktemp("desktop")
    plugin = make_whole_plugin(folder / "plugin", folder / "index")
    variables = {
        "SLOPEWATCH_PYTHON": "",
        "SLOPEWATCH_DATA": str(folder / "data"),
        "PIP_CONFIG_FILE": os.devnull,
        "PIP_NO_INDEX": "1",
        "PIP_FIND_LINKS": str(folder / "index"),
    }
    report = run_session(
        {"PICTURE_AT": "5"}, folder, script="setup_session.py", seconds=300, plugin=plugin, variables=variables
    )
    keep = os.environ.get("SLOPEWATCH_KEEP_IMAGES")
    if keep:
        shutil.copytree(folder / "images", keep, dirs_exist_ok=True)
    return {**report, "folder": folder}


def test_the_session_ran_without_a_fault(session: dict[str, Any]) -> None:
    assert session["errors"] == []
    # QGIS logs what its message bar shows, too, where it is shown in time
    logged = [m for m in session["messages"] if "The SlopeWatch engine is missing" not in m]
    assert [m for m in logged if "slopewatch" in m.lower() or m.startswith("Python")] == []


def test_qgis_says_that_the_engine_is_missing(session: dict[str, Any]) -> None:
    (message,) = session["message"]
    assert message.startswith("The SlopeWatch engine is missing.")
    assert session["buttons"] == ["Set up now"]


def test_one_click_sets_it_up(session: dict[str, Any]) -> None:
    assert session["words_left"] == []
    assert session["finished"]["successful"], session["log"]
    assert Path(session["finished"]["results"]["ENGINE"]).is_file()
    assert (session["folder"] / "data" / "engine.json").is_file()
    for words in ("Making an environment of Python", "Downloading tiny-one 1.0 (1 of 2)", "The engine stands"):
        assert words in session["log"]


def test_then_the_networks_packages_are_offered(session: dict[str, Any]) -> None:
    (message,) = session["second_message"]
    assert "RandLA-Net and training need PyTorch as well" in message
