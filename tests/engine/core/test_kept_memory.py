"""What is freed is kept: no page faults for arrays of a size that were freed before; no harm where it cannot be."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from slopewatch.engine.core import kept_memory

FAULTS = """
import resource, sys
import numpy as np
from slopewatch.engine.core.kept_memory import keep_freed_memory
kept = keep_freed_memory()
assert kept == (sys.argv[1] == "kept"), kept
for _ in range(3):
    one, two = np.ones(3_000_000), np.ones(3_000_000)
    del one, two
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(5):
    one, two = np.ones(3_000_000), np.ones(3_000_000)
    del one, two
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def _faults(state: str, **environment: str) -> int:
    own = {k: v for k, v in os.environ.items() if not k.startswith(("MALLOC_", "GLIBC_TUNABLES"))} | environment
    done = subprocess.run([sys.executable, "-c", FAULTS, state], env=own, check=True, capture_output=True, text=True)
    return int(done.stdout)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="of the C library of Linux")
def test_arrays_that_were_freed_are_used_again():
    """Two arrays of 24 MB are 11,700 pages of 4 kB, five times."""
    assert _faults("kept") < 20
    assert _faults("own settings", MALLOC_TRIM_THRESHOLD_="131072") > 100


@pytest.mark.parametrize("platform", ["win32", "darwin"])
def test_nothing_is_done_elsewhere(monkeypatch, platform):
    monkeypatch.setattr(kept_memory.sys, "platform", platform)
    assert not kept_memory.keep_freed_memory()


@pytest.mark.parametrize("error", [OSError, AttributeError, ValueError])
def test_nothing_fails_with_another_library(monkeypatch, error):
    for name in [name for name in os.environ if name.startswith(("MALLOC_", "GLIBC_TUNABLES"))]:
        monkeypatch.delenv(name)

    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr(kept_memory.sys, "platform", "linux")
    monkeypatch.setattr(kept_memory.os, "confstr", lambda _: "glibc 2.36", raising=False)
    monkeypatch.setattr(kept_memory.ctypes, "CDLL", fail)
    assert not kept_memory.keep_freed_memory()
