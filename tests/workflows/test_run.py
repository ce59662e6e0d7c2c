"""One run of a command: inputs hashed once, steps told alike to record and progress, all outputs or none."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from slopewatch.engine.core import run_record
from slopewatch.engine.core.errors import Cancelled, InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.interface.parameters import GroundParameters, InputParameters, ParameterSet
from slopewatch.workflows.run import Run, record_name_of
from slopewatch.workflows.settings import (
    DistanceSettings,
    ScreeningSettings,
    SeriesSettings,
    Settings,
    gathered,
    groups,
)


class Kept(Progress):
    """Keeps what is emitted."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[tuple[float, str]] = []

    def emit(self, percent: float, message: str) -> None:
        self.seen.append((round(percent, 6), message))


@pytest.fixture
def inputs(tmp_path: Path) -> list[tuple[str, Path | None]]:
    files = []
    for name in ("first", "second"):
        path = tmp_path / f"{name}.laz"
        path.write_text(f"points of the {name}")
        files.append((name, path))
    return [*files, ("roi", None)]


def run_of(inputs, progress: Progress | None = None) -> Run:
    return Run("trial", {"inputs": InputParameters()}, inputs, progress)


def record(folder: Path) -> dict:
    return json.loads((folder / "run.json").read_text())


def test_inputs_are_hashed_once_in_order(inputs, tmp_path, monkeypatch):
    hashed = []

    def counting(*files: Path) -> str:
        hashed.extend(files)
        return hashlib.sha256(b"".join(f.read_bytes() for f in files)).hexdigest()

    monkeypatch.setattr(run_record, "sha256", counting)
    run = run_of(inputs)
    hashes = run.hash_inputs()
    with run.writing(tmp_path / "out"):
        pass
    assert hashed == [path for _, path in inputs if path]
    assert hashes == (*(hashlib.sha256(path.read_bytes()).hexdigest() for _, path in inputs if path), "")
    assert [(i["role"], i["sha256"]) for i in record(tmp_path / "out")["inputs"]] == [
        ("first", hashes[0]),
        ("second", hashes[1]),
    ]


def test_the_run_id_tells_clouds_and_parameters_apart(inputs):
    run = run_of(inputs)
    assert run.run_id(("a", "b")) == run_of(inputs).run_id(("a", "b"))
    other = Run("trial", {"inputs": InputParameters(crs="EPSG:32651")}, inputs)
    assert len({run.run_id(("a", "b")), run.run_id(("b", "a")), other.run_id(("a", "b"))}) == 3


def test_the_records_stages_are_those_of_the_progress(tmp_path):
    progress = Kept()
    run = run_of([], progress)
    with run.writing(tmp_path):
        with run.step("read", 0.0, 0.3, "reading") as entry:
            progress.update(0.5, "half")
            entry["points"] = 7
        with run.step("alone"):
            progress.update(0.6, "by itself")
    assert progress.seen == [(0.0, "reading"), (15.0, "half"), (30.0, "reading"), (60.0, "by itself")]
    stages = record(tmp_path)["stages"]
    assert [s["stage"] for s in stages] == ["read", "alone"]
    assert stages[0]["points"] == 7
    assert all(s["seconds"] >= 0 and s["peak_memory_mb"] > 0 for s in stages)


def test_a_step_that_fails_is_no_stage_and_gives_the_progress_back(tmp_path):
    progress = Kept()
    run = run_of([], progress)
    with pytest.raises(ValueError, match="broken"), run.step("read", 0.0, 0.3, "reading"):
        raise ValueError("broken")
    assert run.record.stages == []
    progress.update(0.5)
    assert progress.seen[-1][0] == 50.0


def test_outputs_figures_and_warnings_come_back_as_the_record_tells_them(inputs, tmp_path):
    run = run_of(inputs)
    with run.writing(tmp_path / "out") as stage:
        stage.path("a.txt").write_text("a")
        assert not (tmp_path / "out" / "a.txt").exists()
        run.outputs["a"] = stage.final("a.txt")
        run.figures = {"count": 3}
        run.facts["colour"] = "red"
        run.progress.warning("Mind this.")
    done = run.result()
    assert list(done.outputs) == ["a", "run"]
    assert all(path.is_file() for path in done.outputs.values())
    assert (done.figures, done.warnings) == ({"count": 3}, ("Mind this.",))
    told = record(tmp_path / "out")
    assert (told["command"], told["colour"], told["metrics"]) == ("trial", "red", {"count": 3})
    assert (told["warnings"], told["outputs"]) == (["Mind this."], {"a": "a.txt", "run": "run.json"})


def test_the_record_keeps_the_place_that_the_workflow_gives_it(tmp_path):
    run = run_of([])
    with run.writing(tmp_path, record_name=record_name_of(tmp_path / "cloud.laz")) as stage:
        stage.path("b.txt").write_text("b")
        run.outputs |= {"run": run.record_path, "b": stage.final("b.txt")}
    assert list(run.result().outputs) == ["run", "b"]
    assert (tmp_path / "cloud_run.json").is_file()


@pytest.mark.parametrize("error", [ValueError("broken"), Cancelled("stop"), KeyboardInterrupt()])
def test_a_step_that_fails_or_is_cancelled_leaves_nothing(tmp_path, error):
    out, beside = tmp_path / "new" / "out", tmp_path / "beside"
    beside.mkdir()
    run = run_of([])

    def fail() -> None:
        with run.writing(out, others=[beside]) as stage:
            stage.path("a.txt").write_text("a")
            run.stage_in(beside).path("b.txt").write_text("b")
            with run.step("fails", 0.0, 1.0):
                raise error

    with pytest.raises(type(error)):
        fail()
    assert [p.name for p in tmp_path.rglob("*")] == ["beside"]


def test_a_record_that_cannot_be_written_leaves_nothing(tmp_path):
    run = run_of([])
    run.figures = {"not": object()}
    with pytest.raises(TypeError), run.writing(tmp_path) as stage:
        stage.path("a.txt").write_text("a")
    assert not list(tmp_path.iterdir())


def test_several_folders_are_filled_together(tmp_path):
    beside = tmp_path / "beside"
    run = run_of([])
    with run.writing(tmp_path, others=[tmp_path, beside]) as stage:
        assert run.stage_in(tmp_path) is stage
        run.stage_in(beside).path("b.txt").write_text("b")
        assert not (beside / "b.txt").exists()
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["b.txt", "beside", "run.json"]


def test_inputs_and_earlier_results_are_not_overwritten(inputs, tmp_path):
    run = run_of(inputs)
    with pytest.raises(InputError, match=r"first\.laz is also an input"):
        run.refuse_folder(tmp_path, ("first.laz",), overwrite=True)
    with pytest.raises(InputError, match=r"more\.laz is also an input"):
        run.refuse_outputs([tmp_path / "more.laz"], also=[tmp_path / "more.laz"])
    (tmp_path / "zones.gpkg").write_text("")
    with pytest.raises(InputError, match=r"holds results already \(zones.gpkg\)"):
        run.refuse_folder(tmp_path, ("run.json", "zones.gpkg"), overwrite=False)
    run.refuse_folder(tmp_path, ("run.json", "zones.gpkg"), overwrite=True)


@pytest.mark.parametrize("bundle", [Settings, ScreeningSettings, DistanceSettings, SeriesSettings])
def test_a_bundle_is_gathered_group_by_group(bundle):
    asked: list[type] = []

    def group_of(kind: type[ParameterSet]) -> ParameterSet:
        asked.append(kind)
        return kind(crs="EPSG:32651") if kind is InputParameters else kind()

    found = gathered(bundle, group_of)
    assert found.inputs.crs == "EPSG:32651"
    assert [type(group) for group in vars(found).values()] == asked
    assert vars(found) | {"inputs": InputParameters()} == vars(bundle())


def test_the_record_gets_the_groups_that_are_named_in_that_order():
    assert list(groups(Settings(), "ground", "inputs")) == ["ground", "inputs"]
    assert groups(Settings(ground=GroundParameters(denoise=False)), "ground")["ground"].denoise is False


def test_a_bundle_of_something_else_is_refused():
    @dataclass(frozen=True)
    class Other:
        inputs: InputParameters = field(default_factory=lambda: InputParameters())

    with pytest.raises(TypeError, match="inputs has no class of parameters"):
        gathered(Other, lambda kind: kind())
