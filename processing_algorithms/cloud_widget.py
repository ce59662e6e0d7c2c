"""The field of a point cloud in a dialog: a file, or one of the clouds that are loaded in the project."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from processing.gui.wrappers import DIALOG_STANDARD
from qgis.gui import QgsGui

from ..plugin.bridge.cloud_field import CloudField
from .dialog_layout import put_in_order
from .own_field import OwnField


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


class CloudWrapper(OwnField):
    """The value is the path of the cloud's file."""

    def createWidget(self) -> CloudField:
        field = CloudField(self.parameterDefinition().fileFilter())
        field.changed.connect(lambda: self.widgetValueHasChanged.emit(self))
        return field

    def setValue(self, value: Any) -> None:
        self.widget.set_path(str(value or ""))

    def value(self) -> str:
        return str(self.widget.path())

    def postInitialize(self, wrappers: Sequence[Any]) -> None:
        """Put the dialog of a model in order, which has no field of settings that would do it."""
        names = [one.parameterDefinition().name() for one in wrappers]
        if self.dialogType == DIALOG_STANDARD and "SETTINGS" not in names:
            put_in_order(wrappers)
