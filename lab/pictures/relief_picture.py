"""The picture of what the network on relief gets right and wrong, in docs/screening.md.

``lab/pictures/relief_picture.py RESULTS WEIGHTS... [--picture FILE]`` reads the results that ``python -m
slopewatch.lab.benchmarks.screening_sites --relief WEIGHTS... --results RESULTS`` kept. Of real clouds and of
simulated slopes it draws the places of which most and fewest hazards are found, by weights that left the survey out
and at the level of the other surveys: ground with the hazards put in, which of them are found, which zones are false.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from PIL import Image
from scipy.interpolate import griddata
from slopewatch.engine.maps.relief import shaded_relief
from slopewatch.lab.benchmarks.screening_networks import RELATIVE, relative, runs_of
from slopewatch.lab.benchmarks.screening_sites import COUNT, Options, load_weights, run
from slopewatch.lab.benchmarks.screening_table import MIN_DENSITY, Judged
from slopewatch.lab.benchmarks.screening_trials import PlaceResult, looks
from slopewatch.models.preparation.raster_zones import zones_above

KINDS = {"points": "real cloud", "simulated": "simulated slope"}
COLOURS = {1: "#2A6BAE", 2: "#B43628"}
"""As everywhere: raised ground is cold, lowered ground is warm."""
FALSE = "#F2B000"
LEAST_M = 0.3
"""Hazards lower than this are left out of the choice: hardly anything finds them."""
PIXEL_M = 0.25


def main() -> None:
    """Read, choose and draw."""
    images = Path(__file__).resolve().parents[2] / "docs/images"
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path)
    parser.add_argument("weights", type=Path, nargs="+")
    parser.add_argument("--count", type=int, default=COUNT)
    parser.add_argument("--no-extraction", action="store_true")
    parser.add_argument("--picture", type=Path, default=images / "relief_right_and_wrong.png")
    given = parser.parse_args()
    options = Options(given.weights, count=given.count, extract=not given.no_extraction, results=given.results)
    judged = run(options)
    chosen = [(word, one) for kind in KINDS for word, one in _extremes(judged, kind)]
    _draw(judged, chosen, given.weights, given.count, given.picture)
    print(f"{given.picture} ({given.picture.stat().st_size / 1e3:.0f} kB)")


def _extremes(judged: Judged, kind: str) -> list[tuple[str, PlaceResult]]:
    mine = [
        one
        for one in judged.results
        if one.place.kind == kind and one.place.density >= MIN_DENSITY and len(one.trials) > 20
    ]
    ranked = sorted(mine, key=lambda one: _share(judged, one))
    return [("most", ranked[-1]), ("fewest", ranked[0])]


def _share(judged: Judged, result: PlaceResult) -> float:
    run_of = judged.measured[RELATIVE][0]
    level = run_of.figures[result.place.name].others
    counted = [number for number, one in enumerate(result.trials) if abs(one.height) >= LEAST_M]
    return float(np.mean(run_of.strength[result.place.name][counted] >= level))


def _draw(
    judged: Judged, chosen: Sequence[tuple[str, PlaceResult]], weights: Sequence[Path], count: int, path: Path
) -> None:
    shapes = [one.lattice.shape for _, one in chosen]
    ratios = [rows / columns for columns, rows in shapes]
    figure = Figure(figsize=(9, 9 * sum(ratios) / 2 + 1.2), layout="constrained", dpi=80)
    lines = figure.subplots(len(chosen), 2, height_ratios=ratios)
    for axes, (word, one) in zip(lines, chosen):
        weight = runs_of(one.place, load_weights(weights))[0]
        scores = relative(one.answers[weight.name], one.lattice.cell)
        level = judged.measured[RELATIVE][0].figures[one.place.name].others
        _place(axes, one, scores, level, count)
        share = 100 * _share(judged, one)
        axes[0].set_title(f"{one.place.name}, {word} of its kind: {share:.0f} % of {LEAST_M:g} m and more", fontsize=9)
        axes[1].set_title("found, missed, false", fontsize=9)
    handles = [
        Patch(color=COLOURS[1], label="zone, rose"),
        Patch(color=COLOURS[2], label="zone, sank"),
        Patch(color=FALSE, label="false zone"),
        Line2D([], [], color="black", label="hazard found"),
        Line2D([], [], color="black", ls=":", label="hazard missed"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=5, fontsize=8)
    drawn = FigureCanvasAgg(figure)
    drawn.draw()
    # A palette takes half of the bytes; by coverage, for by frequency the greys of the ground would take it all.
    Image.fromarray(np.asarray(drawn.buffer_rgba())[..., :3]).quantize(256, Image.Quantize.MAXCOVERAGE).save(path)


def _place(axes: Sequence[Axes], result: PlaceResult, scores: np.ndarray, level: float, count: int) -> None:
    """Ground of the first scene and, on it, what is found of its hazards."""
    cell, origin = result.lattice.cell, result.lattice.origin
    high = origin + np.array(result.lattice.shape) * cell
    extent = (origin[0], high[0], origin[1], high[1])
    scene = next(looks(result.place, result.area, count))[1]
    u, w = np.meshgrid(np.arange(origin[0], high[0], PIXEL_M), np.arange(high[1], origin[1], -PIXEL_M))
    height = griddata(scene.flat[:, :2], scene.flat[:, 2], (u, w))
    ground = np.kron(result.lattice.covered.T[::-1], np.ones((round(cell / PIXEL_M),) * 2, dtype=bool))
    height[~ground[: height.shape[0], : height.shape[1]]] = np.nan
    picture = shaded_relief(height, PIXEL_M) / 255.0
    picture[~np.isfinite(height)] = 1.0
    for axis in axes:
        axis.set_axis_off()
        axis.imshow(picture, extent=extent, interpolation="antialiased")
    mine = [one for one in result.trials if one.scene == 0 and not one.empty]
    for label in COLOURS:
        _zones(axes[1], result, zones_above(scores[1, label - 1], level, cell)[0], label, extent)
    for one in mine:
        mask = np.zeros(result.lattice.shape, dtype=bool)
        mask.ravel()[one.cells] = True
        zone = zones_above(scores[1, one.label - 1], level, cell)[0] > 0
        found = np.count_nonzero(zone & mask) * cell**2 >= min(1.0, 0.25 * np.count_nonzero(mask) * cell**2)
        for axis, style in ((axes[0], "solid"), (axes[1], "solid" if found else "dotted")):
            colour = COLOURS[one.label] if axis is axes[0] else "black"
            axis.contour(mask.T, [0.5], extent=extent, colors=[colour], linewidths=1.2, linestyles=style)


def _zones(
    axis: Axes, result: PlaceResult, zones: np.ndarray, label: int, extent: tuple[float, float, float, float]
) -> None:
    """Zones of a sign; those that touch no hazard of their sign in their own colour."""
    true = np.zeros(result.lattice.shape, dtype=bool)
    for one in result.trials:
        if one.scene == 0 and one.label == label and not one.empty:
            true.ravel()[one.cells] = True
    touched = np.unique(zones[true & (zones > 0)])
    picture = np.zeros((*zones.T.shape, 4))
    for number in np.unique(zones[zones > 0]):
        colour = COLOURS[label] if number in touched else FALSE
        rgb = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
        picture[(zones == number).T] = (*rgb, 0.9)
    axis.imshow(picture[::-1], extent=extent, interpolation="nearest")


if __name__ == "__main__":
    main()
