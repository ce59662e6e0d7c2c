"""Which layers of a folder belong into its project, by its run record."""

from __future__ import annotations

import json
from pathlib import Path

from slopewatch.plugin.bridge.project_contents import CHANGE, EARLIER, LATER, SURVEYS, ZONES, Entry, read_contents

DAYS = ("2015-03-01", "2019-06-01", "2023-02-15")


def contents(folder: Path, files: dict[str, str]) -> list[Entry]:
    for name in files.values():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    record = {"command": "demchange", "outputs": files, "inputs": [{"role": f"epoch {day}"} for day in DAYS]}
    (folder / "run.json").write_text(json.dumps(record), encoding="utf-8")
    return list(read_contents(str(folder)).entries)


def test_classes_of_asset_are_a_layer(tmp_path: Path) -> None:
    files = {"budget_by_class": "budget_by_class.csv", "classes": "budget_by_class.gpkg", "zones": "zones.gpkg"}
    (found,) = (e for e in contents(tmp_path, files) if e.path.name == "budget_by_class.gpkg")
    assert (found.layer, found.title, found.group, found.visible) == (
        "budget_by_class", "Change by class of asset", ZONES, False,
    )  # fmt: skip


def test_pairs_of_elevation_models_stand_under_the_later_one(tmp_path: Path) -> None:
    names = [f"{kind}_{span}" for kind in ("elevation_change", "level_of_detection") for span in ("1_2", "1_3", "2_3")]
    found = contents(tmp_path, {name: f"pairs/{name}.tif" for name in names} | {"elevation_change": "whole.tif"})
    (whole,) = (e for e in found if e.group == CHANGE)
    assert whole.days == (DAYS[0], DAYS[2])
    of_pairs = {e.path.stem: (e.survey, e.title, e.days) for e in found if e.group == SURVEYS}
    assert sorted(of_pairs) == sorted(names)
    assert of_pairs["elevation_change_1_2"] == (DAYS[1], "Change since the first survey", DAYS[:2])
    assert of_pairs["elevation_change_2_3"] == (DAYS[2], "Change since the survey before", DAYS[1:])
    assert of_pairs["level_of_detection_1_3"] == (
        DAYS[2], "Level of detection since the first survey", (DAYS[0], DAYS[2]),
    )  # fmt: skip


def test_heights_and_picture_are_of_their_surveys(tmp_path: Path) -> None:
    files = {"surface_heights": "surface_heights.tif", "top_view": "top_view.tif"}
    heights, view = contents(tmp_path, files)
    assert (heights.surveys, view.survey) == ((DAYS[0], DAYS[2]), DAYS[2])
    (tmp_path / "run.json").write_text(json.dumps({"command": "change", "outputs": files}), encoding="utf-8")
    heights, view = read_contents(str(tmp_path)).entries
    assert (heights.surveys, view.survey, heights.days) == ((EARLIER, LATER), LATER, None)
    (tmp_path / "surface_heights.tif").unlink()
    (view,) = read_contents(str(tmp_path)).entries
    assert view.survey == "", "of one cloud alone"
