"""A real QGIS on a display in memory: the toolbox is opened, Inspect slope run from its dialog, layers are on the map.

SLOPEWATCH_KEEP_IMAGES=FOLDER keeps the pictures of the session; lab/sessions/screenshots.py makes those of the docs.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

import pytest
from slopewatch.lab.sessions.screenshots import run_session
from slopewatch.plugin.shipped_model import TITLES as MODELS
from slopewatch.processing_algorithms import ALGORITHMS
from slopewatch.tests.builders.limits import CANCELLED_S
from slopewatch.tests.builders.qgis import QgisProcess, engine_python, processes_with


@pytest.fixture(scope="module")
def session(qgis_process: QgisProcess, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    engine_python()
    for program in ("qgis", "xvfb-run"):
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed")
    folder = tmp_path_factory.mktemp("desktop")
    survey = qgis_process.run(
        "simulatesurvey", OUTPUT_FOLDER=folder / "survey", POINTS=120000, LENGTH=30, HEIGHT=12, VEGETATION=0.4
    )
    parameters = {name: survey[name] for name in ("REFERENCE", "CLOUD", "ROI")}
    parameters |= {"CELL": 0.2, "SCREENING_METHOD": "residual", "OUTPUT_FOLDER": folder / "results"}
    report = run_session(parameters, folder, seconds=480)
    keep = os.environ.get("SLOPEWATCH_KEEP_IMAGES")
    if keep:
        shutil.copytree(folder / "images", keep, dirs_exist_ok=True)
    return {**report, "folder": folder}


def test_the_session_ran_without_a_fault(session: dict[str, Any]) -> None:
    assert session["errors"] == []
    assert [m for m in session["messages"] if "slopewatch" in m.lower() or m.startswith("Python")] == []
    assert session["loaded"]
    assert session["menu"] == ["SlopeWatch"]


def test_the_toolbox_shows_the_algorithms(session: dict[str, Any]) -> None:
    assert "/SlopeWatch/Inspection/Inspect slope" in session["toolbox"]
    assert len([entry for entry in session["toolbox"] if entry.count("/") == 3]) == len(ALGORITHMS) + len(MODELS)


def test_cancel_ends_the_engine_and_leaves_nothing(session: dict[str, Any]) -> None:
    cancelled = session["cancelled"]
    assert not cancelled["successful"]
    assert cancelled["seconds"] < CANCELLED_S
    assert "no output was written" in cancelled["log"]
    assert not cancelled["left"]
    assert processes_with(f"{session['folder']}/results-cancelled") == []


def test_the_run_from_the_dialog_succeeded(session: dict[str, Any]) -> None:
    assert session["finished"]["successful"], session["log"]
    assert int(session["finished"]["results"]["ZONE_COUNT"]) > 0
    assert (session["folder"] / "results" / "run.json").is_file()


MOTION_LAYERS = {"Displacement vectors", "Zones of coherent motion", "Smallest motion that can be told (m)"}


def test_the_styled_layers_are_on_the_map(session: dict[str, Any]) -> None:
    loaded = {layer["name"].partition(" (arrows")[0]: layer for layer in session["layers"]}
    # motion along the surface is there only where a vector is significant, by chance on this slope
    assert set(loaded) & MOTION_LAYERS in (MOTION_LAYERS, {"Smallest motion that can be told (m)"})
    layers = {name: layer for name, layer in loaded.items() if name not in MOTION_LAYERS}
    assert list(layers) == [
        "Objects above the ground", "Hazard zones", "Screened zones", "Footprints of the volumes", "Unsure change",
        "Not seen", "Significant change (m)", "Seen and not seen", "Elevation change (m)", "Top view",
        "Ground heights, later survey (m)", "Ground heights, earlier survey (m)",
    ]  # fmt: skip
    assert {name: layer["renderer"] for name, layer in layers.items()} == {
        "Objects above the ground": "categorizedSymbol",
        "Hazard zones": "categorizedSymbol",
        "Screened zones": "categorizedSymbol",
        "Footprints of the volumes": "categorizedSymbol",
        "Unsure change": "categorizedSymbol",
        "Not seen": "singleSymbol",
        "Significant change (m)": "singlebandpseudocolor",
        "Seen and not seen": "paletted",
        "Elevation change (m)": "singlebandpseudocolor",
        "Top view": "multibandcolor",
        "Ground heights, later survey (m)": "hillshade",
        "Ground heights, earlier survey (m)": "hillshade",
    }
    shown = {name for name, layer in layers.items() if layer["visible"]}
    # what is within its error is not coloured
    assert shown == {
        "Objects above the ground", "Hazard zones", "Not seen", "Significant change (m)", "Top view",
    }  # fmt: skip
    for layer in layers.values():
        assert layer["valid"]
        assert layer["group"] == "SlopeWatch 2024-05-01 to 2025-05-01"
        assert Path(layer["source"].partition("|")[0]).parent == session["folder"] / "results"
        assert layer["crs"] == session["crs"] != ""


def test_the_settings_page_checks_the_engine(session: dict[str, Any]) -> None:
    assert session["settings"]
    assert "The engine is ready." in session["check"]
    assert "pdal" in session["check"]


def test_the_pictures_show_something(session: dict[str, Any]) -> None:
    from qgis.PyQt.QtGui import QImage

    names = {Path(p).stem for p in session["pictures"]}
    assert {"desktop", "dialog", "toolbox", "map", "zones", "settings"} <= names
    image = QImage(str(session["folder"] / "images" / "map.png"))
    step = max(1, image.width() // 200)
    pixels = [image.pixelColor(x, y) for x in range(0, image.width(), step) for y in range(0, image.height(), step)]
    # lowering is drawn red and raising blue
    assert sum(p.red() > p.blue() + 60 for p in pixels) > 20
    assert sum(p.blue() > p.red() + 40 for p in pixels) > 20
