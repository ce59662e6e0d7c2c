"""Reviews written into the table of zones: edits of the layer, which can be undone until they are saved."""

from __future__ import annotations

import shutil
from datetime import date
from pathlib import Path

from qgis.core import QgsEditorWidgetSetup, QgsField, QgsVectorLayer

from ...interface.reviews import PHOTO, REMARKS, REVIEWED, REVIEWER, STATUS, UNREVIEWED
from ..bridge.compat import STRING
from ..bridge.words import tr
from .run_folder import file_of

PHOTO_FOLDER = "photos"


class ReviewError(Exception):
    """A review that cannot be entered or saved; the message is for the user."""


def review(layer: QgsVectorLayer, feature: int, state: str, reviewer: str) -> None:
    """Enter the state of a zone, who looked at it and that it was today, as one step that can be undone.

    Raises:
        ReviewError: the layer cannot be edited.
    """
    entries = {STATUS: state, REVIEWER: reviewer}
    if state != UNREVIEWED or layer.fields().indexOf(REVIEWED) >= 0:
        entries[REVIEWED] = date.today().isoformat() if state != UNREVIEWED else ""
    _enter(layer, feature, entries, tr("Review of a zone"))


def remark(layer: QgsVectorLayer, feature: int, text: str) -> None:
    """Enter remarks about a zone in place of those it has.

    Raises:
        ReviewError: the layer cannot be edited.
    """
    _enter(layer, feature, {REMARKS: text.strip()}, tr("Remark about a zone"))


def attach_photo(layer: QgsVectorLayer, feature: int, picture: Path, *, copied: bool = True) -> str:
    """Enter a picture of a zone; the column for it is added with the first one.

    Args:
        copied: copy the picture to ``photos/`` next to the table. Else its own path is entered.

    Returns:
        What is entered: the path from the table's folder of a copy, the whole one otherwise.

    Raises:
        ReviewError: the picture is not there or cannot be copied, or the layer cannot be edited.
    """
    picture = Path(picture)
    if not picture.is_file():
        raise ReviewError(tr("The picture {} is not there; choose another one.").format(picture))
    entered = str(picture)
    if copied:
        folder = file_of(layer.source()).parent
        try:
            entered = _copied(picture, folder / PHOTO_FOLDER).relative_to(folder).as_posix()
        except OSError as error:
            raise ReviewError(tr("The picture {} cannot be copied: {}.").format(picture, error)) from None
    _enter(layer, feature, {PHOTO: entered}, tr("Picture of a zone"))
    # a form then shows the picture; its path counts from the table's folder
    settings = {"DocumentViewer": 1, "RelativeStorage": 2, "DefaultRoot": str(file_of(layer.source()).parent)}
    layer.setEditorWidgetSetup(layer.fields().indexOf(PHOTO), QgsEditorWidgetSetup("ExternalResource", settings))
    return entered


def photo_path(layer: QgsVectorLayer, entered: str) -> Path:
    """Where the picture that was entered lies."""
    return file_of(layer.source()).parent / entered


def unsaved(layer: QgsVectorLayer) -> bool:
    """Whether there are edits that are not in the file yet."""
    return bool(layer.isEditable() and layer.isModified())


def undo(layer: QgsVectorLayer) -> None:
    """Take the last step back."""
    layer.undoStack().undo()


def save(layer: QgsVectorLayer) -> None:
    """Write the edits into the file and end editing.

    Raises:
        ReviewError: the file refuses them; they are kept for another attempt.
    """
    if layer.isEditable() and not layer.commitChanges():
        reasons = "; ".join(line for line in layer.commitErrors() if line)
        raise ReviewError(tr("The reviews of {} could not be saved: {}.").format(layer.name(), reasons.rstrip(".")))


def _editable(layer: QgsVectorLayer) -> None:
    if not layer.isEditable() and not layer.startEditing():
        raise ReviewError(
            tr("{} cannot be edited; check that its file can be written and is open nowhere else.").format(layer.name())
        )


def _enter(layer: QgsVectorLayer, feature: int, entries: dict[str, str], words: str) -> None:
    _editable(layer)
    layer.beginEditCommand(words)
    for name in entries:
        if layer.fields().indexOf(name) < 0:
            layer.addAttribute(QgsField(name, STRING))
    entered = all(
        layer.changeAttributeValue(feature, layer.fields().indexOf(name), value) for name, value in entries.items()
    )
    if not entered:
        layer.destroyEditCommand()
        raise ReviewError(tr("The zone is no longer in {}; load the layer again.").format(layer.name()))
    layer.endEditCommand()


def _copied(picture: Path, folder: Path) -> Path:
    """A copy in ``folder`` under a name that is free there; the picture itself where it lies in there already."""
    if picture.resolve().parent == folder.resolve():
        return folder / picture.name
    folder.mkdir(parents=True, exist_ok=True)
    target, number = folder / picture.name, 1
    while target.exists():
        number += 1
        target = folder / f"{picture.stem}_{number}{picture.suffix}"
    shutil.copyfile(picture, target)
    return target
