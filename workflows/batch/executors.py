"""Where jobs run, behind one small interface: in this process, in processes of this machine, or on a Dask cluster."""

from __future__ import annotations

import queue
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

from .jobs import Job, Outcome
from .slope_process import PROGRAM, Events, Listener, work_here, work_on

Finished = tuple[Job, Outcome]


class Executor(ABC):
    """Runs jobs: ``slots`` of them at the same time, in so many bytes of ``memory``, or None for this machine's."""

    slots: int
    memory: int | None = None

    def __init__(self) -> None:
        self._ended: queue.SimpleQueue[Finished | BaseException] = queue.SimpleQueue()

    @abstractmethod
    def submit(self, job: Job, need: int) -> None:
        """Start a job that is estimated to need so many bytes, or have it wait for its turn."""

    def next(self, timeout: float) -> Finished | None:
        """A job that has ended, or None if none did within ``timeout`` seconds.

        Raises:
            Cancelled: the batch is being cancelled.
        """
        try:
            ended = self._ended.get(timeout=timeout)
        except queue.Empty:
            return None
        if isinstance(ended, BaseException):
            raise ended
        return ended

    @abstractmethod
    def close(self) -> None:
        """Wait for what runs, and give back what was taken."""


class InPlace(Executor):
    """One job after the other in this process: for a debugger, and where processes are not to be started."""

    slots = 1

    def __init__(self, work: Callable[[Job, Events], None], listen: Listener | None = None) -> None:
        super().__init__()
        self._work, self._listen = work, listen

    def submit(self, job: Job, need: int) -> None:
        self._ended.put((job, work_here(job, self._work, self._listen)))

    def close(self) -> None:
        return


class Processes(Executor):
    """Each job in a child process of its own; the threads here only wait for them."""

    def __init__(self, workers: int, listen: Listener | None = None, program: Sequence[str] = PROGRAM) -> None:
        super().__init__()
        self.slots = workers
        self._listen, self._program = listen, program
        self._pool = ThreadPoolExecutor(workers, thread_name_prefix="slope")

    def submit(self, job: Job, need: int) -> None:
        self._pool.submit(self._run, job)

    def _run(self, job: Job) -> None:
        try:
            self._ended.put((job, work_on(job, self._program, self._listen)))
        except Exception as error:  # it is raised where the batch waits
            self._ended.put(error)

    def close(self) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)
