"""The loop of a batch with a program in place of the engine: states, retries, memory, kills, and every executor."""

from __future__ import annotations

import json
import multiprocessing
import os
import random
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from slopewatch.engine.core.progress import Progress
from slopewatch.tests.builders.batch_program import PROGRAM, job, starts
from slopewatch.tests.builders.clouds import LasFile, las_file
from slopewatch.tests.builders.limits import PATIENCE_S
from slopewatch.workflows.batch.admission import Admission
from slopewatch.workflows.batch.executors import Executor, Processes
from slopewatch.workflows.batch.jobs import KILLED, MEMORY, Job, Outcome
from slopewatch.workflows.batch.results import result_of
from slopewatch.workflows.batch.scheduling import Board, work_through
from slopewatch.workflows.batch.state import Entry, StateFile

__all__ = ["las_file"]
GB = 1_000_000_000


class Watched(Progress):
    """Remembers what is shown."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []
        self.percents: list[float] = []

    def emit(self, percent: float, message: str) -> None:
        self.percents.append(percent)

    def show(self, level: str, message: str) -> None:
        self.lines.append(message)


class Recorded(Executor):
    """Ends each job at once, or as ``ends`` says; remembers how much memory was taken at the same time."""

    slots = 3

    def __init__(self, ends: dict[str, list[Outcome]]) -> None:
        super().__init__()
        self.ends = ends
        self.open: list[tuple[Job, int]] = []
        self.most = 0
        self.needs: dict[str, list[int]] = {}

    def submit(self, job: Job, need: int) -> None:
        self.open.append((job, need))
        self.needs.setdefault(job.slope, []).append(need)
        self.most = max(self.most, sum(n for _, n in self.open) if len(self.open) > 1 else 0)

    def next(self, timeout: float) -> tuple[Job, Outcome] | None:
        if not self.open:
            time.sleep(timeout)
            return None
        job, _ = self.open.pop(0)
        planned = self.ends.get(job.slope, [])
        return job, planned.pop(0) if planned else Outcome()

    def close(self) -> None:
        return


def jobs_of(*names: str) -> dict[str, Job]:
    return {n: Job(f"task of {n}", n, "series", (), {}, "default", {}, f"/nowhere/{n}") for n in names}


def through(
    jobs: dict[str, Job],
    executor: Executor,
    folder: Path,
    *,
    needs: dict[str, int] | None = None,
    budget: int = 10 * GB,
) -> tuple[dict[str, Entry], Watched]:
    """The states after the loop, as another process reads them from the file."""
    watched = Watched()
    states = StateFile(folder / "slopes.jsonl")
    with states.open(jobs):
        work_through(
            jobs, needs or dict.fromkeys(jobs, GB), executor, budget, states, retries=2, board=Board(len(jobs), watched)
        )
    return StateFile(folder / "slopes.jsonl").entries, watched


@pytest.fixture
def no_pause(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("slopewatch.workflows.batch.scheduling._PAUSE_S", 0.0)


def test_what_runs_fits_the_budget_and_the_largest_go_first(tmp_path: Path) -> None:
    needs = {"a": 2 * GB, "b": 5 * GB, "c": 4 * GB, "d": 3 * GB, "e": 20 * GB}
    executor = Recorded({})
    entries, watched = through(jobs_of(*needs), executor, tmp_path, needs=needs, budget=8 * GB)
    assert {e.state for e in entries.values()} == {"done"}
    assert executor.most == 8 * GB, "b with d fill the budget"
    assert list(executor.needs) == ["e", "b", "d", "c", "a"], "what alone is too large runs alone and first"
    assert watched.percents == sorted(watched.percents)
    assert watched.percents[-1] == 100


def test_admission_counts_slots_and_lets_nothing_in_next_to_what_is_too_large() -> None:
    admission = Admission(8, 2)
    admission.take("huge", 9)
    assert admission.next({"a": 1}) is None
    admission.release("huge")
    admission.take("a", 1)
    assert admission.next({"b": 8, "c": 7}) == "c"
    admission.take("c", 7)
    assert admission.next({"d": 0}) is None, "two slots"


@pytest.mark.usefixtures("no_pause")
def test_only_what_may_pass_the_second_time_is_tried_again(tmp_path: Path) -> None:
    lost, short, refused = Outcome("Killed.", KILLED), Outcome("Memory ran out.", MEMORY), Outcome("No cloud.")
    executor = Recorded({"a": [lost, lost], "b": [short], "c": [refused], "d": [lost] * 3})
    entries, watched = through(jobs_of("a", "b", "c", "d", "e"), executor, tmp_path, budget=3 * GB)
    assert {n: (e.state, e.attempts) for n, e in entries.items()} == {
        "a": ("done", 3), "b": ("done", 2), "c": ("failed", 1), "d": ("failed", 3), "e": ("done", 1),
    }  # fmt: skip
    assert entries["c"].sentence == "No cloud."
    assert entries["a"].sentence == ""
    assert executor.needs["b"] == [GB, 2 * GB], "more room after memory ran out"
    assert executor.needs["a"] == [GB, GB, 2 * GB], "a kill may be a lack of memory too"
    assert watched.warnings == ["c failed: No cloud.", "d failed: Killed."]


def test_a_torn_last_line_is_left_out_and_what_ran_is_pending(tmp_path: Path) -> None:
    path = tmp_path / "slopes.jsonl"
    states = StateFile(path)
    with states.open(["a", "b", "c"]):
        for name, state in (("a", "done"), ("b", "running"), ("c", "failed")):
            states.put(Entry(name, "t", state, sentence="é" if state == "failed" else ""))
    whole = path.read_bytes()
    assert whole.isascii()
    for cut in range(len(whole)):
        path.write_bytes(whole[:cut])
        found = StateFile(path).entries
        lines = whole[:cut].count(b"\n") + (whole[cut : cut + 1] == b"\n")
        assert [e.slope for e in found.values()] == ["a", "b", "c"][: max(0, lines - 1)]
    path.write_bytes(whole + b'{"slope": "a"}\n[1]\nnull\n{"slope": 1e999, "task": []}\n' + b"[" * 99_999 + b"\n\xff\n")
    found = StateFile(path).entries
    assert {n: e.state for n, e in found.items()} == {"a": "done", "b": "pending", "c": "failed"}
    assert found["c"].sentence == "é"
    with StateFile(path).open(["c"]):
        pass
    assert list(StateFile(path).entries) == ["c"], "slopes that the manifest no longer names"


def executors() -> list[str]:
    return ["processes", "dask", "queue"]


@contextmanager
def executor_of(kind: str, folder: Path, watched: Progress | None = None) -> Iterator[Executor]:
    if kind == "processes":
        made: Executor = Processes(2, program=PROGRAM)
    else:
        pytest.importorskip("distributed", reason="Dask is not installed; install slopewatch[cluster]")
        from slopewatch.workflows.batch.dask_cluster import Wanted
        from slopewatch.workflows.batch.dask_executor import Dask

        scheduler = "local"
        if kind == "queue":
            pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed")
            options = {"cores": 1, "processes": 1, "memory": "1GB", "local_directory": str(folder)}
            scheduler = str(folder / "cluster.json")
            Path(scheduler).write_text(json.dumps({"cluster": "local", "jobs": 2, "options": options}))
        made = Dask(Wanted(scheduler, 2, ""), watched or Progress(), PROGRAM)
    try:
        yield made
    finally:
        made.close()


@pytest.mark.filterwarnings("default")  # those of Dask are its own
@pytest.mark.usefixtures("no_pause")
@pytest.mark.parametrize("kind", executors())
def test_every_executor_ends_jobs_alike(kind: str, tmp_path: Path) -> None:
    kinds = {
        "good": "done", "damaged": "refused It is cut short.", "broken": "failed Internal failure.",
        "native": "crashed", "killed": "killed 1", "memory": "memory 1",
    }  # fmt: skip
    jobs = {name: job(tmp_path, name, does) for name, does in kinds.items()}
    with executor_of(kind, tmp_path) as executor:
        assert executor.slots == 2
        entries, _ = through(jobs, executor, tmp_path)
    assert {n: (e.state, e.attempts, e.sentence) for n, e in entries.items()} == {
        "good": ("done", 1, ""),
        "damaged": ("failed", 1, "It is cut short."),
        "broken": ("failed", 1, "Internal failure."),
        "native": ("failed", 1, "Its process crashed (SIGSEGV); a file may be damaged."),
        "killed": ("done", 2, ""),
        "memory": ("done", 2, ""),
    }
    assert {n: starts(j) for n, j in jobs.items()} == {n: e.attempts for n, e in entries.items()}
    for name in ("good", "killed", "memory"):
        assert result_of(jobs[name]) is not None


@pytest.mark.filterwarnings("default")
def test_a_scheduler_that_runs_already_says_how_much_it_has(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="Dask is not installed; install slopewatch[cluster]")
    from slopewatch.workflows.batch.dask_cluster import Wanted
    from slopewatch.workflows.batch.dask_executor import Dask

    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=2, memory_limit=3 * GB, resources={"memory": 2e9}, dashboard_address=None
    ) as cluster:
        watched = Progress()
        executor = Dask(Wanted(cluster.scheduler_address, 1, "127.0.0.1:0"), watched, PROGRAM)
        assert (executor.slots, executor.memory) == (4, 3 * GB)
        assert any("is where it was started" in sentence for sentence in watched.warnings)
        jobs = {name: job(tmp_path, name, "slow") for name in "abcd"}
        # each takes most of what a worker has declared, so that two never share one; one more than any has
        needs = dict.fromkeys(jobs, int(1.5 * GB)) | {"d": 5 * GB}
        started = time.monotonic()
        entries, _ = through(jobs, executor, tmp_path, needs=needs, budget=100 * GB)
        assert time.monotonic() - started > 2.0, "four slopes of a second on two workers"
        assert {e.state for e in entries.values()} == {"done"}
        executor.close()


@pytest.mark.filterwarnings("default")
def test_a_dask_worker_that_is_killed_loses_nothing(tmp_path: Path) -> None:
    jobs = {name: job(tmp_path, name, "slow") for name in "abcd"}
    with executor_of("dask", tmp_path) as executor:
        victims = list(executor._client.run(os.getpid).values())

        def kill() -> None:
            until = time.monotonic() + PATIENCE_S
            while time.monotonic() < until and not any(starts(j) for j in jobs.values()):
                time.sleep(0.02)
            os.kill(victims[0], signal.SIGKILL)

        killer = threading.Thread(target=kill)
        killer.start()
        entries, _ = through(jobs, executor, tmp_path)
        killer.join()
    assert {e.state for e in entries.values()} == {"done"}
    assert all(result_of(j) is not None for j in jobs.values())


SLOPES, KILLS = 6, 8


def run_in_a_process(folder: str) -> None:
    """A batch with the program of the tests, which takes its time for each slope."""
    from slopewatch.interface.parameters import BatchParameters
    from slopewatch.workflows.batch.corridor import run_batch
    from slopewatch.workflows.batch.corridor_plan import Given
    from slopewatch.workflows.batch.planning import Common

    given = Given(Path(folder) / "corridor.csv", Path(folder) / "out", program=PROGRAM)
    run_batch(given, Common({}, "default", None, None, BatchParameters(workers=2)))


@pytest.mark.slow
def test_a_batch_killed_at_random_moments_loses_nothing_and_repeats_little(las_file: LasFile, tmp_path: Path) -> None:
    """Each kill costs at most the two slopes that were at work."""
    lines = ["slope,date,file,roi"]
    for number in range(SLOPES):
        las_file(tmp_path / f"{number}.laz", points=500, seed=number)
        lines.append(f"S{number},2024-05-01,{number}.laz,")
    (tmp_path / "corridor.csv").write_text("\n".join(lines))
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["slopewatch.workflows.batch.corridor_work"])
    chance = random.Random(5)
    done_before: set[str] = set()
    for _ in range(KILLS):
        process = context.Process(target=run_in_a_process, args=(str(tmp_path),))
        process.start()
        process.join(chance.uniform(0.2, 1.5))
        process.kill()
        process.join(PATIENCE_S)
        entries = StateFile(tmp_path / "out" / "slopes.jsonl").entries
        done = {name for name, entry in entries.items() if entry.state == "done"}
        assert done >= done_before
        done_before = done
    last = context.Process(target=run_in_a_process, args=(str(tmp_path),))
    last.start()
    last.join(3 * PATIENCE_S)
    assert last.exitcode == 0
    assert {e.state for e in StateFile(tmp_path / "out" / "slopes.jsonl").entries.values()} == {"done"}
    assert json.loads((tmp_path / "out" / "run.json").read_text())["metrics"]["slopes_done"] == SLOPES
    started = sum(len(p.read_text().splitlines()) for p in tmp_path.glob("*.starts"))
    assert SLOPES <= started <= SLOPES + 2 * KILLS
    assert not list((tmp_path / "out").rglob(".slopewatch-part-*"))
