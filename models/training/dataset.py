"""Blocks to train on, from a cloud whose points have labels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float
from ...engine.core.errors import InputError
from ..configuration import ModelConfiguration
from ..preparation.prepare import UNKNOWN, Block, blocks, prepare_cloud

Labels = NDArray[np.uint8]


def labelled_blocks(
    xyz: Float,
    labels: Labels,
    configuration: ModelConfiguration,
    *,
    seed: int = 0,
    step: float | None = None,
    share: float = 1.0,
) -> list[Block]:
    """The blocks of a cloud with labels: one sample a window.

    Args:
        xyz: (n, 3) metres. labels: (n,) classes, ``UNKNOWN`` where not to be trained on. A voxel has the label that
        most of its points have. step: of the windows, m; the configuration's by default. Longer steps repeat fewer
        points. share: of the windows, chosen at random.

    Raises:
        InputError: a label is none of the model's classes, or the cloud cannot be prepared.
    """
    classes = len(configuration.classes)
    strange = (labels >= classes) & (labels != UNKNOWN)
    if strange.any():
        raise InputError(
            f"The class {int(labels[strange][0])} of some points is none of the model's {classes}; "
            f"use 0 to {classes - 1}, or {UNKNOWN} for unknown."
        )
    cloud = prepare_cloud(xyz, configuration, seed)
    ranked = np.where(labels == UNKNOWN, classes, labels).astype(np.uint8)
    voted = cloud.voxels.majority(ranked, classes + 1)
    voted[voted == classes] = UNKNOWN
    chosen = configuration if step is None else replace(configuration, step=step)
    rng = np.random.default_rng([seed, 1])
    return list(blocks(cloud, chosen, rng, voted, every_point=False, share=share))
