"""The picture in docs/figures.md of what is detected: recall and false zones against height in units of the level.

``lab/pictures/detection_picture.py [FILE]`` draws what the benchmark kept in its results (detection.csv);
``.venv/bin/python -m slopewatch.lab --results lab/benchmarks/results detection`` makes that file again.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from slopewatch.lab.benchmarks.detection import RATIOS
from slopewatch.lab.benchmarks.detection_curves import Recall, false_alarms, recall
from slopewatch.lab.benchmarks.detection_results import PairResult, read_results

ROOT = Path(__file__).resolve().parents[2]
HEIGHTS = (0.02, 0.04, 0.07, 0.12, 0.20, 0.30001)
COLOURS = {"fixed": "#57606a", "growing": "#2a6bae"}
MARKS = {"fixed": "s", "growing": "o"}
LABELS = {"fixed": "cells of one size (0.1 m)", "growing": "growing cells"}
TARGET = 0.1


def main(path: Path) -> None:
    """Read and draw."""
    results = read_results(ROOT / "lab/benchmarks/results/detection.csv")
    figure = Figure(figsize=(12, 3.9), dpi=110, layout="constrained")
    by_ratio, by_height, false = figure.subplots(1, 3)
    for cells, pairs in results.items():
        measured = f"{LABELS[cells]}: {_measured(pairs)} measured"
        _recall(by_ratio, recall(pairs, lambda c: c.ratio, RATIOS), cells, measured)
        heights = [100 * h for h in HEIGHTS]
        _recall(by_height, recall(pairs, lambda c: 100 * abs(c.amplitude), heights), cells, LABELS[cells])
        _false(false, [p for p in pairs if not p.changed], cells)
    by_ratio.axvline(1, color="0.7", lw=0.8, ls="--", zorder=0)
    by_ratio.set(xlabel="height of the change over its median level", ylabel="changes found", xlim=(0, None))
    by_height.set(xlabel="height of the change (cm)", xlim=(0, 31))
    for axis in (by_ratio, by_height):
        axis.set_ylim(-0.03, 1.03)
        axis.yaxis.set_major_formatter(lambda v, _: f"{100 * v:.0f} %")
    false.axhline(TARGET, color="#b43628", lw=1, ls="--", label="target: below 0.1")
    false.set(
        xlabel="change of the false zone over its level, at least", ylabel="false zones a slope", xlim=(1, 3),
        ylim=(0, 0.32),
    )  # fmt: skip
    unchanged = sum(not p.changed for p in next(iter(results.values())))
    titles = (
        "1  found, by height over level",
        "2  found, by height",
        f"3  false zones on {unchanged} unchanged slopes",
    )
    for axis, title in zip((by_ratio, by_height, false), titles, strict=True):
        axis.set_title(title, fontsize=10, loc="left")
        axis.grid(color="#eaeef2")
        axis.set_axisbelow(True)
    by_ratio.legend(fontsize=7.5, frameon=False, loc="upper left")
    by_height.legend(fontsize=7.5, frameon=False, loc="lower right")
    false.legend(fontsize=7.5, frameon=False, loc="upper right")
    figure.savefig(path, metadata={"Software": None})
    print(f"{path} ({path.stat().st_size / 1e3:.0f} kB)")


def _measured(pairs: list[PairResult]) -> str:
    levels = [c.level for pair in pairs for c in pair.changes]
    return f"{int(np.isfinite(levels).sum())} of {len(levels)}"


def _recall(axis, curve: list[Recall], cells: str, label: str) -> None:  # type: ignore[no-untyped-def]
    share = np.array([c.share for c in curve])
    error = np.abs(np.array([[c.low, c.high] for c in curve]).T - share)
    axis.errorbar(
        [c.size for c in curve], share, error, color=COLOURS[cells], marker=MARKS[cells], ms=5, lw=1.4, elinewidth=0.9,
        capsize=2, label=label,
    )  # fmt: skip


def _false(axis, unchanged: list[PairResult], cells: str) -> None:  # type: ignore[no-untyped-def]
    curve = false_alarms(unchanged, np.linspace(1, 3, 401).tolist())
    axis.plot(curve.ratio, curve.a_slope, color=COLOURS[cells], lw=1.8, label=LABELS[cells])
    axis.plot(curve.ratio, curve.high, color=COLOURS[cells], lw=1, ls=":", label="end of its 95 % interval")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs/images/detection.png")
