"""Sums, shares and the rest of a profile of stages."""

from __future__ import annotations

import json

import pytest
from slopewatch.lab.benchmarks import profile
from slopewatch.lab.benchmarks.profile import REST, least, profiled, seconds_of_stages, table, worked


def test_stages_of_one_name_are_summed_and_the_rest_is_what_no_stage_holds():
    stages = [("ground", 3.0), ("registration", 1.5), ("ground", 2.0)]
    record = {"stages": [{"stage": name, "processor_seconds": seconds} for name, seconds in stages]}
    assert seconds_of_stages(record, 8.0) == {"ground": 5.0, "registration": 1.5, REST: 1.5}


def test_of_each_stage_the_least_counts():
    assert least([{"a": 2.0, "b": 1.0}, {"b": 3.0, "a": 1.0}]) == {"a": 1.0, "b": 1.0}


def test_shares_are_of_the_sum():
    found = {row.figure: row.value for row in table("screen", {"read": 1.0, "screening": 2.5, REST: 1.5})}
    assert found["screen: read"] == "1.00 s (20 %)"
    assert found["screen: screening"] == "2.50 s (50 %)"
    assert found["screen: whole"] == "5.00 s"


def test_a_command_that_fails_is_no_figure():
    with pytest.raises(RuntimeError, match="nowhere"):
        worked(["report", "/nowhere"])


def test_each_run_has_an_empty_folder(tmp_path, monkeypatch):
    seconds = iter([5.0, 4.0, 6.0])

    def run(arguments):
        out = arguments[0]
        assert not list(out.iterdir())
        (out / "run.json").write_text(json.dumps({"stages": [{"stage": "read", "processor_seconds": 1.0}]}))
        return next(seconds)

    monkeypatch.setattr(profile, "worked", run)
    found = {row.figure: row.value for row in profiled("x", lambda out: [out], tmp_path, "run.json")}
    assert found == {"x: read": "1.00 s (25 %)", f"x: {REST}": "3.00 s (75 %)", "x: whole": "4.00 s"}
