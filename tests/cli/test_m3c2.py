"""``slopewatch m3c2`` as users start it."""

from __future__ import annotations

import json
from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS
from slopewatch.interface.parameters import DistanceParameters
from slopewatch.tests.builders.program import run


@pytest.fixture(scope="module")
def pair(tmp_path_factory) -> list[Path]:
    """A slope of 45 degrees, lowered by 0.2 m along its normal in the later survey's western half."""
    folder, paths = tmp_path_factory.mktemp("pair"), []
    for seed, (name, lowered) in enumerate((("2024-05-01", 0.0), ("2025-05-01", 0.2))):
        rng = np.random.default_rng(seed)
        u, v = rng.uniform(0, 10, (2, 9000))
        out = rng.normal(0, 0.01, 9000) - np.where(u < 5, lowered, 0.0)
        las = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
        las.header.scales, las.header.offsets = [0.001] * 3, [500_000, 3_500_000, 0]
        las.header.add_crs(CRS.from_epsg(32651))
        las.x, las.y, las.z = 500_000 + u, 3_500_000 + (v - out) / np.sqrt(2), 50 + (v + out) / np.sqrt(2)
        paths.append(folder / f"{name}.laz")
        las.write(paths[-1])
    return paths


def test_help_shows_every_parameter():
    shown = " ".join(run("parameters", "m3c2").stdout.split())
    for specification in DistanceParameters.specifications():
        assert f"--{specification.option}" in shown
    for option in ("--output", "--output-dir", "--core", "--transform", "--stable", "--epoch-from", "--epoch-to"):
        assert option in shown
    assert "Ground that slides along the surface is not detected" in " ".join(run("m3c2", "--help").stdout.split())


def test_progress_result_and_outputs(pair, tmp_path):
    given = ("--output-dir", tmp_path / "maps", "--core-spacing", 0.4, "--progress", "json")
    done = run("m3c2", *pair, "--output", tmp_path / "points.laz", "--registration-error", 0.01, *given)
    assert done.returncode == 0, done.stderr
    events = [json.loads(line) for line in done.stdout.splitlines()]
    percents = [e["percent"] for e in events if e["event"] == "progress"]
    assert percents == sorted(percents)
    assert percents[-1] == 100
    result = events[-1]
    maps = {f"m3c2_{name}" for name in ("distance", "level_of_detection", "significant", "zones", "volumes", "face")}
    assert set(result["outputs"]) == {"points", "run", "report"} | maps
    for path in result["outputs"].values():
        assert Path(path).stat().st_size > 0
    assert Path(result["outputs"]["m3c2_distance"]).parent == tmp_path / "maps"
    las = laspy.read(tmp_path / "points.laz")
    west = np.asarray(las.x) < 500_004
    assert np.nanmedian(np.asarray(las["m3c2_distance"])[west]) == pytest.approx(-0.2, abs=0.003)
    assert result["metrics"]["largest_lowering_m"] == pytest.approx(-0.2, abs=0.03)
    assert result["metrics"]["lod_median_m"] > 1.96 * 0.01


def test_a_refusal_is_one_sentence_and_leaves_nothing(pair, tmp_path):
    done = run("m3c2", pair[0], pair[0], "--output", tmp_path / "out.laz")
    assert done.returncode == 2
    assert "the same" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    done = run("m3c2", *pair, "--output", tmp_path / "out.laz", "--minimum-cylinder-points", 1)
    assert done.returncode == 2
    assert "minimum_cylinder_points is 1; give a whole number from 2 to 100000" in done.stderr
    assert list(tmp_path.iterdir()) == []
