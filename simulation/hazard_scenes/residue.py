"""What vegetation and ground filtering do to a cloud: thinned and missing patches, spikes, clipped crests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from ...engine.core.arrays import Float, Float32
from ..fields import power_law_field
from .styles import Style
from .surface import Surface

SPACING = 0.3
"""Distance (m) of the nodes on which the cover is kept."""


@dataclass(frozen=True)
class Cover:
    """Probability that the ground is seen at a place, and density of the spikes that plants leave, on coarse nodes."""

    low: float
    passes: Float32
    spikes: Float32

    def at(self, values: Float32, u: Float, w: Float) -> Float32:
        """Values at the nearest coarse node."""
        i = ((u - self.low) * (1 / SPACING) + 0.5).astype(np.int32)
        j = ((w - self.low) * (1 / SPACING) + 0.5).astype(np.int32)
        i *= values.shape[1]
        i += j
        return values.ravel().take(i, mode="clip")


def grow_cover(surface: Surface, style: Style, rng: np.random.Generator) -> Cover:
    """Patches of plants: less ground is seen under them, none at their densest, and spikes stand there."""
    shape = [int(nodes * surface.step / SPACING) + 3 for nodes in surface.shape]
    dense = plant_density((shape[0], shape[1]), style.vegetation, rng)
    passes = np.clip(1.0 - dense, 0.0, 1.0)
    spikes = 0.2 + np.minimum(dense, 1.0) * 3.0
    spikes /= (spikes * passes).sum() / passes.sum()
    return Cover(surface.low, passes.astype(np.float32), (spikes * rng.uniform(*style.spikes)).astype(np.float32))


def plant_density(
    shape: tuple[int, int],
    shares: tuple[float, float],
    rng: np.random.Generator,
    waves: tuple[float, float] = (0.6, 6.0),
) -> Float:
    """Density of plants at nodes ``SPACING`` apart: 0 outside of patches, above 1 where no ground is seen.

    The patches cover one of the ``shares`` of the ground; they come of a random field of wavelengths ``waves`` (m).
    """
    patches = power_law_field(shape, SPACING, 2.2, *waves, rng)
    share = rng.uniform(*shares)
    if share <= 0:
        return np.zeros(shape)
    return np.asarray(np.clip((patches - np.quantile(patches, 1 - share)) / 0.8, 0.0, 1.3))


def clipped_crests(surface: Surface, rng: np.random.Generator) -> tuple[NDArray[np.bool_], int]:
    """Where a ground filter took a crest off: places that stand out of their surroundings of 1.2 m. Also the stride."""
    stride = max(1, round(0.1 / surface.step))
    coarse = surface.height[::stride, ::stride]
    width = max(3, round(1.2 / (stride * surface.step)))
    return coarse - uniform_filter(coarse, width, mode="nearest") > rng.uniform(0.10, 0.25), stride


def spike_heights(count: int, rng: np.random.Generator) -> Float:
    """Heights of what low plants leave above the ground, 3 to 30 cm, the low ones more often."""
    return 0.03 + 0.27 * rng.beta(1.0, 2.5, count)
