"""How the project's own models are made: settings, scenes and steps, so that one command makes the same again."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from ...engine.core.arrays import Float
from ...engine.core.progress import Progress
from ..configuration import PAPER, ModelConfiguration
from ..network.batches import Augmentation
from ..preparation.prepare import Block
from .dataset import Labels, labelled_blocks
from .training import PAPER_TRAINING, TrainingParameters, TrainingState, block_provider, class_frequencies, train

HALF_WIDTH = (8, 32, 64, 128)
"""Half the published channels: 0.31 million parameters, 0.4 of the time on a processor."""


@dataclass(frozen=True)
class Recipe:
    """A model's settings, how it is trained, and which windows of a cloud it is trained on: every ``step`` m, and of
    these a random ``share``.
    """

    configuration: ModelConfiguration
    training: TrainingParameters
    step: float
    share: float = 1.0

    def with_steps(self, steps: int) -> Recipe:
        """The recipe with another number of steps."""
        return replace(self, training=replace(self.training, steps=steps))

    def blocks(self, xyz: Float, labels: Labels, seed: int) -> list[Block]:
        """The blocks of a labelled cloud that are trained on; see ``dataset.labelled_blocks``."""
        return labelled_blocks(xyz, labels, self.configuration, seed=seed, step=self.step, share=self.share)

    def train(
        self,
        blocks: Sequence[Block],
        folder: Path,
        *,
        device: torch.device | None = None,
        seconds: float = math.inf,
        progress: Progress | None = None,
    ) -> TrainingState:
        """Train on these blocks, or go on from the checkpoint in ``folder``; see ``training.train``."""
        device = device or torch.device("cpu")
        return train(
            self.configuration,
            block_provider(blocks, self.training, device),
            class_frequencies(blocks, len(self.configuration.classes)),
            self.training,
            folder,
            device=device,
            seconds=seconds,
            progress=progress,
        )


SLOPEWATCH = Recipe(
    ModelConfiguration(
        voxel=0.4,
        neighbours=10,
        widths=(16, 32, 64, 128),
        dropout=0.1,
        trends=((0.8, 0.8), (2.0, 2.0), (5.0, 5.0), (10.0, 0.6), (0.6, 10.0), (20.0, 1.5)),
        density=(8.0, 450.0),
        thinnings=2,
    ),
    TrainingParameters(steps=1800, batch=4, learning_rate=0.01, augmentation=Augmentation(turn=15.0)),
    step=15.0,
)
"""Coordinates and heights over six trends, half width but for the first block, voxels of 0.4 m and ten neighbours: as
much ground as possible is seen in the time.
"""

SHIPPED = replace(
    SLOPEWATCH,
    configuration=replace(SLOPEWATCH.configuration, own_roughness=True, thinnings=1, least_peak=0.75),
    training=replace(SLOPEWATCH.training, steps=24_000),
)
"""The same, trained longer, with heights in units of the slope's own roughness: in metres, a hollow of 40 cm on a
smooth slope was missed. Groups of voxels that are nowhere a hazard by 75 % are none: where
hazards are rare, most of those are false. One look at each window: a second gave 0.2 points for twice the windows.
"""

PUBLISHED = Recipe(
    replace(PAPER, voxel=0.12, block_points=32_768, widths=HALF_WIDTH),
    replace(PAPER_TRAINING, steps=510, batch=1),
    step=18.0,
    share=0.35,
)
"""The published pipeline, made fit for a processor: half width, voxels of 0.12 m instead of 0.01 m and a quarter of the
points a block, so that it sees four times as much ground in the same time. Of the windows as many are prepared as are
seen once.
"""

PUBLISHED_WHOLE = Recipe(PAPER, replace(PAPER_TRAINING, steps=1500, batch=1, bfloat16=True), step=18.0, share=0.15)
"""The published pipeline at its own voxels, width and points a block, in half-precision arithmetic; 1,500 steps see as
many points as 6,000 of ``PUBLISHED``. A block takes 25 MB, so that a smaller share of the windows is prepared.
With GLIBC_TUNABLES=glibc.malloc.mmap_max=0:glibc.malloc.trim_threshold=68719476736 the memory that torch frees is kept,
and a step takes 2.2 s of a core; more than half of its time goes into the system else.
"""

RECIPES = {"slopewatch": SLOPEWATCH, "paper": PUBLISHED, "paper-whole": PUBLISHED_WHOLE}
