"""How a command reports its progress and result: a bar for people, JSON lines for programs, or nothing."""

from __future__ import annotations

import contextlib
import json
import sys
import threading
import time
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TextIO

import click
from rich.console import Console
from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as RichProgress

from ..engine.core.errors import SlopeWatchError
from ..engine.core.json_values import plain
from ..engine.core.messages import one_line
from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..interface.protocol import ERROR, LOG, PROGRESS, RESULT
from .language import framed, say


class Reporter(Progress):
    """Messages on standard error, the result on standard output. Shows no progress."""

    def __enter__(self) -> Reporter:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def show(self, level: str, message: str) -> None:
        click.echo(_printable(_of_level(level, message)), err=True)

    def result(self, done: RunResult, sentences: Sequence[str]) -> None:
        """The command has ended well: what was found in a few sentences; of a command that writes nothing, figures."""
        for sentence in sentences:
            click.echo(_printable(say(sentence)))
        if not done.outputs:
            width = max((len(name) for name in done.figures), default=0)
            for name, value in plain(done.figures).items():
                click.echo(f"{name:<{width}}  {_shown(value)}")

    def error(self, error: SlopeWatchError) -> None:
        click.echo(framed("Error: {0}", one_line(str(error))), err=True)

    def cancelled(self) -> None:
        click.echo(say("Cancelled; nothing half-written is left."), err=True)


class BarReporter(Reporter):
    """A bar on the terminal."""

    def __init__(self) -> None:
        super().__init__()
        self._bar = RichProgress(
            TextColumn("{task.description}", table_column=None),
            BarColumn(),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            console=Console(stderr=True),
            transient=True,
        )
        self._task = self._bar.add_task(say("starting"), total=100.0)

    def __enter__(self) -> Reporter:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def emit(self, percent: float, message: str) -> None:
        self._bar.update(self._task, completed=percent, description=say(message or "working"))

    def show(self, level: str, message: str) -> None:
        style = "yellow" if level == "warning" else None
        text = _printable(_of_level(level, message))
        self._bar.console.print(text, style=style, markup=False, highlight=False)


class JsonReporter(Reporter):
    """One JSON object a line on standard output, which the QGIS client reads."""

    def __init__(self) -> None:
        super().__init__()
        self._write_lock = threading.Lock()
        self._percent, self._message, self._last = 0.0, "", 0.0

    def _line(self, **event: Any) -> None:
        with self._write_lock:
            sys.stdout.write(json.dumps(event, ensure_ascii=True) + "\n")
            sys.stdout.flush()

    def emit(self, percent: float, message: str) -> None:
        self._percent = max(self._percent, percent)  # never backwards
        now = time.monotonic()
        if message == self._message and now - self._last < 0.1:
            return
        self._message, self._last = message, now
        self._line(event=PROGRESS, percent=round(self._percent, 1), message=say(message))

    def show(self, level: str, message: str) -> None:
        self._line(event=LOG, level=level, message=say(message))

    def result(self, done: RunResult, sentences: Sequence[str]) -> None:
        self._line(event=PROGRESS, percent=100.0, message=say("done"))
        self._line(
            event=RESULT,
            outputs=plain(done.outputs),
            metrics=plain(done.figures),
            conclusion=[say(one) for one in sentences],
        )

    def error(self, error: SlopeWatchError) -> None:
        with self._write_lock, contextlib.suppress(BrokenPipeError):
            click.echo(error_event(error))
        super().error(error)


def error_event(error: SlopeWatchError) -> str:
    """The JSON line that reports a failure to a program."""
    return json.dumps({"event": ERROR, "message": say(one_line(str(error))), "code": error.exit_code})


def reporter(kind: str) -> Reporter:
    """The reporter for ``--progress``; auto is a bar on a terminal and nothing elsewhere."""
    if kind == "auto":
        kind = "bar" if sys.stderr.isatty() else "none"
    return {"bar": BarReporter, "json": JsonReporter, "none": Reporter}[kind]()


def _of_level(level: str, message: str) -> str:
    return framed("Warning: {0}", message) if level == "warning" else say(message)


def _printable(message: str) -> str:
    """Lines of a message without commands to the terminal."""
    return "\n".join(one_line(line) for line in message.split("\n"))


def say_of_formats(report: Progress) -> None:
    """Have what GDAL warns of a file told as a warning of the run, and not as a line of its Python binding."""
    told = warnings.showwarning

    def show(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        if {"pyogrio", "rasterio"} & set(Path(filename).parts):
            report.warning(f"GDAL says of a file: {one_line(str(message)).rstrip('.')}.")
        else:
            told(message, category, filename, lineno, file, line)

    warnings.showwarning = show
    sys.unraisablehook = _lost


def _lost(lost: sys.UnraisableHookArgs) -> None:
    """Pass over what rasterio loses of GDAL's words that are not UTF-8: the error itself reaches the reader."""
    if not (isinstance(lost.exc_value, UnicodeDecodeError) and "rasterio" in str(lost.object)):
        sys.__unraisablehook__(lost)


def _shown(value: Any) -> Any:
    """A figure as people read it; one of several in one line."""
    if isinstance(value, dict):
        return "; ".join(f"{name}: {_shown(part)}" for name, part in value.items())
    if isinstance(value, list):
        return f"[{', '.join(str(_shown(part)) for part in value)}]"
    if value is None:
        return say("not available")
    if isinstance(value, str):
        return _printable(value)
    return f"{value:.4g}" if isinstance(value, float) and abs(value) < 1e5 else value
