"""The field of a former run's settings: choosing a file fills its values in, where each can be changed.

It also puts the dialog in order once all fields are there, as it is a field that every dialog with settings has.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from processing.gui.wrappers import DIALOG_STANDARD
from qgis.core import QgsProcessingContext
from qgis.gui import QgsFileWidget

from ..interface.parameters import AUTO, ParameterError
from ..interface.settings_file import read_settings
from ..plugin.bridge.words import tr
from .dialog_layout import put_in_order
from .own_field import OwnField

NOT_READ = "color: #b00020"
"""Style of a field whose file cannot be used; the sentence is its tooltip, and Run says it, too."""


class SettingsWidget(OwnField):
    """A file. What it does not name stays as it is."""

    def createWidget(self) -> QgsFileWidget:
        widget = QgsFileWidget()
        widget.setFilter(self.parameterDefinition().fileFilter())
        widget.fileChanged.connect(lambda *_: self.widgetValueHasChanged.emit(self))
        return widget

    def setValue(self, value: Any) -> None:
        self.widget.setFilePath(str(value or ""))

    def value(self) -> str:
        return str(self.widget.filePath())

    def postInitialize(self, wrappers: Sequence[Any]) -> None:
        """Fill the other fields whenever a file is chosen; not in a model, nor in the rows of a batch."""
        if self.dialogType != DIALOG_STANDARD:
            return
        put_in_order(wrappers)
        self._fields = {one.parameterDefinition().name(): one for one in wrappers}
        self.widget.fileChanged.connect(self._fill)

    def _fill(self, path: str) -> None:
        self.widget.setStyleSheet("")
        self.widget.setToolTip(self.parameterDefinition().toolTip())
        if not path:
            return
        groups = self.dialog.algorithm().PARAMETER_GROUPS
        try:
            read = read_settings(Path(path), groups)
        except ParameterError as error:
            self.widget.setStyleSheet(NOT_READ)
            self.widget.setToolTip(tr(f"{error}."))
            return
        context = QgsProcessingContext()
        if read.profile and "PROFILE" in self._fields:
            self._fields["PROFILE"].setParameterValue(read.profile, context)
        for group in groups:
            for s in group.specifications():
                if s.name in read.values:
                    value = read.values[s.name]
                    empty = s.automatic and value == AUTO
                    self._fields[s.qgis_name].setParameterValue(None if empty else value, context)
