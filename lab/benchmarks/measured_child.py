"""A command as a process of its own: processor time, time by the clock, peak memory. For Linux."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

LAUNCHER = Path(__file__).with_name("child_launcher.py")
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}


def alone() -> dict[str, str]:
    """This process's variables, with one thread for libraries that would take as many as there are cores."""
    return {**os.environ, **ONE_THREAD}


@dataclass(frozen=True)
class Spent:
    """What a command took, all the processes that it started and waited for included.

    ``seconds`` by the clock, ``cpu`` of all processors, ``peak`` bytes of its largest process, ``together`` bytes of
    all of them at one time (looked at twice a second). ``code`` is its exit code, ``stopped`` why it was ended
    ("memory", "time" or nothing), ``said`` and ``complained`` all that it wrote on standard output and error.
    """

    seconds: float
    cpu: float
    peak: int
    together: int
    code: int
    stopped: str
    said: str
    complained: str = ""

    @property
    def reason(self) -> str:
        """Why it has no result, in one line; empty where it has one."""
        if self.stopped == "memory":
            return f"ended when it held {self.together / 1e9:.1f} GB"
        if self.stopped == "time":
            return f"ended after {self.seconds:.0f} s"
        if self.code:
            lines = (self.complained.strip() or self.said.strip() or "without a word").splitlines()
            return f"failed ({self.code}): {lines[-1]}"
        return ""


def measured(
    command: Sequence[str | Path],
    *,
    environment: Mapping[str, str] | None = None,
    limit_bytes: float | None = None,
    limit_s: float | None = None,
) -> Spent:
    """Run a command to its end, or to a limit, in an empty folder that is removed after.

    Args:
        environment: its variables; this process's by default.
        limit_bytes: it is killed once its processes together hold more.
        limit_s: it is killed after so many seconds by the clock.
    """
    with tempfile.TemporaryDirectory() as scratch:
        log = Path(scratch) / "log.txt"
        work = Path(scratch) / "work"
        work.mkdir()
        asked = {
            "command": [str(word) for word in command],
            "environment": dict(os.environ if environment is None else environment),
            "cwd": str(work),
            "log": str(log),
            "limit_bytes": limit_bytes,
            "limit_s": limit_s,
        }
        done = subprocess.run(
            [sys.executable, "-I", "-S", LAUNCHER], input=json.dumps(asked), capture_output=True, text=True, check=True
        )
        said, complained = (path.read_text(encoding="utf-8", errors="replace") for path in (log, Path(f"{log}.errors")))
        return Spent(**json.loads(done.stdout), said=said, complained=complained)
