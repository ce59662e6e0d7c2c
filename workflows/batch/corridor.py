"""``slopewatch batch``: all slopes of a manifest, and what they show together."""

from __future__ import annotations

import hashlib
import importlib.util
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...engine.core.earlier_results import refuse_results
from ...engine.core.errors import InputError
from ...engine.core.json_values import plain
from ...engine.core.messages import shown
from ...engine.core.progress import Progress
from ...engine.core.run_result import RunResult
from ...engine.core.version import VERSION
from ...interface.parameters import given
from ..run import Run
from .corridor_zones import SOURCES
from .dask_cluster import Wanted
from .dask_executor import Dask
from .estimate import default_budget
from .executors import Executor, InPlace, Processes
from .folder_lock import locked
from .jobs import Corridor
from .manifest import read_manifest
from .own_process import work_in_place
from .planning import Common, Plan, plan
from .products import BATCH_OUTPUTS, GEOPACKAGE, Made, read_alerts, write_products
from .results import SlopeResult, result_of
from .scheduling import Board, work_through
from .settings import INSPECT
from .slope_process import PROGRAM
from .state import FAILED, Entry, StateFile
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


def run_batch(what: Given, common: Common, progress: Progress | None = None) -> RunResult:
    """Work on all slopes that have no results yet, and write what they show together.

    A slope that fails is a row of the results with its sentence; the others go on. A batch that was stopped goes on
    where it was, and one that is complete computes nothing.

    Raises:
        InputError: the manifest cannot be read at all, the folder holds other results or another batch is at work in
            it, or the cluster cannot be used.
        EngineError: the cluster was lost.
    """
    folder = what.output_dir.absolute()
    manifest = what.manifest
    inputs = [("manifest", manifest if manifest.is_file() else None), ("centreline", what.centreline)]
    run = Run("batch", {"batch": common.parameters}, inputs, progress)
    run.refuse_outputs([folder / name for name in (*BATCH_OUTPUTS, STATES, HASHES)])
    _refuse_other_results(folder, overwrite=what.overwrite)
    if manifest.is_dir() and folder.is_relative_to(manifest.absolute()):
        raise InputError(f"The output folder {shown(folder)} lies in that of the slopes; choose one outside of it.")
    corridor = read_manifest(manifest, folder / REGIONS)
    sentence = f"Another batch is at work in {folder}; wait until it has ended, or choose another folder."
    with locked(folder / LOCK, sentence):
        return _locked_batch(run, what, common, corridor)


def _locked_batch(run: Run, what: Given, common: Common, corridor: Corridor) -> RunResult:
    folder, progress = what.output_dir.absolute(), run.progress
    run.hash_inputs()
    for note in corridor.notes:
        progress.warning(note)
    states = StateFile(folder / STATES)
    with run.step("plan", 0.0, 0.05, "reading the manifest"):
        hashes = FileHashes(folder / HASHES)
        found = plan(corridor.slopes, folder, common, hashes, states.entries, progress)
    for problem in (*corridor.problems, *found.problems):
        progress.warning(f"{problem.slope}: {problem.sentence}" if problem.slope else problem.sentence)
    progress.info(
        f"{len(corridor.slopes)} slopes: {len(found.done)} have their results, {len(found.needs)} are to be worked on."
    )
    here = not common.parameters.scheduler
    if here and any(
        found.jobs[n].command == INSPECT or not found.jobs[n].options.get("ground_ready") for n in found.needs
    ):
        run.find_pdal(common.pdal)  # without it every slope would fail
    with states.open(slope.name for slope in corridor.slopes), run.step("slopes", 0.05, 0.9) as entry:
        for name in found.done:
            if states.entries.get(name) is None or states.entries[name].task != found.jobs[name].task:
                states.put(Entry(name, found.jobs[name].task, "done"))
        for problem in found.problems:
            if problem.slope in found.jobs:
                states.put(Entry(problem.slope, found.jobs[problem.slope].task, FAILED, sentence=problem.sentence))
        if found.needs:
            _work(found, what, common, states, progress)
        entry["slopes"] = {name: plain(state) for name, state in states.entries.items()}
    return _conclude(run, what, common, corridor, found, states)


def _work(found: Plan, what: Given, common: Common, states: StateFile, progress: Progress) -> None:
    """Start the executor and work on what is to be done."""
    board = Board(len(found.needs), progress)
    executor = _executor(what, common, board, progress)
    parameters = common.parameters
    wanted = given(parameters.memory_budget)
    budget = default_budget(executor.memory) if wanted is None else int(wanted * 1e9)
    large = [name for name, need in found.needs.items() if need > budget]
    if large:
        progress.warning(
            f"{len(large)} slopes ({', '.join(large[:5])}) are estimated to need more than the memory budget of "
            f"{budget / 1e9:.3g} GB; each of them runs alone."
        )
    jobs = {name: found.jobs[name] for name in found.needs}
    with progress.stage(0.05, 0.9):
        try:
            work_through(jobs, found.needs, executor, budget, states, retries=parameters.retries, board=board)
        finally:
            executor.close()


def _executor(what: Given, common: Common, board: Board, progress: Progress) -> Executor:
    parameters = common.parameters
    if parameters.scheduler:
        page = parameters.dashboard_address if parameters.dashboard else ""
        own = None if what.program is PROGRAM else tuple(what.program)
        return Dask(Wanted(parameters.scheduler, parameters.workers, page), progress, own)
    if parameters.workers == 0:
        return InPlace(work_in_place, board.listen)
    return Processes(parameters.workers, board.listen, what.program)


def _conclude(run: Run, what: Given, common: Common, corridor: Corridor, found: Plan, states: StateFile) -> RunResult:
    """Write the products, unless they are there and nothing that they depend on has changed."""
    folder = what.output_dir.absolute()
    results: list[SlopeResult] = []
    failed = {(p.slope or "", p.sentence) for p in (*corridor.problems, *found.problems)}
    for slope in corridor.slopes:
        job = found.jobs.get(slope.name)
        result = None if job is None else found.done.get(slope.name) or result_of(job)
        if result is not None:
            results.append(result)
        elif slope.name in found.needs:
            failed.add((slope.name, states.entries[slope.name].sentence or "Its results are gone."))
    signature = _signature(what, common, results, sorted(failed))
    known = _unchanged(folder, signature)
    if known is not None:
        run.progress.info("Nothing has changed since the last run; its results stay as they are.")
        return RunResult(*known, tuple(run.progress.warnings))
    run.read_reviews(folder, [GEOPACKAGE])
    alerts = read_alerts(folder)
    made = Made(
        corridor.slopes, results, sorted(failed), what.manifest, what.centreline, common.parameters.chainage_start
    )
    run.figures = {
        "slopes": len({*(s.name for s in corridor.slopes), *(p.slope for p in corridor.problems if p.slope)}),
        "slopes_done": len(results),
        "slopes_computed": sum(1 for r in results if r.slope in found.needs),
        "slopes_failed": len({slope for slope, _ in failed}),
    }
    with run.writing(folder) as _:
        write_products(run, made, alerts)
        run.facts |= {
            "made_of": signature,
            "tables_stamp": _stamp(run.stage.path(GEOPACKAGE)),  # renaming keeps it
            "settings": dict(common.options),
            "profile": common.profile,
            "failed": [{"slope": slope, "sentence": sentence} for slope, sentence in sorted(failed)],
        }
        run.finish_reviews()
    return run.result()


def _signature(what: Given, common: Common, results: Sequence[SlopeResult], failed: Sequence[tuple[str, str]]) -> str:
    """What the products depend on, as a hash; the tables of zones by their time of change, for reviews in them."""
    keys = [key for key, _ in SOURCES]
    parts = {
        "version": VERSION,
        "tasks": [(r.slope, r.record["task"], [_stamp(r.outputs[k]) for k in keys if k in r.outputs]) for r in results],
        "failed": list(failed),
        "centreline": None if what.centreline is None else [str(what.centreline), *_stamp(what.centreline)],
        "manifest": what.manifest.name,
        "start": common.parameters.chainage_start,
        "parquet": importlib.util.find_spec("pyarrow") is not None,
    }
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:32]


def _stamp(path: Path) -> list[int]:
    """Size and time of change of a file; empty where it is not there."""
    try:
        status = path.stat()
    except OSError:
        return []
    return [status.st_size, status.st_mtime_ns]


def _unchanged(folder: Path, signature: str) -> tuple[dict[str, Path], dict[str, Any]] | None:
    """Outputs and figures of the last run, if they are there and made of the same."""
    record = _record(folder)
    if record is None or record.get("made_of") != signature:
        return None
    if record.get("tables_stamp") != _stamp(folder / GEOPACKAGE):  # people entered something, which the page shows
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
