"""``slopewatch series`` as users start it."""

from __future__ import annotations

import json
from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS
from slopewatch.interface.parameters import SeriesParameters
from slopewatch.tests.builders.program import run

DAYS = ("2024-01-01", "2024-02-01", "2024-03-01")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Slopes of 10 by 10 m whose middle sinks by 0.1 m from survey to survey."""
    folder = tmp_path_factory.mktemp("it's a slope, ä")
    for number, day in enumerate(DAYS):
        rng = np.random.default_rng(number)
        u, v = rng.uniform(0, 10, (2, 8000))
        square = (np.abs(u - 5) < 1.5) & (np.abs(v - 5) < 1.5)
        header = laspy.LasHeader(point_format=6, version="1.4")
        header.scales, header.offsets = [0.001] * 3, [500_000, 3_500_000, 0]
        header.add_crs(CRS.from_epsg(32651))
        las = laspy.LasData(header)
        las.x, las.y = 500_000 + u, 3_500_000 + v
        las.z = 50 + 0.5 * v + rng.normal(0, 0.01, u.size) - 0.1 * number * square
        las.return_number = las.number_of_returns = np.ones(u.size, dtype=np.uint8)
        las.write(folder / f"{day}.laz")
    return folder


def test_cells_grow_by_default(folder, tmp_path):
    done = run(
        "series", folder, "--ground-ready", "--method", "none", "--no-displacement", "--output-dir", tmp_path / "a"
    )
    assert done.returncode == 0, done.stderr
    record = json.loads((tmp_path / "a" / "run.json").read_text())
    assert record["parameters"]["change"]["adaptive"] is True
    assert record["coverage"][-1]["compared_share"] > 0.95


def test_folder_in_results_out(folder, tmp_path):
    done = run(
        "series",
        folder,
        "--ground-ready",
        "--method",
        "none",
        "--cell",
        0.5,
        "--output-dir",
        tmp_path / "a",
        "--progress",
        "json",
    )
    assert done.returncode == 0, done.stderr
    events = [json.loads(line) for line in done.stdout.splitlines()]
    percents = [e["percent"] for e in events if e["event"] == "progress"]
    assert percents == sorted(percents)
    result = events[-1]
    assert result["event"] == "result"
    assert result["metrics"]["zone_count"] == 1
    metrics = result["metrics"]  # vertical edges are no sharper than a cell: area and mean are not the square's
    assert metrics["fastest_rate_mm_day"] * metrics["zone_area_m2"] == pytest.approx(9 * 1000 * 0.2 / 60, rel=0.1)
    assert 9.0 <= metrics["zone_area_m2"] < 14.0
    assert {"alerts_used", "report", "run"} <= set(result["outputs"])
    assert all(Path(p).stat().st_size > 0 for p in result["outputs"].values())
    said = [e["message"] for e in events if e["event"] == "log"]
    assert any("this screens trends, it is no alarm" in s for s in said)


def test_wrong_use_is_one_sentence(folder, tmp_path):
    out = tmp_path / "out"
    epoch = f"{DAYS[0]}={folder / DAYS[0]}.laz"
    for arguments, sentence in (
        ((), "Give either a folder or manifest"),
        ((folder, "--epoch", epoch), "Give either a folder or manifest"),
        (("--epoch", epoch), "One survey was given"),
    ):
        done = run("series", *arguments, "--output-dir", out)
        assert done.returncode == 2, sentence
        assert sentence in done.stderr
        assert len(done.stderr.strip().splitlines()) == 1
        assert not out.exists()


def test_help_shows_every_parameter():
    shown = " ".join(run("parameters", "series").stdout.split())
    for specification in SeriesParameters.specifications():
        assert f"--{specification.option}" in shown
    shown = " ".join(run("series", "--help").stdout.split())
    assert "FOLDER" in shown
    assert "it is no alarm" in shown
