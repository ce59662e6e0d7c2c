"""The report of a run made again in the background, by the algorithm of the toolbox."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from qgis.core import (
    QgsApplication,
    QgsProcessingAlgRunnerTask,
    QgsProcessingContext,
    QgsProcessingFeedback,
    QgsProject,
)

from ..bridge.words import tr

ALGORITHM = "slopewatch:writereport"


class Complaints(QgsProcessingFeedback):
    """Keeps what went wrong."""

    def __init__(self) -> None:
        super().__init__(False)
        self.sentences: list[str] = []

    def reportError(self, error: str, fatalError: bool = False) -> None:
        self.sentences.append(error)
        super().reportError(error, fatalError)


class ReportTask:
    """Makes the report of ``folder``; ``done`` gets whether it is there and what went wrong."""

    def __init__(self, folder: Path, done: Callable[[bool, str], None]) -> None:
        self._done = done
        self._feedback, self._context = Complaints(), QgsProcessingContext()
        self._context.setProject(QgsProject.instance())
        algorithm = QgsApplication.processingRegistry().createAlgorithmById(ALGORITHM)
        self._task = QgsProcessingAlgRunnerTask(algorithm, {"INPUT": str(folder)}, self._context, self._feedback)
        self._task.setDescription(tr("Report of {}").format(folder.name))
        self._task.executed.connect(self._ended)

    def start(self) -> None:
        if self._task.isCanceled():  # the values were refused
            self._ended(False, {})
            return
        QgsApplication.taskManager().addTask(self._task)

    def _ended(self, successful: bool, results: Any) -> None:
        self._done(successful, "" if successful else " ".join(self._feedback.sentences).strip())
