"""Dask clusters: one at an address, one of processes on this machine, or one that a batch system starts."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...engine.core.errors import EngineError, InputError
from ...engine.core.input_files import read_input
from ...engine.core.json_shapes import parse_json
from ...engine.core.messages import quoted, shown
from ...engine.core.progress import Progress
from ...interface.input_files import CLUSTER

LOCAL = "local"
_QUEUES = {
    "slurm": "SLURMCluster",
    "pbs": "PBSCluster",
    "sge": "SGECluster",
    "lsf": "LSFCluster",
    "oar": "OARCluster",
    "moab": "MoabCluster",
    "htcondor": "HTCondorCluster",
    "local": "LocalCluster",
}
_PATIENCE_S = 30  # seconds until a scheduler answers
MEMORY_SHARE = 0.5  # of a cluster's memory: its workers' machines do other work too


@dataclass(frozen=True)
class Wanted:
    """``scheduler`` as it was given; ``workers`` of an own cluster; ``dashboard`` is its page's address, or empty."""

    scheduler: str
    workers: int
    dashboard: str


@dataclass(frozen=True)
class Queue:
    """A cluster that a batch system starts: the class of dask-jobqueue, how many jobs, and the class's arguments."""

    kind: str
    jobs: int
    options: dict[str, Any]


@dataclass(frozen=True)
class Cluster:
    """``client`` is Dask's; ``slots`` jobs run at a time in ``memory`` bytes, None for those of this machine."""

    client: Any
    slots: int
    memory: int | None


def connect(wanted: Wanted, stack: ExitStack, progress: Progress) -> Cluster:
    """Start or find the cluster; leaving ``stack`` ends what was started.

    Raises:
        InputError: Dask is missing, nobody answers at the address, or the file describes no cluster.
        EngineError: the cluster does not start.
    """
    path = Path(wanted.scheduler)
    is_file = path.suffix.lower() == ".json"
    queue = read_queue(path) if is_file else None
    distributed = required("distributed")
    if wanted.dashboard and importlib.util.find_spec("bokeh") is None:
        progress.warning("Dask shows its dashboard only with bokeh; install it with: pip install bokeh")
    if queue is not None:
        return _queued(queue, wanted, distributed, stack)
    if wanted.scheduler == LOCAL:
        workers = max(1, wanted.workers)
        cluster = stack.enter_context(_started(lambda: _local(distributed, workers, wanted.dashboard)))
        return Cluster(stack.enter_context(distributed.Client(cluster)), workers, None)
    if wanted.dashboard:
        progress.warning("The dashboard of a scheduler that runs already is where it was started; it is not changed.")
    return _remote(wanted.scheduler, distributed, stack)


def required(name: str) -> Any:
    """A library of the optional part.

    Raises:
        InputError: it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InputError(
            f"Working with Dask needs the Python library {name}, which is not there ({error}); install it with: pip "
            "install 'slopewatch[cluster]', or leave out --scheduler."
        ) from error


def read_queue(path: Path) -> Queue:
    """The cluster that a JSON file describes.

    Raises:
        InputError: it cannot be read, or lacks or misnames something.
    """
    name = shown(path)
    try:
        document = parse_json(read_input(path, CLUSTER))
    except ValueError as error:
        raise InputError(f"The cluster file {name} is no JSON in UTF-8; correct it.") from error
    document = document if isinstance(document, dict) else {}
    kind, jobs, options = (document.get(key) for key in ("cluster", "jobs", "options"))
    if not isinstance(kind, str) or kind not in _QUEUES:
        raise InputError(f"The cluster file {name}: cluster is {quoted(kind)}; give one of {', '.join(_QUEUES)}.")
    if not isinstance(jobs, int) or isinstance(jobs, bool) or not 1 <= jobs <= 100_000:
        raise InputError(f"The cluster file {name}: jobs is {quoted(jobs)}; give a whole number from 1 to 100000.")
    if not isinstance(options, dict) or not {"cores", "memory"} <= options.keys():
        raise InputError(f"The cluster file {name}: options must name cores and memory of a job, such as 1 and 8GB.")
    return Queue(kind, jobs, options)


def _local(distributed: Any, workers: int, dashboard: str) -> Any:
    # on the loopback only; the slopes' memory is in their own processes, which Dask does not watch
    return distributed.LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        memory_limit=0,
        dashboard_address=dashboard or None,
        silence_logs=40,
    )


def _queued(queue: Queue, wanted: Wanted, distributed: Any, stack: ExitStack) -> Cluster:
    module = required("dask_jobqueue")
    if queue.kind == LOCAL:  # its stand-in for a batch system, which runs the jobs here
        module = importlib.import_module("dask_jobqueue.local")
    make = getattr(module, _QUEUES[queue.kind])
    options = dict(queue.options)
    options["scheduler_options"] = {
        "dashboard_address": wanted.dashboard or None,
        **dict(options.get("scheduler_options") or {}),
    }
    try:
        memory = required("dask.utils").parse_bytes(str(options["memory"]))
        cores = int(options["cores"])
    except (ValueError, TypeError) as error:
        raise InputError(f"The cluster file {shown(wanted.scheduler)}: {error}; correct cores or memory.") from error
    cluster = stack.enter_context(_started(lambda: make(**options)))
    cluster.scale(jobs=queue.jobs)
    client = stack.enter_context(distributed.Client(cluster))
    return Cluster(client, queue.jobs * cores, int(MEMORY_SHARE * memory) * queue.jobs)


def _started(make: Callable[[], Any]) -> Any:
    try:
        return make()
    except (OSError, RuntimeError, TypeError, ValueError) as error:
        raise EngineError(f"The Dask cluster does not start ({error}); check its settings.") from error


def _remote(address: str, distributed: Any, stack: ExitStack) -> Cluster:
    try:
        client = stack.enter_context(distributed.Client(address, timeout=_PATIENCE_S))
        client.wait_for_workers(1, timeout=_PATIENCE_S)
        workers = client.scheduler_info(n_workers=-1)["workers"].values()
    except (OSError, ValueError, TypeError, TimeoutError) as error:
        reason = str(error) or type(error).__name__
        raise InputError(
            f"No Dask scheduler with a worker answers at {address} ({reason}); check the address, and start workers."
        ) from error
    memory = sum(int(w["memory_limit"] or 0) for w in workers)
    return Cluster(client, sum(int(w["nthreads"]) for w in workers), int(MEMORY_SHARE * memory) or None)
