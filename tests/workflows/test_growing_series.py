"""A series in cells that grow: what it compares, what it states of zones, and what a further survey leaves alone."""

from __future__ import annotations

import csv
import json

import geopandas
import numpy as np
import pytest
import rasterio
from affine import Affine
from rasterio.features import geometry_mask
from slopewatch.engine.grid.grid import Grid
from slopewatch.interface.parameters import DisplacementStepParameters, SeriesParameters, SurveyParameters
from slopewatch.simulation.surveys.series import Creep, simulate_series, survey_days, write_series
from slopewatch.tests.builders.series_clouds import Counted, surveys
from slopewatch.workflows.series import monitor_series
from slopewatch.workflows.settings import SeriesSettings

SETTINGS = SeriesSettings(
    series=SeriesParameters(ground_ready=True), displacement_step=DisplacementStepParameters(displacement=False)
)


@pytest.fixture(scope="module")
def simulated():
    """A slope of 20 by 10 m under 60 % vegetation with 25 ground points a m2; one zone sinks, one rises."""
    parameters = SurveyParameters(seed=4, points=9_000, length=20.0, height=8.0, vegetation=0.6, offset=0.05)
    return simulate_series(parameters, survey_days(4, 30), (Creep(-0.004), Creep(0.003)), half_axes=(2.2, 1.7))


@pytest.fixture(scope="module")
def runs(simulated, tmp_path_factory):
    """Three surveys, then all four into the same folder: the steps that ran, and what lay there after each run."""
    paths = write_series(simulated, tmp_path_factory.mktemp("clouds"), ground_only=True)
    out, found = tmp_path_factory.mktemp("out") / "slope", []
    for count in (3, 4):
        with pytest.MonkeyPatch.context() as patch:
            counted = Counted(patch)
            monitor_series(surveys(paths)[:count], out, SETTINGS, roi=paths["roi"])
        rasters = {p.relative_to(out): p.read_bytes() for p in out.rglob("*.tif") if p.parent != out}
        rows = list(csv.DictReader((out / "coverage.csv").open()))
        found.append((counted.calls, rasters, rows, json.loads((out / "run.json").read_text())))
    return out, found


def test_nine_tenths_of_sparse_ground_are_compared_and_the_rest_is_stated(runs):
    out, ((*_, before, _), (*_, rows, record)) = runs
    assert [row["epoch"] for row in rows] == record["dates"][1:]
    for row, path in zip(rows, sorted((out / "cumulative").glob("elevation*.tif")), strict=True):
        assert float(row["compared_share"]) >= 0.9
        with rasterio.open(path) as raster:
            assert float(row["compared_m2"]) == pytest.approx(
                raster.read_masks(1).astype(bool).sum() * raster.res[0] ** 2
            )
        whole = sum(float(row[f"{part}_m2"]) for part in ("compared", "only_first", "only_this", "too_few_points"))
        assert float(row["compared_share"]) == pytest.approx(float(row["compared_m2"]) / whole, abs=1e-3)
    assert rows[:2] == before  # a further survey changes nothing of the earlier ones
    assert record["metrics"]["least_compared_share"] == pytest.approx(
        min(float(r["compared_share"]) for r in rows), abs=1e-3
    )
    assert '<h2 id="coverage">What each survey saw</h2>' in (out / "report.html").read_text()


def test_a_further_survey_computes_only_itself_and_changes_no_comparison(runs):
    _, ((first, before, *_), (second, after, *_)) = runs
    assert sorted(first) == ["epoch_moments"] * 3 + ["register_pair"] * 2
    assert second == ["register_pair", "epoch_moments"]
    assert len(before) == 12  # change, level and seen of two pairs of each kind
    assert all(after[name] == content for name, content in before.items())


def test_a_zone_whose_area_changed_is_named(runs):
    _, ((*_, before), (*_, after)) = runs
    areas = {zone["zone_id"]: zone["area_m2"] for zone in before["zones"]}
    changed = [z["zone_id"] for z in after["zones"] if areas.get(z["zone_id"], z["area_m2"]) != z["area_m2"]]
    assert changed
    (said,) = (w for w in after["warnings"] if "is not that of the earlier run" in w)
    assert said.startswith(f"The area of {', '.join(changed)} is not")
    assert not any("is not that of the earlier run" in w for w in before["warnings"])


def test_polygon_area_and_volume_are_of_one_ground(simulated, runs):
    out, _ = runs
    zones = geopandas.read_file(out / "series.gpkg", layer="zones")
    rows = geopandas.read_file(out / "series.gpkg", layer="series")
    assert sorted(zones["kind"]) == ["subsidence", "uplift"]
    with rasterio.open(out / "velocity.tif") as raster:
        coarse = Grid(raster.transform.c, raster.transform.f, raster.transform.a, *raster.shape)
    fine = Grid(
        coarse.west, coarse.north, 0.1, round(coarse.rows * coarse.cell * 10), round(coarse.columns * coarse.cell * 10)
    )
    for _, zone in zones.iterrows():
        assert zone["area_m2"] == pytest.approx(zone.geometry.area, rel=1e-6)
        assert zone["vol_net_m3"] == pytest.approx(zone["dz_mean_m"] * zone["area_m2"], rel=1e-4)
        inside = geometry_mask([zone.geometry], fine.shape, Affine(*fine.affine), invert=True)
        for number, (_, row) in enumerate(rows[rows["zone_id"] == zone["zone_id"]].iterrows(), 1):
            assert row["area_m2"] == zone["area_m2"]
            true = float(simulated.true_change(number, fine, 2)[inside].sum()) * 0.01
            assert abs(row["vol_net_m3"] - true) <= 2.6 * row["vol_err_m3"]
        whole = simulated.true_change(3, fine, 2)
        whole = float(whole[np.sign(whole) == np.sign(zone["vol_net_m3"])].sum()) * 0.01
        assert zone["vol_net_m3"] == pytest.approx(whole, rel=0.1)
        assert zone["area_m2"] == pytest.approx(np.pi * 2.2 * 1.7 * (1 - 0.1**0.5), rel=0.1)  # moved by a tenth or more
