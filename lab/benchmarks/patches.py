"""Bumps and hollows that are put into a raw cloud: all returns above a patch go along with its ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from ...engine.core.arrays import Float

TRIALS = 400
MIN_GROUND_POINTS = 3
"""Points of the vendor's ground within half of a patch's radius."""


@dataclass(frozen=True)
class Patch:
    """A cosine bump (hollow if ``height`` is negative), m."""

    east: float
    north: float
    radius: float
    height: float

    def away(self, xyz: Float) -> Float:
        """(n,) distance of points (n, 2+) from its middle."""
        return np.asarray(np.hypot(xyz[:, 0] - self.east, xyz[:, 1] - self.north))

    def rise(self, xyz: Float) -> Float:
        """(n,) m by which points (n, 2+) are moved."""
        share = self.away(xyz) / self.radius
        return np.asarray(np.where(share < 1.0, self.height * np.cos(0.5 * np.pi * share) ** 2, 0.0))


def total_rise(patches: Sequence[Patch], xyz: Float) -> Float:
    """(n,) m by which ``patches`` move points (n, 2+)."""
    return np.asarray(sum((patch.rise(xyz) for patch in patches), start=np.zeros(len(xyz))))


def placed(
    sizes: Sequence[tuple[float, float]],
    grounds: Sequence[Float],
    random: np.random.Generator,
    gap: float,
    slope: shapely.Polygon | None = None,
) -> list[Patch]:
    """Patches of (height, radius) ``sizes``, m, within ``slope`` and ``gap`` m apart.

    Each has ground points of all ``grounds`` (n, 3). A patch for which ``TRIALS`` draws find no place is left out.
    Without a slope, it is the box that all grounds reach.
    """
    if slope is None:
        low = np.max([ground[:, :2].min(axis=0) for ground in grounds], axis=0)
        high = np.min([ground[:, :2].max(axis=0) for ground in grounds], axis=0)
        slope = shapely.box(*low, *high)
    low, high = np.reshape(slope.bounds, (2, 2))
    found: list[Patch] = []
    for height, radius in sizes:
        for _ in range(TRIALS):
            east, north = random.uniform(low + radius, high - radius)
            patch = Patch(float(east), float(north), radius, height)
            inside = slope.contains(shapely.Point(east, north).buffer(radius))
            apart = all(np.hypot(p.east - patch.east, p.north - patch.north) > p.radius + radius + gap for p in found)
            seen = (np.count_nonzero(patch.away(ground) <= radius / 2) >= MIN_GROUND_POINTS for ground in grounds)
            if inside and apart and all(seen):
                found.append(patch)
                break
    return found
