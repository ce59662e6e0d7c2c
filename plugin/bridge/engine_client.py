"""Runs the engine as a child process of QGIS: progress, messages, cancelling and what went wrong.

The protocol is that of ``interface.protocol``; the engine ends when its standard input closes.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import signal
import subprocess
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import IO, Any

from qgis.PyQt.QtCore import QCoreApplication, QThread

from ...interface.protocol import CANCELLED, DONE, ERROR, INPUT_REFUSED, LOG, PROGRESS, RESULT
from . import settings
from .interpreter import PLUGIN_FOLDER, InterpreterNotFoundError, child_environment, find_interpreter, is_windows

MODULE = "slopewatch.cli"
POLL_SECONDS = 0.2
GRACE_SECONDS = 1.5  # between asking the engine to stop and killing it; the whole takes less than 2 s
_LINE_LIMIT = 1 << 20  # bytes of one line; the engine's are far shorter
_STDERR_KEPT = 16384  # bytes of standard error kept for the message


class EngineError(Exception):
    """The engine did not do what it was asked; the message is for the user."""


class EngineNotFoundError(EngineError):
    """There is no interpreter to run the engine."""


class EngineNotStartedError(EngineError):
    """The interpreter is there but the engine did not start."""


class EngineKilledError(EngineError):
    """The system killed the engine."""


class EngineCrashedError(EngineError):
    """The engine ended with another code than the agreed ones."""


class EngineInputError(EngineError):
    """The engine refused its input; the message is the engine's own sentence."""


class EngineCancelledError(EngineError):
    """The user cancelled."""


@dataclass
class EngineResult:
    """``outputs``: name to path; ``metrics``: name to value, as the engine's ``result`` line gives them."""

    outputs: dict[str, str] = field(default_factory=dict)
    metrics: dict[str, Any] = field(default_factory=dict)


def run_engine(arguments: Sequence[str], feedback: Any) -> EngineResult:
    """Run ``slopewatch ARGUMENTS`` in the engine's environment to its end.

    Args:
        arguments: the command and its options, without the program.
        feedback: a QgsProcessingFeedback; takes progress and messages, and says when to cancel.

    Raises:
        EngineError: one of its subclasses, by what went wrong.
    """
    try:
        python, _ = find_interpreter(settings.get(settings.ENGINE_PYTHON))
    except InterpreterNotFoundError as error:
        raise EngineNotFoundError(str(error)) from None
    command = [str(python), "-m", MODULE, *arguments, "--progress", "json", "--watch-parent"]
    pdal = settings.get(settings.PDAL)
    if pdal:
        command += ["--pdal", pdal]
    return run_command(command, feedback)


def run_command(command: Sequence[str], feedback: Any) -> EngineResult:
    """Run a program that speaks the engine's protocol; see ``run_engine``."""
    if feedback.isCanceled():
        raise EngineCancelledError("Cancelled; no output was written.")
    try:
        process = subprocess.Popen(
            list(command),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=child_environment(),
            start_new_session=not is_windows(),  # so that its whole group can be ended
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
    except OSError as error:
        raise EngineNotStartedError(
            f"The engine's interpreter {command[0]} cannot be started ({error.strerror}); run the set-up again or "
            "correct it under Settings > Options > SlopeWatch."
        ) from None
    conversation = _Conversation(feedback)
    lines: queue.Queue[bytes | None] = queue.Queue()
    complaint = _Tail(_STDERR_KEPT)
    readers = [
        threading.Thread(target=_read_lines, args=(process.stdout, lines), daemon=True),
        threading.Thread(target=complaint.read, args=(process.stderr,), daemon=True),
    ]
    for reader in readers:
        reader.start()
    try:
        cancelled = _converse(process, lines, conversation, feedback)
    finally:
        _end(process, 0.0)  # nothing is left running, whatever was raised
        for reader in readers:
            reader.join(1.0)
    if cancelled:
        raise EngineCancelledError("Cancelled; the engine was stopped and no output was written.")
    return conversation.verdict(process.returncode, complaint.text(), command[0])


def _converse(
    process: subprocess.Popen[bytes], lines: queue.Queue[bytes | None], conversation: _Conversation, feedback: Any
) -> bool:
    """Pass the engine's lines on until its output ends; True if the user cancelled meanwhile."""
    application = QCoreApplication.instance()
    on_main_thread = application is not None and QThread.currentThread() == application.thread()
    ended: float | None = None
    while True:
        try:
            line = lines.get(timeout=POLL_SECONDS)
            if line is None:
                break
            conversation.take(line)
        except queue.Empty:
            # The engine has ended but something holds its output open: do not wait for that.
            if process.poll() is not None:
                ended = ended or time.monotonic()
                if time.monotonic() - ended > 1.0:
                    break
        if on_main_thread:
            QCoreApplication.processEvents()
        if feedback.isCanceled():
            _end(process, GRACE_SECONDS)
            return True
    while process.poll() is None:  # output closed, process not gone yet
        if feedback.isCanceled():
            _end(process, GRACE_SECONDS)
            return True
        if on_main_thread:
            QCoreApplication.processEvents()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(POLL_SECONDS)
    return False


def _end(process: subprocess.Popen[bytes], grace: float) -> None:
    """Close the engine's standard input, ask it to stop, and after ``grace`` seconds kill it and its children."""
    with contextlib.suppress(OSError, ValueError):
        if process.stdin is not None:
            process.stdin.close()
    if process.poll() is None and grace > 0:
        with contextlib.suppress(OSError):
            if not is_windows():  # there, terminating is killing; closing its input is the polite way
                process.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(grace)
    if is_windows():
        if process.poll() is None:
            subprocess.run(["taskkill", "/F", "/T", "/PID", str(process.pid)], capture_output=True, check=False)
    else:
        with contextlib.suppress(OSError):  # the group outlives the engine if a child of it does
            os.killpg(process.pid, signal.SIGKILL)
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(GRACE_SECONDS)


def _read_lines(stream: IO[bytes], lines: queue.Queue[bytes | None]) -> None:
    with contextlib.suppress(OSError, ValueError), stream:
        for line in iter(lambda: stream.readline(_LINE_LIMIT), b""):
            lines.put(line)
    lines.put(None)


class _Tail:
    """The last bytes of a stream; reads all of it, so that the writer never blocks."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._kept = b""

    def read(self, stream: IO[bytes]) -> None:
        with contextlib.suppress(OSError, ValueError), stream:
            for chunk in iter(lambda: stream.read1(65536), b""):  # type: ignore[attr-defined]
                self._kept = (self._kept + chunk)[-self._size :]

    def text(self) -> str:
        return self._kept.decode("utf-8", "replace").strip()


class _Conversation:
    """What the engine has said so far."""

    def __init__(self, feedback: Any) -> None:
        self._feedback = feedback
        self._heard = False
        self._stage = ""
        self._error = ""
        self._result: EngineResult | None = None

    def take(self, line: bytes) -> None:
        """Act on one line; what is not an event of the protocol is shown as it is."""
        text = line.decode("utf-8", "replace").strip()
        if not text:
            return
        try:
            event = json.loads(text)
            name = event["event"]
            if name == PROGRESS:
                self._progress(event)
            elif name == LOG:
                self._log(str(event.get("level", "info")), str(event["message"]))
            elif name == RESULT:
                outputs = {str(k): str(v) for k, v in dict(event.get("outputs") or {}).items() if v is not None}
                self._result = EngineResult(outputs, dict(event.get("metrics") or {}))
            elif name == ERROR:
                self._error = str(event["message"])
            self._heard = True
        except (ValueError, TypeError, KeyError, RecursionError):
            self._feedback.pushDebugInfo(text[:2000])

    def _progress(self, event: dict[str, Any]) -> None:
        self._feedback.setProgress(min(100.0, max(0.0, float(event["percent"]))))
        stage = str(event.get("message") or "")
        if stage and stage != self._stage:
            self._stage = stage
            self._feedback.setProgressText(stage[:1].upper() + stage[1:])

    def _log(self, level: str, message: str) -> None:
        if level in ("warning", "error"):
            self._feedback.pushWarning(message)
        else:
            self._feedback.pushInfo(message)

    def verdict(self, code: int, complaint: str, interpreter: str) -> EngineResult:
        """The result, or the failure that the exit code and the messages report."""
        if code == DONE:
            if self._result is None:
                raise EngineCrashedError(f"The engine ended without a result.{_quoted(complaint)}")
            missing = [p for p in self._result.outputs.values() if not os.path.exists(p)]
            if missing:
                raise EngineCrashedError(
                    f"The engine reported {missing[0]}, but it is not there; report this as a bug."
                )
            return self._result
        if code == INPUT_REFUSED and (self._error or complaint):
            raise EngineInputError(self._error or _last_line(complaint))
        if code == CANCELLED:
            raise EngineCancelledError("The engine was interrupted; no output was written.")
        if code in (-9, 137):
            raise EngineKilledError(
                "The engine was killed by the system, most likely because the memory ran out; clip the clouds to a "
                "smaller region of interest or use larger cells."
            )
        if self._error:
            raise EngineCrashedError(f"The engine failed: {self._error}")
        if "No module named" in complaint and "slopewatch" in _last_line(complaint):
            raise EngineNotStartedError(
                f"SlopeWatch is not installed in the engine's environment ({interpreter}); run the set-up again, "
                f'or "{interpreter}" -m pip install "{PLUGIN_FOLDER}".'
            )
        if not self._heard and code > 0:
            raise EngineNotStartedError(
                f"The engine failed to start (interpreter {interpreter}, code {code}); run the set-up again or check "
                f"Settings > Options > SlopeWatch.{_quoted(complaint)}"
            )
        raise EngineCrashedError(f"The engine crashed with code {_code_name(code)}.{_quoted(complaint)}")


def _last_line(text: str) -> str:
    lines: list[str] = [line.strip() for line in text.splitlines() if line.strip()]
    last = lines[-1] if lines else ""
    return last[len("Error: ") :] if last.startswith("Error: ") else last


def _quoted(complaint: str) -> str:
    last = _last_line(complaint)
    return f" Its last words: {last[:500]}" if last else ""


def _code_name(code: int) -> str:
    if code < 0:
        with contextlib.suppress(ValueError):
            return f"{code} ({signal.Signals(-code).name})"
    return f"{code} (0x{code & 0xFFFFFFFF:08X})" if abs(code) > 0xFFFF else str(code)
