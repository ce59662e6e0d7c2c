"""Thresholds, direction and known stable ground from the command line to rasters, warnings and the run record."""

from __future__ import annotations

import json
from pathlib import Path

import geopandas
import numpy as np
import pytest
import rasterio
import shapely
from slopewatch.tests.builders.clouds import write_sunk_slope
from slopewatch.tests.builders.program import run


@pytest.fixture(scope="module")
def clouds(tmp_path_factory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("clouds")
    return write_sunk_slope(folder / "2024-05-01.laz"), write_sunk_slope(folder / "2025-05-01.laz", lowered=0.2)


def polygon(path: Path, west: float, east: float) -> Path:
    box = shapely.box(500_000 + west, 3_500_000, 500_000 + east, 3_500_012)
    geopandas.GeoDataFrame(geometry=[box], crs=32651).to_file(path)
    return path


def changed(clouds, out: Path, *options: object) -> dict:
    done = run("change", *clouds, "--output-dir", out, "--cell", 0.25, "--registration-error", 0.0, *options)
    assert done.returncode == 0, done.stderr
    return json.loads((out / "run.json").read_text())


def read(out: Path, name: str) -> tuple[np.ndarray, str, str]:
    with rasterio.open(out / f"{name}.tif") as source:
        return source.read(1, masked=True).filled(np.nan), source.descriptions[0], source.units[0]


def test_known_stable_ground_and_the_normal_direction_reach_the_outputs(clouds, tmp_path):
    known = polygon(tmp_path / "known.gpkg", 6, 12)
    options = ("--stable", known, "--threshold", "coherent", "--direction", "normal")
    document = changed(clouds, tmp_path / "out", *options)
    record = document["level_of_detection"]
    assert (record["threshold"], record["error_model"], record["direction"]) == ("coherent", "calibrated", "normal")
    level, _, _ = read(tmp_path / "out", "level_of_detection")
    assert record["level_median_m"] == pytest.approx(np.nanmedian(level), rel=1e-5)
    assert 0.4 < record["stable_share"] < 0.6, "the eastern half is known to be stable"
    assert sum(c["cells"] for c in record["slope_classes"]) == record["stable_cells"]
    assert all(0.03 <= c["exceedance"] <= 0.07 for c in record["slope_classes"])
    assert [entry["role"] for entry in document["inputs"]][-1] == "stable"
    dz, description, unit = read(tmp_path / "out", "elevation_change")
    assert (description, unit) == ("Slope-normal change, later minus earlier", "m")
    assert np.nanpercentile(dz, 10) == pytest.approx(-0.2 * np.cos(np.arctan(0.5)), abs=0.01)
    probability, _, unit = read(tmp_path / "out", "change_probability")
    assert unit == "1"
    significant, _, _ = read(tmp_path / "out", "significant_change")
    assert np.array_equal(np.isfinite(significant), np.nan_to_num(probability) > 0.95)


def test_an_unknown_threshold_is_refused_before_any_work(clouds, tmp_path):
    done = run("change", *clouds, "--output-dir", tmp_path / "out", "--threshold", "clever")
    assert done.returncode == 2
    assert "probabilistic" in done.stderr
    assert not (tmp_path / "out").exists()
