"""What the toolbox offers: frozen names, complete help, and parameters equal to the engine's."""

from __future__ import annotations

import re
import subprocess
from typing import Any

import pytest
from qgis.core import QgsApplication, QgsProcessingProvider
from slopewatch.interface.parameters import Specification
from slopewatch.plugin.bridge import resources
from slopewatch.plugin.bridge.compat import ADVANCED, OPTIONAL
from slopewatch.plugin.shipped_model import TITLES as MODELS
from slopewatch.processing_algorithms import ALGORITHMS
from slopewatch.processing_algorithms.base import SlopeWatchAlgorithm
from slopewatch.tests.builders.frozen_names import (
    COMMANDS,
    FROZEN_GROUPS,
    FROZEN_OUTPUTS,
    FROZEN_PARAMETERS,
)
from slopewatch.tests.builders.qgis import engine_python


@pytest.fixture(params=ALGORITHMS, ids=lambda a: a.NAME)
def algorithm(request: pytest.FixtureRequest, qgis_app: QgsApplication) -> SlopeWatchAlgorithm:
    return request.param().create()


def _specifications(algorithm: SlopeWatchAlgorithm) -> list[Specification]:
    return [s for group in algorithm.PARAMETER_GROUPS for s in group.specifications()]


def test_all_are_registered_without_an_engine(monkeypatch: pytest.MonkeyPatch, provider: QgsProcessingProvider) -> None:
    monkeypatch.setenv("SLOPEWATCH_PYTHON", "/nowhere/python")
    provider.refreshAlgorithms()
    assert provider.id() == "slopewatch"
    assert {a.name() for a in provider.algorithms()} == set(FROZEN_PARAMETERS) | set(MODELS)
    assert all(a.canExecute()[0] for a in provider.algorithms())


def test_names_are_frozen(algorithm: SlopeWatchAlgorithm) -> None:
    here = {p.name() for p in algorithm.parameterDefinitions()}
    assert not set(FROZEN_PARAMETERS[algorithm.name()]) - here, "a released parameter is gone"
    assert ("SETTINGS" in here) == bool(algorithm.PARAMETER_GROUPS)
    own = here - {"SETTINGS"} - set(FROZEN_PARAMETERS[algorithm.name()])
    assert own <= {s.qgis_name for s in _specifications(algorithm)}
    assert algorithm.groupId() == FROZEN_GROUPS[algorithm.name()]
    outputs = {o.name() for o in algorithm.outputDefinitions()}
    assert outputs >= set(FROZEN_OUTPUTS[algorithm.name()]), "a released output is gone"


def test_an_algorithm_without_a_command_cannot_be_made() -> None:
    with pytest.raises(TypeError, match="abstract"):
        type("Unfinished", (SlopeWatchAlgorithm,), {})()


def test_identity_is_complete(algorithm: SlopeWatchAlgorithm) -> None:
    assert re.fullmatch("[a-z][a-z0-9]+", algorithm.name())
    assert algorithm.shortDescription().endswith(".")
    assert len(algorithm.shortHelpString()) > 200 or not algorithm.parameterDefinitions()
    assert algorithm.tags()
    assert not algorithm.icon().isNull()
    assert f'id="{algorithm.name()}"' in resources.help_text("index")
    assert algorithm.helpUrl().endswith(f"plugin/help/index.html#{algorithm.name()}")
    assert type(algorithm.createInstance()) is type(algorithm)


def test_every_parameter_has_help_and_a_label(algorithm: SlopeWatchAlgorithm) -> None:
    for parameter in algorithm.parameterDefinitions():
        assert len(parameter.help()) > 10, parameter.name()
        assert parameter.help().endswith("."), parameter.name()
        assert parameter.description(), parameter.name()
        assert parameter.name().isupper()


def test_the_dialog_has_the_engines_parameters(algorithm: SlopeWatchAlgorithm) -> None:
    for s in _specifications(algorithm):
        parameter: Any = algorithm.parameterDefinition(s.qgis_name)
        assert parameter is not None, s.name
        assert parameter.help() == (s.help.replace("auto:", "Not set:") if s.automatic else s.help)
        if s.unit:
            assert f"({s.unit})" in parameter.description()
        assert parameter.description().lower().endswith(s.field_label.lower())
        if s.name == "crs":
            assert parameter.type() == "crs"
        elif s.choices:
            assert parameter.options() == list(s.choices)
            assert parameter.usesStaticStrings()
            assert parameter.defaultValue() == s.default
        else:
            assert parameter.type() == {bool: "boolean", int: "number", float: "number", str: "string"}[s.kind]
            assert parameter.defaultValue() == s.field_default
        if s.kind in (int, float):
            if s.minimum is not None:
                assert parameter.minimum() == s.field_minimum
            if s.maximum is not None:
                assert parameter.maximum() == s.maximum
            decimals = parameter.metadata().get("widget_wrapper", {}).get("decimals", 0)
            assert bool(parameter.flags() & OPTIONAL) == s.automatic, f"{s.name}: empty where it is left to the data"
            if not s.automatic:
                assert round(s.default, decimals) == s.default, f"{s.name}: the field would round the default"
        basic = not s.advanced if algorithm.BASIC is None else s.name in algorithm.BASIC
        assert bool(parameter.flags() & ADVANCED) != basic
    assert set(algorithm.BASIC or ()) <= {s.name for s in _specifications(algorithm)}


def test_at_most_ten_parameters_are_shown_at_first(algorithm: SlopeWatchAlgorithm) -> None:
    shown = [p.name() for p in algorithm.parameterDefinitions() if not p.flags() & ADVANCED and not p.isDestination()]
    assert len(shown) <= 10, f"name those that most users need in BASIC: {shown}"


def test_advanced_parameters_have_the_heading_of_their_step_in_its_order(algorithm: SlopeWatchAlgorithm) -> None:
    titles = list(dict.fromkeys(group.title for group in algorithm.PARAMETER_GROUPS))
    of = {s.qgis_name: group.title for group in algorithm.PARAMETER_GROUPS for s in group.specifications()}
    headings = []
    for parameter in algorithm.parameterDefinitions():
        heading = parameter.metadata().get("slopewatch_group", "")
        if parameter.flags() & ADVANCED and parameter.name() in of and len(titles) > 1:
            assert heading == of[parameter.name()]
            assert heading.lower() in parameter.description().lower(), "where no box can be made, the label says it"
            headings.append(heading)
    assert list(dict.fromkeys(headings)) == [title for title in titles if title in headings]


def test_the_whole_flow_shows_few_parameters_at_first(qgis_app: QgsApplication) -> None:
    inspect = next(a for a in ALGORITHMS if a.NAME == "inspectslope")().create()
    shown = [p.name() for p in inspect.parameterDefinitions() if not p.flags() & ADVANCED and not p.isDestination()]
    assert shown == [
        "REFERENCE", "REFERENCE_DATE", "CLOUD", "CLOUD_DATE", "ROI", "PROFILE",
        "CELL", "MINIMUM_AREA", "SCREEN_LAST_EPOCH", "OVERWRITE",
    ]  # fmt: skip


def test_screening_shows_few_parameters_at_first(qgis_app: QgsApplication) -> None:
    screening = next(a for a in ALGORITHMS if a.NAME == "screenhazards")().create()
    shown = [p.name() for p in screening.parameterDefinitions() if not p.flags() & ADVANCED and not p.isDestination()]
    assert shown == [
        "INPUT", "ROI", "PROFILE", "SCREENING_METHOD", "GROUND", "MINIMUM_PROBABILITY", "MINIMUM_HAZARD_AREA",
        "PROBABILITY_CELL", "FALSE_ZONES", "SELF_TEST",
    ]  # fmt: skip


def test_the_command_line_has_the_dialogs_parameters(algorithm: SlopeWatchAlgorithm) -> None:
    python = engine_python()
    done = subprocess.run(
        [python, "-m", "slopewatch.cli", "parameters", *COMMANDS[algorithm.name()]],
        capture_output=True,
        text=True,
        check=True,
        env={"PYTHONUTF8": "1"},
    )
    offered = set(re.findall(r"--[a-z][a-z-]*", done.stdout))
    wanted = {f"--{s.option}" for s in _specifications(algorithm)} | {"--progress", "--watch-parent", "--pdal"}
    assert wanted <= offered
