"""What a batch is given, what it has found to do, and whether the products of its last run still hold.

This module and what it imports take small libraries only: see ``corridor``.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ...engine.core.errors import InputError
from ...engine.core.input_files import read_input
from ...engine.core.json_shapes import parse_json
from ...engine.core.part_folders import settle
from ...engine.core.progress import Progress
from ...engine.core.run_result import RunResult
from ...engine.core.version import VERSION
from ...interface.input_files import RECORD
from .jobs import Corridor
from .planning import Common, Plan
from .product_names import GEOPACKAGE, SOURCES
from .results import SlopeResult
from .settings import details_in
from .slope_process import PROGRAM
from .state import DONE, FAILED, Entry, StateFile


@dataclass(frozen=True)
class Given:
    """What a batch is given besides its settings: files for all slopes, and the program that works on one."""

    manifest: Path
    output_dir: Path
    overwrite: bool = False
    program: Sequence[str] = PROGRAM

    @property
    def folder(self) -> Path:
        return self.output_dir.absolute()

    @property
    def inputs(self) -> list[tuple[str, Path | None]]:
        """Role and path; a manifest that is a folder has no hash."""
        return [("manifest", self.manifest if self.manifest.is_file() else None)]


@dataclass(frozen=True)
class Planned:
    """What is known before any work: the slopes, what is to be done for them, and the states of earlier runs."""

    corridor: Corridor
    found: Plan
    states: StateFile

    @contextlib.contextmanager
    def open_states(self) -> Iterator[StateFile]:
        """The states, brought up to date with what was found, to be changed until the block is left."""
        jobs = self.found.jobs
        with self.states.open(slope.name for slope in self.corridor.slopes):
            for name in self.found.done:
                before = self.states.entries.get(name)
                if before is None or before.task != jobs[name].task:
                    self.states.put(Entry(name, jobs[name].task, DONE))
            for problem in self.found.problems:
                if problem.slope in jobs:
                    self.states.put(Entry(problem.slope, jobs[problem.slope].task, FAILED, sentence=problem.sentence))
            yield self.states


def unchanged(what: Given, made_of: str, progress: Progress) -> RunResult | None:
    """The result of the last run, if it is there and has this signature; None if the products are to be written."""
    known = _known(what.folder, made_of)
    if known is None:
        return None
    progress.info("Nothing has changed since the last run; its results stay as they are.")
    return RunResult(*known, tuple(progress.warnings))


def in_order(planned: Planned, done: dict[str, SlopeResult]) -> list[SlopeResult]:
    """The results that are there, in the manifest's order."""
    return [done[slope.name] for slope in planned.corridor.slopes if slope.name in done]


def failures(planned: Planned) -> list[tuple[str, str]]:
    """Slope and sentence of what cannot be worked on, as it is known before any work."""
    problems = (*planned.corridor.problems, *planned.found.problems)
    return sorted({(p.slope or "", p.sentence) for p in problems})


def signature(
    what: Given,
    common: Common,
    planned: Planned,
    results: Sequence[SlopeResult],
    failed: Sequence[tuple[str, str]],
) -> str:
    """What the products depend on, as a hash; the tables of zones by their time of change, for reviews in them."""
    keys = [key for key, _ in SOURCES]
    parts = {
        "version": VERSION,
        "tasks": [(r.slope, r.record["task"], [stamp(r.outputs[k]) for k in keys if k in r.outputs]) for r in results],
        "failed": list(failed),
        "layers": {role: [str(path), *stamp(path)] for role, path in common.layers.inputs if path is not None},
        "manifest": what.manifest.name,
        "details": [asdict(details_in(planned.found.jobs[r.slope].options)) for r in results],
        "of_all": asdict(details_in(common.options)),
        "parquet": importlib.util.find_spec("pyarrow") is not None,
    }
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:32]


def stamp(path: Path) -> list[int]:
    """Size and time of change of a file; empty where it is not there."""
    try:
        status = path.stat()
    except OSError:
        return []
    return [status.st_size, status.st_mtime_ns]


def _known(folder: Path, made_of: str) -> tuple[dict[str, Path], dict[str, Any]] | None:
    """Outputs and figures of the last run, if they are there and made of the same."""
    record = read_record(folder)
    if record is None or record.get("made_of") != made_of:
        return None
    if record.get("tables_stamp") != stamp(folder / GEOPACKAGE):  # people entered something, which the page shows
        return None
    outputs = {str(name): folder / str(path) for name, path in dict(record.get("outputs") or {}).items()}
    if not outputs or not all(path.is_file() for path in outputs.values()):
        return None
    return outputs, dict(record.get("metrics") or {}) | {"slopes_computed": 0}


def read_record(folder: Path) -> dict[str, Any] | None:
    """The record of the last run in a folder; None where there is none that can be read."""
    settle(folder)
    try:
        record = parse_json(read_input(folder / "run.json", RECORD))
    except (InputError, ValueError):
        return None
    return record if isinstance(record, dict) else None
