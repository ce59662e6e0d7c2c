"""Refusals of the engine as a dialog tells them."""

from __future__ import annotations

import ast
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from qgis.core import QgsProcessingContext, QgsProcessingException
from slopewatch.interface.command_list import TITLES
from slopewatch.processing_algorithms import ALGORITHMS
from slopewatch.processing_algorithms.dialog_words import in_dialog_words, with_labels
from slopewatch.processing_algorithms.inspectslope import InspectSlope
from slopewatch.processing_algorithms.m3c2distances import M3C2Distances
from slopewatch.processing_algorithms.screenhazards import ScreenHazards
from slopewatch.tests.builders.frozen_names import COMMANDS
from slopewatch.tests.builders.qgis import Recorder, engine_python

pytestmark = pytest.mark.usefixtures("qgis_app")
# Of commands or surveys that dialogs have in another form, or not at all.
NOT_IN_THE_DIALOG = {
    "registerepochs": {"apply", "invert"}, "inspectseries": {"epoch"}, "m3c2distances": {"output-dir"},
    "createproject": {"settings"},  # it runs no command of the engine
}  # fmt: skip
ONLY_TERMINAL = {"language", "help", "progress", "watch-parent", "debug", "set"}
# Arguments of other programs, and beginnings of options that are put together.
DASK_WORKERS_OPTIONS = {"host", "resources", "worker-class"}
NO_OPTIONS = {"stdin", "temporary-folder", "version", "no-", "json"} | DASK_WORKERS_OPTIONS


def told(algorithm, sentence: str) -> str:
    made = algorithm().create()
    return in_dialog_words(made, made.PARAMETER_GROUPS, sentence)


@pytest.mark.parametrize(
    ("algorithm", "sentence", "expected"),
    [
        (InspectSlope, "give both systems with --crs, such as EPSG:32651+5773.",
         "give both systems with “Input: coordinate reference system”, such as EPSG:32651+5773."),
        (InspectSlope, "give a projected one with --crs EPSG:n.",
         "give a projected one with EPSG:n in “Input: coordinate reference system”."),
        (InspectSlope, "have the registration take it off with a maximum_offset of 13 m.",
         "have the registration take it off with a “Registration: largest expected offset (m)” of 13 m."),
        (InspectSlope, "cell is -1; give a number from 0.005 to 100 m, or auto.",
         "“Cell size (m)” is -1; give a number from 0.005 to 100 m, or leave it empty."),
        (InspectSlope, "correct the setting (--pdal).",
         "correct the setting (“PDAL program” under Settings > Options > SlopeWatch)."),
        (InspectSlope, "choose another one, or give --overwrite to replace them.",
         "choose another one, or give “Overwrite earlier results” to replace them."),
        (ScreenHazards, "give --ground extract to do so first, or --ground as_is if it is rough ground.",
         "give extract in “Ground points” to do so first, or as_is in “Ground points” if it is rough ground."),
        (ScreenHazards, "give fewer --threads, --device cpu, or cut the cloud with --roi.",
         "give fewer “Screening: threads”, cpu in “Screening: device”, or cut the cloud with “Region of interest”."),
        (InspectSlope, "correct their days, or give --trust-dates if they are right.",
         "correct their days, or give “Input: trust the given days” if they are right."),
        (M3C2Distances, "give --ground as_is if it is a bare surface.",
         "give as_is in “Ground points” if it is a bare surface."),
        (M3C2Distances, "--normals given needs --core, a cloud with the dimensions nx.",
         "given in “Distances: normals” needs “Core points”, a cloud with the dimensions nx."),
        (M3C2Distances, "--stable has no effect with --no-calibrate: only",
         "“Distances: stable ground” has no effect with “Distances: calibrate errors on stable ground” off: only"),
        (InspectSlope, "The name of 'a.laz' holds no date; give the day with --epoch.",
         "The name of 'a.laz' holds no date; give the day with “First survey”."),
        (ScreenHazards, "give a folder with --output-dir or --dashboard-address.",
         "give a folder with --output-dir or “Address of the dashboard”."),
        (ScreenHazards, "extract its ground with slopewatch ground, or run slopewatch simulate survey.",
         "extract its ground with “Extract ground”, or run “Simulate a survey”."),
        (ScreenHazards, "Internal failure: KeyError: 1 (a.py, line 3); run again with --debug for details.",
         "Internal failure: KeyError: 1 (a.py, line 3); please report it."),
    ],
)  # fmt: skip
def test_options_and_parameters_are_called_as_in_the_dialog(algorithm, sentence: str, expected: str) -> None:
    made = algorithm().create()
    elsewhere = {"Address of the dashboard", *TITLES.values()}
    for label in re.findall("“([^”]+)”(?! under)", expected):
        assert label in {p.description() for p in made.parameterDefinitions()} | elsewhere
    assert told(algorithm, sentence) == expected


@pytest.mark.parametrize(
    "sentence",
    [
        "/data/--crs/largest_cell/a.laz does not exist; check the path.",
        "largest_cell.laz and /data/cloth_reach are the same cloud.",
        "its dimension truth_class is missing in elevation_change.tif",
        "write it with --epochs YYYY-MM-DD=CLOUD.",
        "The surveys of 2024-05-01 -- and others -- are fine.",
    ],
)
def test_paths_and_what_the_dialog_has_not_stay(sentence: str) -> None:
    assert told(InspectSlope, sentence) == sentence


def test_the_plugins_own_sentences_name_labels_too() -> None:
    made = InspectSlope().create()
    with pytest.raises(QgsProcessingException) as caught:
        made.prepareAlgorithm(
            {"REFERENCE": "/a/slope.laz", "OUTPUT_FOLDER": "/out"}, QgsProcessingContext(), Recorder()
        )
    assert str(caught.value).startswith(
        "“Day of the first survey” is not set and the name of /a/slope.laz holds no day"
    )
    assert with_labels(made, "/data/ROI/CLOUD.laz and CELLS stay; ROI is empty.") == (
        "/data/ROI/CLOUD.laz and CELLS stay; “Region of interest” is empty."
    )


def options_of(algorithm: str) -> set[str]:
    """The options that the list of the command's parameters offers."""
    command = [engine_python(), "-m", "slopewatch.cli", "parameters", *COMMANDS[algorithm]]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env={"PYTHONUTF8": "1"})
    rows = re.findall(r"^  (?:-h, )?(--[a-z].*?)(?:  |$)", done.stdout, re.MULTILINE)
    found = {option for row in rows for option in re.findall(r"--([a-z][a-z0-9-]*)", row)}
    assert len(found) >= len(ONLY_TERMINAL)
    return found


@pytest.mark.parametrize("algorithm", ALGORITHMS, ids=lambda a: a.NAME)
def test_every_option_of_the_command_is_called_as_in_the_dialog(algorithm) -> None:
    for option in options_of(algorithm.NAME) - ONLY_TERMINAL - NOT_IN_THE_DIALOG.get(algorithm.NAME, set()):
        assert "--" not in told(algorithm, f"give --{option}, or leave it."), option


def sentences(root: Path) -> Iterator[tuple[str, str]]:
    """File and text of every string that the engine may show: all but those that document the code."""
    for part in ("engine", "models", "simulation", "workflows", "interface"):
        for path in root.glob(f"{part}/**/*.py"):
            if path.name == "__main__.py" or "making" in path.parts:  # for those who work on SlopeWatch
                continue
            tree = ast.parse(path.read_text(encoding="utf-8"))
            documents = {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr)}
            for node in ast.walk(tree):
                if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in documents:
                    yield path.name, node.value


def test_every_option_that_the_engine_names_is_one_of_a_command(root: Path) -> None:
    named = {o: file for file, text in sentences(root) for o in re.findall(r"(?<![\w-])--([a-z][a-z-]+)", text)}
    assert {"crs", "roi", "threads", "no-calibrate"} <= set(named)
    offered = {option for algorithm in ALGORITHMS for option in options_of(algorithm.NAME)}
    missing = set(named) - offered - NO_OPTIONS
    assert not missing, {o: named[o] for o in missing}


def test_every_command_that_the_engine_names_has_its_tools_title(root: Path) -> None:
    known = "|".join(" ".join(words) for words in COMMANDS.values())
    named = {n for _, text in sentences(root) for n in re.findall(rf"slopewatch ({known})\b", text)}
    assert "ground" in named
    assert named <= set(TITLES)
    titles = {" ".join(COMMANDS[a.NAME]): a.TITLE for a in ALGORITHMS}
    assert {command: titles[command] for command in TITLES} == TITLES
