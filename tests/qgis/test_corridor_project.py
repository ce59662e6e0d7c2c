"""A corridor's project has a group for each slope; projects of flights and of layers placed on a road."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path
from typing import Any

import pytest
from slopewatch.plugin.bridge.print_layout import Sheet
from slopewatch.plugin.bridge.project_contents import FLIGHT, SLOPES, read_contents
from slopewatch.plugin.bridge.project_file import write_project
from slopewatch.tests.builders.algorithm_inputs import Inputs
from slopewatch.tests.builders.qgis import engine_python
from slopewatch.tests.qgis.test_createproject_process import opened

_ODD = "Surveys"
"""Name of a slope, and of a group of layers."""


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Inputs:
    engine_python()
    return Inputs(tmp_path_factory.mktemp("inputs"))


@pytest.fixture(scope="module")
def corridor(inputs: Inputs, tmp_path_factory: pytest.TempPathFactory, qgis_app: object) -> dict[str, Any]:
    """What another process finds in a corridor's project after its folder has moved."""
    folder = tmp_path_factory.mktemp("corridor")
    first, later = inputs.pair.values()
    rows = [(_ODD, first), (_ODD, later), ("alone", first)]
    with (folder / "manifest.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([("slope", "date", "file"), *((s, cloud.stem, cloud) for s, cloud in rows)])
    inputs.engine("batch", folder / "manifest.csv", "--ground-ready", "--cell", "0.5", "--no-displacement",
                  "--screening-method", "relief", "--workers", "0", "--output-dir", folder / "out")  # fmt: skip
    made(folder / "out")
    moved = Path(shutil.move(folder / "out", tmp_path_factory.mktemp("moved") / "away"))
    return opened(moved / "slope.qgz", moved / "sheet.png") | {"folder": moved}


def made(folder: Path) -> None:
    write_project(read_contents(str(folder)), folder / "slope.qgz", Sheet("Title", "a", "", "x", "A4"))


def groups(tree: list[Any]) -> dict[str, Any]:
    return dict(one for one in tree if isinstance(one, list))


def test_each_slope_has_a_group_of_its_own(corridor: dict[str, Any]) -> None:
    top = groups(corridor["tree"])
    slopes = groups(top[SLOPES])
    assert set(slopes) == {_ODD, "alone"}
    assert {"Hazard zones", "Significant change (m)"} <= set(slopes[_ODD])
    assert "Screened zones" in slopes["alone"]
    assert {"Zones of all slopes", "Alerts", "Slopes"} <= set(top["Zones and sections"])
    assert corridor["times"] == ["2024-05-01", "2025-05-01"]


def test_no_layer_of_a_slope_is_missing_after_the_folder_has_moved(corridor: dict[str, Any]) -> None:
    for title, layer in corridor["layers"].items():
        assert layer["valid"], title
        assert layer["source"].startswith(str(corridor["folder"])), title
    assert any("/slopes/" in layer["source"] for layer in corridor["layers"].values())
    assert list(corridor["folder"].rglob("*.aux.xml")) == []


def test_a_plan_and_a_located_layer_become_projects(inputs: Inputs, tmp_path: Path, qgis_app: object) -> None:
    made(inputs.plan.parent)
    found = opened(inputs.plan.parent / "slope.qgz", tmp_path / "plan.png")
    assert {"Flight lines", "Waypoints", "Expected ground returns (1/m²)"} <= set(groups(found["tree"])[FLIGHT])
    (tmp_path / "located").mkdir()
    inputs.engine("locate", inputs.survey / "roi.gpkg", "--centreline", inputs.road, "--output",
                  tmp_path / "located" / "region.gpkg")  # fmt: skip
    made(tmp_path / "located")
    found = opened(tmp_path / "located" / "slope.qgz", tmp_path / "located.png")
    assert groups(found["tree"])["Zones and sections"] == ["Places on the road"]
