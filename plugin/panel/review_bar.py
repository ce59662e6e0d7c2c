"""The part of the panel that enters reviews of the zones that are selected in the list."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from qgis.core import QgsApplication, QgsSettings, QgsVectorLayer
from qgis.PyQt.QtCore import QUrl
from qgis.PyQt.QtGui import QDesktopServices
from qgis.PyQt.QtWidgets import QFileDialog, QHBoxLayout, QInputDialog, QLineEdit, QVBoxLayout, QWidget

from ...interface.reviews import CONFIRMED, REJECTED, UNREVIEWED
from ..bridge.words import tr
from . import reviews
from .buttons import button
from .zone_rows import ZoneRow

_REVIEWER = "slopewatch/reviewer"
_PICTURES = "Pictures (*.jpg *.jpeg *.JPG *.JPEG *.png *.PNG *.tif *.tiff *.webp)"


class ReviewBar(QWidget):
    """Works on what ``chosen`` gives: the layer and its zones; ``say`` shows a sentence, with True as a warning."""

    def __init__(
        self, chosen: Callable[[], tuple[QgsVectorLayer | None, list[ZoneRow]]], say: Callable[[str, bool], None]
    ) -> None:
        super().__init__()
        self._chosen, self._say = chosen, say
        self.reviewer = QLineEdit(str(QgsSettings().value(_REVIEWER, "") or QgsApplication.userFullName()))
        self.reviewer.setPlaceholderText(tr("Reviewer"))
        self.reviewer.setToolTip(tr("Who looks at the zones; entered with every review"))
        self.reviewer.editingFinished.connect(lambda: QgsSettings().setValue(_REVIEWER, self.reviewer.text().strip()))
        self.confirm = button(tr("Confirm"), tr("The zone is real"), lambda: self.enter(CONFIRMED), "/mIconSuccess.svg")
        self.reject = button(
            tr("Reject"), tr("The zone is no hazard"), lambda: self.enter(REJECTED), "/mTaskCancel.svg"
        )
        self.reset = button(tr("Unreviewed"), tr("Take the review back"), lambda: self.enter(UNREVIEWED))
        self.note = button(tr("Remark…"), tr("What there was to see"), self.ask_remark, "/mActionAnnotation.svg")
        self.picture = button(
            tr("Photo…"),
            tr("Copy a picture to the results and name it with the zone"),
            self.ask_photo,
            "/mIconRaster.svg",
        )
        self.look = button(tr("Show photo"), tr("Open the picture of the zone"), self.show_photo)
        self.undo = button(tr("Undo"), tr("Take the last entry back"), self.take_back, "/mActionUndo.svg")
        self.save = button(
            tr("Save reviews"), tr("Write the entries into the file"), self.keep, "/mActionSaveEdits.svg"
        )
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        rows = ((self.confirm, self.reject, self.reset), (self.note, self.picture, self.look), (self.undo, self.save))
        for widgets in rows:
            row = QHBoxLayout()
            for widget in widgets:
                row.addWidget(widget)
            row.addStretch()
            layout.addLayout(row)
        row.insertWidget(0, self.reviewer, 1)
        self.refresh()

    def refresh(self) -> None:
        """Offer what can be done with what is chosen."""
        layer, rows = self._chosen()
        for one in (self.confirm, self.reject, self.reset, self.note, self.picture):
            one.setEnabled(layer is not None and bool(rows))
        self.look.setEnabled(any(row.photo for row in rows))
        waiting = layer is not None and reviews.unsaved(layer)
        self.undo.setEnabled(layer is not None and waiting and layer.undoStack().canUndo())
        self.save.setEnabled(waiting)

    def enter(self, state: str) -> None:
        """Enter the state of all chosen zones."""
        reviewer = self.reviewer.text().strip() if state != UNREVIEWED else ""
        self._each(lambda layer, row: reviews.review(layer, row.feature, state, reviewer))

    def enter_remark(self, text: str) -> None:
        self._each(lambda layer, row: reviews.remark(layer, row.feature, text))

    def enter_photo(self, path: Path) -> None:
        """Enter one picture for all chosen zones; it is copied once."""

        def attach(layer: QgsVectorLayer, row: ZoneRow) -> None:
            nonlocal path
            path = reviews.photo_path(layer, reviews.attach_photo(layer, row.feature, path))

        self._each(attach)

    def ask_remark(self) -> None:
        _, rows = self._chosen()
        if not rows:
            return
        names = ", ".join(row.name for row in rows)
        text, given = QInputDialog.getMultiLineText(self, tr("Remark"), names, rows[0].remarks)
        if given:
            self.enter_remark(text)

    def ask_photo(self) -> None:
        path, _ = QFileDialog.getOpenFileName(self, tr("Picture of the zone"), "", _PICTURES)
        if path:
            self.enter_photo(Path(path))

    def show_photo(self) -> None:
        layer, rows = self._chosen()
        for row in rows:
            if layer is None or not row.photo:
                continue
            path = reviews.photo_path(layer, row.photo)
            if path.is_file():
                QDesktopServices.openUrl(QUrl.fromLocalFile(os.fspath(path)))
            else:
                self._say(tr("The picture {} is no longer there.").format(path), True)

    def take_back(self) -> None:
        layer, _ = self._chosen()
        if layer is not None:
            reviews.undo(layer)
        self.refresh()

    def keep(self) -> bool:
        """Save what has been entered; False where the file refuses."""
        layer, _ = self._chosen()
        try:
            if layer is not None:
                reviews.save(layer)
        except reviews.ReviewError as error:
            self._say(str(error), True)
            return False
        finally:
            self.refresh()
        return True

    def _each(self, entering: Callable[[QgsVectorLayer, ZoneRow], Any]) -> None:
        layer, rows = self._chosen()
        try:
            for row in rows if layer is not None else ():
                entering(layer, row)
        except reviews.ReviewError as error:
            self._say(str(error), True)
        self.refresh()
