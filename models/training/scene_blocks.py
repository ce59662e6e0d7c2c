"""Simulated scenes as blocks for training."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from ...simulation.hazard_scenes.scenes import SimulatedScene
from ..configuration import ModelConfiguration
from ..preparation.prepare import UNKNOWN, Block
from .dataset import Item, Made, labelled_blocks


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
