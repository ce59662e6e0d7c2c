"""The run record tells what ran, in names that hold after the run."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import subprocess
import sys
import time

import pytest
from slopewatch.engine.core import run_record
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.run_record import RunRecord
from slopewatch.interface.parameters import ChangeParameters


def test_paths_are_told_from_the_folder_of_the_record(tmp_path):
    part, final = tmp_path / ".part", tmp_path / "out"
    part.mkdir()
    record = RunRecord("x", {"change": ChangeParameters()})
    with record.stage("ground") as entry:
        entry["epochs"] = [{"ground": str(part / "clouds" / "a.laz"), "source": str(tmp_path / "a.laz")}]
    outputs = {"ground": final / "clouds" / "a.laz", "run": final / "run.json", "transform": tmp_path / "t.json"}
    record.write(part / "run.json", [], outputs)
    document = json.loads((part / "run.json").read_text())
    assert document["outputs"] == {
        "ground": "clouds/a.laz",
        "run": "run.json",
        "transform": str(tmp_path / "t.json"),
    }
    told = document["stages"][0]["epochs"][0]
    assert told["ground"].replace("\\", "/") == "clouds/a.laz"
    assert told["source"] == str(tmp_path / "a.laz")


def test_a_stage_tells_what_processors_worked_children_included():
    record = RunRecord("x", {})
    with record.stage("idle"):
        time.sleep(0.1)
    with record.stage("busy"):
        subprocess.run([sys.executable, "-c", "while __import__('time').process_time() < 0.3: pass"], check=True)
    idle, busy = record.stages
    assert idle["seconds"] >= 0.1 > 0.05 > idle["processor_seconds"]
    assert 0.25 <= busy["processor_seconds"] < 5.0  # the system counts in steps


def test_inputs_are_hashed_folders_too(tmp_path):
    (tmp_path / "a.gdb").mkdir()
    (tmp_path / "a.gdb" / "a2.gdbtable").write_bytes(b"two")
    (tmp_path / "a.gdb" / "a1.gdbtable").write_bytes(b"one")
    record = RunRecord("x", {})
    assert record.add_input("roi", tmp_path / "a.gdb") == hashlib.sha256(b"onetwo").hexdigest()
    assert record.inputs[0]["bytes"] == 6


def test_an_input_that_does_not_exist_is_the_users_error(tmp_path):
    with pytest.raises(InputError, match=r"none\.gpkg' does not exist"):
        RunRecord("x", {}).add_input("roi", tmp_path / "none.gpkg")


def test_versions_of_what_decides_the_results_and_of_what_is_missing(monkeypatch):
    assert run_record.versions()["scipy"] == importlib.metadata.version("scipy")
    monkeypatch.setattr(run_record, "_LIBRARIES", ("no-such-library",))
    assert run_record.versions()["no-such-library"] == "not installed"
