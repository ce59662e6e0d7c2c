"""Outputs appear whole or not at all."""

from __future__ import annotations

import os
import shutil

import pytest
from slopewatch.engine.core.errors import EngineError, InputError
from slopewatch.engine.core.staged_outputs import (
    atomic_output,
    refuse_inputs_as_outputs,
    refuse_other_than_cloud,
    refuse_unwritable,
    staged_outputs,
)


def write_and_fail(path):
    path.write_text("half")
    raise RuntimeError


def write_new(stage, *names):
    for name in names:
        stage.path(name).write_text("new")


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
    assert order[-2:] == ["run.json", ".done"]
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


def test_an_output_that_cannot_be_replaced_leaves_the_earlier_run_as_it_was(tmp_path, monkeypatch):
    for name in ("a.tif", "c.tif", "run.json"):
        (tmp_path / name).write_text("old")
    replace = os.replace

    def locked(source, target):
        if os.path.basename(source) == "c.tif":
            raise PermissionError(13, "Permission denied")
        replace(source, target)

    monkeypatch.setattr(os, "replace", locked)
    with pytest.raises(InputError, match=r"c\.tif cannot be replaced"), staged_outputs(tmp_path) as stage:
        write_new(stage, "a.tif", "b.tif", "c.tif", "run.json")
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == dict.fromkeys(("a.tif", "c.tif", "run.json"), "old")


def discard_and(stage, work):
    stage.discard("rest.gpkg")
    work()


def test_what_a_run_discards_goes_with_its_end_and_stays_when_it_fails(tmp_path, monkeypatch):
    (tmp_path / "rest.gpkg").write_text("old")
    with pytest.raises(RuntimeError), staged_outputs(tmp_path) as stage:
        discard_and(stage, lambda: write_and_fail(stage.path("a")))
    assert (tmp_path / "rest.gpkg").read_text() == "old"
    replace = os.replace

    def locked(source, target):
        if os.path.basename(target) == "run.json":
            raise PermissionError(13, "Permission denied")
        replace(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", locked)
        with pytest.raises(InputError), staged_outputs(tmp_path) as stage:
            discard_and(stage, lambda: write_new(stage, "run.json"))
    assert [p.name for p in tmp_path.iterdir()] == ["rest.gpkg"]
    with staged_outputs(tmp_path) as stage:
        stage.discard("rest.gpkg")
        stage.discard("never there")
        write_new(stage, "run.json")
    assert [p.name for p in tmp_path.iterdir()] == ["run.json"]


def test_what_a_program_wrote_beside_an_open_file_goes_with_that_file(tmp_path):
    """SQLite would read the log of the replaced file into the new one."""
    for name in ("zones.gpkg", "zones.gpkg-wal", "zones.gpkg-shm", "mine.gpkg-wal"):
        (tmp_path / name).write_text("old")
    with staged_outputs(tmp_path) as stage:
        write_new(stage, "zones.gpkg")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mine.gpkg-wal", "zones.gpkg"]


def test_a_folder_in_the_place_of_an_output_is_named_and_nothing_is_moved(tmp_path):
    (tmp_path / "zones.gpkg").mkdir()
    with pytest.raises(InputError, match=r"zones\.gpkg is a folder"), staged_outputs(tmp_path) as stage:
        write_new(stage, "a.tif", "zones.gpkg")
    assert [p.name for p in tmp_path.iterdir()] == ["zones.gpkg"]


def test_a_full_disk_is_called_so_whatever_the_writer_says(tmp_path, monkeypatch):
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=20_000))
    told = r"0\.0 MB left; free some space .*done of LASwritePoint failed"
    with pytest.raises(InputError, match=told), staged_outputs(tmp_path / "out"):
        raise EngineError("writers.las: done of LASwritePoint failed")
    assert not list(tmp_path.iterdir())
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=10**12))
    with pytest.raises(EngineError, match=r"^a bug$"), staged_outputs(tmp_path / "out"):
        raise EngineError("a bug")


def test_two_outputs_of_one_name_are_refused(tmp_path):
    with pytest.raises(InputError, match="Two outputs"):
        refuse_inputs_as_outputs([tmp_path / "a.laz", tmp_path / "b" / ".." / "a.laz"], [])


def test_only_clouds_are_called_clouds(tmp_path):
    refuse_other_than_cloud(tmp_path / "a.LAZ")
    for name in ("a.tif", "a", "a.laz.txt"):
        with pytest.raises(InputError, match=r"\.laz or \.las"):
            refuse_other_than_cloud(tmp_path / name)


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
