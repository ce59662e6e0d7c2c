"""Rough ground on which patches slid, sank, or lost their surface, and the zones with what each did."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from slopewatch.engine.change.difference import difference
from slopewatch.engine.displacement.displacement import measure_displacement
from slopewatch.engine.displacement.registered import Registered
from slopewatch.engine.zones.change_movements import Motion, moved_zones
from slopewatch.engine.zones.change_zones import change_zones
from slopewatch.engine.zones.extraction import Origin, Zones
from slopewatch.interface.parameters import ChangeParameters, DisplacementParameters, ZoneParameters
from slopewatch.tests.builders.rough_ground import SPACING_M, axes, in_the_map, relief, sampled

SIDE_M, MIDDLE = 24.0, np.array([12.0, 12.0])


def share(plane: np.ndarray, middle: np.ndarray, half: float) -> np.ndarray:
    """1 in the middle of a disc, 0 from its edge on: (1 - r²)², of places (..., 2) on the plane."""
    square = ((plane - middle) ** 2).sum(axis=-1) / half**2
    return np.maximum(1.0 - square, 0.0) ** 2


def on_plane(xyz: np.ndarray) -> np.ndarray:
    """(n, 2) places on the plane of points in the map."""
    return ((xyz - in_the_map(np.zeros((1, 3)))) @ axes().T)[:, :2]


@dataclass(frozen=True)
class Ground:
    """Two surveys of rough ground at rest; ``heights`` is its relief."""

    heights: np.ndarray
    first: np.ndarray
    later: np.ndarray

    @classmethod
    def at_rest(cls, seed: int = 5, density: float = 80.0) -> Ground:
        heights = relief(SIDE_M, 0.15, seed=seed)
        return cls(heights, *(sampled(heights, density, 0.02, 10 * seed + k, gaps=0.2) for k in (1, 2)))

    def slid(self, along: float, across: float = 0.0, half: float = 5.0) -> np.ndarray:
        """The later survey with a disc moved down the dip and across it as one, with a soft edge."""
        radius = np.hypot(*(on_plane(self.later) - MIDDLE).T) / half
        part = np.clip((1 - radius) / 0.25, 0, 1)
        return self.later + (part * part * (3 - 2 * part))[:, None] * (np.array([along, across, 0.0]) @ axes())

    def lifted(self, height: float, half: float = 5.0) -> np.ndarray:
        """With a disc raised (sunk where negative) straight up, relief and all."""
        return self.later + np.array([0.0, 0.0, 1.0]) * (height * share(on_plane(self.later), MIDDLE, half))[:, None]

    def replaced(self, height: float, half: float = 5.0, seed: int = 77) -> np.ndarray:
        """With another surface in a disc, so much higher (lower where negative) along the normal."""
        count = len(self.heights)
        places = np.stack(np.mgrid[:count, :count], axis=-1) * SPACING_M
        smooth = share(places, MIDDLE, half)
        detail = [h - ndimage.gaussian_filter(h, 1.5 / SPACING_M) for h in (relief(SIDE_M, 0.15, seed), self.heights)]
        changed = self.heights + height * smooth + np.clip(smooth / 0.1, 0, 1) * (detail[0] - detail[1])
        return sampled(changed, len(self.later) / SIDE_M**2 / 0.77, 0.02, seed, gaps=0.2)


def zones_of(first: np.ndarray, later: np.ndarray, origin: Origin | None = None) -> Zones:
    """The zones of two surveys and what they did, at the default settings, as if the registration had no error."""
    change = difference(first, later, ChangeParameters())
    origin = origin or Origin()
    found = change_zones(change, epochs=origin.epochs, method=origin.method, run_id=origin.run_id)
    still = Registered.unknown()
    vectors = measure_displacement(first, later, DisplacementParameters(), still)
    return moved_zones(found, change, Motion(vectors, (first, later), still), ZoneParameters(), origin=origin)
