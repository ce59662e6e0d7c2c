"""The field of a point cloud in a dialog: a file, or one of the clouds that are loaded in the project."""

from __future__ import annotations

from typing import Any

from processing.gui.wrappers import WidgetWrapper
from qgis.gui import QgsGui

from ..plugin.bridge.cloud_field import CloudField


class CloudWidget:
    """Gives the field for a dialog; in a model QGIS's own one, which also offers the model's inputs and results."""

    def __new__(cls, parameter: Any, dialog: Any, row: int = 0, column: int = 0, **options: Any) -> Any:
        if type(dialog).__name__ == "ModelerParametersDialog":
            own = QgsGui.processingGuiRegistry().createModelerParameterWidget(
                dialog.model, dialog.childId, parameter, dialog.context
            )
            own.setDialog(dialog)
            return own
        return CloudWrapper(parameter, dialog, row, column, **options)


class CloudWrapper(WidgetWrapper):  # type: ignore[misc]
    """The value is the path of the cloud's file."""

    def createWidget(self) -> CloudField:
        field = CloudField(self.parameterDefinition().fileFilter())
        field.changed.connect(lambda: self.widgetValueHasChanged.emit(self))
        return field

    def setValue(self, value: Any) -> None:
        self.widget.set_path(str(value or ""))

    def value(self) -> str:
        return str(self.widget.path())
