"""``slopewatch batch``: all slopes of a manifest, and what they show together.

This module and what it imports decide what is to be done, with small libraries only: to find that nothing is takes less
time than to load those that work on clouds. What is done stands in ``corridor_work``.
"""

from __future__ import annotations

from pathlib import Path

from ...engine.core.earlier_results import refuse_results
from ...engine.core.errors import InputError
from ...engine.core.file_lock import locked
from ...engine.core.input_files import refuse_odd_outputs, refuse_unusable
from ...engine.core.messages import shown
from ...engine.core.progress import Progress
from ...engine.core.run_record import RunRecord
from ...engine.core.run_result import RunResult
from ...engine.core.staged_outputs import refuse_inputs_as_outputs
from .corridor_plan import Given, Planned, failures, in_order, read_record, signature, unchanged
from .jobs import Corridor
from .manifest import read_manifest
from .planning import Common, plan
from .product_names import BATCH_OUTPUTS
from .state import StateFile
from .task_ids import FileHashes

STATES, HASHES, REGIONS, LOCK = "slopes.jsonl", "hashes.json", "regions", ".lock"
"""What a batch keeps in its folder from run to run."""


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
    scheduler = common.parameters.scheduler
    cluster = Path(scheduler) if scheduler.lower().endswith(".json") else None
    refuse_unusable([*what.inputs, *common.layers.inputs, ("alerts", common.alerts), ("cluster", cluster)])
    refuse_odd_outputs(outputs)
    refuse_inputs_as_outputs(outputs, [path for _, path in (*what.inputs, *common.layers.inputs) if path])
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
    return unchanged(what, signature(what, common, planned, results, failures(planned)), progress)


def _refuse_other_results(folder: Path, *, overwrite: bool) -> None:
    """Raise InputError if the folder holds results that are not of a batch."""
    record = read_record(folder)
    if (folder / STATES).exists() or (record is not None and record.get("command") == "batch"):
        return
    refuse_results(folder, BATCH_OUTPUTS, overwrite=overwrite)
