"""Outputs appear whole or not at all."""

from __future__ import annotations

import os

import pytest
from slopewatch.engine.errors import EngineError, InputError
from slopewatch.engine.outputs import atomic_output, refuse_inputs_as_outputs, refuse_unwritable, staged_outputs


def write_and_fail(path):
    path.write_text("half")
    raise RuntimeError


def test_a_failing_writer_leaves_the_old_file_and_nothing_else(tmp_path):
    target = tmp_path / "a.txt"
    target.write_text("old")
    with pytest.raises(RuntimeError), atomic_output(target) as partial:
        write_and_fail(partial)
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
    assert target.read_text() == "old"


def test_an_output_that_fails_its_check_is_not_kept(tmp_path):
    def check(path):
        raise EngineError("unsound")

    with pytest.raises(EngineError, match="unsound"), atomic_output(tmp_path / "a.tif", check) as partial:
        partial.with_suffix(".tif").write_text("x")
    assert not list(tmp_path.iterdir())


def test_a_writer_that_writes_nothing_is_an_error(tmp_path):
    with pytest.raises(EngineError), atomic_output(tmp_path / "a.tif"):
        pass


def test_staged_outputs_come_all_together_with_the_record_last(tmp_path, monkeypatch):
    order = []
    replace = os.replace
    monkeypatch.setattr(os, "replace", lambda a, b: (order.append(os.path.basename(b)), replace(a, b)))
    out = tmp_path / "deep" / "out"
    with staged_outputs(out) as stage:
        for name in ("run.json", "zones.gpkg", "clouds/a.laz"):
            stage.path(name).write_text(name)
        assert not (out / "run.json").exists()
    assert order[-1] == "run.json"
    assert sorted(str(p.relative_to(out)) for p in out.rglob("*") if p.is_file()) == [
        "clouds/a.laz",
        "run.json",
        "zones.gpkg",
    ]
    assert [p.name for p in out.iterdir() if p.name.startswith(".")] == []


def test_a_failed_run_removes_the_folders_it_made_and_only_those(tmp_path):
    kept = tmp_path / "kept"
    kept.mkdir()
    with pytest.raises(RuntimeError), staged_outputs(kept / "new" / "out") as stage:
        write_and_fail(stage.path("a"))
    assert kept.is_dir()
    assert not list(kept.iterdir())


def test_output_equal_to_an_input_is_refused_also_through_a_link(tmp_path):
    cloud = tmp_path / "a.laz"
    cloud.write_text("x")
    link = tmp_path / "b.laz"
    link.symlink_to(cloud)
    with pytest.raises(InputError, match="also an input"):
        refuse_inputs_as_outputs([link], [cloud])
    refuse_inputs_as_outputs([tmp_path / "c.laz"], [cloud])


def test_places_that_cannot_be_written_are_refused_before_any_work(tmp_path):
    (tmp_path / "file").write_text("x")
    for path in (tmp_path / "missing" / "a.laz", tmp_path, tmp_path / "file" / "a.laz"):
        with pytest.raises(InputError):
            refuse_unwritable(path)
    with pytest.raises(InputError), staged_outputs(tmp_path / "file" / "out"):
        pass
    assert (tmp_path / "file").read_text() == "x"
