"""Runs the engine as a child process of QGIS: progress, messages, cancelling and what went wrong.

The protocol is that of ``interface.protocol``; the engine ends when its standard input closes.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from ...interface.protocol import CANCELLED, DONE, ERROR, INPUT_REFUSED, LOG, PROGRESS, RESULT, SOME_FAILED
from . import settings
from .engine_process import run_process
from .engine_setup import engine_environment, find_engine
from .interpreter import SET_UP, InterpreterNotFoundError
from .words import tr

MODULE = "slopewatch.cli"


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
    """The engine's ``result`` line: paths by name, figures by name, and the sentences that say what was found."""

    outputs: dict[str, str] = field(default_factory=dict)
    metrics: dict[str, Any] = field(default_factory=dict)
    conclusion: tuple[str, ...] = ()


def run_engine(arguments: Sequence[str], feedback: Any) -> EngineResult:
    """Run ``slopewatch ARGUMENTS`` in the engine's environment to its end.

    Args:
        arguments: the command and its options, without the program.
        feedback: a QgsProcessingFeedback; takes progress and messages, and says when to cancel.

    Raises:
        EngineError: one of its subclasses, by what went wrong.
    """
    try:
        python, _ = find_engine()
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
    conversation = _Conversation(feedback)
    try:
        ended = run_process(command, engine_environment(), conversation.take, feedback.isCanceled)
    except OSError as error:
        raise EngineNotStartedError(
            f"The engine's interpreter {command[0]} cannot be started ({error}); run the set-up again or "
            "correct it under Settings > Options > SlopeWatch."
        ) from None
    if ended.cancelled:
        raise EngineCancelledError("Cancelled; the engine was stopped and no output was written.")
    return conversation.verdict(ended.code, ended.complaint, command[0])


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
                said = tuple(str(sentence) for sentence in event.get("conclusion") or ())
                self._result = EngineResult(outputs, dict(event.get("metrics") or {}), said)
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
        if code in (DONE, SOME_FAILED):
            if self._result is None:
                raise EngineCrashedError(f"The engine ended without a result.{_quoted(complaint)}")
            missing = [p for p in self._result.outputs.values() if not os.path.exists(p)]
            if missing:
                raise EngineCrashedError(
                    f"The engine reported {missing[0]}, but it is not there; report this as a bug."
                )
            if code == SOME_FAILED:
                self._feedback.pushWarning(tr("Some slopes failed; the others have their results."))
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
                f"SlopeWatch is not installed in the engine's environment ({interpreter}); {SET_UP}, with Repair, or "
                "correct the interpreter under Settings > Options > SlopeWatch."
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
