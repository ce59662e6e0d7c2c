"""Cheap pairs for displacement vectors: bare relief that stands still; smooth ground on which objects come and go."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ..engine.core.arrays import Float
from ..simulation.surveys.scene import Relief, relief_values

SIDE_M, _STEP_M = 26.0, 0.05
_DIP_DEG, _NOISE_M, _GAPS = 39.0, 0.02, 0.35
_LINES_M = 0.12  # between scan lines


def bare_pair(seed: int, points_per_m2: float) -> tuple[Float, Float]:
    """Two surveys (n, 3) of the demo's relief without plants, with gaps: a third of the ground has no points.

    ``points_per_m2`` are of the map, where there are points; 2 cm of noise.
    """
    rng = np.random.default_rng((seed, 17))
    count = int(SIDE_M / _STEP_M) + 1
    values = relief_values(Relief(), (count, count), _STEP_M, np.full(count, 10.0), rng)
    holes = ndimage.gaussian_filter(rng.normal(size=values.shape), 12)
    seen = holes > np.quantile(holes, _GAPS)
    found = []
    for _ in range(2):
        flat = rng.uniform(0.5, SIDE_M - 0.5, size=(int(points_per_m2 * np.cos(np.radians(_DIP_DEG)) * SIDE_M**2), 2))
        flat = flat[ndimage.map_coordinates(seen.astype(float), flat.T / _STEP_M, order=0) > 0.5]
        found.append(_in_the_map(flat, ndimage.map_coordinates(values, flat.T / _STEP_M, order=1), rng))
    return found[0], found[1]


def changing_objects(seed: int, points_per_m2: float) -> tuple[Float, Float]:
    """Two surveys (n, 3) of a smooth plane in scan lines: boxes of which a third stays, a third comes and a third goes,
    and a bowl that grows. Nothing moves along the surface.
    """
    rng = np.random.default_rng((seed, 23))
    boxes = np.column_stack([
        rng.uniform(2, SIDE_M - 2, (18, 2)), rng.uniform(0.3, 1.5, (18, 2)), rng.uniform(0.1, 0.6, 18)
    ])  # fmt: skip
    bowl = rng.uniform(6, SIDE_M - 6, 2)
    found = []
    for epoch in range(2):
        count = int(points_per_m2 * np.cos(np.radians(_DIP_DEG)) * SIDE_M**2)
        line = (rng.integers(0, int(SIDE_M / _LINES_M), count) + rng.normal(0, 0.05, count)) * _LINES_M
        flat = np.column_stack([rng.uniform(0, SIDE_M, count), line])
        flat = flat if epoch == 0 else flat[:, ::-1]
        height = -(0.15 + 0.25 * epoch) * np.clip(1 - ((flat - bowl) ** 2).sum(axis=1) / 9.0, 0.0, None)
        for number, (x, y, width, depth, top) in enumerate(boxes):
            if number % 3 != 1 + epoch:
                inside = (np.abs(flat[:, 0] - x) < width) & (np.abs(flat[:, 1] - y) < depth)
                height = np.where(inside, np.maximum(height, top), height)
        found.append(_in_the_map(flat, height, rng))
    return found[0], found[1]


def _in_the_map(flat: Float, height: Float, rng: np.random.Generator) -> Float:
    plane = np.column_stack([flat, height + rng.normal(0, _NOISE_M, len(flat))])
    c, s = np.cos(np.radians(_DIP_DEG)), np.sin(np.radians(_DIP_DEG))
    axes = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    return np.asarray(plane @ axes + np.array([500_000.0, 3_000_000.0, 100.0]))
