"""A child's memory is its own, limits hold, and failures are named."""

from __future__ import annotations

import os
import sys

import numpy as np
from slopewatch.lab.benchmarks.measured_child import Spent, alone, measured

MB = 1_000_000


def child(lines: str, **limits: float) -> Spent:
    return measured([sys.executable, "-I", "-S", "-c", lines], **limits)


def test_the_memory_of_the_one_that_asks_is_not_the_childs():
    held = np.ones(400 * MB // 8)
    spent = child("print('here')")
    assert held.all()
    assert spent.said == "here\n"
    assert spent.code == 0
    assert spent.peak < 60 * MB


def test_the_memory_that_a_child_takes_is_counted():
    spent = child(f"held = bytearray({150 * MB}); print(len(held))")
    assert 150 * MB < spent.peak < 220 * MB


def test_processor_time_of_a_grandchild_counts_and_sleep_does_not():
    work = "import subprocess, sys, time; time.sleep(0.6); subprocess.run([sys.executable, '-c', BUSY])"
    busy = "import time\\nwhile time.process_time() < 0.4: pass"
    spent = child(work.replace("BUSY", f"'{busy}'"))
    assert spent.cpu >= 0.4
    assert spent.seconds >= 0.6 + 0.4
    assert spent.cpu < spent.seconds


def test_together_counts_processes_that_run_at_one_time():
    held = f"held = bytearray({80 * MB})"
    lines = (
        f"import subprocess, sys; {held}\n"
        f"subprocess.run([sys.executable, '-I', '-S', '-c', 'import time; {held}; time.sleep(1.5)'])"
    )
    spent = child(lines)
    assert spent.peak < 120 * MB
    assert spent.together > 160 * MB


def test_a_child_beyond_a_limit_is_ended_and_says_which():
    slow = child("import time; time.sleep(60)", limit_s=0.3)
    assert slow.stopped == "time"
    assert slow.seconds < 20
    assert slow.reason.startswith("ended after")
    large = child(f"import time; held = bytearray({300 * MB}); time.sleep(60)", limit_bytes=200 * MB)
    assert large.stopped == "memory"
    assert large.reason.startswith("ended when it held 0.")


def test_a_failure_is_named_by_its_last_line_and_success_has_no_reason():
    assert child("print('a'); raise SystemExit('no such cloud')").reason == "failed (1): no such cloud"
    assert child("pass").reason == ""


def test_one_thread_is_asked_for_next_to_the_variables_that_are_there(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.setenv("KEPT_FOR_THIS_TEST", "yes")
    seen = alone()
    assert (seen["OMP_NUM_THREADS"], seen["KEPT_FOR_THIS_TEST"]) == ("1", "yes")
    assert os.environ["OMP_NUM_THREADS"] == "7"
