"""The field of a point cloud in real dialogs, without a display."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from processing.core.Processing import Processing
from processing.gui import ParametersPanel
from processing.gui.AlgorithmDialog import AlgorithmDialog
from processing.gui.BatchAlgorithmDialog import BatchAlgorithmDialog
from processing.gui.wrappers import WidgetWrapperFactory
from qgis.core import (
    QgsPointCloudLayer,
    QgsProcessingContext,
    QgsProcessingModelAlgorithm,
    QgsProcessingProvider,
    QgsProject,
)
from qgis.gui import QgsProcessingModelerParameterWidget
from qgis.PyQt.QtWidgets import QDialog
from slopewatch.plugin.bridge.cloud_layers import loaded_clouds
from slopewatch.processing_algorithms.inspectslope import InspectSlope


@pytest.fixture
def cloud(provider: QgsProcessingProvider, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """The path of a cloud that is loaded under the name “May”, next to layers that are no such files."""
    monkeypatch.setattr(ParametersPanel, "iface", None)  # there is no main window
    Processing.initialize()
    path = tmp_path / "2024-05-01.laz"
    path.touch()
    for source, name in ((path, "May"), (tmp_path / "gone.laz", "gone"), ("https://example.org/ept.json", "remote")):
        QgsProject.instance().addMapLayer(QgsPointCloudLayer(str(source), name, "copc"))
    yield str(path)
    QgsProject.instance().clear()


def test_a_loaded_cloud_can_be_chosen_and_a_file_given(cloud: str) -> None:
    assert loaded_clouds(QgsProject.instance()) == [("May", cloud)]
    dialog = AlgorithmDialog(InspectSlope().create())
    wrappers = dialog.mainWidget().wrappers
    box = wrappers["REFERENCE"].widget.box
    assert [box.itemText(n) for n in range(box.count())] == ["May"]
    assert wrappers["REFERENCE"].parameterValue() == ""
    changes: list[str] = []
    wrappers["REFERENCE"].widgetValueHasChanged.connect(lambda one: changes.append(one.parameterValue()))
    box.setCurrentIndex(0)
    box.activated.emit(0)
    wrappers["CLOUD"].setParameterValue("/data/2025.laz", QgsProcessingContext())
    given = dialog.mainWidget().createProcessingParameters()
    assert (given["REFERENCE"], given["CLOUD"]) == (cloud, "/data/2025.laz")
    assert changes[-1] == cloud
    box.setEditText("file:///data/dropped%20here.laz")
    assert wrappers["REFERENCE"].parameterValue() == "/data/dropped here.laz"
    dialog.close()


def test_a_batch_has_the_same_field(cloud: str) -> None:
    dialog = BatchAlgorithmDialog(InspectSlope().create())
    panel = dialog.mainWidget()
    wrapper = panel.wrappers[0][panel.parameter_to_column["REFERENCE"]]
    wrapper.setParameterValue(cloud, QgsProcessingContext())
    assert wrapper.parameterValue() == cloud
    assert wrapper.widget.box.count() == 1
    dialog.close()


def test_a_model_has_its_own_field_which_takes_results_of_other_steps(cloud: str) -> None:
    dialog = type("ModelerParametersDialog", (QDialog,), {})()
    dialog.model, dialog.childId, dialog.context = QgsProcessingModelAlgorithm(), "step", QgsProcessingContext()
    algorithm = InspectSlope().create()
    made = WidgetWrapperFactory.create_wrapper(algorithm.parameterDefinition("REFERENCE"), dialog)
    assert isinstance(made, QgsProcessingModelerParameterWidget)
