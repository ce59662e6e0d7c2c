"""Bare ground that bends within a window: edges of berms, steps, cones, looked for in smaller windows."""

from __future__ import annotations

import numpy as np

from ..core.arrays import Bool, Float
from ..geometry.plane_cells import Planes
from .continued_ground import MAX_PLANE_DISTANCE_SCATTERS, continued
from .narrow_windows import narrow_windows

CLOSER_PARTS = (2, 4)
"""Into so many parts a window is divided."""
MIN_BEND_M = 0.06
"""Height of the smaller windows' ground over the larger one's, from which it bends: no more than stubble stands."""
MIN_BEND_INCLINATION = 0.14
"""Inclination of the smaller windows' ground against the larger one's, from which it bends."""
BEND_SCATTER_M = 0.012
"""What a bend adds to the scatter in a smaller window."""
MAX_ALONE_SHARE = 0.05
"""Returns of the ground around, as a share of those above it, below which a small window is looked at by itself."""
MIN_INNER_SHARE = 0.8
"""Share of the returns about a smaller window's ground that lie within the scatter: of those in plants it is 0.4."""
CLOSER_REACH_M, CLOSER_ROUNDS = 0.3, 4
"""Height within which returns take part in a closer look, and its rounds."""
CONTINUED_REACH_M, CONTINUED_PARTS = 0.45, 2
"""Height within which returns take part where ground is continued, and the parts of the windows for that."""


def looked_closer(
    height: Float, bare: Bool, places: Float, side: float, scatter: float, threshold: float
) -> tuple[Float, Bool]:
    """Heights (n,) over the ground, refined by smaller windows, and which of the returns were refined.

    Args:
        height: (n,) over the ground of the windows, m.
        bare: (n,) returns in windows of bare ground.
        places: (n, 2) m, the windows' corners at whole multiples of ``side``.
        scatter: largest of bare ground's returns, m.
        threshold: largest distance of ground from its surface, m.
    """
    start, replaced = height, np.zeros(len(height), dtype=bool)
    for parts in CLOSER_PARTS:
        finer = Planes(places * (parts / side))
        residual, found = _closer(height, bare, finer, scatter, side / parts)
        found &= ~bare | _stands_alone(height, finer, threshold)
        height, bare, replaced = np.where(found, residual, height), bare | found, replaced | found
    known = bare & (np.abs(height) <= threshold)
    near = np.abs(start) < CONTINUED_REACH_M
    cells = Planes(places * (CONTINUED_PARTS / side), pool=Planes.ALONE)
    residual, found = continued(start, known, near, cells, side / CONTINUED_PARTS, scatter + BEND_SCATTER_M)
    return np.where(found, residual, height), replaced | found


def _stands_alone(height: Float, planes: Planes, threshold: float) -> Bool:
    """(n,) points in windows that hold nearly none of the ground that was found around them, as on a step."""
    present, over = (
        planes.sum(chosen.astype(np.float64)) for chosen in (np.abs(height) <= threshold, height > threshold)
    )
    alone = present < MAX_ALONE_SHARE * over
    return np.asarray(alone.ravel()[planes.key], dtype=np.bool_)


def _closer(height: Float, bare: Bool, planes: Planes, scatter: float, side: float) -> tuple[Float, Bool]:
    """Height (n,) over planes in smaller windows of ``side`` m, and where those show bare ground that bends."""
    near = np.abs(height) < CLOSER_REACH_M
    start, weight = np.where(near, height, 0.0), near.astype(np.float64)
    residual = start
    for _ in range(CLOSER_ROUNDS):
        middle, along, across = planes.fit(start, weight, 0.2, 0.02)
        residual = start - planes.at_points(middle, along, across)
        weight = near / (1.0 + (residual / scatter) ** 2)
    narrow, _ = narrow_windows(np.where(near, residual, np.inf), planes, scatter + BEND_SCATTER_M, median=False)
    inclined = np.hypot(along, across) > MIN_BEND_INCLINATION * side
    bends = inclined.ravel()[planes.key] | (np.abs(start - residual) > MIN_BEND_M)
    within, on = (
        planes.pooled(planes.sum((near & (np.abs(residual) <= reach)).astype(np.float64)))
        for reach in (scatter + BEND_SCATTER_M, MAX_PLANE_DISTANCE_SCATTERS * (scatter + BEND_SCATTER_M))
    )
    narrow &= within >= MIN_INNER_SHARE * on
    return residual, near & bends & narrow.ravel()[planes.key]
