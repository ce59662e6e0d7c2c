"""A real QGIS on a display in memory: the panel at work on a run, with real clicks on the map.

SLOPEWATCH_KEEP_IMAGES=FOLDER keeps the pictures of the session; lab/sessions/screenshots.py makes that of the docs.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from slopewatch.lab.sessions.screenshots import PANEL_SCREEN, run_session
from slopewatch.processing_algorithms import ALGORITHMS
from slopewatch.tests.builders.qgis import QgisProcess, engine_python


@pytest.fixture(scope="module")
def session(
    qgis_process: QgisProcess, survey: dict[str, Any], tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Any]:
    engine_python()
    for program in ("qgis", "xvfb-run"):
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed")
    folder = tmp_path_factory.mktemp("desktop")
    qgis_process.run(
        "inspectslope",
        REFERENCE=survey["REFERENCE"],
        CLOUD=survey["CLOUD"],
        ROI=survey["ROI"],
        CELL=0.25,
        SCREEN_LAST_EPOCH=False,
        OUTPUT_FOLDER=folder / "results",
    )
    run = {"RUN": folder / "results"}
    report = run_session(run, folder, script="panel_session.py", screen=PANEL_SCREEN, seconds=300)
    keep = os.environ.get("SLOPEWATCH_KEEP_IMAGES")
    if keep:
        shutil.copytree(folder / "images", Path(keep) / "panel", dirs_exist_ok=True)
    return {**report, "folder": folder}


def test_nothing_went_wrong(session: dict[str, Any]) -> None:
    assert session["errors"] == []
    assert session["loaded"]
    assert {Path(path).stem for path in session["pictures"]} >= {"masked", "panel", "region"}


def test_the_menu_has_every_tool(session: dict[str, Any]) -> None:
    groups = dict(session["tools"])
    assert len(groups.pop("Models")) >= 1
    tools = [tool for group in groups.values() for tool in group]
    assert sorted(tools) == sorted(f"{algorithm.TITLE}…" for algorithm in ALGORITHMS)


def test_the_reviews_are_in_the_file(session: dict[str, Any]) -> None:
    assert session["saved"]
    with closing(sqlite3.connect(session["folder"] / "results" / "zones.gpkg")) as database:
        rows = database.execute("SELECT review_status, reviewer, remarks FROM zones ORDER BY zone_id").fetchall()
    assert len(rows) == len(session["zones"]) >= 3
    assert rows[0][:2] == ("confirmed", "A. Sato")
    assert rows[-1] == ("rejected", "A. Sato", "cut grass")


def test_a_zone_is_chosen_by_a_click_on_the_map(session: dict[str, Any]) -> None:
    expected, picked = session["picked"]
    assert picked == expected != session["zones"][-1]
    assert not session["picking"]
    assert session["tool_after"] == session["tool_before"] != ""


def test_a_region_is_drawn_by_clicks_on_the_map(session: dict[str, Any]) -> None:
    (drawn,) = session["drawn"]
    assert drawn["crs"] == "EPSG:32651"
    assert drawn["corners"] == [5]
    assert drawn["share"] == pytest.approx(0.289, abs=0.01)  # of the map, by the corners that were clicked
