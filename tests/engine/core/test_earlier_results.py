"""A folder with results is not written into by mistake."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from slopewatch.engine.core.earlier_results import earlier_series, refuse_another_series, refuse_results
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.run_record import RunRecord
from slopewatch.interface.parameters import GridChangeParameters, ZoneParameters


@pytest.mark.parametrize("left", ["run.json", "zones.gpkg"])
def test_results_are_refused_with_folder_and_remedy(tmp_path: Path, left: str) -> None:
    folder = tmp_path / "out"
    refuse_results(folder, ("run.json", "zones.gpkg"))
    folder.mkdir()
    # what a stopped run leaves, and what people put there
    (folder / ".slopewatch-part-x1").mkdir()
    (folder / "work").mkdir()
    (folder / "clouds").mkdir()
    (folder / "notes.txt").touch()
    refuse_results(folder, ("run.json", "zones.gpkg"))
    (folder / left).symlink_to("nowhere")
    with pytest.raises(InputError, match=f"{folder} holds results already .{left}.; choose another.*--overwrite"):
        refuse_results(folder, ("run.json", "zones.gpkg"))
    refuse_results(folder, ("run.json", "zones.gpkg"), overwrite=True)


def record(folder: Path, surveys: dict[str, str], least: float = 0.5, **others: str) -> RunRecord:
    """The record of a series of ``surveys``, text by day."""
    found = RunRecord("series", {"zones": ZoneParameters(minimum_area=least)})
    for role, text in [*((f"epoch {day}", text) for day, text in surveys.items()), *others.items()]:
        path = folder / f"{role}.txt"
        path.write_text(text)
        found.add_input(role, path)
    return found


TWO = {"2024-01-01": "a", "2024-02-01": "b"}
THREE = {**TWO, "2024-03-01": "c"}


def test_a_series_goes_on_and_another_one_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    assert earlier_series(folder) is None
    text = json.dumps(record(tmp_path, TWO, roi="here", alerts="1").document([], {}))
    (folder / "run.json").write_text(text)
    earlier = earlier_series(folder)
    for goes_on in (
        record(tmp_path, TWO, roi="here"),
        record(tmp_path, THREE, roi="here", alerts="2"),
        record(tmp_path, {"2023-01-01": "z", **TWO}, roi="here"),
    ):
        refuse_another_series(folder, earlier, goes_on)
    for other, why in (
        (record(tmp_path, {"2024-01-01": "a", "2024-03-01": "c"}, roi="here"), "survey of 2024-02-01 is not given"),
        (record(tmp_path, {**THREE, "2024-02-01": "x"}, roi="here"), "survey of 2024-02-01 was another file"),
        (record(tmp_path, THREE, roi="there"), "roi was another file"),
        (record(tmp_path, THREE), "roi is not given now"),
        (record(tmp_path, THREE, roi="here", stable="wall"), "stable was another file"),
        (record(tmp_path, THREE, 2.0, roi="here"), "minimum_area was 0.5"),
    ):
        with pytest.raises(InputError, match=f"{folder} holds another series .*{why}.*--overwrite"):
            refuse_another_series(folder, earlier, other)
    # a version with one parameter more
    old = json.loads(text)
    del old["parameters"]["zones"]["minimum_cells"]
    refuse_another_series(folder, old, record(tmp_path, THREE, roi="here"))


def test_a_number_for_auto_in_an_earlier_record_is_no_other_setting(tmp_path: Path) -> None:
    def made(change: GridChangeParameters) -> RunRecord:
        return RunRecord("series", {"change": change})

    earlier = json.loads(json.dumps(made(GridChangeParameters()).document([], {})))
    assert (earlier["parameters"]["change"]["cell"], earlier["parameters"]["change"]["registration_error"]) == (
        "auto",
        "auto",
    )
    earlier["parameters"]["change"]["registration_error"] = -1.0
    refuse_another_series(tmp_path, earlier, made(GridChangeParameters()))
    with pytest.raises(InputError, match=r"registration_error was -1\.0"):
        refuse_another_series(tmp_path, earlier, made(GridChangeParameters(registration_error=0.01)))


@pytest.mark.parametrize("text", ["{", "[]", '{"command": "inspect", "inputs": []}', '{"command": "series"}'])
def test_what_is_no_record_of_a_series(tmp_path: Path, text: str) -> None:
    (tmp_path / "run.json").write_text(text)
    assert earlier_series(tmp_path) is None
