"""Settings given back from a run record or a file of names and values."""

from __future__ import annotations

import json
import sys
import time
import tracemalloc
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from slopewatch.interface.parameters import (
    AUTO,
    ChangeParameters,
    GroundParameters,
    InputParameters,
    LastEpochParameters,
    ParameterError,
    ZoneParameters,
    command_sets,
)
from slopewatch.interface.settings_file import read_settings


def written(folder: Path, content: Any, name: str = "settings.json") -> Path:
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return path


def record(folder: Path, command: str, **groups: Any) -> Path:
    return written(folder, {"command": command, "parameters": {n: asdict(g) for n, g in groups.items()}}, "run.json")


def test_a_run_record_gives_all_its_values_back(tmp_path: Path) -> None:
    change = ChangeParameters(cell=0.4, confidence=0.9, largest_cell=AUTO)
    path = record(tmp_path, "change", change=change, zones=ZoneParameters(minimum_area=2.0))
    found = read_settings(path, command_sets.CHANGE)
    assert ChangeParameters.build(found.values) == change
    assert found.over(command_sets.CHANGE, "default") == {"cell": 0.4, "confidence": 0.9, "minimum_area": 2.0}
    assert not found.left_out


def test_a_default_that_was_recorded_overrides_a_profile(tmp_path: Path) -> None:
    found = read_settings(record(tmp_path, "ground", ground=GroundParameters()), command_sets.GROUND)
    over = found.over(command_sets.GROUND, "paper")
    assert over["cloth_resolution"] == 0.5
    assert GroundParameters.build(over, "paper") == GroundParameters()


def test_of_another_commands_record_what_both_have_is_taken_and_the_rest_is_named(tmp_path: Path) -> None:
    groups = {
        "inputs": InputParameters(crs="EPSG:32651"),
        "ground": GroundParameters(),
        "screening": LastEpochParameters(false_zones=2.0),
    }
    path = record(tmp_path, "inspect", **groups)
    change = read_settings(path, command_sets.CHANGE)
    assert change.values == {"crs": "EPSG:32651", "height_unit": "auto"}
    assert change.left_out == ("ground", "screening")
    screen = read_settings(path, command_sets.SCREEN)
    assert screen.values["false_zones"] == 2.0
    assert "ground" not in screen.values, "an inspection has no such setting, its ground is always extracted"


def test_a_series_takes_the_cells_of_a_change(tmp_path: Path) -> None:
    found = read_settings(record(tmp_path, "change", change=ChangeParameters(cell=0.5)), command_sets.SERIES)
    assert (found.values["cell"], found.values["adaptive"]) == (0.5, True)
    assert not {"adaptive", "target_level", "largest_cell"} & set(found.left_out)


def test_a_batch_gives_back_what_it_was_given_for_all_slopes(tmp_path: Path) -> None:
    content = {"command": "batch", "parameters": {}, "settings": {"cell": 0.2, "overwrite": True}, "profile": "paper"}
    found = read_settings(written(tmp_path, content), command_sets.INSPECT)
    assert (found.values, found.profile, found.left_out) == ({"cell": 0.2}, "paper", ())


@pytest.mark.parametrize(
    ("content", "name"),
    [
        ({"minimum-area": 2, "cell": None, "profile": "paper"}, "a.json"),
        ({"zones": {"minimum_area": 2.0}, "change": {"cell": "auto"}, "profile": "paper"}, "b.json"),
        pytest.param(
            'profile = "paper"\ncell = "auto"\n[zones]\nminimum-area = 2\n', "c.toml",
            marks=pytest.mark.skipif(sys.version_info < (3, 11), reason="no TOML in Python"),
        ),
    ],
)  # fmt: skip
def test_a_plain_file_may_write_names_as_options_or_in_tables(tmp_path: Path, content: Any, name: str) -> None:
    found = read_settings(written(tmp_path, content, name), command_sets.CHANGE)
    assert (found.values, found.profile) == ({"minimum_area": 2.0, "cell": AUTO}, "paper")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"cel": 0.2}, "has cel, which is no setting of this command; it may mean cell"),
        ({"cloth_resolution": 0.2}, "has cloth_resolution, which is no setting of this command; leave it out"),
        ({"cell": -3}, "cell is -3.0; give a number from 0.005 to 100 m, or auto"),
        ({"cell": [1]}, "cell is [1]; give"),
        ({"threshold": "none"}, "threshold is 'none'; give one of probabilistic, coherent"),
        ({"minimum_area": None}, "minimum_area is None; give a number"),
        ({"overwrite": True}, "overwrite, which is not taken from a file"),
        ({"profile": "best"}, "profile is 'best'; give one of default, paper"),
        ([1, 2], "holds no names with values"),
        ("{cell: 1}", "is no JSON file that can be read"),
        ("[" * 100_000, "is no JSON file that can be read"),
        ('{"cell": NaN}', "cell is nan"),
        ({"parameters": {"change": {"cell": "wide"}}, "command": "change"}, "cell is 'wide'"),
    ],
)
def test_what_cannot_be_used_is_one_sentence_that_names_the_file(tmp_path: Path, content: Any, words: str) -> None:
    path = written(tmp_path, content)
    with pytest.raises(ParameterError) as caught:
        read_settings(path, command_sets.CHANGE)
    sentence = str(caught.value)
    assert words in sentence
    assert str(path) in sentence
    assert "\n" not in sentence


def test_a_file_that_is_missing_or_no_text_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "picture.json").write_bytes(b"\x89PNG\xff\xfe")
    for name, words in (("none.json", "does not exist"), ("picture.json", "not UTF-8"), (".", "is a folder")):
        with pytest.raises(ParameterError, match=words):
            read_settings(tmp_path / name, command_sets.CHANGE)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("dots.toml", "a" + ".a" * 50_000 + " = 1\n"),
        ("dots.toml", "a = {b" + ' . "b"' * 30_000 + " = 1}\n"),
        ("table.toml", "[a" + ".a" * 50_000 + "]\n"),
        ("large.toml", "a = 1\n" * 50_000),
        ("deep.toml", "a = " + "[" * 50_000 + "\n"),
        ("many.json", "[" + "[]," * 1_000_000 + "0]"),
        ("deep.json", "[" * 100_000),
    ],
)
def test_settings_that_would_explode_are_refused_at_once(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    began = time.process_time()
    tracemalloc.start()
    with pytest.raises(ParameterError, match=name):
        read_settings(tmp_path / name, command_sets.CHANGE)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert time.process_time() - began < 5.0
    assert peak < 100_000_000


def test_dots_in_texts_and_numbers_of_toml_are_no_names(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text('report_remarks = "See p. 1. Then p. 2. ' + "And so on. " * 50 + '"\n')
    assert read_settings(tmp_path / "a.toml", command_sets.CHANGE).values["report_remarks"].startswith("See p. 1.")
