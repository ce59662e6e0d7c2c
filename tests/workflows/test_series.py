"""A series of simulated surveys through the whole flow, against the simulation's truth."""

from __future__ import annotations

import json
from datetime import datetime, timedelta
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import geopandas
import numpy as np
import pytest
import rasterio
from affine import Affine
from rasterio.features import geometry_mask
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.report.signed.rasters import surface_of
from slopewatch.interface.parameters import (
    GridChangeParameters,
    SeriesParameters,
    SurveyParameters,
)
from slopewatch.interface.seen import COMPARED, KEYS, NOT_SEEN, OUTSIDE
from slopewatch.simulation.surveys.series import Creep, simulate_series, survey_days, write_series
from slopewatch.tests.builders.series_clouds import READY, Counted, surveys
from slopewatch.workflows.products.series import SERIES_OUTPUTS
from slopewatch.workflows.products.series_motion import SERIES_MOTION_OUTPUTS
from slopewatch.workflows.series import monitor_series
from slopewatch.workflows.settings import SeriesSettings


def read(path: Path) -> np.ndarray:
    with rasterio.open(path) as raster:
        return raster.read(1, masked=True).filled(np.nan)


def grid_of(path: Path) -> Grid:
    with rasterio.open(path) as raster:
        return Grid(raster.transform.c, raster.transform.f, raster.transform.a, *raster.shape)


def test_every_promised_output_exists(runs):
    out, found = runs
    outputs = found[1][3]
    assert all(path.stat().st_size > 0 for path in outputs.values())
    assert all((out / name).is_file() for name in SERIES_OUTPUTS if name != "report.pdf")  # which is on request
    assert len(list((out / "cumulative").glob("*.tif"))) == len(list((out / "incremental").glob("*.tif"))) == 12
    assert not [p for p in out.rglob("*") if p.name.startswith(".") or ".part" in p.name]


def test_another_survey_computes_only_itself(runs):
    _, found = runs
    (first, record, *_), (second, again, *_) = found
    assert sorted(first) == ["epoch_cells"] * 4 + ["register_pair"] * 3
    assert second == ["register_pair", "epoch_cells"]
    made = [entry["made"] for entry in again["stages"][0]["epochs"].values()]
    assert made == [[]] * 4 + [["registration", "cells"]]
    before = record["stages"][0]["epochs"]
    assert len(before) == 4
    for name, entry in again["stages"][0]["epochs"].items():
        if name in before:
            assert {**entry, "made": []} == {**before[name], "made": []}


def test_what_was_kept_gives_the_same_bytes_as_a_fresh_run(simulated, runs, tmp_path):
    _, paths = simulated
    out, _ = runs
    monitor_series(surveys(paths), tmp_path / "fresh", READY, roi=paths["roi"])
    fresh = {p.relative_to(tmp_path / "fresh") for p in (tmp_path / "fresh").rglob("*") if p.is_file()}
    assert len([name for name in fresh if name.suffix == ".tif"]) >= 4
    for name in fresh - {Path("run.json"), Path("report.html")}:  # these tell when they were made
        assert (out / name).read_bytes() == (tmp_path / "fresh" / name).read_bytes(), name


def test_ids_stay_when_a_survey_is_added(runs):
    _, ((_, _, before, *_), (_, record, after, *_)) = runs
    assert (before["n_epochs_confirmed"] >= 2).sum() >= 3
    # what only motion showed may be gone when a further survey does not bear it out
    for _, zone in before[(before["n_epochs_confirmed"] >= 2) & (before["found_by"] != "motion")].iterrows():
        same = after[after["zone_id"] == zone["zone_id"]]
        if same.empty:
            assert record["zone_history"][zone["zone_id"]]["merged_into"]
        else:
            assert same.geometry.iloc[0].intersection(zone.geometry).area > 0.8 * zone.geometry.area
            assert same["kind"].iloc[0] == zone["kind"]


def test_zones_have_the_true_velocity_and_the_right_words(simulated, runs):
    series, _ = simulated
    out, (_, (_, _, zones, _, metrics)) = runs
    grid = grid_of(out / "velocity.tif")
    known = np.isfinite(read(out / "velocity.tif"))
    moving = [np.abs(series.true_velocity(k, grid)) > 0 for k in range(3)]
    words = {}
    for _, zone in zones.iterrows():
        inside = known & geometry_mask([zone.geometry], grid.shape, Affine(*grid.affine), invert=True)
        motion = int(np.argmax([np.count_nonzero(m & inside) for m in moving]))
        words[motion] = zone
        truth = 1000 * series.true_velocity(motion, grid)[inside].mean()
        if motion < 2:
            assert zone["rate_low"] < zone["rate_mm_day"] < zone["rate_high"]
            assert abs(zone["rate_mm_day"] - truth) <= 2.6 * zone["rate_err"]  # 99 %
            assert zone["trend"] == "steady"
        total = series.true_change(4, grid)[inside].mean()
        assert abs(zone["dz_mean_m"] - total) < 2.5 * zone["vol_err_m3"] / zone["area_m2"] + 0.003
    assert set(words) == {0, 1, 2}
    assert words[0]["onset_from"] == "2024-05-01"
    assert (words[0]["kind"], words[1]["kind"]) == ("subsidence", "uplift")
    assert words[1]["onset_from"] == ""
    assert words[2]["trend"] == "decelerating"
    assert words[0]["n_epochs_confirmed"] >= 3
    assert words[0]["velocity_class"] in ("very slow", "slow")
    assert words[0]["alert_level"] >= 2
    assert words[0]["alert_reason"].startswith(("rate", "volume"))
    assert set(zones["failure_from"]) == {""}
    assert all(note.startswith("not computable") for note in zones["failure_note"])
    assert metrics["zone_count"] == len(zones)
    assert metrics["failure_interval_count"] == 0


def test_differences_to_the_first_are_the_sums_of_the_steps(simulated, runs):
    series, _ = simulated
    out, _ = runs
    steps = [read(p) for p in sorted((out / "incremental").glob("elevation*.tif"))]
    whole = [read(p) for p in sorted((out / "cumulative").glob("elevation*.tif"))]
    assert len(steps) == len(whole) == 4
    for count in range(1, 5):
        total = np.sum(steps[:count], axis=0)
        both = np.isfinite(total) & np.isfinite(whole[count - 1])
        assert both.any()
        np.testing.assert_allclose(total[both], whole[count - 1][both], atol=1e-5)
    grid = grid_of(out / "velocity.tif")
    for path in out.rglob("*.tif"):
        if path.name not in SERIES_MOTION_OUTPUTS:  # whose cells are windows
            assert grid_of(path) == grid, path
    for number, dz in enumerate(whole, 1):
        error = (dz - series.true_change(number, grid))[np.isfinite(dz)]
        assert abs(np.median(error)) < 0.005


def test_cells_are_confirmed_in_groups_only(simulated, runs):
    series, _ = simulated
    out, _ = runs
    confirmed = read(out / "epochs_confirmed.tif")
    truth = series.true_change(4, grid_of(out / "velocity.tif"))
    moved = np.abs(truth) > 0.15
    assert np.nanmean(confirmed[moved] >= 2) > 0.9
    # far from all that moved, chance alone would confirm single cells
    far = np.abs(truth) == 0
    assert np.nanmean(confirmed[far] >= 2) < 0.005


def test_rasters_say_what_time_they_are_of_and_when_they_are_shown(simulated, runs):
    series, _ = simulated
    out, _ = runs
    shown = {"cumulative": [], "incremental": []}
    for kind, spans in shown.items():
        for path in sorted((out / kind).glob("*.tif"), key=lambda p: p.stem[-10:]):
            with rasterio.open(path) as raster:
                tags = raster.tags()
            begin, end = path.stem.split("_")[-2:]
            assert (tags["EPOCH_FROM"], tags["EPOCH_TO"]) == (begin, end)
            assert begin == "2024-05-01" or kind == "incremental"
            root = ElementTree.fromstring(path.with_suffix(".qml").read_text().partition("\n")[2])
            temporal = root.find("temporal")
            assert (temporal.get("enabled"), temporal.get("mode")) == ("1", "0")
            start, stop = (datetime.fromisoformat(temporal.find(f"fixedRange/{t}").text[:19]) for t in ("start", "end"))
            assert stop.date().isoformat() == end
            if path.stem.startswith("elevation"):
                spans.append((start, stop))
    for spans in shown.values():
        assert len(spans) == 4
        assert spans[0][0].date() == series.dates[0] + timedelta(days=1)
        # side by side: no day shows two surveys or none
        assert all(later[0] - before[1] == timedelta(seconds=1) for before, later in pairwise(spans))


def test_each_pair_says_what_was_seen_and_the_maps_hatch_the_rest_of_the_last(runs):
    out, found = runs
    record = json.loads((out / "run.json").read_text(encoding="utf-8"))
    files = sorted(out.glob("*/seen_*.tif"))
    assert len(files) == 8
    for path in files:
        with rasterio.open(path) as raster:
            classes = raster.read(1)
        change = read(path.with_name(path.name.replace("seen", "elevation_change")))
        assert np.array_equal(classes == COMPARED, np.isfinite(change))
        shares = record["seen_of_pairs"][path.stem.removeprefix("seen_").replace("_", " to ")]
        slope = np.count_nonzero(classes != OUTSIDE)
        assert shares == pytest.approx({KEYS[k]: (classes == k).sum() / slope for k in (COMPARED, *NOT_SEEN)})
    assert set(map(str, found[1][3].values())) >= set(map(str, files))
    last = out / record["outputs"]["cumulative_seen_004"]
    with rasterio.open(last) as raster:
        unseen, transform = np.isin(raster.read(1), NOT_SEEN), raster.transform
    assert unseen.any()
    outlined = geopandas.read_file(out / "series.gpkg", layer="not_seen")
    assert np.array_equal(geometry_mask(outlined.geometry, unseen.shape, transform, invert=True), unseen)
    hatched = surface_of(record, out).unseen
    assert np.array_equal(hatched.cells, unseen)


def test_raw_surveys_get_their_ground_once(tmp_path):
    parameters = SurveyParameters(seed=5, points=12_000, length=12.0, height=5.0, vegetation=0.3, offset=0.02)
    series = simulate_series(parameters, survey_days(3, 60), (Creep(-0.005),), half_axes=(1.8, 1.4))
    paths = write_series(series, tmp_path / "clouds")
    settings = SeriesSettings(
        change=GridChangeParameters(cell=0.25), series=SeriesParameters(rasters_each_survey=False)
    )
    calls = []
    for count in (2, 3):
        with pytest.MonkeyPatch.context() as patch:
            counted = Counted(patch)
            monitor_series(surveys(paths)[:count], tmp_path / "out", settings, roi=paths["roi"])
        calls.append(sorted(counted.calls))
    assert calls[0] == ["epoch_cells"] * 2 + ["extract_ground"] * 2 + ["register_pair"]
    assert calls[1] == ["epoch_cells", "extract_ground", "register_pair"]
    assert len(list((tmp_path / "out" / "work").glob("*_ground.laz"))) == 3
    zones = geopandas.read_file(tmp_path / "out" / "series.gpkg", layer="zones")
    assert zones["kind"].iloc[0] == "subsidence"
    assert not (tmp_path / "out" / "cumulative").exists()
    for pipeline in (tmp_path / "out" / "work").glob("*_select.json"):
        assert ".slopewatch-part" not in pipeline.read_text()
