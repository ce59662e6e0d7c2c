"""One sentence with a remedy for each thing that goes wrong, from what pip and the system really write."""

from __future__ import annotations

import errno
import http.server
import sys
import threading
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import pytest
from slopewatch.plugin.bridge.interpreter import child_environment
from slopewatch.plugin.bridge.setup.children import run_child
from slopewatch.plugin.bridge.setup.network import pip_environment
from slopewatch.plugin.bridge.setup.pip import Pip
from slopewatch.plugin.bridge.setup.problems import NoWheelError, SetupError, of_output, of_system
from slopewatch.plugin.bridge.setup.requirements import Requirement, read_lock
from slopewatch.tests.builders.engine_setup import entry, make_lock, make_wheel

DATA = PurePosixPath("/data")


def pip_of(folder: Path, **variables: str) -> Pip:
    """pip of the Python that runs the tests, without retrying."""
    clean = {k: v for k, v in child_environment().items() if not k.startswith("PIP_") and "proxy" not in k.lower()}
    environ = {**pip_environment(clean, {}), "PIP_CONFIG_FILE": "/dev/null", "PIP_RETRIES": "1", **variables}

    def failed(lines: list[str], task: str) -> SetupError:
        return of_output(lines, task, DATA, "2 GB")

    def run(command, environment, take) -> int:  # type: ignore[no-untyped-def]
        return run_child(command, environment, take, lambda: False)

    return Pip(Path(sys.executable), run, environ, folder / "wheels", None, failed, lambda address: b"")


@pytest.fixture
def tiny(tmp_path: Path) -> Requirement:
    wheel = make_wheel(tmp_path / "index", "tiny_one", "1.0")
    return read_lock(make_lock(tmp_path / "lock", entry(wheel)))[0]


class Index(http.server.BaseHTTPRequestHandler):
    """An index whose wheel breaks off in the middle."""

    def do_GET(self) -> None:
        page = b'<a href="tiny_one-1.0-py3-none-any.whl">tiny_one-1.0-py3-none-any.whl</a>'
        body, length = (b"PK half", 5_000) if self.path.endswith(".whl") else (page, len(page))
        self.send_response(200)
        self.send_header("Content-Length", str(length))
        self.send_header("Content-Type", "application/octet-stream" if self.path.endswith(".whl") else "text/html")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *arguments: object) -> None:
        pass


@pytest.fixture
def broken_index() -> Iterator[str]:
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Index)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/simple"
    server.shutdown()
    server.server_close()


def refused(tmp_path: Path, tiny: Requirement, **variables: str) -> str:
    with pytest.raises(SetupError) as caught:
        pip_of(tmp_path, **variables).download(tiny, lambda done, of: None)
    assert list((tmp_path / "wheels").iterdir()) == [], "nothing half is left"
    sentence = str(caught.value)
    assert sentence.count(". ") == 0
    assert sentence.endswith(".")
    return sentence


def test_no_network(tmp_path: Path, tiny: Requirement) -> None:
    sentence = refused(tmp_path, tiny, PIP_INDEX_URL="http://127.0.0.1:9/simple")
    assert sentence.startswith("The package index cannot be reached; check the network, or the proxy in QGIS")


def test_a_name_that_is_not_known(tmp_path: Path, tiny: Requirement) -> None:
    sentence = refused(tmp_path, tiny, PIP_INDEX_URL="https://index.invalid/simple")
    assert sentence.startswith("The package index cannot be reached")


def test_a_proxy_that_does_not_answer(tmp_path: Path, tiny: Requirement) -> None:
    sentence = refused(tmp_path, tiny, PIP_INDEX_URL="https://index.invalid/simple", HTTPS_PROXY="http://127.0.0.1:9")
    assert sentence.startswith("The proxy does not let the set-up through; correct it in QGIS under")


def test_half_a_download(tmp_path: Path, tiny: Requirement, broken_index: str) -> None:
    sentence = refused(tmp_path, tiny, PIP_INDEX_URL=broken_index, PIP_TRUSTED_HOST="127.0.0.1")
    assert sentence.startswith(("The download broke off", "A downloaded file is not the one"))


def test_a_package_without_a_build(tmp_path: Path, tiny: Requirement) -> None:
    links = tmp_path / "index"
    (links / "tiny_one-1.0-py3-none-any.whl").rename(links / "tiny_one-1.0-cp27-cp27m-win32.whl")
    with pytest.raises(NoWheelError, match=r"^Downloading tiny-one 1\.0 failed: there is no ready build"):
        pip_of(tmp_path, PIP_NO_INDEX="1", PIP_FIND_LINKS=str(links)).download(tiny, lambda done, of: None)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (
            "ERROR: Could not install packages due to an OSError: [Errno 28] No space left on device",
            "is full; make room",
        ),
        (
            "ERROR: [WinError 112] Es steht nicht genug Speicherplatz auf dem Datenträger zur Verfügung",
            "make room for 2 GB",
        ),
        ("ERROR: [WinError 5] Accès refusé: 'C:\\\\x'", "may not write to /data"),
        ("ERROR: [Errno 13] Permission denied: '/data/x'", "may not write to /data"),
        ("ERROR: Missing dependencies for SOCKS support.", "cannot use a SOCKS proxy"),
        ("SSLError(SSLCertVerificationError(1, '[SSL: CERTIFICATE_VERIFY_FAILED]", "PIP_CERT"),
        ("OSError('Tunnel connection failed: 407 Proxy Authentication Required')", "proxy does not let"),
        ("ERROR: THESE PACKAGES DO NOT MATCH THE HASHES FROM THE REQUIREMENTS FILE.", "was refused"),
    ],
)
def test_what_pip_writes_becomes_one_sentence(line: str, said: str) -> None:
    error = of_output(["Collecting numpy", line, "WARNING: more"], "Downloading numpy 2.4.6", DATA, "2 GB")
    assert said in str(error)


def test_what_is_not_known_is_quoted() -> None:
    error = of_output(["a", "ERROR: the moon is full", "b"], "Installing pip", DATA, "2 GB")
    assert str(error) == "Installing pip failed (ERROR: the moon is full); the log is set-up.log in /data."


def test_calls_of_the_system() -> None:
    full = of_system(OSError(errno.ENOSPC, "No space left on device"), DATA, "2 GB")
    assert str(full).startswith("The disk of /data is full; make room for 2 GB")
    assert str(of_system(PermissionError(errno.EACCES, "no"), DATA, "")).startswith("The set-up may not write to /data")
    assert "(strange)" in str(of_system(OSError("strange"), DATA, ""))
