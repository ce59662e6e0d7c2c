"""Sparse ground with relief and plants, and cells that grow on it."""

from __future__ import annotations

import numpy as np
from slopewatch.engine.change.result import Change
from slopewatch.interface.parameters import ChangeParameters

GROWING = ChangeParameters(adaptive=True, calibrate=False, cell=0.1, largest_cell=1.6)


def surface(x, y):
    return 100.0 + 0.7 * x + 0.3 * y + 0.3 * np.sin(x / 3) * np.cos(y / 4) + 0.02 * np.sin(4 * x) * np.sin(5 * y)


def epoch(seed: int, *, n: int = 20_000, noise: float = 0.03, side: float = 24.0, plants: int = 60) -> np.ndarray:
    """A rough slope under plants, each epoch seen through other gaps: discs where one point in twelve is left."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, side, (n, 2))
    gap = np.hypot(*(xy[:, None] - np.random.default_rng(0).uniform(0, side, (plants, 2))).transpose(2, 0, 1)).min(1)
    xy = xy[(gap > 1.2) | (rng.random(n) < 1 / 12)]
    return np.column_stack([xy, surface(*xy.T) + rng.normal(0, noise, len(xy))])


def blocks_of(change: Change) -> np.ndarray:
    """Flat index of one cell of each block."""
    return np.unique(change.partition.block.ravel(), return_index=True)[1][int((change.partition.block < 0).any()) :]
