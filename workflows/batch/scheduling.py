"""The loop of a batch: starts slopes as their memory fits, keeps their states, tries again what may pass."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from dataclasses import replace

from ...engine.core.progress import Progress
from .admission import Admission
from .executors import Executor
from .jobs import MEMORY, Job, Outcome
from .state import DONE, FAILED, PENDING, RUNNING, Entry, StateFile

_WAKING_S = 0.2  # seconds
_PAUSE_S = 1.0  # seconds before the first retry, twice as long before each further one
_LONGEST_PAUSE_S = 60.0
_MEMORY_FACTOR = 2  # what ran out of memory, or was killed twice, is held for so many times more


def work_through(
    jobs: Mapping[str, Job],
    needs: Mapping[str, int],
    executor: Executor,
    budget: int,
    states: StateFile,
    *,
    retries: int,
    board: Board,
) -> None:
    """Work on all jobs (by slope) until each is done or failed.

    Args:
        needs: estimated bytes of each.
        budget: bytes that may be in use at the same time.
        retries: how often one is tried again whose process was killed or ran out of memory.
        board: takes what is done.
    """
    admission = Admission(budget, executor.slots)
    waiting, from_when = dict(needs), dict.fromkeys(jobs, 0.0)
    for name, job in jobs.items():
        states.put(Entry(name, job.task, memory=needs[name]))
    while waiting or admission.held:
        now = time.monotonic()
        ready = {name: need for name, need in waiting.items() if from_when[name] <= now}
        chosen = admission.next(ready)
        if chosen is not None:
            need = waiting.pop(chosen)
            admission.take(chosen, need)
            entry = states.entries[chosen]
            states.put(replace(entry, state=RUNNING, attempts=entry.attempts + 1))
            executor.submit(jobs[chosen], need)
            continue
        ended = executor.next(_WAKING_S)
        if ended is None:
            continue
        job, outcome = ended
        need = admission.held[job.slope]
        admission.release(job.slope)
        entry = states.entries[job.slope]
        if outcome.again and entry.attempts <= retries:
            waiting[job.slope] = _need_again(need, outcome, entry.attempts, budget)
            from_when[job.slope] = time.monotonic() + min(_PAUSE_S * 2 ** (entry.attempts - 1), _LONGEST_PAUSE_S)
            states.put(replace(entry, state=PENDING, sentence=outcome.sentence))
            board.again(job.slope, outcome)
            continue
        state = DONE if outcome.done else FAILED
        states.put(replace(entry, state=state, sentence=outcome.sentence, seconds=round(outcome.seconds, 3)))
        board.ended(job.slope, outcome)


def _need_again(need: int, outcome: Outcome, attempts: int, budget: int) -> int:
    """Bytes to hold for what is tried again: at most the budget, with which it runs alone."""
    more = outcome.again == MEMORY or attempts > 1
    return max(need, min(_MEMORY_FACTOR * need, budget)) if more else need


class Board:
    """The progress of all slopes together, and a message for each that ended."""

    def __init__(self, count: int, progress: Progress) -> None:
        self._count, self._progress = count, progress
        self._done = 0
        self._percent: dict[str, float] = {}
        self._lock = threading.Lock()

    def listen(self, slope: str, percent: float, message: str) -> None:
        """Take the progress of a slope; called from other threads."""
        with self._lock:
            self._percent[slope] = percent
            self._show(f"{slope}: {message}")

    def again(self, slope: str, outcome: Outcome) -> None:
        with self._lock:
            self._percent.pop(slope, None)
        self._progress.info(f"{slope} is tried again. {outcome.sentence}")

    def ended(self, slope: str, outcome: Outcome) -> None:
        with self._lock:
            self._percent.pop(slope, None)
            self._done += 1
            self._show(f"{slope} {'done' if outcome.done else 'failed'}")
        if outcome.done:
            self._progress.info(f"{slope}: done in {outcome.seconds:.0f} s.")
        else:
            self._progress.warning(f"{slope} failed: {outcome.sentence}")

    def _show(self, message: str) -> None:
        fraction = (self._done + sum(self._percent.values()) / 100.0) / max(1, self._count)
        self._progress.update(fraction, f"{self._done} of {self._count} slopes, {message}")
