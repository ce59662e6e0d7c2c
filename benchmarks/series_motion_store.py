"""What became of series whose ground moves along its surface, a line of JSON for each, kept from run to run."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..engine.core.arrays import Float

Key = tuple[str, int, tuple[float, ...]]
"""Simulated or real, the seed, and the rates of the places that move, mm a day; none of a still series."""


@dataclass
class Outcome:
    """What became of series: ``off`` errors of the zones' velocities (east, north, up) and ``stated`` their standard
    errors, ``share`` their length by the true one, ``uneven`` the part of their errors that unevenness makes, as a
    share of the velocity, ``false`` zones where nothing moved, ``alerts`` of each place that moves the surveys after
    which it had an alert (None: never), with motion and by heights alone.
    """

    off: list[Float] = field(default_factory=list)
    stated: list[Float] = field(default_factory=list)
    share: list[float] = field(default_factory=list)
    uneven: list[float] = field(default_factory=list)
    false: int = 0
    still_series: int = 0
    still_with_zone: int = 0
    alerts: list[tuple[float, int | None, int | None]] = field(default_factory=list)

    def add(self, other: Outcome) -> None:
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)


def read(store: Path | None) -> dict[Key, Outcome]:
    """What was kept; a line that a kill cut short is left out, and of several of one series the last one counts."""
    found: dict[Key, Outcome] = {}
    for line in store.read_text(encoding="utf-8").splitlines() if store is not None and store.exists() else ():
        try:
            row: dict[str, Any] = json.loads(line)
            key = str(row.pop("kind")), int(row.pop("seed")), tuple(float(rate) for rate in row.pop("rates"))
            row["alerts"] = [tuple(alert) for alert in row["alerts"]]
            for name in ("off", "stated"):
                row[name] = [np.array(values) for values in row[name]]
            found[key] = Outcome(**row)
        except (json.JSONDecodeError, KeyError, TypeError):
            continue
    return found


def append(store: Path, key: Key, outcome: Outcome) -> None:
    """Keep the outcome of one series, on a line of its own even after one that was cut short."""
    store.parent.mkdir(parents=True, exist_ok=True)
    cut = store.exists() and store.stat().st_size > 0 and not store.read_bytes().endswith(b"\n")
    row = vars(outcome) | {name: [v.tolist() for v in getattr(outcome, name)] for name in ("off", "stated")}
    named = {"kind": key[0], "seed": key[1], "rates": list(key[2])}
    with store.open("a", encoding="utf-8") as file:
        file.write("\n" * cut + json.dumps(named | row) + "\n")
