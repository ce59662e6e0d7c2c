"""run.json: what ran, on what, with which parameters, and what came out."""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from ...interface.language import current_language
from ...interface.parameters import ParameterSet
from . import child_process
from .checksums import sha256
from .errors import InputError
from .input_files import parts_of
from .json_values import plain
from .version import VERSION

_LIBRARIES = (
    "numpy",
    "scipy",
    "rasterio",
    "geopandas",
    "shapely",
    "pyproj",
    "pyogrio",
    "laspy",
    "lazrs",
    "numba",
    "matplotlib",
)


class RunRecord:
    """Collects the facts of one run; ``write`` puts them into a file.

    ``stages`` holds one entry for each step: seconds by the clock and of all processors, peak memory and the counts it
    reported.
    """

    def __init__(self, command: str, parameters: dict[str, ParameterSet]) -> None:
        self.started = datetime.now(timezone.utc)
        self._clock = time.monotonic()
        self.command = command
        self.parameters = {name: asdict(group) for name, group in parameters.items()}
        self.inputs: list[dict[str, Any]] = []
        self.stages: list[dict[str, Any]] = []
        self.metrics: dict[str, Any] = {}
        self.facts: dict[str, Any] = {}

    def add_input(self, role: str, path: Path) -> str:
        """Record an input file (or folder, such as a file geodatabase); returns its SHA-256.

        Raises:
            InputError: it does not exist or cannot be read.
        """
        try:
            files = parts_of(path)
            digest = sha256(*files)
            size = sum(p.stat().st_size for p in files)
        except InputError:
            raise
        except OSError as error:
            raise InputError(f"{path} cannot be read ({error.strerror}); check its permissions.") from error
        self.inputs.append({"role": role, "path": str(path), "bytes": size, "sha256": digest})
        return digest

    @contextmanager
    def stage(self, name: str) -> Iterator[dict[str, Any]]:
        """Time a step and its peak memory; the block may add numbers to the entry."""
        entry: dict[str, Any] = {"stage": name}
        child_process.reset_peak_memory()
        start, worked = time.monotonic(), processor_seconds()
        yield entry
        entry["seconds"] = round(time.monotonic() - start, 3)
        entry["processor_seconds"] = round(processor_seconds() - worked, 3)
        entry["peak_memory_mb"] = round(child_process.peak_memory() / 1e6, 1)
        self.stages.append(entry)

    def document(self, warnings: list[str], outputs: dict[str, Path]) -> dict[str, Any]:
        """The record as plain JSON values; outputs are named from the folder of ``outputs["run"]``."""
        folder = outputs["run"].parent if "run" in outputs else None
        return {
            "software": f"SlopeWatch {VERSION}",
            "command": self.command,
            "language": current_language(),
            "started": self.started.isoformat(timespec="seconds"),
            "seconds": round(time.monotonic() - self._clock, 3),
            "parameters": self.parameters,
            "inputs": self.inputs,
            **{key: plain(value) for key, value in self.facts.items()},
            "stages": plain(self.stages),
            "metrics": plain(self.metrics),
            "warnings": warnings,
            "outputs": {name: _within(path, folder) for name, path in outputs.items()},
            "versions": versions(),
        }

    def write(self, path: Path, warnings: list[str], outputs: dict[str, Path]) -> None:
        document = _without(f"{path.parent}{os.sep}", self.document(warnings, outputs))
        text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
        # a file name that is no Unicode is written with escapes rather than not at all
        path.write_text(text + "\n", encoding="utf-8", errors="backslashreplace")


def processor_seconds() -> float:
    """Seconds that processors have worked for this process and for its children that have ended."""
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


def _without(prefix: str, value: Any) -> Any:
    """``value`` with paths below a folder named from there: the folder is gone when the record is read."""
    if isinstance(value, dict):
        return {k: _without(prefix, v) for k, v in value.items()}
    if isinstance(value, list):
        return [_without(prefix, v) for v in value]
    return value.removeprefix(prefix) if isinstance(value, str) else value


def _within(path: Path, folder: Path | None) -> str:
    if folder is not None and path.is_relative_to(folder):
        return path.relative_to(folder).as_posix()
    return str(path)


def versions() -> dict[str, str]:
    """Versions of SlopeWatch, Python, the system and the libraries that the results depend on."""
    found = {"slopewatch": VERSION, "python": sys.version.split()[0], "system": platform.platform()}
    for name in _LIBRARIES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found
