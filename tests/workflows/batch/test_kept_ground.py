"""A third survey makes a series of a pair: the pair's ground is used again, with the results of a fresh run."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from slopewatch.engine.core.run_result import RunResult
from slopewatch.interface.parameters import BatchParameters
from slopewatch.tests.builders import epoch_pairs
from slopewatch.workflows.batch.corridor import run_batch
from slopewatch.workflows.batch.corridor_plan import Given
from slopewatch.workflows.batch.kept_ground import keep_ground
from slopewatch.workflows.batch.planning import Common

OPTIONS = {"cell": 0.5, "method": "none", "screen_last_epoch": False, "zone_profiles": 0}
DAYS = ("2024-05-01", "2025-05-01", "2026-05-01")


def batch(folder: Path, out: Path, count: int) -> RunResult:
    lines = ["slope,date,file,roi", *(f"A,{day},{day}.laz," for day in DAYS[:count])]
    (folder / "corridor.csv").write_text("\n".join(lines) + "\n")
    common = Common(OPTIONS, "default", None, None, BatchParameters(workers=0))
    return run_batch(Given(folder / "corridor.csv", out), common)


@pytest.fixture(scope="module")
def grown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    """Output folders: a pair, the same with a third survey, and the three surveys at once."""
    folder = tmp_path_factory.mktemp("grown")
    for number, day in enumerate(DAYS):
        xyz = epoch_pairs.slope(number, 4000)
        xyz[xyz[:, 0] < epoch_pairs.X + 3, 2] -= 0.2 * number
        epoch_pairs.write(folder / f"{day}.laz", xyz)
    batch(folder, folder / "out", 2)
    shutil.copytree(folder / "out" / "slopes" / "A" / "inspect", folder / "pair")
    batch(folder, folder / "out", 3)
    batch(folder, folder / "fresh", 3)
    return folder / "pair", folder / "out", folder / "fresh"


def made(out: Path) -> dict[str, list[str]]:
    """What the series says that it made anew, by survey."""
    record = json.loads((out / "slopes" / "A" / "series" / "run.json").read_text())
    (stage,) = (stage for stage in record["stages"] if stage["stage"] == "surveys")
    return {day: facts["made"] for day, facts in stage["epochs"].items()}


def contents(out: Path) -> dict[str, bytes]:
    """All files of the series but those with times and the pipelines, which name the folder."""
    series = out / "slopes" / "A" / "series"
    files = [p for p in series.rglob("*") if p.is_file() and not p.name.startswith(".")]
    left_out = ("run.json", "report.html")
    return {
        p.relative_to(series).as_posix(): p.read_bytes().replace(str(out).encode(), b"OUT")
        for p in files
        if p.name not in left_out
    }


def test_only_the_third_surveys_ground_is_made(grown: tuple[Path, Path, Path]) -> None:
    _, out, fresh = grown
    assert {day: "ground" in steps for day, steps in made(out).items()} == dict(
        zip(DAYS, (False, False, True), strict=True)
    )
    assert all("ground" in steps for steps in made(fresh).values())


def test_every_file_is_that_of_a_fresh_run(grown: tuple[Path, Path, Path]) -> None:
    _, out, fresh = grown
    ours, theirs = contents(out), contents(fresh)
    assert ours.keys() == theirs.keys()
    assert {name.rpartition(".")[2] for name in ours} >= {"tif", "gpkg", "csv", "laz", "npz", "json"}
    different = [name for name in ours if ours[name] != theirs[name]]
    assert not different


def changed_ground(pair: Path) -> None:
    ground = next(pair.glob("clouds/2024-05-01_ground.laz"))
    ground.write_bytes(ground.read_bytes()[:-1] + b"x")


def changed_record(**values: Any) -> Callable[[Path], None]:
    def change(pair: Path) -> None:
        record = json.loads((pair / "run.json").read_text())
        (pair / "run.json").write_text(json.dumps(record | values))

    return change


def with_a_ground_elsewhere(pair: Path) -> None:
    record = json.loads((pair / "run.json").read_text())
    for stage in record["stages"]:
        for facts in stage.get("epochs", {}).values():
            facts["ground"] = "../../" + facts["ground"]
    (pair / "run.json").write_text(json.dumps(record))


@pytest.mark.parametrize(
    ("change", "count"),
    [
        (lambda pair: None, 2),
        (changed_ground, 1),
        (changed_record(software="SlopeWatch 0.0.1"), 0),
        (changed_record(command="series"), 0),
        (changed_record(stages=[]), 0),
        (changed_record(stages=None), 0),
        (changed_record(inputs=[]), 0),
        (with_a_ground_elsewhere, 0),
        (lambda pair: (pair / "run.json").write_text("["), 0),
        (lambda pair: (pair / "run.json").unlink(), 0),
    ],
)
def test_what_cannot_be_trusted_is_made_anew(
    grown: tuple[Path, Path, Path], tmp_path: Path, change: Callable[[Path], object], count: int
) -> None:
    pair, series = tmp_path / "inspect", tmp_path / "series"
    shutil.copytree(grown[0], pair)
    change(pair)
    assert keep_ground(pair, series) == count
    assert len(list(series.rglob("*_ground.laz"))) == count
    assert not list(series.rglob(".*"))
    assert keep_ground(pair, series) == 0, "what is there stays"


def test_other_settings_find_another_key(grown: tuple[Path, Path, Path], tmp_path: Path) -> None:
    """The key holds all that the ground depends on, so that of other parameters is never taken."""
    shutil.copytree(grown[0], tmp_path / "inspect")
    record = json.loads((tmp_path / "inspect" / "run.json").read_text())
    record["parameters"]["ground"]["cloth_resolution"] += 0.1
    (tmp_path / "inspect" / "run.json").write_text(json.dumps(record))
    assert keep_ground(tmp_path / "inspect", tmp_path / "series") == 2
    kept = {p.name for p in (tmp_path / "series" / "work").glob("*_ground.laz")}
    used = {p.name for p in (grown[2] / "slopes" / "A" / "series" / "work").glob("*_ground.laz")}
    assert not kept & used
