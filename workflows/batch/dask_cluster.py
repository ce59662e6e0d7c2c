"""Dask clusters: one at an address, one of processes on this machine, or one that a batch system starts.

Whoever reaches a Dask scheduler or worker runs programs there. So a cluster that is started here takes only who has its
certificate, which is made for the batch and lies in a folder that its user alone can read.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...engine.core.errors import EngineError, InputError
from ...engine.core.input_files import read_input
from ...engine.core.messages import quoted, shown
from ...engine.core.progress import Progress
from ...engine.core.temporary_folders import temporary_folder
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
_LOOPBACK = "127.0.0.1"
_OURS = ("security", "protocol")
_PATIENCE_S = 30  # seconds until a scheduler answers
_CERTIFICATE_BYTES = 8_192
MEMORY_SHARE = 0.5  # of a cluster's memory: its workers' machines do other work too


@dataclass(frozen=True)
class Wanted:
    """``scheduler`` as it was given; ``workers`` of an own cluster; ``dashboard`` is its page's address, or empty.

    ``folder`` is one that the workers of a batch system see too; by default the one for temporary files.
    """

    scheduler: str
    workers: int
    dashboard: str
    folder: Path | None = None


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
        folder = stack.enter_context(temporary_folder("dask", needed_bytes=_CERTIFICATE_BYTES))
        workers = max(1, wanted.workers)
        cluster = stack.enter_context(_started(lambda: _local(distributed, workers, wanted.dashboard, folder)))
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
        document = json.loads(read_input(path, CLUSTER).decode())
    except (ValueError, RecursionError) as error:
        raise InputError(f"The cluster file {name} is no JSON in UTF-8; correct it.") from error
    document = document if isinstance(document, dict) else {}
    kind, jobs, options = (document.get(key) for key in ("cluster", "jobs", "options"))
    if not isinstance(kind, str) or kind not in _QUEUES:
        raise InputError(f"The cluster file {name}: cluster is {quoted(kind)}; give one of {', '.join(_QUEUES)}.")
    if not isinstance(jobs, int) or isinstance(jobs, bool) or not 1 <= jobs <= 100_000:
        raise InputError(f"The cluster file {name}: jobs is {quoted(jobs)}; give a whole number from 1 to 100000.")
    if not isinstance(options, dict) or not {"cores", "memory"} <= options.keys():
        raise InputError(f"The cluster file {name}: options must name cores and memory of a job, such as 1 and 8GB.")
    scheduler = options.get("scheduler_options")
    for odd in _OURS:
        if odd in options or (isinstance(scheduler, dict) and odd in scheduler):
            raise InputError(
                f"The cluster file {name}: options must not name {odd}, as a batch's cluster always uses TLS; remove "
                "it."
            )
    return Queue(kind, jobs, options)


def certified(folder: Path) -> Any:
    """Dask's settings for TLS by a new certificate, whose files in ``folder`` this user alone can read.

    Raises:
        InputError: the library that makes certificates is missing.
    """
    required("cryptography")
    security = required("distributed.security").Security
    made = security.temporary().get_tls_config_for_role("scheduler")
    paths = {}
    for kind, ending in (("cert", "certificate.pem"), ("key", "key.pem")):
        paths[kind] = str(folder / ending)
        descriptor = os.open(paths[kind], os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with open(descriptor, "w", encoding="ascii") as file:
            file.write(made[kind])
    roles = {f"tls_{role}_{kind}": path for role in ("client", "scheduler", "worker") for kind, path in paths.items()}
    return security(require_encryption=True, tls_ca_file=paths["cert"], **roles)


def _local(distributed: Any, workers: int, dashboard: str, folder: Path) -> Any:
    nodes = _nodes()
    ours = {"host": _LOOPBACK, "protocol": "tls://", "security": certified(folder)}
    # the slopes' memory is in their own processes, which Dask does not watch
    options = {**ours, "nthreads": 1, "memory_limit": 0, "local_directory": str(folder), "silence_logs": 40}
    worker = {"cls": distributed.Nanny, "options": {**options, "worker_class": nodes.QuietWorker}}
    return distributed.SpecCluster(
        scheduler={"cls": nodes.QuietScheduler, "options": {**ours, "dashboard_address": dashboard or None}},
        workers=dict.fromkeys(range(workers), worker),
        worker=worker,
        security=ours["security"],
        silence_logs=40,
    )


def _nodes() -> Any:
    return importlib.import_module(".dask_nodes", __package__)


def _queued(queue: Queue, wanted: Wanted, distributed: Any, stack: ExitStack) -> Cluster:
    module = required("dask_jobqueue")
    if queue.kind == LOCAL:  # its stand-in for a batch system, which runs the jobs here
        module = importlib.import_module("dask_jobqueue.local")
    make = getattr(module, _QUEUES[queue.kind])
    nodes = _nodes()
    options = dict(queue.options)
    try:
        memory = required("dask.utils").parse_bytes(str(options["memory"]))
        cores = int(options["cores"])
    except (ValueError, TypeError) as error:
        raise InputError(f"The cluster file {shown(wanted.scheduler)}: {error}; correct cores or memory.") from error
    shared = options.get("shared_temp_directory")
    base = Path(os.path.expandvars(shared)).expanduser() if isinstance(shared, str) else wanted.folder
    folder = stack.enter_context(temporary_folder("dask", needed_bytes=_CERTIFICATE_BYTES, base=base))
    if len(str(folder).split()) != 1:  # it stands in job scripts, where dask-jobqueue quotes nothing
        raise InputError(
            f"The cluster file {shown(wanted.scheduler)}: Dask's certificate cannot lie in {shown(folder.parent)}, "
            "whose name has a space; name another folder that all workers see as shared_temp_directory in options."
        )
    options |= {"security": certified(folder), "protocol": "tls://", "scheduler_cls": nodes.QuietScheduler}
    options["scheduler_options"] = {
        "dashboard_address": wanted.dashboard or None,
        **dict(options.get("scheduler_options") or {}),
    }
    settings = f"jobqueue.{options.get('config_name') or queue.kind}"
    arguments = options.get("worker_extra_args", required("dask").config.get(f"{settings}.worker-extra-args", []))
    options["worker_extra_args"] = [*(arguments or []), "--worker-class", f"{nodes.__name__}.QuietWorker"]
    if queue.kind == LOCAL and not options.get("interface"):
        options["scheduler_options"].setdefault("host", _LOOPBACK)
        options["worker_extra_args"] += ["--host", _LOOPBACK]
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
