"""A task that SlopeWatch and other programs do on the same files, each as a process of its own, and what it takes them.

Processor time and time by the clock are those of the work alone: scripts in Python take them between reading and
writing, and from other programs the same run without the work is taken off. Peak memory is that of the whole process,
libraries and reading included, as the system counts it.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .measured_child import ONE_THREAD, Spent, measured
from .peers import PeerMissingError, peer_python

KEPT_OUT = ("PYTHONPATH", "VIRTUAL_ENV")
"""Variables that would let a peer find this program's packages."""
LIMIT_S, LIMIT_BYTES = 1800.0, 8e9
"""A run that takes more is ended."""


@dataclass(frozen=True)
class Judged:
    """How good a result is: ``value`` in the unit of the case, smaller is better; ``text`` with what belongs to it."""

    value: float
    text: str


@dataclass(frozen=True)
class Tool:
    """A program that does a task on the files of a folder.

    ``command`` makes its command line of the folder; the folder of its results is the folder's ``found``. ``without``
    makes that of the same run without the work, None where the program itself prints the ``cpu`` and ``seconds`` of its
    work as JSON in its last line. ``own`` marks SlopeWatch's.
    """

    name: str
    version: str
    command: Callable[[Path], list[str]]
    without: Callable[[Path], list[str]] | None = None
    own: bool = False


@dataclass(frozen=True)
class Case:
    """A stage on a data set. ``prepare`` writes the inputs into a folder; ``judge`` looks at what a tool left there.

    What ``prepare`` returns is the truth that ``judge`` gets, with the folder of the results and what was printed.
    """

    stage: str
    data: str
    prepare: Callable[[Path], Any]
    judge: Callable[[Any, Path, Mapping[str, Any]], Judged]
    tools: tuple[Tool, ...]


@dataclass(frozen=True)
class Outcome:
    """What a tool did with a case. ``reason`` says why there is nothing, else the figures count (s, s, bytes)."""

    stage: str
    data: str
    tool: str
    version: str
    own: bool = False
    error: float | None = None
    accuracy: str = ""
    cpu: float = 0.0
    seconds: float = 0.0
    peak: int = 0
    reason: str = ""
    day: str = ""
    runs: int = 0

    @property
    def key(self) -> tuple[str, str, str, str]:
        return self.stage, self.data, self.tool, self.version


@dataclass
class Tries:
    """The runs of one tool: smallest times with and without the work, largest memory, the first judgement."""

    spent: list[tuple[float, float]] = field(default_factory=list)
    base: list[tuple[float, float]] = field(default_factory=list)
    peak: int = 0
    judged: Judged | None = None
    reason: str = ""

    @property
    def cpu(self) -> float:
        """Seconds of the processor, the smallest of all runs less the smallest without the work."""
        return self._least(0)

    @property
    def seconds(self) -> float:
        """The same by the clock."""
        return self._least(1)

    def _least(self, kind: int) -> float:
        base = min((times[kind] for times in self.base), default=0.0)
        return min(times[kind] for times in self.spent) - base


def script_tool(name: str, peer: str, version: str, script: str) -> Tool:
    """A peer in Python, in its own environment: lines that get the folder and print JSON."""
    return Tool(name, version, lambda folder: [str(peer_python(peer)), "-c", script, str(folder)])


def own_tool(name: str, version: str, script: str, *, peer: bool = False) -> Tool:
    """Lines that get the folder and print JSON, in this interpreter: SlopeWatch, or a ``peer`` beside it."""
    return Tool(name, version, lambda folder: [sys.executable, "-c", script, str(folder)], own=not peer)


def attempt(case: Case, tool: Tool, folder: Path, truth: Any, tries: Tries) -> None:
    """Run a tool once more on a case whose inputs lie in the folder; what it took goes into ``tries``."""
    found = folder / "found"
    for path in found.iterdir():
        path.unlink()
    try:
        command = tool.command(folder)
        base = _run(tool.without(folder)) if tool.without else None
        spent = _run(command)
    except PeerMissingError as missing:
        tries.reason = str(missing).splitlines()[-1]
        return
    tries.reason = spent.reason or (base.reason if base else "")
    if tries.reason:
        return
    tries.peak = max(tries.peak, spent.peak)
    printed = {} if base else json.loads(spent.said.strip().splitlines()[-1])
    if base:
        tries.base.append((base.cpu, base.seconds))
        tries.spent.append((spent.cpu, spent.seconds))
    else:
        tries.spent.append((float(printed["cpu"]), float(printed["seconds"])))
    if tries.judged is None:
        tries.judged = case.judge(truth, found, printed)


def _run(command: list[str]) -> Spent:
    here = command[0] == sys.executable
    kept = {k: v for k, v in os.environ.items() if here or k not in KEPT_OUT}
    return measured(command, environment={**kept, **ONE_THREAD}, limit_s=LIMIT_S, limit_bytes=LIMIT_BYTES)
