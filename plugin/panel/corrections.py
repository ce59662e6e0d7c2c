"""Corrections by hand: areas drawn on the map, kept beside a run's results, with which the run is made again."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

from qgis.core import QgsGeometry, QgsProject
from qgis.PyQt.QtWidgets import QInputDialog, QMenu, QToolButton

from ...interface.corrections import ACTION, EPOCH, EXCLUDE, FILE, GROUND, NOT_GROUND, REASON
from ...interface.input_files import RECORD, UnusableFileError, read_input
from ..bridge.words import tr
from .areas import AreaError, Kind, add_area
from .run_folder import RECORD as RECORD_NAME

_ACTIONS = (
    (EXCLUDE, "Exclude area", "#404040"),
    (GROUND, "This is ground", "#a6611a"),
    (NOT_GROUND, "This is not ground", "#018571"),
)
"""What is done with an area, in the menu and the legend, and its colour: apart also for the colour-blind."""
CORRECTIONS = Kind(
    "corrections", "CORRECTIONS", "Corrections by hand", "#404040", (ACTION, REASON, EPOCH), classes=_ACTIONS
)
_ALGORITHMS = {"inspect": "slopewatch:inspectslope", "series": "slopewatch:inspectseries"}
_LAYERS = ("roi", "stable", "profiles", "centreline", "field_names", "classes")

Draw = Callable[[str, Callable[[QgsGeometry], None]], object]


class CorrectionsButton(QToolButton):
    """Its menu draws areas to correct and opens the dialog of the run again.

    ``draw`` takes a colour and what is to be done with the polygon; ``folder`` gives that of the run, None without one;
    ``say`` and ``open_dialog`` are those of ``AreaBar``.
    """

    def __init__(
        self,
        canvas: Any,
        draw: Draw,
        folder: Callable[[], Path | None],
        say: Callable[[str, bool], None],
        open_dialog: Callable[[str, dict[str, Any]], None],
    ) -> None:
        super().__init__()
        self._canvas, self._draw, self._folder, self._say, self._open_dialog = canvas, draw, folder, say, open_dialog
        self.setText(tr("Correct"))
        self.setToolTip(tr("Draw an area that the run is to leave out, or whose ground it is to take otherwise"))
        self.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        menu = QMenu(self)
        for action, words, _ in _ACTIONS:
            menu.addAction(tr(words)).triggered.connect(lambda *_, action=action: self.draw(action))
        menu.addSeparator()
        menu.addAction(tr("Run again…")).triggered.connect(lambda *_: self.run_again())
        self.setMenu(menu)

    def draw(self, action: str) -> object:
        """Begin to draw; what is drawn is kept in the folder of the run."""
        colour = next(colour for name, _, colour in _ACTIONS if name == action)
        return self._draw(colour, lambda polygon: self._keep(action, polygon))

    def _keep(self, action: str, polygon: QgsGeometry) -> None:
        folder = self._folder()
        if folder is None:
            return
        reason, given = QInputDialog.getText(self, tr("Correct"), tr("Reason, for the report"))
        if not given:
            return
        values = {ACTION: action, REASON: reason.strip()}
        crs = self._canvas.mapSettings().destinationCrs()
        try:
            add_area(CORRECTIONS, polygon, folder / FILE, QgsProject.instance(), crs, values)
        except AreaError as error:
            self._say(str(error), True)
            return
        # until the layer is closed QGIS keeps what was added beside the file, whose hash a run records
        with closing(sqlite3.connect(folder / FILE)) as database:
            database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        self._say(tr("The correction is kept in {}. Run again uses it.").format(folder / FILE), False)

    def run_again(self) -> None:
        """Open the dialog of the run with its surveys, its settings and the corrections."""
        folder = self._folder()
        if folder is None:
            return
        try:
            algorithm, values = values_of_run(folder)
        except (UnusableFileError, ValueError, KeyError, TypeError, AttributeError):
            self._say(tr("The run in {} cannot be repeated from its record; open its dialog.").format(folder), True)
            return
        self._open_dialog(algorithm, values)


def values_of_run(folder: Path) -> tuple[str, dict[str, Any]]:
    """The algorithm that made a folder, and its values; with the corrections that lie there.

    A series gets its surveys by their folder if all lie in one; else the dialog asks for them.

    Raises:
        UnusableFileError, ValueError, KeyError, TypeError, AttributeError: the record is damaged or of another command.
    """
    record = json.loads(read_input(folder / RECORD_NAME, RECORD))
    algorithm = _ALGORITHMS[record["command"]]
    inputs = {str(one["role"]): str(one["path"]) for one in record["inputs"]}
    surveys = [(role.partition(" ")[2], path) for role, path in inputs.items() if role.startswith("epoch ")]
    values: dict[str, Any] = {"SETTINGS": str(folder / RECORD_NAME), "OUTPUT_FOLDER": str(folder), "OVERWRITE": True}
    if record["command"] == "series":
        folders = {str(Path(path).parent) for _, path in surveys}
        values.update({"INPUT": folders.pop()} if len(folders) == 1 else {})
    else:
        for name, (day, path) in zip(("REFERENCE", "CLOUD"), surveys):
            values.update({name: path, f"{name}_DATE": day})
    for role in _LAYERS:
        if role in inputs:
            values[role.upper()] = inputs[role]
    if (folder / FILE).is_file():
        values[CORRECTIONS.parameter] = str(folder / FILE)
    return algorithm, values
