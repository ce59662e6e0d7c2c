"""``slopewatch batch``: all slopes of a manifest, and what they show together.

This module and what it imports decide what is to be done, with small libraries only: to find that nothing is takes less
time than to load those that work on clouds. What is done stands in ``corridor_work``.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...engine.core.earlier_results import refuse_results
from ...engine.core.errors import InputError
from ...engine.core.file_lock import locked
from ...engine.core.messages import shown
from ...engine.core.progress import Progress
from ...engine.core.run_record import RunRecord
from ...engine.core.run_result import RunResult
from ...engine.core.staged_outputs import refuse_inputs_as_outputs
from ...engine.core.version import VERSION
from .jobs import Corridor
from .manifest import read_manifest
from .planning import Common, Plan, plan
from .product_names import BATCH_OUTPUTS, GEOPACKAGE, SOURCES
from .results import SlopeResult
from .slope_process import PROGRAM
from .state import DONE, FAILED, Entry, StateFile
from .task_ids import FileHashes

STATES, HASHES, REGIONS, LOCK = "slopes.jsonl", "hashes.json", "regions", ".lock"
"""What a batch keeps in its folder from run to run."""


@dataclass(frozen=True)
class Given:
    """What a batch is given besides its settings: files for all slopes, and the program that works on one."""

    manifest: Path
    output_dir: Path
    centreline: Path | None = None
    overwrite: bool = False
    program: Sequence[str] = PROGRAM

    @property
    def folder(self) -> Path:
        return self.output_dir.absolute()

    @property
    def inputs(self) -> list[tuple[str, Path | None]]:
        """Role and path of the files for all slopes; a manifest that is a folder has no hash."""
        return [("manifest", self.manifest if self.manifest.is_file() else None), ("centreline", self.centreline)]


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


def run_batch(what: Given, common: Common, progress: Progress | None = None) -> RunResult:
    """Work on all slopes that have no results yet, and write what they show together.

    A slope that fails is a row of the results with its sentence; the others go on. A batch that was stopped goes on
    where it was, and one that is complete computes nothing.

    Raises:
        InputError: the manifest cannot be read at all, the folder holds other results or another batch is at work in
            it, or the cluster cannot be used.
        EngineError: the cluster was lost.
    """
    progress, folder, manifest = progress or Progress(), what.folder, what.manifest
    record = RunRecord("batch", {"batch": common.parameters})
    outputs = [folder / name for name in (*BATCH_OUTPUTS, STATES, HASHES)]
    refuse_inputs_as_outputs(outputs, [path for _, path in what.inputs if path is not None])
    _refuse_other_results(folder, overwrite=what.overwrite)
    if manifest.is_dir() and folder.is_relative_to(manifest.absolute()):
        raise InputError(f"The output folder {shown(folder)} lies in that of the slopes; choose one outside of it.")
    corridor = read_manifest(manifest, folder / REGIONS)
    sentence = f"Another batch is at work in {folder}; wait until it has ended, or choose another folder."
    with locked(folder / LOCK, sentence):
        planned = _planned(what, common, corridor, record, progress)
        known = None if planned.found.waiting else _unchanged_plan(what, common, planned, progress)
        if known is not None:
            with planned.open_states():
                return known
        # not at the top: the libraries of all commands take longer to load than all of the above
        from .corridor_work import work_on_all

        return work_on_all(what, common, planned, record, progress)


def _planned(what: Given, common: Common, corridor: Corridor, record: RunRecord, progress: Progress) -> Planned:
    for note in corridor.notes:
        progress.warning(note)
    states = StateFile(what.folder / STATES)
    with progress.stage(0.0, 0.04, "reading the manifest"), record.stage("plan"):
        hashes = FileHashes(what.folder / HASHES)
        found = plan(corridor.slopes, what.folder, common, hashes, states.entries, progress)
    for problem in (*corridor.problems, *found.problems):
        progress.warning(problem.text)
    progress.info(
        f"{len(corridor.slopes)} slopes: {len(found.done)} have their results, {len(found.waiting)} are to be worked "
        "on."
    )
    return Planned(corridor, found, states)


def _unchanged_plan(what: Given, common: Common, planned: Planned, progress: Progress) -> RunResult | None:
    results = in_order(planned, planned.found.done)
    return unchanged(what, signature(what, common, results, failures(planned)), progress)


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


def signature(what: Given, common: Common, results: Sequence[SlopeResult], failed: Sequence[tuple[str, str]]) -> str:
    """What the products depend on, as a hash; the tables of zones by their time of change, for reviews in them."""
    keys = [key for key, _ in SOURCES]
    parts = {
        "version": VERSION,
        "tasks": [(r.slope, r.record["task"], [stamp(r.outputs[k]) for k in keys if k in r.outputs]) for r in results],
        "failed": list(failed),
        "centreline": None if what.centreline is None else [str(what.centreline), *stamp(what.centreline)],
        "manifest": what.manifest.name,
        "start": common.parameters.chainage_start,
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
    record = _record(folder)
    if record is None or record.get("made_of") != made_of:
        return None
    if record.get("tables_stamp") != stamp(folder / GEOPACKAGE):  # people entered something, which the page shows
        return None
    outputs = {str(name): folder / str(path) for name, path in dict(record.get("outputs") or {}).items()}
    if not outputs or not all(path.is_file() for path in outputs.values()):
        return None
    return outputs, dict(record.get("metrics") or {}) | {"slopes_computed": 0}


def _refuse_other_results(folder: Path, *, overwrite: bool) -> None:
    """Raise InputError if the folder holds results that are not of a batch."""
    record = _record(folder)
    if (folder / STATES).exists() or (record is not None and record.get("command") == "batch"):
        return
    refuse_results(folder, BATCH_OUTPUTS, overwrite=overwrite)


def _record(folder: Path) -> dict[str, Any] | None:
    try:
        record = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return record if isinstance(record, dict) else None
