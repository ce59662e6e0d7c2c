"""What the plugin's own fields have in common: a label as QGIS's fields have it."""

from __future__ import annotations

from typing import Any

from processing.gui.wrappers import WidgetWrapper
from qgis.PyQt.QtCore import QCoreApplication


class OwnField(WidgetWrapper):  # type: ignore[misc]
    """A field of a dialog, written in Python."""

    def tr(self, text: str) -> str:
        """QGIS's translation of its own words; Qt would look for them under the name of the class derived from it."""
        return str(QCoreApplication.translate(WidgetWrapper.__name__, text))

    def createLabel(self) -> Any:
        """The label; its tooltip is the help, as of QGIS's fields, and not the parameter's name."""
        label = super().createLabel()
        if label is not None:
            label.setToolTip(self.parameterDefinition().toolTip())
        return label
