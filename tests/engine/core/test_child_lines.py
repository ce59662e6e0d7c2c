"""The lines of a child process, heard while it runs."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import pytest
from slopewatch.engine.core.child_process import ChildTimeout, run_child
from slopewatch.tests.builders.limits import PATIENCE_S


def test_lines_are_heard_as_they_come_and_a_full_standard_error_stops_nothing() -> None:
    code = (
        "import sys, time\nprint('first', flush=True)\nsys.stderr.write('x' * 1_000_000)\nsys.stderr.flush()\n"
        "time.sleep(0.5)\nprint('last')\nsys.exit(3)"
    )
    heard: list[tuple[bytes, float]] = []
    done = run_child([sys.executable, "-c", code], each_line=lambda line: heard.append((line, time.monotonic())))
    assert [line for line, _ in heard] == [b"first\n", b"last\n"]
    assert heard[1][1] - heard[0][1] > 0.4
    assert (done.returncode, done.stdout, len(done.stderr)) == (3, b"first\nlast\n", 1_000_000)


def test_a_child_whose_lines_cannot_be_used_is_ended() -> None:
    def refuse(line: bytes) -> None:
        raise ValueError(line)

    started = time.monotonic()
    with pytest.raises(ValueError, match="first"):
        run_child([sys.executable, "-c", "import time\nprint('first', flush=True)\ntime.sleep(600)"], each_line=refuse)
    assert time.monotonic() - started < PATIENCE_S


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="groups of processes")
def test_a_child_that_takes_too_long_is_ended_with_its_own_children(tmp_path: Path) -> None:
    code = (
        "import subprocess, sys\nfrom pathlib import Path\n"
        "inner = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(600)'])\n"
        f"Path({str(tmp_path / 'inner')!r}).write_text(str(inner.pid))\ninner.wait()"
    )
    started = time.monotonic()
    with pytest.raises(ChildTimeout, match=r"did not end within 10 s"):
        run_child([sys.executable, "-c", code], time_limit_s=10.0)
    assert 10.0 <= time.monotonic() - started < PATIENCE_S
    inner = int((tmp_path / "inner").read_text())
    while time.monotonic() - started < PATIENCE_S and _lives(inner):
        time.sleep(0.05)
    assert not _lives(inner)


def _lives(process: int) -> bool:
    """Whether a process is there that still works."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False
