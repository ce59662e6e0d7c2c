"""The picture in docs/scenes.md of simulated plants compared with real ones.

``lab/pictures/plants_picture.py [FILE]`` draws slices through simulated grass, grown and mown, ferns and
forest, and how high their returns lie over the ground; the same of real clouds where these lie next to the checkout.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from slopewatch.lab.benchmarks.plants import BARE, FOREST_EXAMPLE, REAL, fitted, real
from slopewatch.lab.benchmarks.real_data import DATA
from slopewatch.simulation.surveys.plot import Plot, grass_plot, plot

GROUND, PLANT, OTHER = "#8a5a2b", "#4f8a3c", "#2a6bae"
PUBLISHED = {0.5: (0.20, 0.27), 0.9: (0.42, 0.55), 0.99: (0.65, 0.88)}


@dataclass(frozen=True)
class Slice:
    """What a slice shows: its plot, its thickness and length (m)."""

    title: str
    made: Plot
    thick: float
    long: float


def main(path: Path) -> None:
    """Simulate, measure, draw."""
    grown, mown = grass_plot(1), grass_plot(1, state="mown")
    ferns = plot(replace(BARE, ferns=1.0), 15.0, 150.0, 30.0)
    forest = plot(replace(BARE, forest=1.0), 60.0, 32.0, 38.0)
    slices = (
        Slice("closed grass, 700 returns/m²", grown, 0.15, 6.0),
        Slice("the same slope mown", mown, 0.15, 6.0),
        Slice("ferns and low shrubs, 150/m²", ferns, 0.3, 12.0),
        Slice("native forest, 32/m²", forest, 1.5, 45.0),
    )
    figure = Figure(figsize=(13.0, 6.4), dpi=120, layout="constrained")
    upper, lower = figure.subplots(2, 4)
    for axes, shown in zip(upper, slices, strict=True):
        draw_slice(axes, shown)
    _histogram(lower[0], grown.above, 1.0, "simulated")
    for share, (low, high) in PUBLISHED.items():
        lower[0].axvspan(low, high, color=OTHER, alpha=0.2, lw=0)
        lower[0].axvline(np.quantile(grown.above, share), color=PLANT, ls="--", lw=1)
        lower[0].text((low + high) / 2, 0.98, f"{100 * share:g} %", ha="center", va="top", fontsize=8, color=OTHER,
                      transform=lower[0].get_xaxis_transform())  # fmt: skip
    lower[0].plot([], [], color=OTHER, alpha=0.4, lw=6, label="real grass: its quantiles")
    lower[0].plot([], [], color=PLANT, ls="--", lw=1, label="simulated: the same")
    _histogram(lower[1], mown.above, 0.15, "simulated", low=-0.06)
    _histogram(lower[2], ferns.above, 2.0, "simulated")
    _histogram(lower[3], fitted(forest, 60.0).above, 16.0, "simulated", low=-1.0)
    example = DATA / REAL[FOREST_EXAMPLE]
    if example.is_file():
        _histogram(lower[3], real(example).above, 16.0, "real, New Zealand", colour=OTHER, low=-1.0)
    for axes in lower:
        axes.set(xlabel="height over the ground (m)", ylabel="share of the returns per m" if axes is lower[0] else "")
        axes.tick_params(labelsize=8)
        axes.legend(fontsize=8, loc="upper right")
    lower[0].set_ylim(top=4.4)
    lower[0].legend(fontsize=8, loc="upper right", bbox_to_anchor=(1.0, 0.93))
    figure.savefig(path, metadata={"Software": None})
    print(path)


def draw_slice(axes: Axes, shown: Slice) -> None:
    """Points of a slice up the slope, with the slope's own inclination taken out."""
    local = shown.made.scene.frame.to_local(shown.made.cloud.xyz)
    u0, v0, u1, _ = shown.made.scene.slope
    near = (np.abs(local[:, 0] - (u0 + u1) / 2) < shown.thick / 2) & (local[:, 1] - v0 < shown.long)
    v, ground = local[near, 1] - v0, shown.made.cloud.truth_ground[near] == 1
    height = local[near, 2] - shown.made.scene.profile(local[near, 1])
    level = np.linspace(0.0, shown.long, 400)
    surface = shown.made.scene.height(np.full(400, (u0 + u1) / 2), v0 + level) - shown.made.scene.profile(v0 + level)
    axes.plot(level, surface, color="0.6", lw=0.8, zorder=0)
    axes.scatter(v[~ground], height[~ground], s=2, color=PLANT, lw=0)
    axes.scatter(v[ground], height[ground], s=5, color=GROUND, lw=0)
    axes.set_title(shown.title, fontsize=10, loc="left")
    axes.set(xlabel="m up the slope", xlim=(0, shown.long))
    axes.set_ylabel("m over the plane of the slope" if "700" in shown.title else "")
    axes.tick_params(labelsize=8)


def _histogram(axes: Axes, above: np.ndarray, top: float, label: str, colour: str = PLANT, low: float = -0.1) -> None:
    count, edges = np.histogram(above, np.linspace(low, top, 56))
    axes.stairs(count / len(above) / (edges[1] - edges[0]), edges, color=colour, lw=1.4, label=label)
    axes.axvline(0.0, color="0.7", lw=0.8, zorder=0)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images/plants.png"))
