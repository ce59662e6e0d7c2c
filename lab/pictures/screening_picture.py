"""The picture of right and wrong screenings in docs/screening.md.

``lab/pictures/screening_picture.py [FILE]`` screens twelve scenes of each kind with the shipped weights
(2,000 m² at 60 points a square metre, seeds that neither training nor the benchmark sets have) and draws of each kind
the one that came out best and the one that came out worst: relief, truth, what was found.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from PIL import Image
from slopewatch.lab.making.scene_scores import screened_zones
from slopewatch.lab.pictures.small_jpeg import keep_small
from slopewatch.models.inference.prediction import predict
from slopewatch.models.network.shipped import shipped_model
from slopewatch.models.network.weights import load_model
from slopewatch.models.training.evaluation import confusion, intersection_over_union
from slopewatch.simulation.hazard_scenes.picture import LABEL_COLOURS, LABEL_OPACITY, shade
from slopewatch.simulation.hazard_scenes.scenes import SimulatedScene, scene

KINDS = ("published", "realistic", "shifted")
FIRST, COUNT = 2000, 12
WORDS = {1: "uplift", 2: "subsidence"}


def main(path: Path) -> None:
    """Screen, choose and draw."""
    torch.set_num_threads(1)
    network = load_model(*shipped_model()).network
    rows = []
    for kind in KINDS:
        scored = []
        for seed in range(FIRST, FIRST + COUNT):
            one = scene(seed, kind, area=2000.0, density=60.0)
            if not (one.label > 0).any():
                continue
            found = predict(network, one.xyz).labels
            iou = float(np.nanmean(intersection_over_union(confusion(one.label, found))))
            scored.append((iou, seed, one, found))
        scored.sort(key=lambda row: row[:2])
        rows += [(word, *chosen) for word, chosen in (("best", scored[-1]), ("worst", scored[0]))]
    _draw(rows, path)
    print(f"{path} ({path.stat().st_size / 1e3:.0f} kB)")


def _draw(rows: list[tuple[str, float, int, SimulatedScene, np.ndarray]], path: Path) -> None:
    pictures = []
    for word, iou, seed, one, found in rows:
        grey, truth, _ = shade(one, 0.2)
        _, labels, _ = shade(replace(one, label=found), 0.2)
        zones, false = screened_zones(one, found)
        title = f"{one.spec.kind} {seed}, {word} of {COUNT}: mean IoU {100 * iou:.0f} %"
        pictures.append((title, f"found: {zones} zones, {len(false)} of them false", grey, truth, labels))
    ratios = [p[2].shape[0] / p[2].shape[1] for p in pictures]
    figure = Figure(figsize=(13, 13 / 3 * sum(ratios) + 0.35 * len(rows) + 0.5), layout="constrained", dpi=80)
    axes = figure.subplots(len(rows), 3, height_ratios=ratios)
    for line, (title, counts, grey, truth, labels) in zip(axes, pictures):
        for axis, name, overlay in zip(line, (title, "truth", counts), (None, truth, labels)):
            axis.set_axis_off()
            axis.imshow(np.ma.masked_invalid(grey), cmap="gray", vmin=0, vmax=1, interpolation="antialiased")
            if overlay is not None:
                axis.imshow(_colours(overlay), interpolation="antialiased")
            axis.set_title(name, fontsize=9)
    handles = [Patch(color=[c / 255 for c in LABEL_COLOURS[k]], label=WORDS[k]) for k in WORDS]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, fontsize=9)
    drawn = FigureCanvasAgg(figure)
    drawn.draw()
    keep_small(Image.fromarray(np.asarray(drawn.buffer_rgba())[..., :3]), path)


def _colours(labels: np.ndarray) -> np.ndarray:
    result = np.zeros((*labels.shape, 4))
    for kind, colour in LABEL_COLOURS.items():
        result[labels == kind] = (*(c / 255 for c in colour), LABEL_OPACITY)
    return result


if __name__ == "__main__":
    images = Path(__file__).resolve().parents[2] / "docs/images"
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else images / "screening.jpg")
