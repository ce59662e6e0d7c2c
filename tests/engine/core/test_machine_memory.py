"""The machine's memory as the system says it."""

from __future__ import annotations

from pathlib import Path

import pytest
from slopewatch.engine.core import machine_memory as module
from slopewatch.engine.core.machine_memory import machine_memory


@pytest.mark.skipif(not Path("/proc/meminfo").exists(), reason="Linux")
def test_it_is_what_the_kernel_says_or_less_in_a_container():
    kilobytes = int(
        next(line.split()[1] for line in Path("/proc/meminfo").read_text().splitlines() if "MemTotal" in line)
    )
    assert 0 < machine_memory() <= 1024 * kilobytes


def test_a_container_may_have_less(monkeypatch, tmp_path):
    limits = tmp_path / "memory.max", tmp_path / "missing"
    monkeypatch.setattr(module, "_CGROUP_LIMITS", limits)
    limits[0].write_text("123456789\n")
    assert machine_memory() == 123_456_789
    limits[0].write_text("max\n")
    whole = machine_memory()
    assert whole > 123_456_789
    monkeypatch.setattr(module, "_installed", lambda: 0)
    assert machine_memory() == 8_000_000_000
