"""The field of the profile in a dialog: choosing one fills in the values that it uses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from processing.gui.wrappers import DIALOG_MODELER
from qgis.core import QgsProcessingContext
from qgis.PyQt.QtWidgets import QComboBox

from .own_field import OwnField


class ProfileWidget(OwnField):
    """A list of the profiles. What no profile names stays as it is when another is chosen."""

    def createWidget(self, filled: Mapping[str, Mapping[str, Any]]) -> QComboBox:
        """The list; ``filled`` are the values of each profile by the parameters' names, None for an empty field."""
        self._filled = filled
        box = QComboBox()
        for option in self.parameterDefinition().options():
            box.addItem(option, option)
        return box

    def setValue(self, value: Any) -> None:
        """Choose a profile by its name or, as qgis_process may, by its number."""
        options = self.parameterDefinition().options()
        word = str(value)
        name = options[int(word)] if word.isdecimal() and int(word) < len(options) else word
        if name in options:
            self.widget.setCurrentIndex(options.index(name))

    def value(self) -> str:
        return str(self.widget.currentData())

    def postInitialize(self, wrappers: Sequence[Any]) -> None:
        """Fill the other fields whenever a profile is chosen; in a model they hold sources of values, not values."""
        if self.dialogType == DIALOG_MODELER:
            return
        fields = {one.parameterDefinition().name(): one for one in wrappers}
        context = QgsProcessingContext()

        def fill(*_: object) -> None:
            for name, value in self._filled[self.value()].items():
                fields[name].setParameterValue(value, context)
            self.widgetValueHasChanged.emit(self)

        self.widget.currentIndexChanged.connect(fill)
