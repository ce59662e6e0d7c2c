"""The networks that take part in the benchmark of screening by sites, and which weights judge which survey.

A survey is judged by weights that were trained without it. With several of them, by seeds, each is a run of its own.
What was in no training at all (simulated slopes of other numbers, ground of one's own) is judged by the first file and
those that left the same surveys out alone, to save time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...engine.core.arrays import Float, Float32
from ...engine.core.errors import InputError
from ...models.preparation.bump_filter import cell_heights
from ...models.preparation.raster_zones import Scores
from ...models.preparation.relative_scores import relative_scores
from ...models.preparation.relief_channels import relief_channels
from ..making.relief_grounds import SITES
from .screening_ground import SIMULATED, Place
from .screening_trials import Cells, Detector, network_scores

if TYPE_CHECKING:
    from ...models.network.randlanet import RandLANet
    from ...models.network.unet import UNet

UNET = "U-Net"
"""What names of the runs of the network on relief begin with."""
RANDLA = "RandLA-Net"
"""What the name of the network on points begins with."""
RAW = "U-Net, raw"
RELATIVE = "U-Net, relative"
SHIPPED = "RandLA-Net, shipped"
FURTHER = "RandLA-Net of "
"""What columns of further weights of the network on points begin with: their configuration and checksum follow."""
POINT_ZONES = "RandLA-Net, zones"
"""Its zones as screening shows them; the others are of its odds, and of these relative to the slope, at a level."""


@dataclass(frozen=True)
class Weights:
    """A file of the raster network: its ``name`` (with the start of its SHA-256), the surveys it ``left_out``, the
    names of the ``real_ground`` that it was trained on, its ``seed``.
    """

    name: str
    network: UNet
    left_out: frozenset[str]
    real_ground: frozenset[str]
    seed: int

    def detector(self) -> Detector:
        """Log odds under the weights' name."""
        return _raster_scores(self.name, self.network)


def load_weights(paths: Sequence[Path]) -> list[Weights]:
    """Weights of the raster network.

    Raises:
        InputError: weights cannot be read, or two files left the same surveys out with the same seed.
    """
    from ...models.network.unet import load_unet

    found: list[Weights] = []
    for path in paths:
        network, description = load_unet(path)
        training = description["training"]
        name = f"{UNET} {str(description['sha256'])[:16]}"
        left_out, ground = (frozenset(training.get(field, ())) for field in ("left_out", "real_ground"))
        one = Weights(name, network, left_out, ground, int(training.get("seed", 0)))
        if any((one.left_out, one.seed) == (other.left_out, other.seed) for other in found):
            raise InputError(f"The weights {path} have surveys and seed of others that are given; leave one out.")
        found.append(one)
    return found


def runs_of(place: Place, weights: Sequence[Weights]) -> list[Weights]:
    """The weights that judge a place, one for each seed that there is; empty where all of them may have seen it. A seed
    that is missing is replaced by the first.
    """
    mine = [one for one in weights if place.group in one.left_out]
    trained = {site.survey for site in SITES} | {name for one in weights for name in one.real_ground}
    if not mine and weights and (place.kind == SIMULATED or place.group not in trained):
        mine = [one for one in weights if one.left_out == weights[0].left_out]
    if not mine:
        return []
    by_seed = {one.seed: one for one in reversed(mine)}
    return [by_seed.get(seed, mine[0]) for seed in sorted({one.seed for one in weights})]


def relative(answers: Float32, cell: float, scores: Callable[..., Scores] = relative_scores) -> Float32:
    """Log odds (1 + scenes, 2, columns, rows) over those of most of the slope, each raster by itself."""
    found = [scores(up, down, cell) for up, down in answers]
    return np.stack([np.stack([one.uplift, one.subsidence]) for one in found]).astype(np.float32)


def shipped_network() -> tuple[str, Detector]:
    """The shipped weights by the package's own prediction, and a name that says which they are."""
    from ...models.network.shipped import shipped_model
    from ...models.network.weights import load_model

    path, sha256 = shipped_model()
    name = f"{RANDLA} {sha256[:16]}"
    return name, _point_scores(name, load_model(path, sha256).network)


def further_networks(paths: Sequence[Path]) -> dict[str, tuple[str, Detector]]:
    """Networks on points from files of weights: column, name that says which they are, and detector.

    Raises:
        InputError: weights cannot be read, or two are the same.
    """
    from ...models.network.weights import load_model

    found: dict[str, tuple[str, Detector]] = {}
    for path in paths:
        model = load_model(path)
        title, sha256 = model.network.configuration.name, str(model.metadata["sha256"])
        # What it refuses, such as windows of too few points, it does not see.
        name, column = f"points {sha256[:16]}", f"{FURTHER}{title} {sha256[:6]}"
        if column in found:
            raise InputError(f"The weights {path} are given twice; leave one out.")
        found[column] = name, _point_scores(name, model.network, refusing=True)
    return found


def _point_scores(name: str, network: RandLANet, *, refusing: bool = False) -> Detector:
    """Scores of the network; a cloud that it is ``refusing`` is background to it."""
    from ...models.inference.prediction import predict

    def probabilities(xyz: Float) -> Float:
        try:
            return np.asarray(predict(network, xyz).probabilities, dtype=np.float64)
        except InputError:
            if not refusing:
                raise
            return np.tile([1.0, 0.0, 0.0], (len(xyz), 1))

    return network_scores(probabilities, name)


def _raster_scores(name: str, network: UNet) -> Callable[[Place, Cells], dict[str, Scores]]:
    from ...models.network.relief_looks import log_odds, raster_logits

    def scores(place: Place, raster: Cells) -> dict[str, Scores]:
        relief = relief_channels(cell_heights(place.flat, raster.cell, raster.origin, raster.shape))
        odds = log_odds(raster_logits(network, relief.channels))
        up, down = (np.where(raster.covered, one, np.nan) for one in odds)
        return {name: Scores(up, down, raster.cell)}

    return scores
