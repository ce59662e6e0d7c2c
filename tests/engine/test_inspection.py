"""The whole flow on a simulated pair, against the simulation's truth."""

from __future__ import annotations

import json
from datetime import date
from pathlib import Path

import geopandas
import numpy as np
import pytest
import rasterio
from slopewatch.engine.epoch_screening import SCREENING_OUTPUTS
from slopewatch.engine.epochs import Epoch
from slopewatch.engine.errors import InputError
from slopewatch.engine.gridding import Grid
from slopewatch.engine.inspection import CHANGE_OUTPUTS, Settings, inspect_slope
from slopewatch.engine.parameters import ChangeParameters, LastEpochParameters, SurveyParameters
from slopewatch.engine.progress import Progress
from slopewatch.engine.transform import RigidTransform
from slopewatch.simulation.survey import simulate_pair
from slopewatch.simulation.write import write_pair

RESIDUAL = LastEpochParameters(screening_method="residual", residual_threshold=0.05)


@pytest.fixture(scope="module")
def survey(tmp_path_factory):
    pair = simulate_pair(SurveyParameters(points=250_000, length=30.0, height=12.0, amplitude=0.4, seed=3))
    return pair, write_pair(pair, tmp_path_factory.mktemp("survey"))


def epochs(paths) -> tuple[Epoch, Epoch]:
    return Epoch(paths["first"], date(2024, 5, 1)), Epoch(paths["second"], date(2025, 5, 1))


@pytest.fixture(scope="module")
def run(survey, tmp_path_factory):
    _, paths = survey
    out = tmp_path_factory.mktemp("out") / "new"
    progress = Progress()
    settings = Settings(change=ChangeParameters(cell=0.2), screening=RESIDUAL)
    outputs, metrics = inspect_slope(epochs(paths), out, settings, roi=paths["roi"], progress=progress)
    return out, outputs, metrics


def test_every_promised_output_exists_and_nothing_else_lies_about(run):
    out, outputs, _ = run
    for name in (*CHANGE_OUTPUTS, *SCREENING_OUTPUTS, "transform.json", "run.json"):
        assert (out / name).stat().st_size > 0, name
    assert all(path.exists() for path in outputs.values())
    assert not [p for p in out.rglob("*") if ".part" in p.name or p.name.startswith(".")]


def test_change_agrees_with_the_truth(survey, run):
    pair, _ = survey
    out, _, metrics = run
    with rasterio.open(out / "elevation_change.tif") as raster:
        dz = raster.read(1, masked=True).filled(np.nan)
        grid = Grid(raster.transform.c, raster.transform.f, raster.transform.a, *dz.shape)
        assert raster.crs.to_epsg() == 32651
        assert raster.tags()["EPOCH_FROM"] == "2024-05-01"
    truth = pair.true_change_raster(grid)
    error = (dz - truth)[np.isfinite(dz)]
    assert abs(np.median(error)) < 0.01
    assert 1.4826 * np.median(np.abs(error - np.median(error))) < 0.06
    assert 0.8 < metrics["common_cell_rate"] <= 1.0


def test_zones_lie_where_the_ground_changed(survey, run):
    pair, _ = survey
    out, _, metrics = run
    zones = geopandas.read_file(out / "zones.gpkg", layer="zones")
    assert len(zones) == metrics["zone_count"]
    assert {"uplift", "subsidence"} <= set(zones["kind"])
    inside = zones.to_crs(32651)
    grid = Grid(*_grid(out))
    truth = pair.true_change_raster(grid)
    row, column = np.nonzero(np.abs(truth) > 0.2)
    points = geopandas.GeoSeries.from_xy(
        grid.west + (column + 0.5) * grid.cell, grid.north - (row + 0.5) * grid.cell, crs=32651
    )
    assert points.within(inside.union_all()).mean() > 0.8
    # what is drawn is where something moved: little area lies far from any true change
    moved = points.buffer(2.0).union_all()
    assert inside[~inside.intersects(moved)].area.sum() < 0.05 * inside.area.sum()


def _grid(out):
    with rasterio.open(out / "elevation_change.tif") as raster:
        return raster.transform.c, raster.transform.f, raster.transform.a, raster.height, raster.width


def test_the_known_offset_is_undone(survey, run):
    pair, _ = survey
    out, _, _ = run
    found = RigidTransform.load(out / "transform.json")
    points = pair.second.xyz[::50]
    error = found.apply(points) - pair.transform.apply(points)
    slope = points - points.mean(axis=0)
    normal = np.linalg.svd(slope, full_matrices=False)[2][2]
    # across the face it is seen well; along it only by its unevenness
    assert np.abs(error @ normal).max() < 0.005
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < 0.03


def test_run_record_tells_what_ran(run):
    out, _, metrics = run
    record = json.loads((out / "run.json").read_text())
    assert [s["stage"] for s in record["stages"]] == ["ground", "registration", "change", "screening", "products"]
    assert all(s["seconds"] >= 0 and s["peak_memory_mb"] > 0 for s in record["stages"])
    assert record["pdal"]["version"]
    assert record["metrics"].keys() == metrics.keys()
    assert record["parameters"]["change"]["cell"] == 0.2
    assert record["transform"] == json.loads((out / "transform.json").read_text())["matrix"]
    assert all((out / name).is_file() for name in record["outputs"].values())
    assert ".slopewatch-part" not in json.dumps(record)
    for ground in record["stages"][0]["epochs"].values():
        assert (out / ground["ground"]).is_file()


def test_kept_pipelines_name_files_that_exist(run):
    out, _, _ = run
    pipelines = sorted(out.rglob("*.json"))
    kept = [p for p in pipelines if p.name not in ("run.json", "transform.json")]
    assert len(kept) >= 4
    for path in kept:
        text = path.read_text()
        assert ".slopewatch-part" not in text
        reader = json.loads(text)
        stages = reader["pipeline"] if isinstance(reader, dict) else reader
        source = next(s["filename"] if isinstance(s, dict) else s for s in stages)
        assert (out / source).exists() or Path(source).exists(), source


def test_an_epoch_that_fails_leaves_nothing(survey, tmp_path):
    _, paths = survey
    broken = tmp_path / "2025-05-01.laz"
    broken.write_bytes(paths["second"].read_bytes()[:200_000])
    out = tmp_path / "out"
    with pytest.raises(InputError, match=r"2025-05-01\.laz"):
        inspect_slope((epochs(paths)[0], Epoch(broken, date(2025, 5, 1))), out, Settings(), roi=paths["roi"])
    assert not out.exists()
