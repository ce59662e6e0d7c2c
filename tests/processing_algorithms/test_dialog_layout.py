"""The real dialogs, without a display: boxes by steps, destinations with their place, settings of a former run."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from processing.core.Processing import Processing
from processing.gui import ParametersPanel
from processing.gui.AlgorithmDialog import AlgorithmDialog
from qgis.core import QgsProcessingContext, QgsProcessingFeedback, QgsProcessingOutputLayerDefinition
from qgis.PyQt.QtWidgets import QGroupBox, QLineEdit
from slopewatch.interface.parameters import ChangeParameters, GroundParameters, InputParameters
from slopewatch.plugin.bridge.compat import ADVANCED
from slopewatch.processing_algorithms import ALGORITHMS
from slopewatch.processing_algorithms.elevationchange import ElevationChange
from slopewatch.processing_algorithms.inspectslope import InspectSlope
from slopewatch.processing_algorithms.screenhazards import ScreenHazards
from slopewatch.processing_algorithms.settings_widget import NOT_READ
from slopewatch.processing_algorithms.values import Values

MORE = "More outputs"


@pytest.fixture
def opened(provider: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[Any], Any]]:
    """Opens the dialog of an algorithm's class."""
    monkeypatch.setattr(ParametersPanel, "iface", None)  # there is no main window
    Processing.initialize()
    dialogs = []

    def open_dialog(algorithm: Any) -> Any:
        dialogs.append(AlgorithmDialog(algorithm().create()))
        return dialogs[-1]

    yield open_dialog
    for dialog in dialogs:
        dialog.close()


def box_of(widget: Any) -> str:
    """Title of the innermost box around a field."""
    while widget is not None and not isinstance(widget, QGroupBox):
        widget = widget.parentWidget()
    return "" if widget is None else str(widget.title())


def field(dialog: Any, name: str) -> Any:
    wrapper = dialog.mainWidget().wrappers[name]
    own = wrapper.wrappedWidget() if hasattr(wrapper, "wrappedWidget") else None
    return own or wrapper.widget


@pytest.mark.parametrize("algorithm", ALGORITHMS, ids=lambda a: a.NAME)
def test_advanced_parameters_are_in_boxes_by_step_in_order(algorithm: Any, opened: Callable[[Any], Any]) -> None:
    dialog = opened(algorithm)
    titles = list(dict.fromkeys(group.title for group in algorithm.PARAMETER_GROUPS))
    of = {s.qgis_name: group.title for group in algorithm.PARAMETER_GROUPS for s in group.specifications()}
    for parameter in dialog.algorithm().parameterDefinitions():
        inside = box_of(field(dialog, parameter.name()))
        if parameter.isDestination():
            assert inside in ("", MORE)
        elif not parameter.flags() & ADVANCED:
            assert inside == ""
        elif parameter.name() in of and len(titles) > 1:
            assert inside == of[parameter.name()]
        else:
            assert inside in ("Advanced Parameters", *titles)
    boxes = [box.title() for box in dialog.findChildren(QGroupBox)]
    assert [title for title in titles if title in boxes] == [title for title in boxes if title in titles]
    assert all(box.property("collapsed") for box in dialog.findChildren(QGroupBox) if box.title() in titles)


def test_every_field_still_gives_its_value(opened: Callable[[Any], Any]) -> None:
    """Moved fields are QGIS's own widgets: it must still hold them."""
    for algorithm in ALGORITHMS:
        for wrapper in opened(algorithm).mainWidget().wrappers.values():
            wrapper.parameterValue()


def test_destinations_say_their_place_in_the_output_folder(opened: Callable[[Any], Any], tmp_path: Path) -> None:
    dialog = opened(InspectSlope)
    places = {
        "ZONES": "[zones.gpkg in the output folder]",
        "SURFACE_HEIGHTS": "[surface_heights.tif in the output folder]",
        "HEATMAP": "[Skip output]",
    }
    for name, place in places.items():
        assert field(dialog, name).findChild(QLineEdit).placeholderText() == place
    assert box_of(field(dialog, "HEATMAP")) == MORE
    heatmap = dialog.mainWidget().wrappers["HEATMAP"]
    context = QgsProcessingContext()
    heatmap.setParameterValue(QgsProcessingOutputLayerDefinition("TEMPORARY_OUTPUT"), context)
    line = field(dialog, "HEATMAP").findChild(QLineEdit)
    assert (line.text(), line.placeholderText()) == ("", "[heatmap.tif in the output folder]")
    heatmap.setParameterValue(QgsProcessingOutputLayerDefinition(str(tmp_path / "mine.tif")), context)
    assert line.text() == str(tmp_path / "mine.tif")
    screening = opened(ScreenHazards)
    assert field(screening, "ZONES").findChild(QLineEdit).placeholderText() == "[next to the labelled cloud]"


def record(folder: Path) -> str:
    path = folder / "run.json"
    groups = {
        "inputs": asdict(InputParameters(crs="EPSG:32651")),
        "ground": asdict(GroundParameters(refine=False)),
        "change": asdict(ChangeParameters(cell=0.4, largest_cell=3.0)),
    }
    path.write_text(json.dumps({"command": "inspect", "parameters": groups}), encoding="utf-8")
    return str(path)


def test_settings_of_a_former_run_fill_the_fields_where_they_can_be_changed(
    opened: Callable[[Any], Any], tmp_path: Path
) -> None:
    dialog = opened(InspectSlope)
    fields, context = dialog.mainWidget().wrappers, QgsProcessingContext()
    for name in ("REFERENCE", "CLOUD"):
        fields[name].setParameterValue(f"/{name}.laz", context)
    fields["MINIMUM_AREA"].setParameterValue(3.0, context)
    fields["CONFIDENCE"].setParameterValue(0.8, context)
    path = record(tmp_path)
    fields["SETTINGS"].setParameterValue(path, context)
    shown = {name: fields[name].parameterValue() for name in ("CELL", "REFINE", "LARGEST_CELL", "MINIMUM_AREA")}
    assert shown == {"CELL": 0.4, "REFINE": False, "LARGEST_CELL": 3.0, "MINIMUM_AREA": 3.0}
    assert fields["CONFIDENCE"].parameterValue() == 0.95
    assert options(dialog) == ["--settings", path, "--minimum-area", "3.0"]
    fields["CELL"].setParameterValue(None, context)
    fields["REFINE"].setParameterValue(True, context)
    assert options(dialog) == ["--settings", path, "--refine", "--cell", "auto", "--minimum-area", "3.0"]


def options(dialog: Any) -> list[str]:
    given = dialog.mainWidget().createProcessingParameters()
    values = Values(dialog.algorithm(), given, QgsProcessingContext(), QgsProcessingFeedback())
    return values.settings(InspectSlope.PARAMETER_GROUPS)


def test_a_file_that_cannot_be_used_is_marked_and_changes_nothing(opened: Callable[[Any], Any], tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    path.write_text('{"cell": 0.3, "confidence": 7}')
    dialog = opened(ElevationChange)
    fields = dialog.mainWidget().wrappers
    fields["SETTINGS"].setParameterValue(str(path), QgsProcessingContext())
    assert fields["CELL"].parameterValue() is None
    assert "confidence is 7" in fields["SETTINGS"].widget.toolTip()
    assert fields["SETTINGS"].widget.styleSheet() == NOT_READ
    path.write_text('{"cell": 0.3}')
    fields["SETTINGS"].setParameterValue("", QgsProcessingContext())
    fields["SETTINGS"].setParameterValue(str(path), QgsProcessingContext())
    assert fields["CELL"].parameterValue() == 0.3
    assert fields["SETTINGS"].widget.styleSheet() == ""
