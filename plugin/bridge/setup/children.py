"""Child processes of the set-up: their lines as they come, ended with all their children when the user cancels."""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import subprocess
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from .problems import CANCELLED, SetupCancelledError

POLL_SECONDS = 0.1
_HIDDEN = getattr(subprocess, "CREATE_NO_WINDOW", 0)  # Windows: no console flashes up


def run_child(
    command: Sequence[str],
    environ: Mapping[str, str],
    take: Callable[[str], None],
    cancelled: Callable[[], bool],
    folder: Path | None = None,
) -> int:
    """Run a program without a shell to its end, and give its exit code.

    Args:
        take: gets each line of its output and of its complaints, in order, in the calling thread.
        cancelled: asked at least every 0.1 s.

    Raises:
        SetupCancelledError: it was cancelled; the program and its children have been killed.
        OSError: it cannot be started.
    """
    process = subprocess.Popen(
        list(command),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env=dict(environ),
        cwd=folder,
        start_new_session=os.name == "posix",
        creationflags=_HIDDEN,
    )
    lines: queue.Queue[bytes | None] = queue.Queue()
    threading.Thread(target=_pump, args=(process, lines), daemon=True).start()
    try:
        while True:
            if cancelled():
                raise SetupCancelledError(CANCELLED)
            with contextlib.suppress(queue.Empty):
                line = lines.get(timeout=POLL_SECONDS)
                if line is None:
                    break
                take(line.decode("utf-8", "replace").rstrip())
        while process.poll() is None:  # it closed its output, and may still be at work
            if cancelled():
                raise SetupCancelledError(CANCELLED)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(POLL_SECONDS)
        return int(process.returncode)
    finally:
        _end(process)


def _pump(process: subprocess.Popen[bytes], lines: queue.Queue[bytes | None]) -> None:
    assert process.stdout is not None
    with contextlib.suppress(OSError, ValueError):
        for line in process.stdout:
            lines.put(line)
    lines.put(None)


def _end(process: subprocess.Popen[bytes]) -> None:
    """Kill what is left of a program and its children."""
    if os.name == "posix":
        with contextlib.suppress(OSError):
            os.killpg(process.pid, signal.SIGKILL)
    elif process.poll() is None:
        kill = ["taskkill", "/F", "/T", "/PID", str(process.pid)]
        with contextlib.suppress(OSError):
            subprocess.run(kill, capture_output=True, check=False, creationflags=_HIDDEN)
    process.wait()
    if process.stdout is not None:
        process.stdout.close()
