"""What a batch is made of: slopes with their surveys, what is wrong with a manifest's rows, jobs and how they ended.

Jobs and outcomes travel to other processes and machines as JSON; they hold paths, never points.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from datetime import date
from pathlib import Path
from typing import Any

KILLED, MEMORY = "killed", "memory"
"""Why a job may pass the second time: its process was killed, or the memory ran out."""


@dataclass(frozen=True)
class Survey:
    """A cloud and its day."""

    day: date
    cloud: Path


@dataclass(frozen=True)
class Slope:
    """A slope of the corridor: its surveys, the earliest first, the files that belong to it, and settings by name."""

    name: str
    surveys: tuple[Survey, ...]
    roi: Path | None = None
    stable: Path | None = None
    alerts: Path | None = None
    centreline: Path | None = None
    classes: Path | None = None
    corrections: Path | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    profile: str = ""


@dataclass(frozen=True)
class Problem:
    """Why a slope, or a row of the manifest, cannot be worked on; ``slope`` is empty where it is not known."""

    slope: str
    sentence: str

    @property
    def text(self) -> str:
        """For the log."""
        return f"{self.slope}: {self.sentence}" if self.slope else self.sentence


@dataclass(frozen=True)
class Corridor:
    """What a manifest holds. A slope with a problem is not among ``slopes``; ``notes`` are sentences for the log."""

    slopes: tuple[Slope, ...]
    problems: tuple[Problem, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Job:
    """One slope to be worked on.

    ``task`` stands for all that its results depend on. ``epochs`` are days and clouds, ``files`` the other inputs by
    their role (roi, stable, alerts, centreline, field_names, classes, corrections), ``options`` the settings that
    differ from the profile's, ``folder`` the place of the results.
    """

    task: str
    slope: str
    command: str
    epochs: tuple[tuple[str, str], ...]
    files: Mapping[str, str]
    profile: str
    options: Mapping[str, Any]
    folder: str
    pdal: str = ""

    def as_json(self) -> dict[str, Any]:
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return (
            values
            | {"epochs": [list(e) for e in self.epochs], "files": dict(self.files)}
            | {"options": dict(self.options)}
        )

    @staticmethod
    def from_json(values: Mapping[str, Any]) -> Job:
        epochs = tuple((str(day), str(cloud)) for day, cloud in values["epochs"])
        return Job(**{**values, "epochs": epochs})


@dataclass(frozen=True)
class Outcome:
    """How a job ended. ``sentence`` says why it failed, ``again`` is KILLED or MEMORY; empty where it did not."""

    sentence: str = ""
    again: str = ""
    seconds: float = 0.0
    warnings: tuple[str, ...] = ()

    @property
    def done(self) -> bool:
        return not self.sentence

    def as_json(self) -> dict[str, Any]:
        warnings = list(self.warnings)
        return {"sentence": self.sentence, "again": self.again, "seconds": self.seconds, "warnings": warnings}

    @staticmethod
    def from_json(values: Mapping[str, Any]) -> Outcome:
        return Outcome(values["sentence"], values["again"], values["seconds"], tuple(values["warnings"]))
