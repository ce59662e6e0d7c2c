"""How good an extracted ground is: heights over the known one, what was found of it, errors of cells."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from ...engine.core.arrays import Bool, Float
from .ground_clouds import Cloud

CELL, NEAR = 0.5, 0.20
"""Side of the cells in which ground is looked for, and height (m) within which a point is of the ground."""


@dataclass(frozen=True)
class Figures:
    """What became of one method on a case: metres and shares.

    ``points`` are those found; ``median`` to ``p99`` describe their heights over the reference; ``near`` is the share
    of them within 20 cm of it; ``recall`` that of the reference's points found; ``covered`` that of the cells of 0.5 m
    with returns in which some were found; ``bias`` and ``error`` are mean and mean magnitude of the found points' mean
    height in these cells. Not a number where nothing was found.
    """

    points: int
    median: float
    mean: float
    p90: float
    p99: float
    recall: float
    near: float
    covered: float
    bias: float
    error: float

    def text(self, cells: bool = False) -> str:
        """In one line; ``cells``: with the errors of the cells' means."""
        if not self.points:
            return "no ground"
        line = (
            f"{self.points:,} points; median {self.median:+.3f}, mean {self.mean:+.3f}, 90 % {self.p90:+.2f}, "
            f"99 % {self.p99:+.2f} m; recall {self.recall:.3f}; within 20 cm {100 * self.near:.1f} %; "
            f"cells {100 * self.covered:.1f} %"
        )
        return line + (f", their bias {self.bias:+.3f}, mean error {self.error:.3f} m" if cells else "")


@dataclass(frozen=True)
class Target:
    """Limits of some of the figures: of magnitudes, in metres, and shares at least."""

    mean: float | None = None
    p99: float | None = None
    recall: float | None = None
    near: float | None = None
    bias: float | None = None
    error: float | None = None

    def text(self) -> str:
        words = {
            "mean": "|mean| <= {:.2f} m",
            "p99": "99 % <= {:.2f} m",
            "recall": "recall >= {:.1f}",
            "near": "within 20 cm >= {:.0%}",
            "bias": "|bias| of cells <= {:.2f} m",
            "error": "mean error <= {:.2f} m",
        }
        return ", ".join(words[name].format(limit) for name, limit in asdict(self).items() if limit is not None)

    def met(self, found: Figures) -> bool:
        """Whether all limits hold; figures that are not numbers hold none."""
        values = asdict(found)
        return all(
            values[name] >= limit if name in ("recall", "near") else abs(values[name]) <= limit
            for name, limit in asdict(self).items()
            if limit is not None
        )


def measured(clouds: Sequence[Cloud], found: Sequence[Bool], parts: Sequence[Bool] | None = None) -> Figures:
    """Figures of points found (n,) in clouds together; ``parts``: of these points (n,) alone."""
    parts = parts or [np.ones(len(cloud), dtype=bool) for cloud in clouds]
    known = [part & cloud.ground for cloud, part in zip(clouds, parts, strict=True)]
    own = [part & mask for mask, part in zip(found, parts, strict=True)]
    above = np.concatenate([cloud.above[mask] for cloud, mask in zip(clouds, own, strict=True)])
    right = sum(int(np.count_nonzero(a & b)) for a, b in zip(known, own, strict=True))
    reference = sum(int(np.count_nonzero(mask)) for mask in known)
    means, cells = [], 0
    for cloud, mask, part in zip(clouds, own, parts, strict=True):
        mean, count = cell_means(cloud.seen.xyz[part], cloud.above[part], mask[part])
        means.append(mean)
        cells += count
    mean = np.concatenate(means)
    recall = right / reference if reference else np.nan
    if not len(above):
        return Figures(0, np.nan, np.nan, np.nan, np.nan, recall, np.nan, 0.0, np.nan, np.nan)
    return Figures(
        points=len(above),
        median=float(np.median(above)),
        mean=float(above.mean()),
        p90=float(np.quantile(above, 0.90)),
        p99=float(np.quantile(above, 0.99)),
        recall=recall,
        near=float((np.abs(above) <= NEAR).mean()),
        covered=len(mean) / cells,
        bias=float(mean.mean()),
        error=float(np.abs(mean).mean()),
    )


def cell_means(xyz: Float, above: Float, found: Bool) -> tuple[Float, int]:
    """Mean height of the points found in each cell of 0.5 m that holds some, and the number of cells with returns."""
    _, cell = np.unique(np.floor(xyz[:, :2] / CELL).astype(np.int64), axis=0, return_inverse=True)
    cell = cell.ravel()
    count = int(cell.max()) + 1 if len(cell) else 0
    number = np.bincount(cell[found], minlength=count)
    total = np.bincount(cell[found], above[found], minlength=count)
    return total[number > 0] / number[number > 0], count


@dataclass(frozen=True)
class Result:
    """Figures of a method on a part of a case and the seconds it took; ``reason`` where it was not measured."""

    figures: Figures | None = None
    seconds: float | None = None
    reason: str = ""


def write_results(path: Path, results: Mapping[tuple[str, str, str], Result]) -> None:
    """Keep what was measured as CSV: a line for each case, part of it and method, by which ``results`` go."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        columns = [field.name for field in fields(Figures)]
        table = csv.DictWriter(file, ["cloud", "part", "method", *columns, "seconds"], lineterminator="\n")
        table.writeheader()
        for (case, part, method), result in results.items():
            if result.figures is not None:
                spent = "" if result.seconds is None else f"{result.seconds:.1f}"
                values = {name: f"{value:.8g}" for name, value in asdict(result.figures).items()}
                table.writerow({"cloud": case, "part": part, "method": method, **values, "seconds": spent})
