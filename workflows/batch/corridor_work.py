"""What a batch does where something is to be done: works on slopes, and writes what all of them show together."""

from __future__ import annotations

from ...engine.core.json_values import plain
from ...engine.core.progress import Progress
from ...engine.core.run_record import RunRecord
from ...engine.core.run_result import RunResult
from ...engine.report.signed.typesetting import refuse_without_means
from ...interface.parameters import RoadParameters, given
from ..run import Run
from .corridor_plan import Given, Planned, failures, in_order, signature, stamp, unchanged
from .dask_cluster import Wanted
from .dask_executor import Dask
from .estimate import default_budget, memory_needs
from .executors import Executor, InPlace, Processes
from .own_process import work_in_place
from .planning import Common, Plan
from .product_names import GEOPACKAGE
from .products import Made, read_alerts, write_products
from .regions_on_roads import Road
from .results import SlopeResult, result_of
from .scheduling import Board, work_through
from .settings import INSPECT, details_in, ground_is_given, group_of
from .signed_reports import renewed_reports
from .slope_process import PROGRAM
from .state import StateFile


def work_on_all(what: Given, common: Common, planned: Planned, record: RunRecord, progress: Progress) -> RunResult:
    """Work on the slopes that wait, and write the products unless nothing that they depend on has changed.

    Args:
        planned: what is to be done.
        record: that of the run, as it was begun.
    """
    run = Run("batch", {"batch": common.parameters}, [*what.inputs, *common.layers.inputs], progress, record)
    if common.options.get("pdf"):
        refuse_without_means()
    run.hash_inputs()
    found = planned.found
    with run.step("estimates", 0.04, 0.05, "reading headers"):
        known = len(found.problems)
        needs = memory_needs(found, progress)
    for problem in found.problems[known:]:
        progress.warning(problem.text)
    if needs and not common.parameters.scheduler and _need_pdal(found, needs):
        run.find_pdal(common.pdal)  # without it every slope would fail
    with planned.open_states() as states, run.step("slopes", 0.05, 0.9) as entry:
        if needs:
            _work(found, needs, what, common, states, progress)
        entry["slopes"] = {name: plain(state) for name, state in states.entries.items()}
    return _conclude(run, what, common, planned, needs)


def _need_pdal(found: Plan, needs: dict[str, int]) -> bool:
    return any(found.jobs[n].command == INSPECT or not ground_is_given(found.jobs[n].options) for n in needs)


def _work(
    found: Plan, needs: dict[str, int], what: Given, common: Common, states: StateFile, progress: Progress
) -> None:
    """Start the executor and work on what is to be done."""
    board = Board(len(needs), progress)
    executor = _executor(what, common, board, progress)
    parameters = common.parameters
    wanted = given(parameters.memory_budget)
    budget = default_budget(executor.memory) if wanted is None else int(wanted * 1e9)
    large = [name for name, need in needs.items() if need > budget]
    if large:
        progress.warning(
            f"{len(large)} slopes ({', '.join(large[:5])}) are estimated to need more than the memory budget of "
            f"{budget / 1e9:.3g} GB; each of them runs alone."
        )
    jobs = {name: found.jobs[name] for name in needs}
    with progress.stage(0.05, 0.9):
        try:
            work_through(jobs, needs, executor, budget, states, retries=parameters.retries, board=board)
        finally:
            executor.close()


def _executor(what: Given, common: Common, board: Board, progress: Progress) -> Executor:
    parameters = common.parameters
    if parameters.scheduler:
        page = parameters.dashboard_address if parameters.dashboard else ""
        own = None if what.program is PROGRAM else tuple(what.program)
        return Dask(Wanted(parameters.scheduler, parameters.workers, page, what.folder), progress, own)
    if parameters.workers == 0:
        return InPlace(work_in_place, board.listen)
    return Processes(parameters.workers, board.listen, what.program)


def _roads(common: Common, planned: Planned) -> dict[str, Road]:
    """The centreline of each slope that has one, and how its chainages are to be read."""
    found = {}
    for slope in planned.corridor.slopes:
        path, job = slope.centreline or common.layers.centreline, planned.found.jobs.get(slope.name)
        if path is not None and job is not None:
            groups = group_of(job.command, job.options, job.profile)
            parameters = groups[RoadParameters]
            assert isinstance(parameters, RoadParameters)
            found[slope.name] = Road(path, common.layers.field_names, parameters)
    return found


def _conclude(run: Run, what: Given, common: Common, planned: Planned, needs: dict[str, int]) -> RunResult:
    """Write the products, unless they are there and nothing that they depend on has changed."""
    folder, corridor, found = what.folder, planned.corridor, planned.found
    done: dict[str, SlopeResult] = dict(found.done)
    failed = set(failures(planned))
    for name in needs:
        result = result_of(found.jobs[name])
        if result is not None:
            done[name] = result
        else:
            failed.add((name, planned.states.entries[name].sentence or "Its results are gone."))
    results = in_order(planned, done)
    made_of = signature(what, common, planned, results, sorted(failed))
    known = unchanged(what, made_of, run.progress)
    if known is not None:
        return known
    run.read_reviews(folder, [GEOPACKAGE])
    alerts = read_alerts(folder)
    results = renewed_reports(results, found.jobs, run.progress)
    details = details_in(common.options)
    made = Made(corridor.slopes, results, sorted(failed), what.manifest, _roads(common, planned), details)
    run.figures = {
        "slopes": len({*(s.name for s in corridor.slopes), *(p.slope for p in corridor.problems if p.slope)}),
        "slopes_done": len(results),
        "slopes_computed": sum(1 for r in results if r.slope in needs),
        "slopes_failed": len({slope for slope, _ in failed}),
    }
    with run.writing(folder) as _:
        write_products(run, made, alerts)
        run.facts |= {
            "made_of": made_of,
            "tables_stamp": stamp(run.stage.path(GEOPACKAGE)),  # renaming keeps it
            "settings": dict(common.options),
            "profile": common.profile,
            "failed": [{"slope": slope, "sentence": sentence} for slope, sentence in sorted(failed)],
        }
        run.finish_reviews()
    return run.result()
