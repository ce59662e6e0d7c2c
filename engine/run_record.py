"""run.json: what ran, on what, with which parameters, and what came out."""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.metadata
import json
import math
import platform
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from . import lifecycle
from .parameters import ParameterSet
from .version import VERSION

_LIBRARIES = ("numpy", "scipy", "rasterio", "geopandas", "shapely", "pyproj", "pyogrio", "laspy", "lazrs")


class RunRecord:
    """Collects the facts of one run; ``write`` puts them into a file.

    ``stages`` holds one entry for each step: seconds, peak memory and the counts it reported.
    """

    def __init__(self, command: str, parameters: dict[str, ParameterSet]) -> None:
        self.started = datetime.now(timezone.utc)
        self._clock = time.monotonic()
        self.command = command
        self.parameters = {name: dataclasses.asdict(group) for name, group in parameters.items()}
        self.inputs: list[dict[str, Any]] = []
        self.stages: list[dict[str, Any]] = []
        self.metrics: dict[str, Any] = {}
        self.facts: dict[str, Any] = {}

    def add_input(self, role: str, path: Path) -> str:
        """Record an input file; returns its SHA-256."""
        digest = sha256(path)
        self.inputs.append({"role": role, "path": str(path), "bytes": path.stat().st_size, "sha256": digest})
        return digest

    @contextmanager
    def stage(self, name: str) -> Iterator[dict[str, Any]]:
        """Time a step and its peak memory; the block may add numbers to the entry."""
        entry: dict[str, Any] = {"stage": name}
        lifecycle.reset_peak_memory()
        start = time.monotonic()
        yield entry
        entry["seconds"] = round(time.monotonic() - start, 3)
        entry["peak_memory_mb"] = round(lifecycle.peak_memory() / 1e6, 1)
        self.stages.append(entry)

    def document(self, warnings: list[str], outputs: dict[str, Path]) -> dict[str, Any]:
        """The record as plain JSON values."""
        return {
            "software": f"SlopeWatch {VERSION}",
            "command": self.command,
            "started": self.started.isoformat(timespec="seconds"),
            "seconds": round(time.monotonic() - self._clock, 3),
            "parameters": self.parameters,
            "inputs": self.inputs,
            **{key: plain(value) for key, value in self.facts.items()},
            "stages": plain(self.stages),
            "metrics": plain(self.metrics),
            "warnings": warnings,
            "outputs": {name: path.name for name, path in outputs.items()},
            "versions": versions(),
        }

    def write(self, path: Path, warnings: list[str], outputs: dict[str, Path]) -> None:
        path.write_text(json.dumps(self.document(warnings, outputs), indent=2, ensure_ascii=False, allow_nan=False))


def versions() -> dict[str, str]:
    """Versions of SlopeWatch, Python, the system and the libraries that the results depend on."""
    found = {"slopewatch": VERSION, "python": sys.version.split()[0], "system": platform.platform()}
    for name in _LIBRARIES:
        found[name] = importlib.metadata.version(name)
    return found


def sha256(path: Path) -> str:
    """SHA-256 of a file's bytes, hexadecimal."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def plain(value: Any) -> Any:
    """Numpy numbers, paths and dataclasses as JSON values; numbers that are not finite as null."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return plain(dataclasses.asdict(value))
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Path):
        return str(value)
    return value
