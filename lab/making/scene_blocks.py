"""Simulated scenes as blocks for training."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from typing import TypeVar

import numpy as np

from ...models.preparation.prepare import UNKNOWN, Block
from ...models.training.recipes import Recipe
from ...simulation.hazard_scenes.scenes import SimulatedScene

Item = TypeVar("Item")
Made = TypeVar("Made")


def scene_blocks(recipe: Recipe, scene: SimulatedScene) -> list[Block]:
    """The blocks of a scene that are trained on; points close to the limit between two labels are not."""
    labels = np.where(scene.ignore, np.uint8(UNKNOWN), scene.label)
    return recipe.blocks(scene.xyz, labels, scene.spec.seed)


def in_order(make: Callable[[Item], Made], items: Iterable[Item], processes: int = 1) -> Iterator[Made]:
    """``make`` of each item, in the items' order. Several processes do not wait until the next is asked for, so that
    all that they made is held at once.
    """
    if processes <= 1:
        yield from map(make, items)
        return
    with ProcessPoolExecutor(processes) as pool:
        yield from pool.map(make, items)
