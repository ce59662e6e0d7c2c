"""The lines of a child process, heard while it runs."""

from __future__ import annotations

import sys
import time

import pytest
from slopewatch.engine.core.child_process import run_child
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
