"""Jobs on a Dask cluster. Only JSON travels: the clouds must lie where every worker finds them under the same path."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

from ...engine.core.errors import EngineError
from ...engine.core.progress import Progress
from .dask_cluster import Wanted, connect
from .executors import Executor
from .jobs import KILLED, Job, Outcome
from .slope_process import run_job

_RESOURCE = "memory"
"""Bytes that a worker may declare (``dask worker --resources memory=32e9``), of which a slope takes its estimate."""


class Dask(Executor):
    """Runs jobs as Dask's tasks, each of which starts a child process on its worker.

    Raises:
        InputError, EngineError: see ``connect``.
    """

    def __init__(self, wanted: Wanted, progress: Progress, program: Sequence[str] | None = None) -> None:
        super().__init__()
        self._program = program
        self._stack = ExitStack()
        with ExitStack() as stack:
            cluster = connect(wanted, stack, progress)
            self._stack = stack.pop_all()
        self._client, self.slots, self.memory = cluster.client, cluster.slots, cluster.memory
        workers = self._client.scheduler_info(n_workers=-1)["workers"].values()
        self._declared = max((float(w.get("resources", {}).get(_RESOURCE, 0)) for w in workers), default=0.0)
        self._futures: dict[Any, Job] = {}
        self._number = 0

    def submit(self, job: Job, need: int) -> None:
        self._number += 1
        resources = {_RESOURCE: min(float(need), self._declared)} if self._declared else None
        try:
            future = self._client.submit(
                run_job, job.as_json(), self._program, key=f"{job.task}-{self._number}", resources=resources, retries=0
            )
        except Exception as error:
            raise EngineError(
                f"Dask's scheduler takes no more work ({error}); start it, and the batch again."
            ) from error
        self._futures[future] = job
        future.add_done_callback(self._done)

    def _done(self, future: Any) -> None:
        job = self._futures.pop(future)
        try:
            outcome = Outcome.from_json(future.result())
        except Exception as error:  # whatever happened to the worker, its other slopes are not to suffer
            outcome = self._lost(error)
        self._ended.put((job, outcome))
        future.release()

    def _lost(self, error: Exception) -> Outcome:
        """How a job ended whose worker gave no answer."""
        kind = type(error).__name__
        if kind in ("KilledWorker", "CancelledError", "FutureCancelledError", "CommClosedError", "TimeoutError"):
            return Outcome(f"Its Dask worker was lost ({kind}).", KILLED)
        return Outcome(f"Its Dask worker failed ({kind}: {error}); is the same SlopeWatch installed there?")

    def close(self) -> None:
        self._stack.close()
