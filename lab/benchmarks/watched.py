"""Running a command of SlopeWatch while its time and memory are taken."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path


def run_watched(arguments: Sequence[str]) -> tuple[float, int]:
    """Seconds from start to end of ``slopewatch ARGUMENTS``, and the peak memory of all its processes, bytes.

    Raises:
        RuntimeError: the command failed.
    """
    command = [sys.executable, "-m", "slopewatch.cli", *arguments]
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    peak = [0]
    watcher = threading.Thread(target=_watch, args=(process.pid, peak), daemon=True)
    watcher.start()
    _, error = process.communicate()
    seconds = time.perf_counter() - start
    if process.returncode:
        raise RuntimeError(error.decode())
    return seconds, peak[0]


def inspect_command(paths: Mapping[str, Path], output: Path) -> list[str]:
    """Arguments of ``inspect`` on a pair as ``write_pair`` wrote it, at the defaults."""
    epochs = [part for name in ("first", "second") for part in ("--epoch", f"{paths[name].stem}={paths[name]}")]
    return ["inspect", *epochs, "--roi", str(paths["roi"]), "--output-dir", str(output)]


def exit_of(arguments: Sequence[str]) -> tuple[int, str]:
    """Exit code of ``slopewatch ARGUMENTS``, run on its own, and the last line of what it complained of."""
    command = [sys.executable, "-m", "slopewatch.cli", *arguments]
    done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, check=False)
    said = done.stderr.decode(errors="replace").strip().splitlines()
    return done.returncode, said[-1] if said else ""


def _watch(pid: int, peak: list[int]) -> None:
    """Largest sum of the resident sizes of a process and its descendants, sampled 20 times a second (Linux)."""
    while Path(f"/proc/{pid}").exists():
        peak[0] = max(peak[0], sum(_resident(p) for p in _family(pid)))
        time.sleep(0.05)


def _family(pid: int) -> list[int]:
    members = [pid]
    for member in members:
        for task in Path(f"/proc/{member}/task").glob("*/children"):
            try:
                members += [int(child) for child in task.read_text().split()]
            except OSError:
                continue
    return members


def _resident(pid: int) -> int:
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, IndexError):
        return 0
