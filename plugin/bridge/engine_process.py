"""A child process of QGIS whose lines are passed on as they come, and that leaves no process behind.

It runs in an event loop of the calling thread's own: QGIS's window stays alive where that is the main thread, and it
works as well in the thread of a task and in qgis_process. QProcess, because QgsBlockingProcess neither takes an
environment, nor closes the program's standard input, nor kills what does not end when it is asked to (ADR 0057).
"""

from __future__ import annotations

import contextlib
import functools
import os
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from qgis.PyQt.QtCore import QEventLoop, QProcess, QProcessEnvironment, QTimer

POLL_SECONDS = 0.1  # between looks at whether the user has cancelled
GRACE_SECONDS = 1.5  # between asking the program to stop and killing it; the whole takes less than 2 s
_LINE_LIMIT = 1 << 20  # bytes of one line; what is longer is passed on in pieces
_STDERR_KEPT = 16384  # bytes of standard error kept for the message
_WINDOWS = sys.platform == "win32"


@dataclass(frozen=True)
class Ended:
    """How a process ended.

    ``code`` is its exit code, negative for a signal; ``complaint`` is the end of its standard error. Neither is known
    of one that was ``cancelled``.
    """

    code: int
    complaint: str
    cancelled: bool


def run_process(
    command: Sequence[str],
    environment: Mapping[str, str],
    take: Callable[[bytes], None],
    is_cancelled: Callable[[], bool],
) -> Ended:
    """Run a program to its end, or until it is cancelled: its input is closed, then it is terminated, then killed.

    Args:
        command: program and arguments, no shell.
        environment: the whole environment of the program.
        take: gets each line of standard output without its end, in order, in the calling thread.
        is_cancelled: asked ten times a second.

    Raises:
        OSError: the program cannot be started.
        Exception: what ``take`` or ``is_cancelled`` raised; the program has been killed then.
    """
    run = _Run(take, is_cancelled)
    try:
        return run.to_end(command, environment)
    finally:
        run.leave_nothing()


def _guarded(slot: Callable[[_Run], None]) -> Callable[..., None]:
    """``slot``, whose failure ends the run, to be raised there: what leaves a slot would end QGIS."""

    @functools.wraps(slot)
    def guarded(self: _Run, *_: Any) -> None:
        try:
            slot(self)
        except BaseException as error:
            self.fail(error)

    return guarded


class _Run:
    def __init__(self, take: Callable[[bytes], None], is_cancelled: Callable[[], bool]) -> None:
        self._take, self._is_cancelled = take, is_cancelled
        self._lines: deque[bytes] = deque()
        self._begun, self._complaint = b"", b""
        self._passing = False
        self._asked_to_stop: float | None = None
        self._failure: BaseException | None = None
        self._group = 0
        self._loop, self._process, self._watch = QEventLoop(), QProcess(), QTimer()
        self._watch.setInterval(int(1000 * POLL_SECONDS))
        self._watch.timeout.connect(self._look)
        self._process.readyReadStandardOutput.connect(self._read)
        self._process.readyReadStandardError.connect(self._read)
        self._process.finished.connect(self._finish)

    def to_end(self, command: Sequence[str], environment: Mapping[str, str]) -> Ended:
        variables = QProcessEnvironment()
        for name, value in environment.items():
            variables.insert(name, value)
        self._process.setProcessEnvironment(variables)
        self._process.start(command[0], list(command[1:]))
        if not self._process.waitForStarted(-1):
            raise OSError(self._process.errorString())
        self._group = int(self._process.processId())
        self._watch.start()
        if self._running():
            self._loop.exec()
        if self._failure is not None:
            raise self._failure
        if self._asked_to_stop is not None or self._running():  # QGIS is quitting, which ends all loops
            return Ended(0, "", cancelled=True)
        if self._begun:
            self._take(self._begun)
        return Ended(self._code(), self._complaint.decode("utf-8", "replace").strip(), cancelled=False)

    def fail(self, error: BaseException) -> None:
        self._failure = self._failure or error
        self._loop.quit()

    def leave_nothing(self) -> None:
        """Kill the program and its children, where any of them are left."""
        self._watch.stop()
        if not self._group:
            return
        running = self._running()
        if not _WINDOWS:
            with contextlib.suppress(OSError):  # the group, which the engine leads, outlives it if a child does
                os.killpg(self._group, signal.SIGKILL)
        elif running:
            QProcess.execute("taskkill", ["/F", "/T", "/PID", str(self._group)])
        if running:
            self._process.kill()
            self._process.waitForFinished(int(1000 * GRACE_SECONDS))

    def _running(self) -> bool:
        return bool(self._process.state() != QProcess.ProcessState.NotRunning)

    def _code(self) -> int:
        code = int(self._process.exitCode())
        if _WINDOWS:
            return code & 0xFFFFFFFF
        return -code if self._process.exitStatus() == QProcess.ExitStatus.CrashExit else code

    @_guarded
    def _look(self) -> None:
        now = time.monotonic()
        if self._asked_to_stop is None:
            if self._is_cancelled():
                self._asked_to_stop = now
                self._process.closeWriteChannel()
                if not _WINDOWS:  # there it reaches windows only; the engine ends when its input closes
                    self._process.terminate()
        elif now - self._asked_to_stop > GRACE_SECONDS:
            self._loop.quit()  # leave_nothing kills it

    @_guarded
    def _read(self) -> None:
        self._complaint = (self._complaint + bytes(self._process.readAllStandardError()))[-_STDERR_KEPT:]
        *lines, self._begun = (self._begun + bytes(self._process.readAllStandardOutput())).split(b"\n")
        if len(self._begun) > _LINE_LIMIT:
            lines, self._begun = [*lines, self._begun], b""
        if self._asked_to_stop is not None:
            return
        self._lines.extend(lines)
        if self._passing:  # a dialog lets events through while it shows a line; the one that shows it goes on
            return
        self._passing = True
        try:
            while self._lines:
                self._take(self._lines.popleft())
        finally:
            self._passing = False

    @_guarded
    def _finish(self) -> None:
        self._read()
        self._loop.quit()
