"""Works on one slope: a child process that runs ``slopewatch``, so that its memory goes back to the system."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from ...engine.core.child_process import ChildResult, run_child
from ...engine.core.errors import EngineError, InputError, SlopeWatchError
from ...engine.core.file_lock import locked
from ...engine.core.part_folders import settle
from ...interface.protocol import CANCELLED, ERROR, INTERNAL_FAILURE, LOG, PROGRESS, TASK_VARIABLE
from .jobs import KILLED, MEMORY, Job, Outcome
from .results import result_of
from .settings import INSPECT, SERIES, arguments_of, ground_is_given

PROGRAM = (sys.executable, "-m", "slopewatch.cli")
"""What runs a slope; a test may give another program that speaks the engine's protocol."""
Listener = Callable[[str, float, str], None]
"""Takes the slope, the percentage that is done, and what is being done."""
_OUT_OF_MEMORY = ("Memory ran out", "MemoryError", "bad_alloc", "Cannot allocate memory", "Unable to allocate")
_KILLS = {-getattr(signal, name) for name in ("SIGKILL", "SIGTERM", "SIGHUP", "SIGINT") if hasattr(signal, name)}
# one thread a slope: the budget counts slopes, and the bytes must not depend on the machine
_ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


def run_job(values: dict[str, Any], program: Sequence[str] | None = None) -> dict[str, Any]:
    """``work_on`` for other machines: from JSON to JSON."""
    return work_on(Job.from_json(values), program or PROGRAM).as_json()


def work_on(job: Job, program: Sequence[str] = PROGRAM, listen: Listener | None = None) -> Outcome:
    """Run a job in a child process to its end.

    Raises:
        Cancelled: the batch is being cancelled.
    """

    def work(events: Events) -> int:
        environment = dict(os.environ) | {"PYTHONUTF8": "1", "PYTHONSAFEPATH": "1", TASK_VARIABLE: job.task}
        for name, value in _ENVIRONMENT.items():
            environment.setdefault(name, value)
        ended = run_child([*program, *arguments_of(job)], environment=environment, each_line=events.take)
        events.complaint = _last_line(ended)
        return ended.returncode

    return attempt(job, work, listen)


def attempt(job: Job, work: Callable[[Events], int], listen: Listener | None) -> Outcome:
    """Work on a job in its folder, which only one process does at a time, and check what it made."""
    started = time.monotonic()
    events = Events(job.slope, listen)
    folder = Path(job.folder)
    try:
        with _own(folder):
            made = result_of(job) is not None
            if made:
                code = 0
            else:
                _go_on_from_pair(job)
                code = work(events)
                made = result_of(job) is not None
    except InputError as error:  # another process is at work there, or the folder cannot be made
        return Outcome(str(error), KILLED, time.monotonic() - started)
    except EngineError as error:
        return Outcome(str(error), "", time.monotonic() - started)
    sentence, again = verdict(code, events, made=made)
    return Outcome(sentence, again, round(time.monotonic() - started, 3), tuple(events.warnings))


def _go_on_from_pair(job: Job) -> None:
    """Have a series use the ground of the surveys that the slope's earlier results hold."""
    folder = Path(job.folder)
    if job.command != SERIES or ground_is_given(job.options):
        return
    settle(folder.parent / INSPECT)
    if not (folder.parent / INSPECT / "run.json").is_file():
        return
    # not at the top: a worker of a cluster need not load what works on clouds, nor a batch that finds nothing to do
    from .kept_ground import keep_ground

    keep_ground(folder.parent / INSPECT, folder)


class Events:
    """What a child has said so far by the engine's protocol."""

    def __init__(self, slope: str, listen: Listener | None) -> None:
        self._slope, self._listen = slope, listen
        self.warnings: list[str] = []
        self.error, self.complaint = "", ""

    def progress(self, percent: float, message: str) -> None:
        if self._listen is not None:
            self._listen(self._slope, percent, message)

    def take(self, line: bytes) -> None:
        try:
            event = json.loads(line)
            name = event["event"]
            if name == PROGRESS:
                self.progress(float(event["percent"]), str(event["message"]))
            elif name == LOG and event.get("level") == "warning":
                self.warnings.append(str(event["message"]))
            elif name == ERROR:
                self.error = str(event["message"])
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            return  # not of the protocol: a library that prints


def verdict(code: int, events: Events, *, made: bool) -> tuple[str, str]:
    """Why a job failed (empty where it did not), and whether it may pass the second time."""
    said = events.error or events.complaint
    if code == 0:
        return (
            ("", "") if made else ("The results are not complete; look for a full disk, and run the batch again.", "")
        )
    if any(word in said for word in _OUT_OF_MEMORY):
        return said, MEMORY
    if code in _KILLS or code == CANCELLED:
        return "Its process was killed; the system does that where memory runs out.", KILLED
    if code < 0:
        return f"Its process crashed ({_signal_name(-code)}); a file may be damaged.", ""
    return said or f"Its process ended with code {code} and without a word.", ""


@contextlib.contextmanager
def _own(folder: Path) -> Iterator[None]:
    """Hold the folder of a slope, without what killed runs left in it."""
    try:
        with locked(folder / ".lock", f"Another process is at work in {folder}; wait until it has ended."):
            settle(folder)
            yield
    except OSError as error:
        raise EngineError(f"The folder {folder} cannot be written ({error.strerror}); free some space.") from error


def _last_line(ended: ChildResult) -> str:
    lines = ended.stderr.decode("utf-8", "replace").strip().splitlines()
    return lines[-1].removeprefix("Error: ")[:500] if lines else ""


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def work_here(job: Job, work: Callable[[Job, Events], None], listen: Listener | None = None) -> Outcome:
    """Run a job in this process: ``work`` raises SlopeWatchError where it fails."""

    def run(events: Events) -> int:
        before = os.environ.get(TASK_VARIABLE)
        os.environ[TASK_VARIABLE] = job.task
        try:
            work(job, events)
        except SlopeWatchError as error:
            events.error = str(error)
            return error.exit_code
        except MemoryError:
            events.error = "Memory ran out; clip the cloud to the slope or use a larger cell."
            return INTERNAL_FAILURE
        except Exception as unexpected:  # a child process would have ended with it; the other slopes go on here too
            events.error = f"Internal failure: {type(unexpected).__name__}: {unexpected}"
            return INTERNAL_FAILURE
        finally:
            os.environ.pop(TASK_VARIABLE)
            if before is not None:
                os.environ[TASK_VARIABLE] = before
        return 0

    return attempt(job, run, listen)
