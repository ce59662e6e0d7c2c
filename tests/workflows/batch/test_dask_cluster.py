"""What a batch refuses of Dask's settings, each in one sentence; and that nothing listens to other machines unasked."""

from __future__ import annotations

import builtins
import importlib
import json
import socket
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from slopewatch.engine.core.errors import EngineError, InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.workflows.batch.dask_cluster import LOCAL, Queue, Wanted, connect, read_queue

GOOD = {"cluster": "slurm", "jobs": 20, "options": {"cores": 1, "memory": "8GB", "queue": "short"}}


def test_a_cluster_file(tmp_path: Path) -> None:
    path = tmp_path / "cluster.json"
    path.write_text(json.dumps(GOOD))
    assert read_queue(path) == Queue("slurm", 20, {"cores": 1, "memory": "8GB", "queue": "short"})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"cluster": "os"}, "cluster is 'os'; give one of slurm, pbs, "),
        ({"cluster": None}, "cluster is None"),
        ({"cluster": ["slurm"]}, "cluster is ['slurm']"),
        ({"jobs": 0}, "jobs is 0; give a whole number from 1"),
        ({"jobs": True}, "jobs is True"),
        ({"jobs": 1e400}, "jobs is inf"),
        ({"options": {"cores": 1}}, "options must name cores and memory"),
        ({"options": []}, "options must name cores and memory"),
    ],
)
def test_a_cluster_file_that_says_something_else(change: dict[str, Any], words: str, tmp_path: Path) -> None:
    path = tmp_path / "cluster.json"
    path.write_text(json.dumps(GOOD | change))
    with pytest.raises(InputError) as caught:
        read_queue(path)
    assert words in str(caught.value)
    assert "cluster.json" in str(caught.value)


@pytest.mark.parametrize("data", [b"", b"\xff\xfe", b"[" * 100_000, b"{"])
def test_a_cluster_file_that_is_no_json(data: bytes, tmp_path: Path) -> None:
    (tmp_path / "cluster.json").write_bytes(data)
    with pytest.raises(InputError, match=r"is no JSON in UTF-8; correct it\."):
        read_queue(tmp_path / "cluster.json")


def test_without_dask_the_command_to_install_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str, package: str | None = None) -> Any:
        raise ImportError(f"No module named {name!r}")

    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(InputError, match=r"pip install 'slopewatch\[cluster\]', or leave out --scheduler."):
        connect(Wanted(LOCAL, 1, ""), ExitStack(), Progress())


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nonsense", "file:///etc/passwd"])
def test_a_scheduler_that_does_not_answer(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="Dask is not installed; install slopewatch[cluster]")
    monkeypatch.setattr("slopewatch.workflows.batch.dask_cluster._PATIENCE_S", 1)
    with ExitStack() as stack, pytest.raises(InputError) as caught:
        connect(Wanted(address, 1, ""), stack, Progress())
    assert f"No Dask scheduler with a worker answers at {address}" in str(caught.value)


def test_options_that_the_batch_system_does_not_know(tmp_path: Path) -> None:
    pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed; install slopewatch[cluster]")
    path = tmp_path / "cluster.json"
    for options, kind in (
        ({"cores": 1, "memory": "1GB", "no_such": 1}, EngineError),
        ({"cores": "x", "memory": 1}, InputError),
    ):
        path.write_text(json.dumps({"cluster": "local", "jobs": 1, "options": options}))
        with ExitStack() as stack, pytest.raises(kind):
            connect(Wanted(str(path), 1, ""), stack, Progress())


@pytest.mark.filterwarnings("default")  # those of Dask are its own
def test_an_own_cluster_listens_on_the_loopback_only() -> None:
    pytest.importorskip("distributed", reason="Dask is not installed; install slopewatch[cluster]")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    progress = Progress()
    with ExitStack() as stack:
        found = connect(Wanted(LOCAL, 1, f"127.0.0.1:{port}"), stack, progress)
        listening = _listening()
        assert found.client.scheduler.address.startswith("tls://127.0.0.1:")
        assert ("127.0.0.1", port) in listening
        assert {host for host, _ in listening} <= {"127.0.0.1", "::1"}
    assert builtins.any("bokeh" in w for w in progress.warnings) or importlib.util.find_spec("bokeh")


def _listening() -> set[tuple[str, int]]:
    """Addresses that this process listens on (IPv4), by the system's own table."""
    inodes = set()
    for link in Path("/proc/self/fd").iterdir():
        try:
            target = str(link.readlink())
        except OSError:
            continue
        if target.startswith("socket:["):
            inodes.add(target[8:-1])
    found = set()
    for line in Path("/proc/net/tcp").read_text().splitlines()[1:]:
        fields = line.split()
        if fields[3] == "0A" and fields[9] in inodes:
            host, port = fields[1].split(":")
            found.add((socket.inet_ntoa(bytes.fromhex(host)[::-1]), int(port, 16)))
    return found
