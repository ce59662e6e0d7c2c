"""The log of a training: loss and learning rate of its steps."""

from __future__ import annotations

import csv
from pathlib import Path


def append_step(path: Path, step: int, loss: float, rate: float, seconds: float) -> None:
    """Append one step to the CSV file ``path``, which is begun with its header; ``seconds`` since the start."""
    new = not path.exists()
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        if new:
            writer.writerow(["step", "loss", "learning_rate", "seconds"])
        writer.writerow([step, f"{loss:.5f}", f"{rate:.6f}", f"{seconds:.1f}"])
