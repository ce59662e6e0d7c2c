"""The order of a dialog's fields: advanced ones in boxes by the workflow's steps, destinations with their real place.

QGIS knows one box, *Advanced Parameters*, and no groups in it (ADR 0075). Where its dialog is built in another way than
it is known here, the fields stay as QGIS arranged them, with the group before their labels.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from qgis.core import QgsProcessingParameterEnum
from qgis.gui import QgsCollapsibleGroupBoxBasic
from qgis.PyQt.QtWidgets import QBoxLayout, QComboBox, QLineEdit, QVBoxLayout, QWidget

from ..interface.choice_words import shown_choice
from ..plugin.bridge.compat import ADVANCED
from ..plugin.bridge.words import tr
from .declare import GROUP, MORE, PLACE

MORE_TITLE = "More outputs"


def put_in_order(wrappers: Sequence[Any]) -> None:
    """Arrange the fields of a dialog whose wrappers these are, in their order."""
    groups: dict[str, list[QWidget]] = {}
    last: list[QWidget] = []
    for wrapper in wrappers:
        parts = _parts(wrapper)
        definition = wrapper.parameterDefinition()
        if not parts:
            continue
        details = definition.metadata()
        if isinstance(definition, QgsProcessingParameterEnum):
            _in_words(parts[-1])
        if not definition.isDestination():
            if details.get(GROUP) and definition.flags() & ADVANCED:
                groups.setdefault(details[GROUP], []).extend(parts)
            continue
        last = parts
        if details.get(PLACE):
            _say_where(wrapper, parts[-1], details[PLACE])
        if details.get(MORE):
            groups.setdefault(tr(MORE_TITLE), []).extend(parts)
    for title, parts in groups.items():
        _into_box(parts, title, after=last if title == tr(MORE_TITLE) else None)


def _in_words(box: QWidget) -> None:
    """Say the choices of a list in QGIS's language; its values, which are its data, stay as they are."""
    if isinstance(box, QComboBox):
        for number in range(box.count()):
            if isinstance(box.itemData(number), str):
                box.setItemText(number, shown_choice(box.itemData(number), tr))


def _parts(wrapper: Any) -> list[QWidget]:
    """Label, where it has one, and widget of a field; of Python's and of QGIS's own wrappers."""
    if hasattr(wrapper, "wrappedWidget"):
        label, widget = wrapper.wrappedLabel(), wrapper.wrappedWidget()
    else:
        label, widget = None, None
    label, widget = label or getattr(wrapper, "label", None), widget or getattr(wrapper, "widget", None)
    return [part for part in (label, widget) if part is not None]


def _into_box(parts: list[QWidget], title: str, after: list[QWidget] | None) -> None:
    """Put the widgets into a new box in the place of the first of them, or after others."""
    outer = parts[-1].parentWidget()
    layout = outer.layout() if outer is not None else None
    if not isinstance(layout, QBoxLayout) or any(layout.indexOf(part) < 0 for part in (*parts, *(after or ()))):
        return
    box = QgsCollapsibleGroupBoxBasic(title, outer)
    inside = QVBoxLayout(box)
    # once and for all: taking a box out of a layout again gives it to Python, which deletes it
    layout.insertWidget(layout.indexOf(after[-1]) + 1 if after else layout.indexOf(parts[0]), box)
    box.setCollapsed(True)
    for part in parts:
        layout.removeWidget(part)
        inside.addWidget(part)


def _say_where(wrapper: Any, widget: QWidget, place: str) -> None:
    """Have an empty destination say where its file lies instead of that it is temporary."""
    line = widget.findChild(QLineEdit)
    if line is None or not hasattr(widget, "destinationChanged"):
        return

    def show(*_: object) -> None:
        if not line.text() and wrapper.parameterValue() is not None:  # None: it is skipped
            line.setPlaceholderText(tr(place))

    widget.destinationChanged.connect(show)
    show()
