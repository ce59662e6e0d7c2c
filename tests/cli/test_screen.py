"""``slopewatch screen`` as users start it."""

from __future__ import annotations

import json
import signal
import subprocess
from pathlib import Path

import pytest
from slopewatch.interface.parameters import ScreeningParameters
from slopewatch.tests.builders.limits import PATIENCE_S
from slopewatch.tests.builders.program import COMMAND, run
from slopewatch.tests.builders.screening_clouds import slope, write


@pytest.fixture(scope="module")
def cloud(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("slope") / "slope.laz", slope())


def test_help_shows_every_parameter():
    shown = " ".join(run("parameters", "screen").stdout.split())
    for specification in ScreeningParameters.specifications():
        assert f"--{specification.option}" in shown
    for option in ("--output", "--zones", "--raster", "--smallest-hazard", "--map", "--roi", "--method"):
        assert option in shown


def test_progress_result_and_outputs(cloud, tmp_path):
    zones = tmp_path / "hazards.gpkg"
    given = ("--method", "residual", "--zones", zones, "--progress", "json", "--minimum-hazard-area", 2)
    done = run("screen", cloud, "--output", tmp_path / "out.laz", *given)
    assert done.returncode == 0, done.stderr
    events = [json.loads(line) for line in done.stdout.splitlines()]
    percents = [e["percent"] for e in events if e["event"] == "progress"]
    assert percents == sorted(percents)
    assert percents[-1] == 100
    result = events[-1]
    assert result["outputs"]["zones"] == str(zones)
    for path in result["outputs"].values():
        assert Path(path).stat().st_size > 0
    record = json.loads((tmp_path / "out_run.json").read_text())
    assert record["metrics"] == result["metrics"]
    assert record["metrics"]["zone_count"] == 2
    assert record["parameters"]["screening"]["screening_method"] == "residual"
    assert record["parameters"]["screening"]["minimum_hazard_area"] == 2
    assert record["outputs"]["zones"] == "hazards.gpkg"


def test_a_refusal_is_one_sentence_and_leaves_nothing(tmp_path):
    flat = write(tmp_path / "flat.laz", slope(8000, dip=3.0))
    done = run("screen", flat, "--screening-method", "residual", "--output", tmp_path / "out.laz")
    assert done.returncode == 2
    assert done.stderr.strip().splitlines()[-1].startswith(f"Error: '{flat}' is no slope")
    assert "Traceback" not in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["flat.laz"]


def test_a_cancelled_run_leaves_nothing(cloud, tmp_path):
    child = subprocess.Popen(
        [*COMMAND, "screen", cloud, "--method", "residual", "--output", tmp_path / "out.laz", "--progress", "json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        stdin=subprocess.DEVNULL,
        text=True,
    )
    assert child.stdout is not None
    assert "progress" in child.stdout.readline()
    assert any(p.name.startswith(".slopewatch-part") for p in tmp_path.iterdir())
    child.send_signal(signal.SIGTERM)
    _, errors = child.communicate(timeout=PATIENCE_S)
    assert child.returncode == 130, errors
    assert list(tmp_path.iterdir()) == []
