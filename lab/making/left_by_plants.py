"""What ground extraction leaves of low plants: ground that is too high in patches, holes, and returns above the ground.

On real grass, ferns and forest the extracted ground lies centimetres over the true one where plants are dense, some
decimetres in places (docs/ground.md). None of it is a hazard. How wide and how frequent such places are is assumed.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from ...engine.core.arrays import Float
from ...simulation.hazard_scenes.residue import SPACING, plant_density
from ...simulation.hazard_scenes.styles import log_uniform

COVERED = (0.1, 0.7)
"""Share of the ground with plants."""
PATCHES_M = (4.0, 20.0)
"""Longest wave of the field that patches of plants come of, log-uniform; the shortest is a sixth of it."""
SURPLUS_M = (0.02, 0.15)
SURPLUS_WIDTH_M = (0.5, 4.0)
"""Height and width of a blob of surplus, log-uniform."""
BLOBS_M2 = (0.03, 0.25)
"""Blobs on a square metre of dense plants, log-uniform."""
HOLES_PER_BLOB = (0.0, 0.4)
HOLE_WIDTH_M = (0.4, 2.0)
LEFTOVERS = (0.002, 0.02)
"""Share of the points among plants that are returns from them, log-uniform."""
LEFTOVER_HEIGHT_M = (0.1, 0.5)
_FORM_EXPONENT = 1.5


def left_by_plants(xyz: Float, rng: np.random.Generator) -> Float:
    """Points (m, 3) of a ground (n, 3) with z upwards, m <= n, as extracted where plants stand on parts of it."""
    low, size = xyz[:, :2].min(axis=0), np.ptp(xyz[:, :2], axis=0)
    rows, columns = (int(n) for n in np.ceil(size / SPACING).astype(int) + 2)
    longest = log_uniform(PATCHES_M, rng)
    dense = plant_density((rows, columns), COVERED, rng, (longest / 6.0, longest))
    node = np.rint((xyz[:, :2] - low) / SPACING).astype(np.int64)
    among = dense[node[:, 0], node[:, 1]]
    count = rng.poisson(log_uniform(BLOBS_M2, rng) * float(np.minimum(dense, 1.0).sum()) * SPACING**2)
    result = xyz.copy()
    kept = np.ones(len(xyz), dtype=bool)
    if count:
        places = low + SPACING * _drawn(dense, count, rng)
        tree = cKDTree(xyz[:, :2])
        result[:, 2] += _surplus(tree, places, rng)
        holes = places[rng.random(count) < rng.uniform(*HOLES_PER_BLOB)]
        for place in holes:
            kept[tree.query_ball_point(place, log_uniform(HOLE_WIDTH_M, rng) / 2)] = False
    left = rng.random(len(xyz)) < log_uniform(LEFTOVERS, rng) * (among > 0)
    # Low ones are more: what stands high was taken off.
    share = rng.beta(1.0, 2.0, int(left.sum()))
    result[left, 2] += LEFTOVER_HEIGHT_M[0] + (LEFTOVER_HEIGHT_M[1] - LEFTOVER_HEIGHT_M[0]) * share
    return np.asarray(result[kept])


def _surplus(tree: cKDTree, places: Float, rng: np.random.Generator) -> Float:
    """Height (n,) m of smooth blobs about places (m, 2); where several meet, the highest counts."""
    xy = tree.data
    added = np.zeros(len(xy))
    for place in places:
        height, radius = log_uniform(SURPLUS_M, rng), log_uniform(SURPLUS_WIDTH_M, rng) / 2
        stretch, angle = math.sqrt(log_uniform((0.5, 2.0), rng)), rng.uniform(0.0, math.pi)
        near = np.array(tree.query_ball_point(place, radius * max(stretch, 1 / stretch)), dtype=np.int64)
        x, y = (xy[near] - place).T / radius
        along = (math.cos(angle) * x + math.sin(angle) * y) / stretch
        across = (math.cos(angle) * y - math.sin(angle) * x) * stretch
        form = np.clip(1.0 - along**2 - across**2, 0.0, None) ** _FORM_EXPONENT
        added[near] = np.maximum(added[near], height * form)
    return added


def _drawn(dense: Float, count: int, rng: np.random.Generator) -> Float:
    """Nodes (count, 2) of the lattice drawn by density."""
    weight = np.cumsum(dense.ravel())
    number = np.searchsorted(weight, rng.random(count) * weight[-1], side="right")
    return np.column_stack(np.divmod(number, dense.shape[1])).astype(np.float64)
