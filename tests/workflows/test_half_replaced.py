"""Whatever reads results first puts back what a killed run had half replaced."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from slopewatch.engine.core.errors import InputError, SlopeWatchError
from slopewatch.engine.handover import corridor, held
from slopewatch.engine.report import compose
from slopewatch.models.network.description import read_description
from slopewatch.tests.builders.killed_runs import half_replaced
from slopewatch.workflows import report_corridor
from slopewatch.workflows.batch import corridor_plan, slope_process
from slopewatch.workflows.batch.results import result_of
from slopewatch.workflows.given_values import Values
from slopewatch.workflows.run import Run

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="a killed run is a forked process")
NAMES = ("run.json", "zones.gpkg", "clouds/a.laz", "slope_run.json")


def job(folder: Path, **more: Any) -> Any:
    return SimpleNamespace(folder=str(folder), slope="S", task="t", command="inspect", options={}, **more)


def corridor_of(folder: Path) -> Any:
    layer = SimpleNamespace(name=corridor.SLOPES, frame=corridor_frame(folder))
    return SimpleNamespace(folder=folder.parent, record={"command": "batch"}, layers=(layer,))


def corridor_frame(folder: Path) -> Any:
    import pandas as pd

    report = f"{folder.name}/report.html"
    return pd.DataFrame({"slope": ["S"], "state": ["done"], "report": [report]})


READERS: dict[str, Callable[[Path], object]] = {
    "report": compose.read_record,
    "hand-over of a folder": held.find_record,
    "hand-over of a record": lambda folder: held.find_record(folder / "slope_run.json"),
    "slopes of a corridor": lambda folder: corridor.records_of_slopes(corridor_of(folder)),
    "corridor's page": lambda folder: report_corridor._result(
        folder.parent, {"slope": "S", "surveys": 2, "last_survey": "2025-05-01", "report": f"{folder.name}/report.html"}
    ),
    "batch": corridor_plan.read_record,
    "slope of a batch": lambda folder: result_of(job(folder)),
    "slope that is tried again": lambda folder: slope_process.attempt(job(folder), lambda _: 0, None),
    "cloud in a subfolder": lambda folder: Run("change", {}, [("moving", folder / "clouds" / "a.laz")]),
    "table of results": lambda folder: Run("locate", {}, [("zones", folder / "zones.gpkg")]),
    "folder to be overwritten": lambda folder: Run("change", {}).refuse_folder(folder, NAMES, overwrite=True),
    "output next to others": lambda folder: Run("ground", {}).refuse_outputs([folder / "other.laz"]),
    "weights": lambda folder: read_description(folder / "weights.safetensors"),
    "settings": lambda folder: Values({"settings": folder / "run.json"}, ()),
}


@pytest.mark.parametrize("name", READERS)
def test_the_earlier_results_are_back_before_they_are_read(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "out"
    half_replaced(folder, NAMES)
    assert {(folder / name).read_text() for name in NAMES} == {"new"}
    with contextlib.suppress(SlopeWatchError):  # they are no results that can be used
        READERS[name](folder)
    assert {(folder / name).read_text() for name in NAMES} == {"old"}
    assert not list(folder.glob(".slopewatch-part-*"))


def test_what_is_there_after_the_kill_is_not_overwritten_without_a_word(tmp_path: Path) -> None:
    half_replaced(tmp_path, NAMES)
    for name in NAMES:
        (tmp_path / name).unlink()
    with pytest.raises(InputError, match="holds results already"):
        Run("change", {}).refuse_folder(tmp_path, NAMES, overwrite=False)
