"""Blocks to train on: from simulated scenes, or from any cloud whose points have labels."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..engine.errors import InputError
from ..simulation.hazard_scenes.scenes import SimulatedScene
from .configuration import ModelConfiguration
from .preparation import UNKNOWN, Block, blocks, prepare_cloud

Float = NDArray[np.float64]
Labels = NDArray[np.uint8]
Item = TypeVar("Item")
Made = TypeVar("Made")


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


def scene_blocks(
    scene: SimulatedScene,
    configuration: ModelConfiguration,
    *,
    seed: int = 0,
    step: float | None = None,
    share: float = 1.0,
) -> list[Block]:
    """The blocks of a simulated scene; points close to the limit between two labels are not trained on."""
    labels = np.where(scene.ignore, np.uint8(UNKNOWN), scene.label)
    return labelled_blocks(scene.xyz, labels, configuration, seed=seed, step=step, share=share)


def in_order(make: Callable[[Item], Made], items: Iterable[Item], processes: int = 1) -> Iterator[Made]:
    """``make`` of each item, in the items' order. Several processes do not wait until the next is asked for, so that
    all that they made is held at once.
    """
    if processes <= 1:
        yield from map(make, items)
        return
    with ProcessPoolExecutor(processes) as pool:
        yield from pool.map(make, items)
