"""A field for a point cloud: the path of a file, or one of the clouds that are loaded."""

from __future__ import annotations

from typing import Any

from qgis.core import QgsProject
from qgis.PyQt.QtCore import QUrl, pyqtSignal
from qgis.PyQt.QtWidgets import QComboBox, QFileDialog, QHBoxLayout, QSizePolicy, QToolButton, QWidget

from .cloud_layers import loaded_clouds
from .words import tr


class CloudField(QWidget):
    """The text is a path; the list holds the loaded clouds by their names."""

    changed = pyqtSignal()

    def __init__(self, pattern: str, parent: Any = None) -> None:
        super().__init__(parent)
        self._pattern = pattern
        self.box = QComboBox()
        self.box.setEditable(True)
        self.box.setInsertPolicy(QComboBox.InsertPolicy.NoInsert)
        self.box.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.box.setMinimumContentsLength(12)
        self.refresh()
        self.box.lineEdit().setPlaceholderText(tr("File, or a loaded cloud from the list"))
        # a chosen name becomes the path, which is what is used and kept
        self.box.activated.connect(lambda index: self.box.setEditText(str(self.box.itemData(index))))
        self.box.editTextChanged.connect(lambda _: self.changed.emit())
        self.button = QToolButton()
        self.button.setText("…")
        self.button.setToolTip(tr("Choose a file"))
        self.button.clicked.connect(self._browse)
        layout = QHBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.box)
        layout.addWidget(self.button)

    def path(self) -> str:
        """The path given; empty without one. A file that was dropped on the field is an address there."""
        text = str(self.box.currentText()).strip()
        return QUrl(text).toLocalFile() if text.startswith("file:") else text

    def refresh(self) -> None:
        """List the clouds that are loaded now; what is given stays."""
        text = self.box.currentText()
        self.box.clear()
        for name, path in loaded_clouds(QgsProject.instance()):
            self.box.addItem(name, path)
        self.box.setCurrentIndex(-1)
        self.box.setEditText(text)

    def set_path(self, path: str) -> None:
        self.box.setEditText(path)

    def _browse(self) -> None:
        path, _ = QFileDialog.getOpenFileName(self, tr("Point cloud"), self.path(), self._pattern)
        if path:
            self.set_path(path)
