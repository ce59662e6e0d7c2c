"""A survey is added to a series: what is computed again, and which earlier figures are said to be others."""

from __future__ import annotations

import json
import shutil

import geopandas as gpd
import pytest
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.epochs.manifest import epochs_of
from slopewatch.tests.builders.series_clouds import GROWING, plane
from slopewatch.workflows import series_store
from slopewatch.workflows.series import monitor_series
from slopewatch.workflows.series_continued import say_changed_figures

TRUE_M3 = (-0.9, -1.8, -1.8, -3.6)
"""Of the square of 9 m2, by survey from the second on."""


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Four surveys, then a fifth, in one folder; the record and the rows of the zones after each run."""
    base = tmp_path_factory.mktemp("series")
    (base / "clouds").mkdir()
    found = []
    for number, volume in enumerate((0.0, *TRUE_M3)):
        plane(base / "clouds" / f"2024-0{number + 1}-01.laz", bump=volume / 9, seed=number)
        if number >= 3:
            progress = Progress()
            monitor_series(epochs_of(base / "clouds"), base / "out", GROWING, progress=progress)
            record = json.loads((base / "out" / "run.json").read_text())
            rows = gpd.read_file(base / "out" / "series.gpkg", layer="series").set_index(["zone_id", "epoch"])
            found.append((record, rows))
    return base, found


def test_the_figures_of_earlier_surveys_stay_true(runs):
    _, found = runs
    for _, rows in found:
        for (_, day), row in rows.iterrows():
            assert abs(row["vol_net_m3"] - TRUE_M3[int(day[5:7]) - 2]) < 3 * row["vol_err_m3"] + 0.02
    (_, before), (_, after) = found
    assert len(before) == 3
    for key, row in before.iterrows():
        assert abs(after.loc[key, "vol_net_m3"] - row["vol_net_m3"]) < row["vol_err_m3"]
        assert after.loc[key, "alert_level"] == row["alert_level"]


def test_every_zone_with_other_figures_is_named(runs):
    _, ((_, before), (record, after)) = runs
    changed = {
        name
        for (name, day), row in before.iterrows()
        for column, digit in (("dz_mean_m", 0.001), ("vol_net_m3", 0.01), ("area_m2", 0.01))
        if abs(after.loc[(name, day), column] - row[column]) >= digit
    }
    assert changed
    said = " ".join(w for w in record["warnings"] if "not that of the earlier run" in w or "not those of" in w)
    assert all(name in said for name in changed)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({}, None),
        ({"dz_mean_m": -0.2004}, None),  # the report shows the same digits
        ({"dz_mean_m": -0.202}, "Figures of earlier surveys of S001 are not those of the earlier run."),
        ({"vol_err_m3": 0.04}, "Figures of earlier surveys of S001 are not those of the earlier run."),
        ({"alert_level": 1}, "Alert levels after earlier surveys of S001 are not those of the earlier run."),
    ],
)
def test_sentences_on_figures(change, sentence):
    row = {"epoch": "2024-02-01", "dz_mean_m": -0.2, "vol_net_m3": -1.8, "vol_err_m3": 0.02, "alert_level": 2}
    zones = [{"zone_id": "S001", "area_m2": 9.0}]
    progress = Progress()
    earlier = {"zones": zones, "course": {"S001": [row]}}
    say_changed_figures({"zones": zones, "course": {"S001": [row | change]}}, earlier, progress)
    assert progress.warnings == ([] if sentence is None else [sentence])


def test_a_zone_that_is_gone_is_named():
    progress = Progress()
    earlier = {"zones": [{"zone_id": "S001", "area_m2": 9.0}], "course": {"S001": []}}
    say_changed_figures({"zones": [], "course": {}}, earlier, progress)
    assert progress.warnings == ["The earlier run had the zones S001, which are no zones of their own any more."]


def test_a_folder_of_another_version_is_computed_again_and_says_so(runs, tmp_path, monkeypatch):
    base, _ = runs
    out = tmp_path / "out"
    shutil.copytree(base / "out", out)
    before = (out / "series.csv").read_bytes()
    again = Progress()
    monitor_series(epochs_of(base / "clouds"), out, GROWING, progress=again)
    assert not [w for w in again.warnings if "computed again" in w]
    monkeypatch.setattr(series_store, "_FORMAT", series_store._FORMAT + 1)
    progress = Progress()
    monitor_series(epochs_of(base / "clouds"), out, GROWING, progress=progress)
    (said,) = [w for w in progress.warnings if "computed again" in w]
    assert said.startswith("The surveys of 2024-01-01, 2024-02-01, 2024-03-01, 2024-04-01, 2024-05-01 were")
    assert said in json.loads((out / "run.json").read_text())["warnings"]
    assert (out / "series.csv").read_bytes() == before
