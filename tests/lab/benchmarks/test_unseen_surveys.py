"""What is drawn, kept and counted of the surveys of unseen seeds; no survey is flown but a small one."""

from __future__ import annotations

import json
from dataclasses import replace

import geopandas as gpd
import numpy as np
import pytest
import shapely
from slopewatch.engine.grid.geotiff import write_raster
from slopewatch.engine.grid.grid import snapped_grid
from slopewatch.interface.parameters import SurveyParameters
from slopewatch.lab.benchmarks import unseen_surveys
from slopewatch.lab.benchmarks.survey_outcome import FoundZone, KnownChange, NetVolume, Outcome, judged, read_outcomes
from slopewatch.lab.benchmarks.unseen_surveys import LENGTH, SEEDS, drawn, outcomes, rows, table
from slopewatch.simulation.surveys.change import Bump
from slopewatch.simulation.surveys.survey import simulate_pair

CHANGE = KnownChange("bulge", 0.2, 5.0, 0.05, 0.9, True)
ZONE = FoundZone(5.0, 0.999, 1.0, 0.1, 1.1, 7.0, False)
GOOD = Outcome(
    1, 40.0, 100.0, 0.5, 0.0, 0, "", "vertical", 0.003, 0.03, (CHANGE,), (ZONE,), NetVolume(1.0, 0.5, 0.9),
    NetVolume(1.0, 0.1, 1.1),
)  # fmt: skip


def row_of(found, name):
    return next(row for row in table(found) if name in row.figure)


def test_surveys_span_what_they_promise_and_changes_do_not_touch():
    all_drawn = [drawn(seed) for seed in SEEDS]
    angles = [parameters.angle for parameters, _ in all_drawn]
    assert min(angles) < 25
    assert max(angles) > 65
    assert {len(changes) for _, changes in all_drawn} == {0, 1, 2, 3}
    assert any(parameters.grass > 0 for parameters, _ in all_drawn)
    for parameters, changes in all_drawn:
        run = parameters.height / np.tan(np.radians(parameters.angle))
        boxes = [shapely.box(*change.bounds) for change in changes]
        assert all(shapely.box(0.4, 0.4, LENGTH - 0.4, run - 0.4).contains(box) for box in boxes)
        assert all(a.distance(b) >= 1.0 for i, a in enumerate(boxes) for b in boxes[:i])
    assert drawn(9003) == drawn(9003)


def test_what_was_measured_is_kept_and_not_measured_again(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(unseen_surveys, "inspected", lambda seed: asked.append(seed) or replace(GOOD, seed=seed))
    kept = tmp_path / "results" / "unseen_surveys.jsonl"
    outcomes([1, 2], kept)
    found = outcomes([1, 2, 3], kept)
    assert asked == [1, 2, 3]
    assert found == read_outcomes(kept) == [replace(GOOD, seed=n) for n in (1, 2, 3)]
    assert rows(tmp_path / "results" / "unseen_surveys.csv", [1])[0].value == "0"


def test_failures_count_and_refusals_are_named():
    found = [GOOD, replace(GOOD, code=2, said="Too thin."), replace(GOOD, seed=7, code=1, said="KeyError")]
    row = row_of(found, "internal failures")
    assert (row.value, row.met) == ("1; 7: KeyError", False)
    assert "refused: 1; 1: Too thin." in row.peer


def test_false_zones_and_intervals_that_do_not_hold():
    wrong = replace(ZONE, true=1.3)
    false = replace(ZONE, true=0.0, false=True)
    found = [replace(GOOD, zones=(ZONE, wrong, false, false))]
    assert row_of(found, "false zones").met is False
    assert row_of([replace(GOOD, zones=(ZONE, false))], "false zones").met is True
    row = row_of(found, "footprints whose")
    assert row.value == "1 of 4 (25.0 %)"
    assert row.met is False
    assert "2 state too large a volume" in row.peer
    ninety = [GOOD] * 19 + [replace(GOOD, net=NetVolume(3.0, 0.5, 0.9))]
    assert row_of(ninety, "net volume holds").met is True


def test_a_change_in_parts_under_the_level_is_distinguished():
    missed = replace(CHANGE, share=0.1)
    lost = replace(missed, touched=False, height=-0.12)
    row = row_of([replace(GOOD, changes=(CHANGE, missed))], "3 and more")
    assert (row.value, row.met) == ("1 of 2", True)
    assert row_of([replace(GOOD, changes=(lost,))], "2 to 3").value == "0 of 1"
    assert row_of([replace(GOOD, changes=(replace(lost, height=-0.3),))], "3 and more").met is False


@pytest.fixture(scope="module")
def pair():
    parameters = SurveyParameters(seed=3, points=3_000, length=16.0, height=8.0, angle=40.0, vegetation=0.0)
    return simulate_pair(parameters, changes=(Bump(8.0, 4.0, 2.0, 1.5, 0.3),))


def test_files_of_a_run_are_judged_by_the_truth(pair, tmp_path):
    grid = snapped_grid(pair.bounds, 0.2)
    truth = pair.true_change_raster(grid, 8)
    level = np.full(grid.shape, 0.06)
    for name, values in (("elevation_change", truth), ("level_of_detection", level)):
        write_raster(tmp_path / f"{name}.tif", values, grid, None, description=name)
    place = pair.scene.frame.to_world(np.array([[8.0, 4.0, 0.0], [13.0, 4.0, 0.0]]))[:, :2]
    shapes = [shapely.Point(*p).buffer(r) for p, r in zip(place, (1.4, 1.0), strict=True)]
    frame = gpd.GeoDataFrame(
        {
            "zone_id": ["Z001", "Z002"],
            "area_m2": [6.0, 3.0],
            "confidence": [1.0, 0.96],
            "vol_net_m3": [1.0, -0.4],
            "vol_err_m3": [0.05, 0.1],
            "vol_area_m2": [9.0, 3.0],
        },
        geometry=shapes,
    )
    frame.to_file(tmp_path / "zones.gpkg", layer="zones")
    wider = frame.set_geometry([shape.buffer(0.8) for shape in shapes])
    wider.iloc[::-1].to_file(tmp_path / "zones.gpkg", layer="footprints")
    record = {
        "level_of_detection": {"direction": "vertical"},
        "metrics": {"registration_error_m": 0.004, "lod_median_m": 0.06},
    }
    (tmp_path / "run.json").write_text(json.dumps(record))
    total = truth.sum() * 0.04
    (tmp_path / "volumes.csv").write_text(
        "group,quantity,raw,raw_error,thresholded,standard_error\n"
        f"VOLUMETRIC,Total Net Volume Difference,{total + 0.3},0.2,,\n"
        "ZONES (OVER THEIR FOOTPRINTS),Total Net Volume Difference,,,0.6,0.1\n"
    )
    found = judged(3, pair, tmp_path)
    volume = pair.changes[0].volumes[0]
    assert [zone.false for zone in found.zones] == [False, True]
    assert found.zones[0].true == pytest.approx(volume, rel=0.01), "its footprint holds all of the change"
    assert found.zones[1].true == 0.0
    assert not found.zones[1].held
    assert found.changes[0].found
    assert found.changes[0].ratio == pytest.approx(5.0)
    assert found.net.held
    assert found.net.true == pytest.approx(volume, rel=0.01)
    assert not found.zones_net.held
