"""Finding PDAL in the order that is promised, and running pipelines whatever the files are called."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import laspy
import numpy as np
import pytest
from slopewatch.engine.core.errors import EngineError, InputError
from slopewatch.engine.pointcloud import pdal_program as module
from slopewatch.engine.pointcloud.pdal_program import NO_PDAL, Pdal, find_pdal, keep_pipeline, time_limit_s
from slopewatch.tests.builders.extracted_ground import any_pdal
from slopewatch.tests.builders.limits import PATIENCE_S

pytestmark = pytest.mark.skipif(os.name != "posix", reason="the programs that stand in for PDAL are shell scripts")


def program(path: Path, version: str, exit_code: int = 0) -> Path:
    """A program that says it is PDAL of a version."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\necho 'pdal {version} (git-version: abc)'\nexit {exit_code}\n")
    path.chmod(0o755)
    return path


@pytest.fixture
def bare(tmp_path, monkeypatch) -> Path:
    """No PDAL anywhere: an empty PATH but for the shell, no variable, no private prefix, no Python package."""
    monkeypatch.delenv(module.VARIABLE, raising=False)
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    for name in ("SLOPEWATCH_QGIS", "CONDA_PREFIX"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(module, "PRIVATE", tmp_path / "private" / "pdal")
    monkeypatch.setattr(module.importlib.util, "find_spec", lambda name: None)
    module._find.cache_clear()
    yield tmp_path
    module._find.cache_clear()


@pytest.fixture(scope="session")
def real_pdal() -> Pdal:
    return any_pdal()


def test_the_setting_comes_before_the_variable_and_the_variable_before_the_rest(bare, monkeypatch):
    program(bare / "bin" / "pdal", "2.9.1")
    named = program(bare / "named" / "mine", "2.3.0")
    setting = program(bare / "chosen" / "pdal", "2.4.0")
    monkeypatch.setenv(module.VARIABLE, str(named))
    assert (find_pdal().version, find_pdal().path) == ("2.3.0", named)
    assert module.VARIABLE in find_pdal().how
    for variable in (str(named), "none"):
        monkeypatch.setenv(module.VARIABLE, variable)
        assert (find_pdal(setting).version, find_pdal(setting).how) == ("2.4.0", "setting")


@pytest.mark.parametrize(
    ("on_path", "private", "expected"),
    [
        ("2.9.1", "2.2.0", "PATH"),
        ("2.2.0", "2.2.0", "PATH"),
        ("2.10.0", "2.9.3", "PATH"),
        ("2.1.0", "2.2.0", "private"),
    ],
)
def test_of_the_one_on_path_and_the_private_one_the_newer_is_taken(bare, on_path, private, expected):
    program(bare / "bin" / "pdal", on_path)
    program(bare / "private" / "pdal", private)
    assert expected in find_pdal().how


def test_what_came_with_qgis_and_conda_is_found(bare, monkeypatch):
    program(bare / "qgis" / "bin" / "pdal", "2.5.0")
    program(bare / "conda" / "bin" / "pdal", "2.6.0")
    monkeypatch.setenv("SLOPEWATCH_QGIS", str(bare / "qgis"))
    assert (find_pdal().version, find_pdal().how) == ("2.5.0", "came with QGIS")
    monkeypatch.setenv("CONDA_PREFIX", str(bare / "conda"))
    assert (find_pdal().version, find_pdal().how) == ("2.6.0", "conda"), "the newest"
    program(bare / "bin" / "pdal", "2.6.0")
    module._find.cache_clear()
    assert find_pdal().how == "PATH", "the first of equals"


def test_one_on_path_that_does_not_start_is_passed_over(bare):
    program(bare / "bin" / "pdal", "2.9.1", exit_code=127)
    program(bare / "private" / "pdal", "2.2.0")
    assert "private" in find_pdal().how


@pytest.mark.parametrize("how", ["variable", "setting"])
def test_an_explicit_one_that_does_not_start_is_an_error_that_names_it(bare, monkeypatch, how):
    program(bare / "bin" / "pdal", "2.9.1")
    broken = program(bare / "broken" / "pdal", "2.9.1", exit_code=1)
    if how == "variable":
        monkeypatch.setenv(module.VARIABLE, str(broken))
    with pytest.raises(InputError, match=r"broken/pdal.*does not start"):
        find_pdal(broken)


def test_there_may_be_none_and_one_may_do_without(bare, monkeypatch):
    assert find_pdal() == NO_PDAL
    assert not NO_PDAL.is_there
    assert not NO_PDAL.has_csf
    program(bare / "bin" / "pdal", "2.9.0")
    module._find.cache_clear()
    assert find_pdal().is_there
    monkeypatch.setenv("SLOPEWATCH_PDAL", "none")
    assert not find_pdal().is_there
    assert "SLOPEWATCH_PDAL" in find_pdal().how


@pytest.mark.parametrize(("version", "works"), [("2.2.0", False), ("2.3.0", True), ("2.9.3", True), ("2.10.1", True)])
def test_filters_csf_is_trusted_from_2_3_on(version, works):
    assert Pdal(Path("pdal"), version, "").has_csf is works


PACKAGE = """
import json
class info:
    version = "2.9.1"
class Pipeline:
    streamable = False
    def __init__(self, text):
        self.stages = json.loads(text)
    def execute(self):
        if self.stages[0]["filename"].endswith("broken.las"):
            raise RuntimeError("readers.las: broken")
        with open(self.stages[-1]["filename"], "w") as file:
            json.dump(self.stages, file)
"""


def test_the_python_package_is_preferred_and_runs_the_same_pipelines(tmp_path, monkeypatch):
    (tmp_path / "site" / "pdal").mkdir(parents=True)
    (tmp_path / "site" / "pdal" / "__init__.py").write_text(PACKAGE)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "site"))
    monkeypatch.syspath_prepend(tmp_path / "site")
    monkeypatch.delenv(module.VARIABLE, raising=False)
    module._find.cache_clear()
    try:
        found = find_pdal()
    finally:
        module._find.cache_clear()
    assert (found.path, found.version, found.how) == (None, "2.9.1", "Python package pdal")
    pipeline = [
        {"type": "readers.las", "filename": "in.las"},
        {"type": "writers.las", "filename": str(tmp_path / "o.las")},
    ]
    found.run(pipeline)
    assert json.loads((tmp_path / "o.las").read_text())[0] == {
        "type": "readers.las",
        "filename": str(Path("in.las").absolute()),
    }
    with pytest.raises(InputError, match=r"broken\.las"):
        found.run([{"type": "readers.las", "filename": "/broken.las"}, pipeline[1]])


def copy_pipeline(source: Path, output: Path) -> list[dict[str, object]]:
    return [
        {"type": "readers.las", "filename": str(source)},
        {"type": "filters.range", "limits": "Classification[2:2]"},
        {"type": "writers.las", "filename": str(output), "forward": "all", "compression": "laszip"},
    ]


NAMES = ["plain", "a[1]", "all*", "who?", "50#", 'it\'s "quoted"', "Böschung Nº 3, km 4", "two\nlines", "back\\slash"]


@pytest.mark.parametrize("name", NAMES)
def test_any_file_name_works_in_any_folder(real_pdal, las_file, tmp_path, name):
    folder = tmp_path / name
    folder.mkdir()
    source = las_file(folder / f"{name}.las")
    # what a wildcard would take instead
    las_file(folder / "a1.las", points=50, seed=1)
    output = folder / f"out {name}.laz"
    real_pdal.run(copy_pipeline(source, output))
    expected = laspy.read(source)
    expected = expected.points[np.asarray(expected.classification) == 2]
    found = laspy.read(output)
    assert np.array_equal(found.X, expected.X)
    assert np.array_equal(found.gps_time, expected.gps_time)
    assert sorted(p.name for p in folder.iterdir()) == sorted([source.name, "a1.las", output.name])


@pytest.mark.parametrize("name", ["plain", "a[1]", "all*"])
def test_a_kept_pipeline_runs_again_to_the_same_bytes(real_pdal, las_file, tmp_path, name):
    if real_pdal.path is None:
        pytest.skip("the pdal program is needed to run a kept pipeline")
    source, output, keep = las_file(tmp_path / f"{name}.las"), tmp_path / "out.laz", tmp_path / "pipeline.json"
    las_file(tmp_path / "a1.las", points=50, seed=1)
    real_pdal.run(copy_pipeline(source, output))
    keep_pipeline(copy_pipeline(source, output), keep)
    first = output.read_bytes()
    output.unlink()
    subprocess.run([real_pdal.path, "pipeline", keep], check=True, cwd="/")
    assert output.read_bytes() == first


def test_the_record_names_the_folder_in_which_the_files_will_lie(las_file, tmp_path):
    stage = tmp_path / ".part"
    stage.mkdir()
    pipeline = copy_pipeline(las_file(tmp_path / "in.las"), stage / "out.laz")
    keep_pipeline(pipeline, stage / "kept.json", tmp_path)
    kept = json.loads((stage / "kept.json").read_text())["pipeline"]
    assert [s.get("filename") for s in kept] == [str(tmp_path / "in.las"), None, str(tmp_path / "out.laz")]
    assert kept[1:2] == pipeline[1:2]


def test_a_failure_leaves_no_output_and_keeps_an_older_one(real_pdal, las_file, tmp_path):
    source, output = las_file(tmp_path / "in.las"), tmp_path / "out.laz"
    output.write_text("older")
    pipeline = copy_pipeline(source, output)
    pipeline[1] = {"type": "filters.nonsense"}
    with pytest.raises(EngineError, match="nonsense"):
        real_pdal.run(pipeline)
    assert output.read_text() == "older"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in.las", "out.laz"]


def test_a_file_that_cannot_be_read_is_the_users_to_mend(real_pdal, las_file, tmp_path):
    source = tmp_path / "in.las"
    source.write_bytes(b"no LAS file at all" * 100)
    with pytest.raises(InputError, match=r"in\.las"):
        real_pdal.run(copy_pipeline(source, tmp_path / "out.laz"))
    assert [p.name for p in tmp_path.iterdir()] == ["in.las"]


def test_memory_can_be_limited(real_pdal, las_file, tmp_path):
    if sys.platform != "linux":
        pytest.skip("address space is limited on Linux only")
    pipeline = copy_pipeline(las_file(tmp_path / "in.las"), tmp_path / "out.laz")
    with pytest.raises((InputError, EngineError)):
        real_pdal.run(pipeline, memory_limit=30_000_000)
    assert not (tmp_path / "out.laz").exists()


def test_a_pdal_that_hangs_is_ended_and_the_users_cloud_is_named(las_file, tmp_path):
    hanging = tmp_path / "pdal"
    hanging.write_text("#!/bin/sh\nsleep 600\n")
    hanging.chmod(0o755)
    pipeline = copy_pipeline(las_file(tmp_path / "part.las"), tmp_path / "out.las")
    began = time.monotonic()
    with pytest.raises(InputError, match=r"did not finish '.*slope\.las' within 0 minutes; clip the cloud"):
        Pdal(hanging, "2.8.0", "test").run(pipeline, time_limit_s=1.0, cloud=tmp_path / "slope.las")
    assert time.monotonic() - began < PATIENCE_S
    assert not (tmp_path / "out.las").exists()


def test_one_that_never_says_its_version_does_not_start(bare, monkeypatch):
    monkeypatch.setattr(module, "_START_S", 0.5)
    hanging = program(bare / "hanging", "2.8.0")
    hanging.write_text("#!/bin/sh\nsleep 600\n")
    with pytest.raises(InputError, match="does not start"):
        find_pdal(hanging)


def test_a_cloud_has_time_by_its_points():
    assert time_limit_s(0) == 600.0
    assert time_limit_s(100_000_000) == pytest.approx(600.0 + 20_000.0)
