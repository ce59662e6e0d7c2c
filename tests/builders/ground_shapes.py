"""Small clouds whose ground is known: points at random places on a surface, some of them caught by leaves above it."""

from __future__ import annotations

import numpy as np

NOISE = 0.02


def field(count: int, size: float, seed: int = 0) -> np.ndarray:
    """Places (count, 2) at random in a square."""
    return np.random.default_rng(seed).uniform(0, size, (count, 2))


def with_plants(
    xy: np.ndarray, height: np.ndarray, seed: int = 1, share: float = 0.6, lowest: float = 0.15
) -> tuple[np.ndarray, np.ndarray]:
    """Points on ``height`` with noise, a ``share`` caught by leaves from ``lowest`` up; and which are ground."""
    rng = np.random.default_rng(seed)
    leaf = rng.random(len(xy)) < share
    z = height + rng.normal(0, NOISE, len(xy)) + np.where(leaf, rng.uniform(lowest, 0.6, len(xy)), 0.0)
    return np.column_stack([xy, z]), ~leaf


def jittered_grid(size: float, step: float, seed: int = 0) -> np.ndarray:
    """One place (n, 2) in each cell of a square grid."""
    rng = np.random.default_rng(seed)
    corners = np.stack(np.meshgrid(np.arange(0, size, step), np.arange(0, size, step)), axis=-1).reshape(-1, 2)
    return corners + rng.uniform(0.1, 0.9, corners.shape) * step


def shares(found: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    """Recall and precision."""
    return (found & truth).sum() / truth.sum(), (found & truth).sum() / found.sum()
