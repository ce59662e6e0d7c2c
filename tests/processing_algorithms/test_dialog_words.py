"""Refusals of the engine as a dialog tells them."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest
from slopewatch.processing_algorithms import ALGORITHMS
from slopewatch.processing_algorithms.dialog_words import in_dialog_words
from slopewatch.processing_algorithms.inspectslope import InspectSlope
from slopewatch.processing_algorithms.m3c2distances import M3C2Distances
from slopewatch.processing_algorithms.screenhazards import ScreenHazards

pytestmark = pytest.mark.usefixtures("qgis_app")
# Of commands or surveys that dialogs have in another form, or not at all.
NO_DIALOG = {"epoch", "invert", "apply"}


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
         "give fewer “Threads”, cpu in “Device”, or cut the cloud with “Region of interest”."),
        (InspectSlope, "correct their days, or give --trust-dates if they are right.",
         "correct their days, or give “Input: trust the given days” if they are right."),
        (M3C2Distances, "give --ground as_is if it is a bare surface.",
         "give as_is in “Ground points” if it is a bare surface."),
        (M3C2Distances, "--normals given needs --core, a cloud with the dimensions nx.",
         "given in “Normals” needs “Core points”, a cloud with the dimensions nx."),
    ],
)  # fmt: skip
def test_options_and_parameters_are_called_as_in_the_dialog(algorithm, sentence: str, expected: str) -> None:
    made = algorithm().create()
    for label in re.findall("“([^”]+)”(?! under)", expected):
        assert label in {p.description() for p in made.parameterDefinitions()}
    assert told(algorithm, sentence) == expected


@pytest.mark.parametrize(
    "sentence",
    [
        "/data/--crs/largest_cell/a.laz does not exist; check the path.",
        "largest_cell.laz and /data/cloth_reach are the same cloud.",
        "its dimension truth_class is missing in elevation_change.tif",
        "write it with --epoch YYYY-MM-DD=CLOUD.",
        "The surveys of 2024-05-01 -- and others -- are fine.",
    ],
)
def test_paths_and_what_the_dialog_has_not_stay(sentence: str) -> None:
    assert told(InspectSlope, sentence) == sentence


def test_every_option_that_a_refusal_names_is_in_a_dialog(root: Path) -> None:
    named: dict[str, str] = {}
    for path in (
        path for part in ("engine", "models", "simulation", "workflows") for path in root.glob(f"{part}/**/*.py")
    ):
        if path.name == "__main__.py":  # for those who work on SlopeWatch
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "InputError":
                words = " ".join(
                    c.value for c in ast.walk(node) if isinstance(c, ast.Constant) and isinstance(c.value, str)
                )
                named.update(dict.fromkeys(re.findall(r"(?<![\w-])--([a-z][a-z-]+)", words), path.name))
    assert {"crs", "roi"} <= set(named)
    made = [algorithm().create() for algorithm in ALGORITHMS]
    offered = {p.name() for algorithm in made for p in algorithm.parameterDefinitions()} | {"PDAL"}
    missing = {o for o in set(named) - NO_DIALOG if o.upper().replace("-", "_") not in offered}
    assert not missing, {o: named[o] for o in missing}
