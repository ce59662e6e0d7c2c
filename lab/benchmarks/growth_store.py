"""What growth was measured, a line of JSON for each command on each size, kept from run to run."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

Key = tuple[float, str, float]


@dataclass(frozen=True)
class Measured:
    """One command on one slope that faces ``azimuth``, of ``millions`` of points a survey.

    ``points`` it read; ``cpu`` seconds of all processors, ``seconds`` by the clock, ``peak`` bytes of its largest
    process, ``together`` of all of them at one time. ``error_mm`` is that of a registration, ``cell_m`` the side of a
    change's cells. ``reason`` says why there are no figures. ``code`` names the state of the program.
    """

    millions: float
    stage: str
    azimuth: float
    points: int = 0
    cpu: float = 0.0
    seconds: float = 0.0
    peak: int = 0
    together: int = 0
    error_mm: float | None = None
    cell_m: float | None = None
    reason: str = ""
    day: str = ""
    machine: str = ""
    code: str = ""

    @property
    def key(self) -> Key:
        return self.millions, self.stage, self.azimuth

    @property
    def final(self) -> bool:
        """Whether it need not be run again: it has figures, or more time would not give any."""
        return not self.reason.startswith(("not run", "ended after"))


def read(store: Path) -> dict[Key, Measured]:
    """What was measured before; a line that a kill cut short is left out, and of several the last one counts."""
    found = {}
    for line in store.read_text(encoding="utf-8").splitlines() if store.exists() else ():
        try:
            row = Measured(**json.loads(line))
        except (json.JSONDecodeError, TypeError):
            continue
        found[row.key] = row
    return found


def append(store: Path, row: Measured) -> None:
    """Keep a row, on a line of its own even after one that was cut short."""
    cut = store.exists() and store.stat().st_size > 0 and not store.read_bytes().endswith(b"\n")
    with store.open("a", encoding="utf-8") as file:
        file.write("\n" * cut + json.dumps(asdict(row)) + "\n")
