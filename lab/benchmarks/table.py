"""A figure of a benchmark and the table of all of them."""

from __future__ import annotations

import math
import os
import platform
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path


@dataclass(frozen=True)
class Row:
    """One measured figure.

    ``value``, ``target`` and ``peer`` (what it is compared with) are texts with units; ``met`` says whether the target
    is reached (None where there is no target).
    """

    figure: str
    value: str
    target: str = ""
    peer: str = ""
    met: bool | None = None


def say(message: str) -> None:
    """Write on standard error how far a benchmark has come."""
    print(f"  {message}", file=sys.stderr, flush=True)


def counted(hits: Sequence[bool], digits: int = 1) -> str:
    """How many of all, with the share in percent."""
    share = f" ({100 * sum(hits) / len(hits):.{digits}f} %)" if len(hits) else ""
    return f"{sum(hits)} of {len(hits)}{share}"


def ratio_class(low: float, high: float) -> str:
    """A class of heights in levels of detection; the last one is open."""
    return f"{low:g} to {high:g}" if math.isfinite(high) else f"{low:g} and more"


def machine() -> str:
    """Processor, cores and memory of this machine in one line."""
    name = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        name = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), name)
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
        return f"{name}, {os.cpu_count()} cores, {memory:.0f} GiB"
    except (OSError, ValueError):
        return f"{name}, {os.cpu_count()} cores"


def markdown(title: str, rows: Sequence[Row]) -> str:
    """The rows as a Markdown table under a heading."""
    head = ["figure", "SlopeWatch", "target", "met", "compared with"]
    body = [[r.figure, r.value, r.target, {True: "yes", False: "**no**", None: ""}[r.met], r.peer] for r in rows]
    widths = [max(len(line[i]) for line in [head, *body]) for i in range(len(head))]
    lines = ["| " + " | ".join(c.ljust(w) for c, w in zip(line, widths, strict=True)) + " |" for line in [head, *body]]
    lines.insert(1, "|" + "|".join("-" * (w + 2) for w in widths) + "|")
    return f"## {title}\n\n" + "\n".join(lines) + "\n"


def heading() -> str:
    return f"Measured on {date.today().isoformat()}: {machine()}; {platform.platform(terse=True)}.\n"
