"""The field of the profile in a real dialog, without a display."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from processing.core.Processing import Processing
from processing.gui import ParametersPanel
from processing.gui.AlgorithmDialog import AlgorithmDialog
from qgis.core import QgsProcessingContext, QgsProcessingFeedback, QgsProcessingProvider
from slopewatch.interface.parameters import ChangeParameters, GroundParameters, RegistrationParameters
from slopewatch.processing_algorithms.inspectslope import InspectSlope
from slopewatch.processing_algorithms.values import Values


@pytest.fixture
def fields(provider: QgsProcessingProvider, monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, Any]]:
    """The fields of Inspect slope by their parameters' names, both surveys given."""
    monkeypatch.setattr(ParametersPanel, "iface", None)  # there is no main window
    Processing.initialize()
    dialog = AlgorithmDialog(InspectSlope().create())
    found = dialog.mainWidget().wrappers
    for name in ("REFERENCE", "CLOUD"):
        found[name].setParameterValue("/cloud.laz", QgsProcessingContext())
    yield {**found, "dialog": dialog}
    dialog.close()


def shown(fields: dict[str, Any], *names: str) -> list[Any]:
    return [fields[name].parameterValue() for name in names]


def options(fields: dict[str, Any]) -> list[str]:
    algorithm = fields["dialog"].algorithm()
    given = fields["dialog"].mainWidget().createProcessingParameters()
    values = Values(algorithm, given, QgsProcessingContext(), QgsProcessingFeedback())
    return values.settings(InspectSlope.PARAMETER_GROUPS)


def test_a_profile_fills_in_the_values_that_it_uses(fields: dict[str, Any]) -> None:
    names = ("CLOTH_RESOLUTION", "REFINE", "METHOD", "CELL", "DIRECTION")
    context = QgsProcessingContext()
    for profile in ("default", "paper", "default"):
        fields["PROFILE"].setParameterValue(profile, context)
        ground, registration, change = (
            group.build(profile=profile) for group in (GroundParameters, RegistrationParameters, ChangeParameters)
        )
        cell = None if change.cell == "auto" else change.cell
        expected = [ground.cloth_resolution, ground.refine, registration.method, cell, change.direction]
        assert shown(fields, *names) == expected, profile
        assert options(fields) == ([] if profile == "default" else ["--profile", profile])


def test_what_is_changed_after_that_is_used_even_if_it_is_the_default(fields: dict[str, Any]) -> None:
    context = QgsProcessingContext()
    fields["CONFIDENCE"].setParameterValue(0.9, context)
    fields["PROFILE"].setParameterValue("paper", context)
    fields["CLOTH_RESOLUTION"].setParameterValue(GroundParameters().cloth_resolution, context)
    fields["CELL"].setParameterValue(None, context)
    assert shown(fields, "CONFIDENCE") == [0.9], "no profile names it"
    assert options(fields) == [
        "--profile", "paper", "--cloth-resolution", "0.5", "--cell", "auto", "--confidence", "0.9",
    ]  # fmt: skip
