"""`simulate series`: what it writes is a series, and its velocities are found again."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import geopandas
import numpy as np
import pytest
import rasterio
from affine import Affine
from rasterio.features import geometry_mask
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.interface.parameters import CreepParameters
from slopewatch.tests.builders.program import run
from slopewatch.workflows.simulate import creep_laws, series_step

SMALL = ["--points", "26000", "--length", "20", "--height", "7", "--surveys", "5", "--vegetation", "0.2"]


def simulate(*arguments: str) -> None:
    done = run("simulate", "series", *arguments)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("creep")
    simulate("--velocities", "-10, 4", "--ground-only", *SMALL, "--output-dir", str(folder / "s"))
    return folder / "s"


def test_it_writes_dated_clouds_a_manifest_and_the_truth(folder):
    with (folder / "surveys.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [r["date"] for r in rows] == ["2024-05-01", "2024-05-31", "2024-06-30", "2024-07-30", "2024-08-29"]
    assert all((folder / r["path"]).is_file() for r in rows)
    truth = json.loads((folder / "truth.json").read_text())
    # rest for 15 of the 120 days
    assert [m["displacement_m"][-1] for m in truth["motions"]] == [pytest.approx(-1.05), pytest.approx(0.42)]
    with rasterio.open(folder / "truth_velocity.tif") as raster:
        velocity = raster.read(1)
        assert raster.units == ("mm/day",)
        # in the middle of a zone a cell's mean is little less than the velocity there
        assert -10 <= velocity.min() < -9.5
        assert 3.8 < velocity.max() <= 4
        assert np.mean(velocity == 0) > 0.5
    record = json.loads((folder / "run.json").read_text())
    assert record["command"] == "simulate series"
    assert record["metrics"]["surveys"] == 5


@pytest.mark.parametrize("source", ["surveys.csv", "."])
def test_a_series_of_them_holds_the_velocities_in_its_intervals(folder, source, tmp_path):
    given = ("--roi", folder / "roi.gpkg", "--ground-ready", "--cell", 0.25, "--output-dir", tmp_path / "out")
    done = run("series", folder / source, *given)
    assert done.returncode == 0, done.stderr
    zones = geopandas.read_file(tmp_path / "out" / "series.gpkg", layer="zones")
    assert sorted(zones["kind"]) == ["subsidence", "uplift"]
    with rasterio.open(folder / "truth_velocity.tif") as truth, rasterio.open(tmp_path / "out/velocity.tif") as found:
        known = found.read_masks(1) > 0
        for _, zone in zones.iterrows():
            measured = geometry_mask([zone.geometry], known.shape, Affine(*found.transform), invert=True) & known
            rows, columns = np.nonzero(measured)
            x, y = found.transform * (columns + 0.5, rows + 0.5)
            true = float(np.mean([value[0] for value in truth.sample(np.column_stack([x, y]))]))
            assert abs(true) > 1
            assert zone["rate_low"] <= true <= zone["rate_high"]


def test_the_same_seed_gives_the_same_bytes(folder, tmp_path):
    simulate("--velocities", "-10, 4", "--ground-only", *SMALL, "--output-dir", str(tmp_path / "s"))
    for name in ("2024-08-29.laz", "surveys.csv", "truth.json", "truth_velocity.tif", "roi.gpkg"):
        assert (tmp_path / "s" / name).read_bytes() == (folder / name).read_bytes(), name


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"velocities": "fast"}, "velocities is 'fast'; give numbers"),
        ({"velocities": "1, nan"}, "velocities is '1, nan'"),
        ({"velocities": "1,1,1,1,1,1,1,1"}, "names 8 zones, which need 38 m of slope"),
        ({"velocities": "-400"}, r"would move by 54\.0 m"),
        ({"height": 2.0}, r"is 2\.5 m wide on the map"),
    ],
)
def test_what_makes_no_series_is_refused(values, words, tmp_path):
    with pytest.raises(InputError, match=words):
        series_step(CreepParameters(**values), tmp_path / "out", Progress())
    assert not (tmp_path / "out").exists()


def test_a_slope_at_rest_is_a_series_too():
    assert creep_laws(CreepParameters(velocities="")) == ()


def test_zones_that_move_along_the_surface_have_true_vectors(tmp_path):
    simulate(
        "--motion", "creep", "--velocities", "4, 2", *SMALL, "--points", "6000", "--output-dir", str(tmp_path / "s")
    )
    ways = [tmp_path / "s" / f"truth_motion_{day}.tif" for day in ("2024-05-31", "2024-08-29")]
    lengths = []
    for path in ways:
        with rasterio.open(path) as raster:
            lengths.append(np.nanmax(np.sqrt((raster.read(masked=True).filled(np.nan) ** 2).sum(axis=0))))
    # rest for 15 of the 120 days
    assert lengths == [pytest.approx(0.004 * 15, rel=0.02), pytest.approx(0.004 * 105, rel=0.02)]
    with rasterio.open(tmp_path / "s/truth_velocity.tif") as raster:
        assert raster.count == 3
        speed = np.sqrt((raster.read(masked=True).filled(np.nan) ** 2).sum(axis=0))
    assert np.nanmax(speed) == pytest.approx(4.0, rel=0.02)


def test_motion_that_would_fold_the_ground_is_refused_with_what_is_possible(tmp_path):
    done = run(
        "simulate", "survey", "--motion", "translation", "--motion-amount", "2", "--output-dir", str(tmp_path / "s")
    )
    assert done.returncode == 2
    assert "at most 0.76 m" in done.stderr
    assert not (tmp_path / "s").exists()
