"""Works on one slope in the engine's own process, by the workflows themselves."""

from __future__ import annotations

from dataclasses import fields
from datetime import date
from pathlib import Path
from typing import Any

from ...engine.core.progress import Progress
from ...engine.epochs.epoch import Epoch
from ..inspect import inspect_slope
from ..layer_files import LayerFiles
from ..series import monitor_series
from ..settings import SeriesSettings, Settings, gathered
from .jobs import Job
from .settings import INSPECT, group_of
from .slope_process import Events


def work_in_place(job: Job, events: Events) -> None:
    """Run a job here.

    Raises:
        InputError: something given cannot be used.
        EngineError: the engine failed.
    """
    groups = group_of(job.command, job.options, job.profile)
    epochs = [Epoch(Path(cloud), date.fromisoformat(day)) for day, cloud in job.epochs]
    files: dict[str, Any] = {role: Path(path) for role, path in job.files.items()}
    files["layers"] = LayerFiles(**{field.name: files.pop(field.name, None) for field in fields(LayerFiles)})
    more: dict[str, Any] = {
        "pdal": Path(job.pdal) if job.pdal else None,
        "overwrite": True,
        "progress": _Reported(events),
    }

    def group(wanted: type[Any]) -> Any:
        # a bundle may name a group by a class above the command's own, or one that the command does not take
        return next((g for kind, g in groups.items() if issubclass(kind, wanted)), wanted())

    if job.command == INSPECT:
        inspect_slope(epochs, Path(job.folder), gathered(Settings, group), **files, **more)
    else:
        monitor_series(epochs, Path(job.folder), gathered(SeriesSettings, group), **files, **more)


class _Reported(Progress):
    """The run's progress as events of its slope."""

    def __init__(self, events: Events) -> None:
        super().__init__()
        self._events = events

    def emit(self, percent: float, message: str) -> None:
        self._events.progress(percent, message)

    def show(self, level: str, message: str) -> None:
        if level == "warning":
            self._events.warnings.append(message)
