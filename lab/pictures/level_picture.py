"""The picture in docs/change.md of how the level of detection comes about.

``lab/pictures/level_picture.py [FILE]`` simulates two surveys of a cut with a road, a face of 45 degrees,
a berm and a shoulder, lowers two places of it, and draws what the engine computes: points and errors, the
calibration by slope, the level on the map, and what each threshold makes of the change.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from slopewatch.engine.change.difference import difference, epoch_cells
from slopewatch.engine.change.result import Change
from slopewatch.engine.grid.pooled_variance import pooled_variance
from slopewatch.engine.maps.palette import BELOW_LEVEL, diverging_colours
from slopewatch.interface.parameters import ChangeParameters, SurveyParameters
from slopewatch.lab.benchmarks.chain import inside
from slopewatch.simulation.frame import Frame
from slopewatch.simulation.surveys.change import Bump
from slopewatch.simulation.surveys.survey import simulate_pair

CELL = 0.25
LOWERED = (Bump(12.0, 9.0, 3.5, 3.0, -0.12), Bump(26.0, 8.0, 3.0, 2.5, -0.035))
WAYS = (
    ("4  propagated: 0.11 m everywhere", {"threshold": "propagated"}),
    ("probabilistic: each cell's own error", {}),
    ("coherent: the same and what lies around", {"threshold": "coherent"}),
)
STYLE = {
    "axes.titlelocation": "left",
    "axes.titlesize": 9,
    "axes.labelsize": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7,
    "legend.frameon": False,
}


def main(path: Path) -> None:
    """Simulate, compute, draw."""
    parameters = SurveyParameters(
        seed=2, points=450_000, length=40.0, height=14.0, angle=45.0, benches=1, vegetation=0.4, offset=0.0
    )
    pair = simulate_pair(parameters, changes=LOWERED, roi_buffer=3.0, frame=Frame(dip_azimuth=180.0))
    clouds = [c.xyz[inside(c.xyz, pair) & c.truth_ground.astype(bool)] for c in (pair.first, pair.second)]
    settings = ChangeParameters(cell=CELL, adaptive=False)
    found = [difference(*clouds, replace(settings, **values)) for _, values in WAYS]
    published = difference(*clouds, replace(settings, cell_value="mean", calibrate=False))
    with rc_context(STYLE):
        figure = Figure(figsize=(12.0, 7.4), dpi=130, layout="constrained")
        axes = figure.subplots(3, 3, gridspec_kw={"height_ratios": (1.15, 1.15, 0.9)})
        own = found[1]
        _points(axes[0][0], clouds[0], own)
        _map(figure, axes[0][1], own, own.count_to.astype(float), "points in a cell, later survey", "points", top=20.0)
        _map(figure, axes[0][2], own, 100 * _sampling(clouds, own), "error from the points' scatter", "cm", top=3.0)
        _classes(axes[1][0], own)
        _map(figure, axes[1][1], own, 100 * own.level, "level of detection at 95 %", "cm", top=6.0)
        _levels(axes[1][2], own, published)
        for axis, change, (title, _) in zip(axes[2], found, WAYS, strict=True):
            _significant(axis, change, title)
        figure.savefig(path)
    print(f"{path} ({path.stat().st_size / 1e3:.0f} kB)")


def _extent(change: Change) -> tuple[float, float, float, float]:
    west, south, east, north = change.grid.bounds
    return 0.0, east - west, 0.0, north - south


def _sampling(clouds: list[np.ndarray], change: Change) -> np.ndarray:
    first, second = (epoch_cells(xyz, change.grid, ChangeParameters(cell=CELL, adaptive=False)) for xyz in clouds)
    return np.sqrt(sum(cells.on_grid(cells.leverage * pooled_variance(cells)) for cells in (first, second)))


def _points(axis, cloud: np.ndarray, change: Change) -> None:  # type: ignore[no-untyped-def]
    """Points of a strip across the face with the cells' edges and the cells' heights."""
    row_of = lambda xyz: np.floor((change.grid.north - xyz[:, 1]) / CELL).astype(int)  # noqa: E731
    column = int((np.median(cloud[:, 0]) - change.grid.west) / CELL)
    across = np.floor((cloud[:, 0] - change.grid.west) / CELL).astype(int) == column
    middle = int(np.median(row_of(cloud[across])))
    near = across & (np.abs(row_of(cloud) - middle) <= 3)
    x = change.grid.north - cloud[near, 1]
    start = (middle - 3) * CELL
    base = cloud[near, 2].min()
    axis.plot(x - start, cloud[near, 2] - base, ".", ms=3, color="#4a7a6a", label="ground points")
    rows = np.arange(middle - 3, middle + 4)
    heights = change.height_from[rows, column] - base
    axis.plot((rows + 0.5) * CELL - start, heights, "o", mfc="none", ms=7, color="#b43628", label="height of the cell")
    for row in range(middle - 3, middle + 5):
        axis.axvline(row * CELL - start, color="0.85", lw=0.8, zorder=0)
    axis.set(xlabel="m across", ylabel="m up", title="1  points in cells of 0.25 m, face of 45°")
    axis.legend()


def _map(figure, axis, change: Change, values: np.ndarray, title: str, unit: str, top: float | None = None) -> None:  # type: ignore[no-untyped-def]
    shown = np.where(change.valid, values, np.nan)
    picture = axis.imshow(shown, extent=_extent(change), cmap="cividis", vmax=top, interpolation="nearest")
    figure.colorbar(picture, ax=axis, shrink=0.7, extend="max" if top else "neither", label=unit)
    axis.set_title(title)


def _classes(axis, change: Change) -> None:  # type: ignore[no-untyped-def]
    classes = change.model.classes
    at = [c.at for c in classes]
    axis.axhspan(3, 7, color="0.92", zorder=0)
    axis.axhline(5, color="0.7", lw=0.8, zorder=0)
    axis.plot(at, [100 * c.exceedance_uncalibrated for c in classes], "o", color="0.5", ms=4, label="as the points say")
    axis.plot(at, [100 * c.exceedance for c in classes], "o", color="#2a6bae", ms=4, label="calibrated")
    axis.set_ylim(0, 14)
    axis.set(
        xlabel="slope (degrees)", ylabel="stable cells beyond the level (%)", title="2  calibration on stable ground"
    )
    axis.legend()


def _levels(axis, own: Change, published: Change) -> None:  # type: ignore[no-untyped-def]
    edges = np.arange(0, 66, 6)
    for change, colour, label in ((published, "0.5", "mean height, as published"), (own, "#2a6bae", "slope removed")):
        middle, median = [], []
        for low, high in pairwise(edges):
            cells = change.valid & (change.slope >= low) & (change.slope < high)
            if cells.sum() >= 100:
                middle.append((low + high) / 2)
                median.append(100 * float(np.median(change.level[cells])))
        axis.plot(middle, median, "o-", color=colour, ms=4, lw=1, label=label)
    axis.axhline(11.1, color="#b43628", lw=1, ls="--", label="4 cm an epoch")
    axis.set_ylim(0, 13)
    axis.set(xlabel="slope (degrees)", ylabel="median level (cm)", title="3  the level by slope")
    axis.legend()


def _significant(axis, change: Change, title: str) -> None:  # type: ignore[no-untyped-def]
    axis.imshow(
        np.where(change.valid, 1.0, np.nan),
        extent=_extent(change),
        cmap=ListedColormap([tuple((2 * v / 255 + 1) / 3 for v in BELOW_LEVEL)]),
        interpolation="nearest",
    )
    rgb = diverging_colours(change.dz, 0.12)
    alpha = np.where(change.significant, 255, 0).astype(np.uint8)
    axis.imshow(np.dstack([rgb, alpha]), extent=_extent(change), interpolation="nearest")
    axis.set_title(title)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images/level_of_detection.png"))
