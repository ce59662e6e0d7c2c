"""A real QGIS on a display in memory: Screen for hazards is run from its dialog, its layers are looked at on the map.

SLOPEWATCH_KEEP_IMAGES=FOLDER keeps the pictures of the session; lab/sessions/screenshots.py makes those of the docs.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

import pytest
from qgis.core import QgsRectangle, QgsVectorLayer
from qgis.PyQt.QtGui import QColor, QImage
from slopewatch.lab.sessions.screenshots import run_session
from slopewatch.tests.builders.qgis import QgisProcess, engine_python

SIGNS = {"subsidence": 1, "uplift": -1}  # of red less blue in the picture


@pytest.fixture(scope="module")
def session(qgis_process: QgisProcess, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    engine_python()
    for program in ("qgis", "xvfb-run"):
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed")
    folder = tmp_path_factory.mktemp("desktop")
    scenes = qgis_process.run(
        "simulatescenes", OUTPUT_FOLDER=folder / "scenes", COUNT=1, SEED=1001, AREA=900, DENSITY=60
    )
    cloud = next((folder / "scenes").glob("*.laz"))
    parameters = {"INPUT": cloud, "OUTPUT": folder / "screened.laz", "SCREENING_METHOD": "residual"}
    report = run_session(parameters, folder, script="screening_session.py", seconds=480)
    keep = os.environ.get("SLOPEWATCH_KEEP_IMAGES")
    if keep:
        shutil.copytree(folder / "images", Path(keep) / "screening", dirs_exist_ok=True)
    return {**report, "folder": folder, "truth": scenes["HAZARDS"]}


def picture(session: dict[str, Any], name: str) -> QImage:
    return QImage(str(session["folder"] / "images" / f"{name}.png"))


def test_the_run_from_the_dialog_succeeded(session: dict[str, Any]) -> None:
    assert session["errors"] == []
    assert [m for m in session["messages"] if "slopewatch" in m.lower() or m.startswith("Python")] == []
    assert session["finished"]["successful"], session["log"]
    assert int(session["finished"]["results"]["ZONE_COUNT"]) > 0
    assert {Path(p).stem for p in session["pictures"]} == {"dialog", "log", "zones_map", "layers", "map", "table"}


def test_the_layers_are_on_the_map(session: dict[str, Any]) -> None:
    seen = [(layer["name"], layer["renderer"], layer["visible"]) for layer in session["layers"]]
    assert seen == [
        ("Hazard zones (screening)", "categorizedSymbol", True),
        ("Probability of a hazard", "singlebandpseudocolor", False),
        ("Smallest hazard (m)", "singlebandpseudocolor", False),
    ]
    for layer in session["layers"]:
        assert layer["valid"]
        assert layer["crs"] == session["crs"] != ""
        assert layer["group"].startswith("SlopeWatch published_")


@pytest.mark.parametrize("name", ["zones_map", "map"])
def test_zones_are_drawn_where_the_hazards_are_in_their_sign_s_colour(session: dict[str, Any], name: str) -> None:
    """The simulator tells where their centres are; one that no zone of its kind covers has no say."""
    image, extent = picture(session, name), QgsRectangle(*session["extent"])
    zones = QgsVectorLayer(f"{session['folder'] / 'screened_zones.gpkg'}|layername=zones", "zones", "ogr")
    hazards = QgsVectorLayer(str(session["truth"]), "truth", "ogr")
    scale = image.width() / extent.width()
    assert extent.height() * scale == pytest.approx(image.height(), rel=0.01)
    kinds = []
    for hazard in hazards.getFeatures():
        # 0.3 m from the zone's outline
        around = hazard.geometry().buffer(0.3, 4)
        if not any(z["kind"] == hazard["class"] and z.geometry().contains(around) for z in zones.getFeatures()):
            continue
        point = hazard.geometry().asPoint()
        column, row = int((point.x() - extent.xMinimum()) * scale), int((extent.yMaximum() - point.y()) * scale)
        # a label is black on white
        colours = [image.pixelColor(column + i, row + j) for i in range(-7, 8) for j in range(-7, 8)]
        difference = sorted((c.red() - c.blue()) * SIGNS[hazard["class"]] for c in colours)
        assert difference[-len(difference) // 4] > 25, hazard["id"]
        kinds.append(hazard["class"])
    assert min(kinds.count(kind) for kind in SIGNS) >= 2


def test_the_probability_is_drawn_in_greys_where_no_zone_is(session: dict[str, Any]) -> None:
    before, after = picture(session, "zones_map"), picture(session, "map")
    assert before.size() == after.size()
    step = max(1, before.width() // 150)
    places = [(x, y) for x in range(0, before.width(), step) for y in range(0, before.height(), step)]
    bare = [p for p in places if before.pixelColor(*p) == QColor("white")]
    grey = [after.pixelColor(*p) for p in bare if after.pixelColor(*p) != QColor("white")]
    assert 300 < len(grey) < len(bare) / 2
    assert all(max(c.getRgb()[:3]) - min(c.getRgb()[:3]) <= 2 for c in grey)
