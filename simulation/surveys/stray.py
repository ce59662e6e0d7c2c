"""Returns that are no surface's: multipath below the ground, and stray points along the beam."""

from __future__ import annotations

import numpy as np

from ...engine.core.arrays import Float
from ..sources import MULTIPATH, STRAY
from ..trace import Rays
from .returns import Echoes

SHALLOWEST, TYPICAL, DEEPEST = 0.1, 0.6, 6.0
"""Depth of multipath below the ground, m: exponential about TYPICAL beyond SHALLOWEST."""
BEFORE, BEHIND = 15.0, 3.0
"""Stray points lie up to so far before and behind the ground along the beam, m."""


def disturbed(
    found: Echoes, rays: Rays, ground: Float, multipath: float, stray: float, rng: np.random.Generator
) -> Echoes:
    """The echoes, of which shares of ``multipath`` and ``stray`` have been moved along their beams.

    Args:
        ground: distance (n,) of each ray to the ground.
        multipath, stray: shares of all echoes. Multipath befalls last echoes, stray points are single ones; where
            these are too few, all of them.
    """
    distance, source = found.distance.copy(), found.source.copy()
    total = len(found.ray)
    # Echoes are sorted by ray.
    last = np.flatnonzero(np.append(found.ray[1:] != found.ray[:-1], True)) if total else np.empty(0, np.intp)
    single = last[np.bincount(found.ray, minlength=len(rays))[found.ray[last]] == 1]
    chosen = last[rng.random(len(last)) < multipath * total / max(len(last), 1)]
    depth = np.minimum(SHALLOWEST + rng.exponential(TYPICAL, len(chosen)), DEEPEST)
    beam = found.ray[chosen]
    distance[chosen] = ground[beam] + depth / -rays.direction[2, beam]
    source[chosen] = MULTIPATH
    single = single[source[single] != MULTIPATH]
    chosen = single[rng.random(len(single)) < stray * total / max(len(single), 1)]
    distance[chosen] = ground[found.ray[chosen]] + rng.uniform(-BEFORE, BEHIND, len(chosen))
    source[chosen] = STRAY
    return Echoes(found.ray, distance, found.energy, source)
