"""The public API: the same results as the commands, parameters by name, and the example of the README."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from datetime import date
from pathlib import Path

import geopandas as gpd
import numpy as np
import pytest
import rasterio
import shapely
from slopewatch import api
from slopewatch.tests.builders import known_truth
from slopewatch.tests.builders.known_changes import write_clouds, write_models
from slopewatch.tests.builders.planes import write_plane
from slopewatch.tests.builders.program import run

DAYS = ("2024-05-01", "2025-05-01")


@pytest.fixture(scope="module")
def clouds(tmp_path_factory) -> tuple[Path, Path]:
    """Ground of a slope before and after a block of 3 x 3 m rose by 0.3 m."""
    folder = tmp_path_factory.mktemp("clouds")
    first, second = (folder / f"{day}.laz" for day in DAYS)
    write_plane(first, seed=1)
    write_plane(second, seed=2, raised=(8.0, 8.0, 3.0, 0.3))
    return first, second


def test_change_gives_what_the_command_gives(clouds, tmp_path):
    made = api.change(*clouds, tmp_path / "api", cell=0.5, registration_error=0.002)
    options = ["--cell", 0.5, "--registration-error", 0.002, "--progress", "none"]
    done = run("change", *clouds, "--output-dir", tmp_path / "cli", *options)
    assert done.returncode == 0, done.stderr
    with (
        rasterio.open(made.outputs["elevation_change"]) as one,
        rasterio.open(tmp_path / "cli/elevation_change.tif") as two,
    ):
        np.testing.assert_array_equal(one.read(), two.read())
    assert made.figures["zone_count"] == 1
    assert made.outputs["zones"].is_file()


def test_settings_of_a_file_are_overridden_by_arguments(clouds, tmp_path):
    path = tmp_path / "mine.json"
    path.write_text('{"cell": 0.5, "confidence": 0.9}', encoding="utf-8")
    run = api.change(*clouds, tmp_path / "out", settings=path, confidence=0.8)
    record = json.loads(run.outputs["run"].read_text(encoding="utf-8"))
    assert (record["parameters"]["change"]["cell"], record["parameters"]["change"]["confidence"]) == (0.5, 0.8)
    path.write_text('{"cel": 0.5}', encoding="utf-8")
    with pytest.raises(api.InputError, match=r"has cel, which is no setting of this command; it may mean cell\.$"):
        api.change(*clouds, tmp_path / "other", settings=path)


def test_warnings_come_back(clouds, tmp_path):
    run = api.change(*clouds, tmp_path / "out", cell=0.5)
    assert any("registration's error is not known" in warning for warning in run.warnings)


def test_m3c2_takes_polygons_of_stable_ground(clouds, tmp_path):
    """The record names them, as that of the command does."""
    area = tmp_path / "stable.gpkg"
    lower = shapely.box(500_000, 3_500_000, 500_020, 3_500_006)  # below the block
    gpd.GeoDataFrame(geometry=[lower], crs="EPSG:32651").to_file(area)
    given = {"registration_error": 0.002, "projection_scale": 1.0, "normal_scale": 1.5, "core_spacing": 0.5}
    run = api.m3c2(*clouds, tmp_path / "out.laz", stable=area, **given)
    record = json.loads(run.outputs["run"].read_text(encoding="utf-8"))
    assert record["inputs"][-1]["role"] == "stable"
    assert record["inputs"][-1]["path"] == str(area)


def test_displacement_gives_the_motion_of_the_half_that_moved(tmp_path):
    moved = write_clouds(tmp_path)
    made = api.displacement(*moved, tmp_path / "out", ground="as_is", surface_error=0.001)
    with rasterio.open(made.outputs["displacement"]) as raster:
        down = raster.read(raster.descriptions.index("motion down the dip") + 1, masked=True)
        assert (raster.tags()["EPOCH_FROM"], raster.tags()["EPOCH_TO"]) == known_truth.DAYS
    quarter = len(down) // 4
    assert np.ma.median(down[quarter]) == pytest.approx(known_truth.MOTION_M, abs=0.03)
    assert np.ma.median(down[-1 - quarter]) == pytest.approx(0.0, abs=0.03)
    assert made.figures["moving_zone_count"] == 1
    record = json.loads(made.outputs["run"].read_text(encoding="utf-8"))
    assert record["parameters"]["displacement"]["surface_error"] == 0.001
    with pytest.raises(api.InputError, match=r"windows is no parameter here; did you mean window\?"):
        api.displacement(*moved, tmp_path / "other", windows=4.0)


def test_dem_change_takes_off_the_bias_and_leaves_the_pit(tmp_path):
    """Days as keys, which differ from those of the names, go before them."""
    models = write_models(tmp_path)
    made = api.dem_change(dict(zip(("2020-01-01", date(2021, 1, 1)), models)), tmp_path / "out")
    figures = made.figures
    assert figures["bias_m"] == pytest.approx(known_truth.BIAS_M, abs=3.5 * figures["bias_error_m"])
    assert figures["zone_count"] == 1
    volume = known_truth.PIT_M * known_truth.PIT_SIZE_M**2
    assert abs(figures["vol_loss_m3"]) == pytest.approx(abs(volume), abs=3 * figures["vol_loss_err_m3"])
    with rasterio.open(made.outputs["elevation_change"]) as raster:
        assert (raster.tags()["EPOCH_FROM"], raster.tags()["EPOCH_TO"]) == ("2020-01-01", "2021-01-01")
    with pytest.raises(api.InputError, match="overwrite"):
        api.dem_change(models, tmp_path / "out")
    with pytest.raises(api.InputError, match="1 elevation model was given"):
        api.dem_change(models[:1], tmp_path / "other")


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"cel": 0.5}, r"cel is no parameter here; did you mean cell\?"),
        ({"cloth_resolution": 0.5}, "cloth_resolution is no parameter here"),
        ({"cell": -3.0}, "cell is -3.*number from"),
        ({"profile": "mine"}, "profile is 'mine'; give one of default, paper"),
    ],
)
def test_what_is_not_understood_is_refused_in_a_sentence(clouds, tmp_path, parameters, message):
    with pytest.raises(api.InputError, match=message):
        api.change(*clouds, tmp_path / "out", **parameters)
    assert not (tmp_path / "out").exists()


def test_the_api_is_an_attribute_of_the_package_and_loaded_late():
    program = "import slopewatch, sys; assert 'numpy' not in sys.modules; print(slopewatch.api.change.__name__)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout == "change\n", done.stderr


def test_every_promised_name_is_documented():
    for name in api.__all__:
        assert getattr(api, name).__doc__, name


def test_the_example_of_the_readme_runs(root, clouds, tmp_path, monkeypatch):
    text = (root / "README.md").read_text(encoding="utf-8")
    example = re.search(r"```python\n(.*?)```", text, re.DOTALL)
    assert example is not None
    lines = [line for line in example[1].splitlines() if line.strip()]
    assert len(lines) <= 8
    for name, cloud in zip(("may24_ground.laz", "may25_ground.laz"), clouds):
        (tmp_path / name).symlink_to(cloud)
    monkeypatch.chdir(tmp_path)
    done = subprocess.run([sys.executable, "-c", example[1]], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "1 zone" in done.stdout


def test_what_is_drawn_on_and_drawn_goes_round(clouds, tmp_path):
    """From a cloud to its top view, to Label Studio's tasks, and from what is drawn on them to a layer."""
    view = api.top_view(clouds[1], tmp_path / "view", cell=0.5)
    region = api.suggest_roi(clouds[1], tmp_path / "roi.gpkg", region_cell=1.0)
    assert region.figures["area_share"] > 0.9
    given = {"segments": region.outputs["roi"], "label_field": "part"}
    sent = api.export_label_studio(view.outputs["top_view"], tmp_path / "tasks", **given)
    (task,) = json.loads(sent.outputs["tasks"].read_text(encoding="utf-8"))
    export = tmp_path / "export.json"
    annotation = {"id": 1, "completed_by": 1, "result": task["predictions"][0]["result"]}
    export.write_text(json.dumps([{"id": 1, "data": task["data"], "annotations": [annotation]}]), encoding="utf-8")
    api.import_label_studio(export, sent.outputs["tasks"], tmp_path / "labels.gpkg")
    found = gpd.read_file(tmp_path / "labels.gpkg", layer="labels")
    wanted = gpd.read_file(tmp_path / "roi.gpkg", layer="roi")
    assert found.geometry[0].symmetric_difference(wanted.geometry[0]).area < 1e-3
    assert found["reason"].tolist() == wanted["reason"].tolist()
    with pytest.raises(api.InputError, match="cel is no parameter here"):
        api.top_view(clouds[1], tmp_path / "other", cel=0.5)


def test_simulate_writes_surveys_and_series_with_their_truth(tmp_path):
    small = {"points": 4000, "length": 12.0, "height": 8.0, "vegetation": 0.0, "motion": "slump"}
    pair = api.simulate(tmp_path / "pair", **small, motion_amount=0.3)
    assert pair.figures["motions"] == 1
    assert {"reference", "cloud", "truth_motion", "truth_zones"} <= set(pair.outputs)
    zone = gpd.read_file(pair.outputs["truth_zones"]).iloc[0]
    assert np.linalg.norm([zone.east_m, zone.north_m, zone.up_m]) == pytest.approx(0.3, rel=0.1)
    series = api.simulate(tmp_path / "series", series=True, **small, surveys=2, velocities="3")
    assert series.figures["surveys"] == 2
    with pytest.raises(api.InputError):
        api.simulate(tmp_path / "no", motion_amounts=1)
