"""Cancelling a real process: children die, half-written files go, the exit code says so."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from slopewatch.engine.core import child_process
from slopewatch.engine.core.errors import EngineError
from slopewatch.tests.builders.limits import PATIENCE_S

SCRIPT = """
import sys, time
from pathlib import Path
from slopewatch.engine.core import cancellation, child_process
from slopewatch.engine.core.staged_outputs import staged_outputs

out = Path(sys.argv[1])
cancellation.install(lambda: print("cancelled", flush=True), watch_parent=sys.argv[2] == "watch")
if sys.argv[3] == "stubborn":  # as where another thread still writes into the folder, or removes it
    rmtree, calls = cancellation.shutil.rmtree, []
    cancellation.shutil.rmtree = lambda *a, **k: rmtree(*a, **k) if len(calls) > 4 else calls.append(a)
with staged_outputs(out / "made" / "here") as stage:
    stage.path("zones.gpkg").write_text("half")
    child = [sys.executable, "-c", "import os,time; open(%r,'w').write(str(os.getpid())); time.sleep(600)"
             % str(out / "child.pid")]
    print("ready", flush=True)
    if sys.argv[3] == "child":
        child_process.run_child(child)
    while True:  # busy Python
        sum(range(10000))
"""


@pytest.fixture
def start(tmp_path) -> Iterator[Callable[[str, str], subprocess.Popen[bytes]]]:
    """Starts the script; it is ended and its pipes are closed after the test."""
    with contextlib.ExitStack() as started:

        def begin(watch: str, work: str) -> subprocess.Popen[bytes]:
            command = [sys.executable, "-c", SCRIPT, str(tmp_path), watch, work]
            process = started.enter_context(subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE))
            started.callback(process.kill)
            assert process.stdout is not None
            assert process.stdout.readline().strip() == b"ready"
            if work == "child":
                deadline = time.monotonic() + PATIENCE_S
                while not ((tmp_path / "child.pid").exists() and (tmp_path / "child.pid").read_text()):
                    assert time.monotonic() < deadline
                    time.sleep(0.02)
            return process

        yield begin


def running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] not in "ZX"
    except FileNotFoundError:
        return False


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, "stdin"])
@pytest.mark.parametrize("work", ["child", "busy", "stubborn"])
def test_cancel_ends_children_and_removes_what_is_half_written(start, tmp_path, how, work):
    process = start("watch", work)
    asked = time.monotonic()
    if how == "stdin":
        process.stdin.close()
    else:
        process.send_signal(how)
    assert process.wait(PATIENCE_S) == 130
    assert time.monotonic() - asked < 2.0
    assert process.stdout.read().strip() == b"cancelled"
    assert not (tmp_path / "made").exists()
    if work == "child":
        child = int((tmp_path / "child.pid").read_text())
        # It is killed before its parent ends; on a busy machine the system takes a moment to let it go.
        while running(child) and time.monotonic() - asked < 2.0:
            time.sleep(0.01)
        assert not running(child)


@pytest.mark.skipif(not hasattr(os, "getpgid"), reason="process groups are of POSIX")
@pytest.mark.parametrize(("watch", "leads"), [("watch", True), ("no", False)])
def test_a_watched_command_leads_a_group_of_its_own(start, watch, leads):
    process = start(watch, "busy")
    assert (os.getpgid(process.pid) == process.pid) == leads


def test_without_watch_parent_a_closed_standard_input_is_no_cancel(start):
    process = start("no", "busy")
    process.stdin.close()
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(timeout=0.7)
    process.kill()
    process.wait()


@pytest.mark.skipif(sys.platform != "linux", reason="the parent's death reaches children through the kernel on Linux")
def test_a_killed_engine_leaves_no_child(start, tmp_path):
    process = start("no", "child")
    process.kill()
    process.wait()
    pid = int((tmp_path / "child.pid").read_text())
    deadline = time.monotonic() + PATIENCE_S
    while running(pid):
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_childs_end_is_reported():
    done = child_process.run_child(
        [sys.executable, "-c", "import sys; print(sys.stdin.read()[::-1]); sys.exit(7)"], stdin=b"ab"
    )
    assert (done.returncode, done.stdout.strip()) == (7, b"ba")


def test_a_child_that_reads_late_gets_all_of_its_input():
    """More than a pipe holds, read after the first time that the parent looks."""
    late = "import sys, time; time.sleep(0.7); print(len(sys.stdin.buffer.read()))"
    done = child_process.run_child([sys.executable, "-c", late], stdin=b"x" * 300_000)
    assert done.stdout.strip() == b"300000"


@pytest.mark.skipif(sys.platform != "linux", reason="memory limits are set on POSIX only")
def test_memory_limit_stops_a_child():
    done = child_process.run_child([sys.executable, "-c", "bytearray(2_000_000_000)"], memory_limit=500_000_000)
    assert done.returncode != 0
    assert b"MemoryError" in done.stderr


def test_a_program_that_does_not_exist_is_named(tmp_path):
    with pytest.raises(EngineError, match="no_such_program"):
        child_process.run_child([tmp_path / "no_such_program"])


def test_nothing_of_python_runs_between_fork_and_exec(monkeypatch):
    """``preexec_fn`` hangs now and then in a process with threads; a hang that rare is not met by chance in a test."""
    seen = []
    popen = subprocess.Popen
    monkeypatch.setattr(subprocess, "Popen", lambda *a, **k: seen.append(k) or popen(*a, **k))
    child_process.run_child([sys.executable, "-c", ""], memory_limit=10**12)
    assert len(seen) == 1
    assert seen[0].get("preexec_fn") is None
