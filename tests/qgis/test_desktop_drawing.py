"""A real QGIS on a display in memory: Top view is run from its dialog, its layers are looked at on the map.

SLOPEWATCH_KEEP_IMAGES=FOLDER keeps the pictures of the session.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

import pytest
from qgis.PyQt.QtGui import QColor, QImage
from slopewatch.lab.sessions.screenshots import run_session
from slopewatch.tests.builders.qgis import engine_python


@pytest.fixture(scope="module")
def session(survey: dict[str, Any], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    engine_python()
    for program in ("qgis", "xvfb-run"):
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed")
    folder = tmp_path_factory.mktemp("desktop")
    parameters = {"INPUT": survey["CLOUD"], "OUTPUT_FOLDER": folder / "view"}
    report = run_session(parameters, folder, script="drawing_session.py", seconds=480)
    keep = os.environ.get("SLOPEWATCH_KEEP_IMAGES")
    if keep:
        shutil.copytree(folder / "images", Path(keep) / "drawing", dirs_exist_ok=True)
    return {**report, "folder": folder}


def test_the_run_from_the_dialog_succeeded(session: dict[str, Any]) -> None:
    assert session["errors"] == []
    assert [m for m in session["messages"] if "slopewatch" in m.lower() or m.startswith("Python")] == []
    assert session["finished"]["successful"], session["log"]
    assert float(session["finished"]["results"]["MEDIAN_DENSITY"]) > 10
    titles = ["Suggest a region of interest", "Export to Label Studio", "Import from Label Studio"]
    assert [title.removeprefix("Tools - ") for title in session["titles"]] == titles


def test_the_layers_are_in_the_order_in_which_one_draws_on_them(session: dict[str, Any]) -> None:
    seen = [(layer["name"], layer["renderer"], layer["visible"]) for layer in session["layers"]]
    assert seen == [
        ("Top view", "multibandcolor", True),
        ("Hillshade", "singlebandpseudocolor", False),
        ("Density (returns/m²)", "singlebandpseudocolor", False),
        ("Ground density (returns/m²)", "singlebandpseudocolor", False),
        ("Canopy height (m)", "singlebandpseudocolor", False),
    ]
    assert {layer["group"] for layer in session["layers"]} == {"SlopeWatch top view of 2025-05-01"}


@pytest.mark.parametrize(("name", "grey"), [("picture_map", False), ("hillshade_map", True)])
def test_the_map_shows_the_slope(session: dict[str, Any], name: str, grey: bool) -> None:
    image = QImage(str(session["folder"] / "images" / f"{name}.png"))
    step = range(0, 100, 4)
    colours = [QColor(image.pixel(i * image.width() // 100, j * image.height() // 100)) for i in step for j in step]
    inside = [c for c in colours if c.lightness() < 250]
    assert len(inside) > 0.15 * len(colours), "the slope fills a part of the map"
    assert len({c.lightness() for c in inside}) > 20
    assert (max(c.saturation() for c in inside) < 20) == grey
