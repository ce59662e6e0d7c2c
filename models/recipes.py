"""How the project's own models are made: settings, scenes and steps, so that one command makes the same again."""

from __future__ import annotations

from dataclasses import dataclass, replace

from .batches import Augmentation
from .configuration import PAPER, ModelConfiguration
from .training import PAPER_TRAINING, TrainingParameters

HALF_WIDTH = (8, 32, 64, 128)
"""Half the published channels: 0.31 million parameters, a third of the time on a processor."""


@dataclass(frozen=True)
class Recipe:
    """A model's settings, how it is trained, and which windows of a scene it is trained on: every ``step`` m, and of
    these a random ``share``.
    """

    configuration: ModelConfiguration
    training: TrainingParameters
    step: float
    share: float = 1.0


SLOPEWATCH = Recipe(
    ModelConfiguration(
        voxel=0.4,
        neighbours=10,
        widths=HALF_WIDTH,
        trends=((0.8, 0.8), (2.0, 2.0), (5.0, 5.0), (10.0, 0.6), (0.6, 10.0), (20.0, 1.5)),
        density=(8.0, 450.0),
    ),
    TrainingParameters(steps=2600, batch=4, learning_rate=0.01, augmentation=Augmentation(turn=15.0)),
    step=15.0,
)
"""Coordinates and heights over six trends, voxels of 0.4 m: as much ground as possible is seen in the time."""

PUBLISHED = Recipe(replace(PAPER, widths=HALF_WIDTH), replace(PAPER_TRAINING, steps=150, batch=1), step=18.0, share=0.1)
"""The published pipeline, at half width. A step takes one block of 131,072 points, so that a fold sees fewer blocks in
the same time; as many are prepared as are seen once.
"""

RECIPES = {"slopewatch": SLOPEWATCH, "paper": PUBLISHED}
