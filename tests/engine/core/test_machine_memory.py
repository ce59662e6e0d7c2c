"""The machine's memory, and a container's limit on it."""

from __future__ import annotations

from pathlib import Path

import pytest
from slopewatch.engine.core.machine_memory import machine_memory


def test_the_machines_memory_is_what_the_kernel_says():
    total = int(Path("/proc/meminfo").read_text().split("MemTotal:")[1].split()[0]) * 1024
    assert machine_memory(()) == pytest.approx(total, rel=0.05)


@pytest.mark.parametrize(
    ("text", "limited"), [("2000000000\n", True), ("max\n", False), ("9223372036854771712", False)]
)
def test_a_containers_limit_counts_where_it_is_less(tmp_path, text, limited):
    stated = tmp_path / "memory.max"
    stated.write_text(text)
    assert machine_memory((stated, tmp_path / "missing")) == (2_000_000_000 if limited else machine_memory(()))
