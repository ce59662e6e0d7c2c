"""Whether a folder holds the results of a task, and what they say."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...engine.core.errors import InputError
from ...engine.core.input_files import read_input
from ...engine.core.json_shapes import parse_json
from ...engine.core.part_folders import settle
from ...engine.core.version import VERSION
from ...interface.input_files import RECORD
from .jobs import Job

_RECORD = "run.json"


@dataclass(frozen=True)
class SlopeResult:
    """The results of a slope that is done: its run record, and its outputs by name."""

    slope: str
    folder: Path
    record: dict[str, Any]
    outputs: dict[str, Path]

    @property
    def command(self) -> str:
        return str(self.record["command"])

    @property
    def figures(self) -> dict[str, Any]:
        figures = self.record.get("metrics")
        return figures if isinstance(figures, dict) else {}

    @property
    def days(self) -> list[str]:
        """Days of the surveys, the earliest first."""
        roles = [str(i.get("role")) for i in self.record["inputs"]]
        return [role.removeprefix("epoch ") for role in roles if role.startswith("epoch ")]


def result_of(job: Job) -> SlopeResult | None:
    """The results of a job if its folder holds all of them: the record of this very task, and each file it promises."""
    folder = Path(job.folder)
    settle(folder)
    record = _record(folder / _RECORD)
    if record is None or record.get("task") != job.task or record.get("command") != job.command:
        return None
    outputs, inputs = record.get("outputs"), record.get("inputs")
    if record.get("software") != f"SlopeWatch {VERSION}" or not isinstance(outputs, dict):
        return None
    if not isinstance(inputs, list) or not all(isinstance(i, dict) for i in inputs):
        return None
    files = {str(name): folder / str(path) for name, path in outputs.items()}
    if not all(_sound(path) for path in files.values()):
        return None
    return SlopeResult(job.slope, folder, record, files)


def _record(path: Path) -> dict[str, Any] | None:
    try:
        record = parse_json(read_input(path, RECORD))
    except (InputError, ValueError):
        return None
    return record if isinstance(record, dict) else None


def _sound(path: Path) -> bool:
    try:
        return path.is_file() and path.stat().st_size > 0
    except (OSError, ValueError):
        return False
