"""``--settings``: a former run's settings, overridden by what is given with the run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from slopewatch.cli.options import _with_settings
from slopewatch.cli.reporting import Reporter
from slopewatch.interface.parameters import ParameterError, command_sets
from slopewatch.tests.builders.clouds import write_sunk_slope
from slopewatch.tests.builders.program import run


def used(path: Path | None, profile: str | None = None, **values: Any) -> tuple[dict[str, Any], str, list[str]]:
    report, said = Reporter(), []
    report.show = lambda _, message: said.append(message)  # type: ignore[method-assign]
    return *_with_settings(path, command_sets.CHANGE, values, profile, report), said


def test_given_values_override_the_file_and_the_file_the_profile(tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    path.write_text(json.dumps({"cell": 0.4, "confidence": 0.9, "minimum_points": 1, "profile": "paper"}))
    values, profile, said = used(path, cell=0.2, confidence=None)
    assert ({n: v for n, v in values.items() if v is not None}, profile) == ({"cell": 0.2, "confidence": 0.9}, "paper")
    assert said == [f"Settings of '{path}': confidence 0.9."]
    values, profile, _ = used(path, profile="default")
    assert (values["cell"], profile) == (0.4, "default")
    assert used(None, cell=None)[:2] == ({"cell": None}, "default")


def test_a_value_that_cannot_be_used_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    path.write_text('{"cell": 0}')
    assert used(path)[0] == {}, "0 stands for auto"
    path.write_text('{"confidence": 2}')
    with pytest.raises(ParameterError, match="confidence is 2"):
        used(path)


def test_a_run_is_repeated_with_its_record(tmp_path: Path) -> None:
    clouds = write_sunk_slope(tmp_path / "2024-05-01.laz"), write_sunk_slope(tmp_path / "2025-05-01.laz", lowered=0.2)
    done = run("change", *clouds, "--output-dir", tmp_path / "a", "--cell", 0.5, "--minimum-area", 3)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert 3 <= len(lines) <= 8
    assert lines[0].startswith("1 zone of significant change was found: ")
    assert all(line.endswith(".") for line in lines)
    assert "compared_share" not in done.stdout
    record = tmp_path / "a" / "run.json"
    again = run(
        "change", *clouds, "--output-dir", tmp_path / "b", "--settings", record, "--cell", 1, "--progress", "json"
    )
    assert again.returncode == 0, again.stderr
    result = json.loads(again.stdout.splitlines()[-1])
    parameters = json.loads((tmp_path / "b" / "run.json").read_text())["parameters"]
    assert (parameters["change"]["cell"], parameters["zones"]["minimum_area"]) == (1.0, 3.0)
    assert 3 <= len(result["conclusion"]) <= 8
    assert "compared_share" in result["metrics"]
    refused = run("change", *clouds, "--output-dir", tmp_path / "c", "--settings", tmp_path / "none.json")
    assert (refused.returncode, refused.stderr) == (
        2,
        f"Error: {tmp_path / 'none.json'} does not exist; give a run.json, or a JSON or TOML file of settings.\n",
    )
    assert not (tmp_path / "c").exists()


def test_set_overrides_the_file_and_an_option_overrides_set(tmp_path: Path) -> None:
    clouds = write_sunk_slope(tmp_path / "2024-05-01.laz"), write_sunk_slope(tmp_path / "2025-05-01.laz", lowered=0.2)
    (tmp_path / "mine.toml").write_text("cell = 1\nconfidence = 0.9\nminimum_area = 4\n")
    words = ("--settings", tmp_path / "mine.toml", "--set", "change.cell=0.5", "--set", "confidence=0.8")
    done = run("change", *clouds, "--output-dir", tmp_path / "a", *words, "--confidence", 0.7)
    assert done.returncode == 0, done.stderr
    parameters = json.loads((tmp_path / "a" / "run.json").read_text())["parameters"]
    change, zones = parameters["change"], parameters["zones"]
    assert (change["cell"], change["confidence"], zones["minimum_area"]) == (0.5, 0.7, 4.0)
    refused = run("change", *clouds, "--output-dir", tmp_path / "b", "--set", "cel=1")
    assert (refused.returncode, refused.stderr) == (
        2, "Error: --set cel=1 names no parameter of this command; it may mean cell.\n",
    )  # fmt: skip
