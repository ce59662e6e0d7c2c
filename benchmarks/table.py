"""A figure of a benchmark and the table of all of them."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path


@dataclass(frozen=True)
class Row:
    """One measured figure.

    ``value``, ``target`` and ``peer`` are texts with units; ``met`` tells whether the target is reached (None where
    there is no target).
    """

    figure: str
    value: str
    target: str = ""
    peer: str = ""
    met: bool | None = None


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
    head = ["figure", "SlopeWatch", "target", "met", "beside it"]
    body = [[r.figure, r.value, r.target, {True: "yes", False: "**no**", None: ""}[r.met], r.peer] for r in rows]
    widths = [max(len(line[i]) for line in [head, *body]) for i in range(len(head))]
    lines = ["| " + " | ".join(c.ljust(w) for c, w in zip(line, widths, strict=True)) + " |" for line in [head, *body]]
    lines.insert(1, "|" + "|".join("-" * (w + 2) for w in widths) + "|")
    return f"## {title}\n\n" + "\n".join(lines) + "\n"


def heading() -> str:
    return f"Measured on {date.today().isoformat()}: {machine()}; {platform.platform(terse=True)}.\n"
