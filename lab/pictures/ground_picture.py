"""The picture in docs/ground.md: sections through real clouds and a simulated meadow, with what is called ground.

``lab/pictures/ground_picture.py [FILE [FOLDER]]`` draws the returns, the ground by the default settings,
that of the published settings (the cloth alone), and the vendor's class 2 or the true surface. FOLDER holds what an
earlier version called ground, as NAME.npy of booleans for each point (meadow, and the names of the real clouds), and is
drawn too. Needs the real clouds next to the checkout (../shared/data).
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from slopewatch.engine.ground.filtering import ground_mask
from slopewatch.interface.parameters import GroundParameters
from slopewatch.simulation.surveys.plot import grass_plot

PUBLISHED = GroundParameters.build(profile="paper")
DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "terrain"
Float = NDArray[np.float64]
Bool = NDArray[np.bool_]


@dataclass(frozen=True)
class Section:
    """Points within a strip: distance along it and height (m), and which each method calls ground."""

    title: str
    along: Float
    height: Float
    own: Bool
    published: Bool
    former: Bool | None
    reference: tuple[Float, Float]
    reference_name: str


def main(path: Path, former: Path | None) -> None:
    """Extract, cut, draw."""
    sections = [
        _real("chablais_forest", "forest, French Alps, 13 returns/m²", 40.0, (20.0, 50.0), former),
        _real(
            "coromandel_forest", "native forest of 38 degrees, New Zealand, 32 returns/m²", 60.0, (30.0, 70.0), former
        ),
        _meadow(former),
    ]
    figure = Figure(figsize=(12.0, 11.0), dpi=120, layout="constrained")
    for axes, section in zip(figure.subplots(3, 1), sections, strict=True):
        _draw(axes, section)
    figure.savefig(path)
    print(f"{path} ({path.stat().st_size / 1e3:.0f} kB)")


def _real(
    name: str, title: str, across: float, along: tuple[float, float], former: Path | None, width: float = 1.0
) -> Section:
    las = laspy.read(DATA / f"{name}.laz")
    xyz = np.array(las.xyz)
    last = np.asarray(las.return_number) >= np.asarray(las.number_of_returns)
    vendor = np.asarray(las.classification) == 2
    place = xyz - xyz.min(axis=0)
    strip = (np.abs(place[:, 1] - across) < width / 2) & (place[:, 0] >= along[0]) & (place[:, 0] <= along[1])
    reference = (place[strip & vendor, 0], place[strip & vendor, 2])
    return _section(title, place, strip, (xyz, last), _kept(former, name), reference, "vendor's class 2")


def _meadow(former: Path | None) -> Section:
    plot = grass_plot(1, side=10.0, density=700.0, state="grown", slope=10.0)
    xyz = plot.cloud.xyz
    last = plot.cloud.return_number == plot.cloud.number_of_returns
    place = xyz - xyz.min(axis=0)
    strip = (np.abs(place[:, 1] - place[:, 1].max() / 2) < 0.1) & (place[:, 0] < 8.0)
    true = xyz[:, 2] - plot.above - xyz[:, 2].min()
    order = np.argsort(place[strip, 0])
    reference = (place[strip, 0][order], true[strip][order])
    title = "closed grass, simulated, 700 returns/m²"
    return _section(title, place, strip, (xyz, last), _kept(former, "meadow"), reference, "true surface")


def _section(
    title: str,
    place: Float,
    strip: Bool,
    cloud: tuple[Float, Bool],
    former: Bool | None,
    reference: tuple[Float, Float],
    reference_name: str,
) -> Section:
    """The points of ``strip``; ``cloud`` are all points and which of them are last returns."""
    own, published = (ground_mask(cloud[0], p, cloud[1]) for p in (GroundParameters(), PUBLISHED))
    before = None if former is None else former[strip]
    along, height = place[strip, 0], place[strip, 2]
    return Section(title, along, height, own[strip], published[strip], before, reference, reference_name)


def _kept(former: Path | None, name: str) -> Bool | None:
    """What an earlier version called ground, of all points."""
    return None if former is None else np.asarray(np.load(former / f"{name}.npy"), dtype=np.bool_)


def _draw(axes: Axes, section: Section) -> None:
    axes.scatter(section.along, section.height, s=3, c="0.75", label="returns")
    if section.former is not None:
        old = section.former
        axes.scatter(
            section.along[old], section.height[old], s=14, c="tab:pink", marker="x", lw=0.7, label="ground, before"
        )
    chosen = section.published
    axes.scatter(
        section.along[chosen], section.height[chosen], s=12, c="tab:orange", label="ground, published settings"
    )
    if section.reference_name.startswith("true"):
        axes.plot(*section.reference, c="k", lw=1.0, label=section.reference_name)
    else:
        axes.scatter(*section.reference, s=40, facecolors="none", edgecolors="k", label=section.reference_name)
    axes.scatter(section.along[section.own], section.height[section.own], s=9, c="tab:blue", label="ground, default")
    low, high = np.quantile(section.height, [0.0, 1.0])
    axes.set(
        title=section.title, xlabel="along the section, m", ylabel="height, m", ylim=(low - 0.2, min(high, low + 30.0))
    )
    axes.legend(loc="upper left", fontsize=8)


if __name__ == "__main__":
    main(
        Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parents[2] / "docs" / "images" / "ground.png"),
        Path(sys.argv[2]) if len(sys.argv) > 2 else None,
    )
