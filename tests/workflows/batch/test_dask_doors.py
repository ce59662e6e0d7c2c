"""Who gets into a cluster that a batch starts: nobody without its certificate, and nobody from another machine."""

from __future__ import annotations

import json
import os
import socket
import ssl
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.core.temporary_folders import PREFIX, VARIABLE
from slopewatch.tests.builders.limits import PATIENCE_S
from slopewatch.workflows.batch.dask_cluster import LOCAL, Wanted, certified, connect, read_queue

distributed = pytest.importorskip("distributed", reason="Dask is not installed; install slopewatch[cluster]")
dask = pytest.importorskip("dask")
psutil = pytest.importorskip("psutil")
pytestmark = [
    pytest.mark.filterwarnings("default"),  # those of Dask are its own
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the ports of other processes are listed on Linux"),
]
NOBODY = 65534
REFUSED_AFTER_S = 3  # until then the client tries again
INTRUDER = """
import json, os, sys
import distributed
from distributed.security import Security
address, uid, key, patience_s = sys.argv[1], int(sys.argv[2]), sys.argv[3], int(sys.argv[4])
other = Security.temporary()
if uid != os.getuid():
    os.setgroups([])
    os.setgid(uid)
    os.setuid(uid)
outcomes = {}
try:
    open(key).close()
    outcomes["key"] = "read"
except OSError as error:
    outcomes["key"] = type(error).__name__
for protocol, given in (("tcp", None), ("tls", other)):
    try:
        client = distributed.Client(f"{protocol}://{address}", timeout=patience_s, security=given)
        outcomes[protocol] = f"ran as {client.submit(os.getuid).result(patience_s)}"
        client.close()
    except Exception as error:
        outcomes[protocol] = "refused"
print(json.dumps(outcomes))
"""


@pytest.fixture(autouse=True)
def base(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setenv(VARIABLE, str(folder))
    return folder


def wanted(kind: str, workers: int, folder: Path, dashboard: str = "") -> Wanted:
    if kind == LOCAL:
        return Wanted(LOCAL, workers, dashboard)
    pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed")
    options = {"cores": 1, "processes": 1, "memory": "1GB", "local_directory": str(folder)}
    path = folder / "cluster.json"
    path.write_text(json.dumps({"cluster": "local", "jobs": workers, "options": options}))
    return Wanted(str(path), 1, dashboard, folder)


def ports() -> set[tuple[str, int]]:
    """Addresses that this process and all that it started listen on."""
    here = psutil.Process()
    found = set()
    for process in (here, *here.children(recursive=True)):
        try:
            connections = process.net_connections(kind="inet")
        except psutil.NoSuchProcess:
            continue
        found |= {(c.laddr.ip, c.laddr.port) for c in connections if c.status == psutil.CONN_LISTEN}
    return found


def takes_strangers(port: int) -> bool:
    """Whether a port answers somebody who asks in plain text, or by TLS without a certificate."""
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    for encrypted in (False, True):
        with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S) as plain:
            try:
                with context.wrap_socket(plain) if encrypted else plain as connection:
                    connection.sendall(b"GET / HTTP/1.0\r\n\r\n")
                    if connection.recv(1):
                        return True
            except (ssl.SSLError, ConnectionError):
                continue
    return False


@pytest.mark.parametrize(("kind", "workers"), [(LOCAL, 1), (LOCAL, 2), ("queue", 2)])
def test_all_ports_are_on_the_loopback_and_take_no_stranger(
    kind: str, workers: int, base: Path, tmp_path: Path
) -> None:
    before = ports()
    with ExitStack() as stack:
        client = connect(wanted(kind, workers, tmp_path), stack, Progress()).client
        client.wait_for_workers(workers, timeout=PATIENCE_S)
        opened = ports() - before
        assert {host for host, _ in opened} == {"127.0.0.1"}
        assert len(opened) == 1 + 2 * workers, "a scheduler, and of each worker itself and what watches it"
        assert not [port for _, port in opened if takes_strangers(port)]
        (folder,) = (base if kind == LOCAL else tmp_path).glob(f"{PREFIX}dask-*")
        assert folder.stat().st_mode & 0o777 == 0o700
        assert {p.name: p.stat().st_mode & 0o777 for p in folder.glob("*.pem")} == {
            "certificate.pem": 0o600, "key.pem": 0o600,
        }  # fmt: skip
        assert set(client.run(os.getpid)) == set(client.scheduler_info(n_workers=-1)["workers"]), "they work together"
    assert not list(tmp_path.rglob("*.pem"))
    assert list(base.iterdir()) == []
    until = time.monotonic() + PATIENCE_S
    while ports() - before and time.monotonic() < until:
        time.sleep(0.1)  # jobs that were ended take a moment
    assert ports() - before == set()


def test_the_page_is_there_only_when_asked_for_and_on_the_loopback() -> None:
    before = ports()
    with ExitStack() as stack:
        connect(Wanted(LOCAL, 1, "127.0.0.1:0"), stack, Progress())
        opened = ports() - before
        assert {host for host, _ in opened} == {"127.0.0.1"}
        assert len(opened) == 4
        assert [takes_strangers(port) for _, port in opened].count(True) == 1, "the page"


def intruded(address: str, key: Path, user: int, patience_s: int = REFUSED_AFTER_S) -> dict[str, str]:
    command = [sys.executable, "-c", INTRUDER, address.partition("://")[2], str(user), str(key), str(patience_s)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=5 * PATIENCE_S)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_a_client_without_the_certificate_is_refused(base: Path) -> None:
    with ExitStack() as stack:
        address = connect(Wanted(LOCAL, 1, ""), stack, Progress()).client.scheduler.address
        (key,) = base.rglob("key.pem")
        assert intruded(address, key, os.getuid()) | {"key": ""} == {"key": "", "tcp": "refused", "tls": "refused"}


@pytest.mark.skipif(os.name != "posix" or os.geteuid() != 0, reason="only root can become another user")
def test_another_user_is_refused_and_cannot_read_the_key(base: Path, tmp_path: Path) -> None:
    for folder in (base, *base.parents[:-1]):
        if folder.is_relative_to(tmp_path.parents[1]):
            folder.chmod(0o755)  # as /tmp: the certificate's own folder must keep others out
    with ExitStack() as stack:
        address = connect(Wanted(LOCAL, 1, ""), stack, Progress()).client.scheduler.address
        (key,) = base.rglob("key.pem")
        assert intruded(address, key, NOBODY) == {"key": "PermissionError", "tcp": "refused", "tls": "refused"}
    options = {"n_workers": 1, "processes": False, "dashboard_address": None, "protocol": "tcp://"}
    with distributed.LocalCluster(**options) as unlocked:
        found = intruded(unlocked.scheduler_address, tmp_path / "none", NOBODY, int(PATIENCE_S))
        assert found["tcp"] == f"ran as {os.getuid()}", "the client of this test gets in where the door is open"


def test_a_scheduler_that_runs_already_with_tls_is_reached_by_dasks_own_settings(tmp_path: Path) -> None:
    security = certified(tmp_path)
    names = {"ca-file": security.tls_ca_file, "client.cert": security.tls_client_cert}
    names["client.key"] = security.tls_client_key
    options = {"n_workers": 1, "processes": False, "dashboard_address": None, "security": security}
    with distributed.LocalCluster(**options) as running:
        address = running.scheduler_address
        assert address.startswith("tls://")
        given = {f"distributed.comm.tls.{name}": value for name, value in names.items()}
        with dask.config.set(given), ExitStack() as stack:
            client = connect(Wanted(address, 1, ""), stack, Progress()).client
            assert client.submit(os.getpid).result() == os.getpid()
        with ExitStack() as stack, pytest.raises(InputError, match="No Dask scheduler with a worker answers"):
            connect(Wanted(address, 1, ""), stack, Progress())


@pytest.mark.parametrize("options", [{"security": None}, {"scheduler_options": {"protocol": "tcp://"}}])
def test_a_cluster_file_that_would_open_the_door(options: dict[str, object], tmp_path: Path) -> None:
    path = tmp_path / "cluster.json"
    path.write_text(json.dumps({"cluster": "slurm", "jobs": 1, "options": {"cores": 1, "memory": "1GB", **options}}))
    with pytest.raises(
        InputError, match=r"options must not name (security|protocol), as a batch's cluster always uses"
    ):
        read_queue(path)


def test_a_folder_for_the_certificate_with_a_space_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "a b"
    folder.mkdir()
    with (
        ExitStack() as stack,
        pytest.raises(InputError, match=r"whose name has a space; name another .* as shared_temp_directory"),
    ):
        connect(wanted("queue", 1, folder), stack, Progress())
    assert not list(tmp_path.rglob("*.pem"))


def test_certificates_without_their_library(monkeypatch: pytest.MonkeyPatch, base: Path) -> None:
    monkeypatch.setitem(sys.modules, "cryptography", None)
    started = time.monotonic()
    with ExitStack() as stack, pytest.raises(InputError, match=r"library cryptography, .* 'slopewatch\[cluster\]'"):
        connect(Wanted(LOCAL, 1, ""), stack, Progress())
    assert time.monotonic() - started < PATIENCE_S
    assert list(base.iterdir()) == []
