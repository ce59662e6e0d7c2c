"""Plants that close: layers over the ground's height field with a density that depends on the relative height."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .fields import HeightField
from .scene import Scene
from .trace import Rays

Float = NDArray[np.float64]
LEAST_HEIGHT = 0.005
"""A layer lower than this is none, m."""
LOW, NODES_LOW, NODES_HIGH = 2.0, 28, 72
"""Nodes along a ray through layers up to LOW m and through higher ones; they lie closer towards the ground."""


@dataclass(frozen=True)
class Layer:
    """One kind of plant: ``height`` (m above the ground, 0: none) and ``depth`` over the place.

    ``depth`` is the optical depth of a vertical ray through the whole layer: exp(-depth) of the rays pass
    (Beer-Lambert). ``profile`` (k,) is the density at equally spaced relative heights from 0 to 1, of mean 1.
    ``source`` is what its echoes are (see ``returns``).
    """

    height: HeightField
    depth: HeightField
    profile: Float
    source: int

    def density(self, u: Float, v: Float, above: Float) -> Float:
        """Optical density at places ``above`` m over the ground, 1/m."""
        height = self.height(u, v)
        relative = above / np.maximum(height, LEAST_HEIGHT)
        index = np.clip(relative * (len(self.profile) - 1) + 0.5, 0, len(self.profile) - 1).astype(np.int64)
        value = self.depth(u, v) / np.maximum(height, LEAST_HEIGHT) * self.profile.take(index)
        return np.where((relative >= 0) & (relative <= 1) & (height > LEAST_HEIGHT), value, 0.0)


@dataclass(frozen=True)
class Cover:
    """What lies over the ground of one epoch besides shrubs, trees and turf.

    ``litter`` is the thickness (m) of dead leaves or cuttings on the ground. ``multipath`` and ``stray`` are the
    shares of the returns that lie below the ground, and anywhere along their beam.
    """

    layers: tuple[Layer, ...] = ()
    litter: HeightField | None = None
    multipath: float = 0.0
    stray: float = 0.0

    @property
    def tallest(self) -> float:
        """Largest height of a layer above the ground, m."""
        return max((float(layer.height.values.max()) for layer in self.layers), default=0.0)


@dataclass(frozen=True)
class LayerHits:
    """Where rays meet plants: index of the ray, distance along it (m), what it met."""

    ray: NDArray[np.intp]
    distance: Float
    source: NDArray[np.uint8]


class Crossing:
    """Rays on their way from ``entry`` to ``ground`` (n,), distances, through all layers at once.

    The optical depth is summed at nodes that lie closer towards the ground; between them it rises evenly, so that the
    place where a ray meets a plant is known exactly.
    """

    def __init__(self, scene: Scene, cover: Cover, rays: Rays, entry: Float, ground: Float) -> None:
        self.scene, self.cover, self.rays = scene, cover, rays
        count = NODES_LOW if cover.tallest <= LOW else NODES_HIGH
        back = (1.0 - np.arange(count + 1, dtype=np.float64) / count) ** 2
        self.nodes: Float = ground - np.maximum(ground - entry, 0.0) * back[:, None]
        self.optical = np.zeros_like(self.nodes)
        for k in range(count):
            middle = (self.nodes[k] + self.nodes[k + 1]) / 2
            density = sum(self._densities(rays, middle))
            self.optical[k + 1] = self.optical[k] + density * (self.nodes[k + 1] - self.nodes[k])

    def _densities(self, rays: Rays, distance: Float) -> list[Float]:
        u, v, z = rays.at(distance)
        above = z - self.scene.height(u, v)
        return [layer.density(u, v, above) for layer in self.cover.layers]

    def hits(self, threshold: Float, rng: np.random.Generator) -> LayerHits:
        """Where each ray's optical depth reaches ``threshold`` (n,); without the rays that reach the ground before."""
        index = np.count_nonzero(self.optical[1:] < threshold, axis=0)
        ray = np.flatnonzero(index < len(self.optical) - 1)
        k = index[ray]
        low, high = self.optical[k, ray], self.optical[k + 1, ray]
        part = np.clip((threshold[ray] - low) / np.maximum(high - low, 1e-12), 0.0, 1.0)
        distance = self.nodes[k, ray] + part * (self.nodes[k + 1, ray] - self.nodes[k, ray])
        # Which plant it was: in proportion to the densities in the middle of the step.
        middle = (self.nodes[k, ray] + self.nodes[k + 1, ray]) / 2
        shares = np.cumsum(self._densities(self.rays.take(ray), middle), axis=0)
        chosen = np.count_nonzero(shares < rng.random(len(ray)) * shares[-1], axis=0)
        kinds = np.array([layer.source for layer in self.cover.layers], dtype=np.uint8)
        return LayerHits(ray, distance, kinds[np.minimum(chosen, len(kinds) - 1)])

    def passed(self, distance: Float) -> Float:
        """Optical depth of each ray up to ``distance`` (n,)."""
        index = np.clip(np.count_nonzero(self.nodes < distance, axis=0) - 1, 0, len(self.nodes) - 2)
        ray = np.arange(len(distance))
        low, high = self.nodes[index, ray], self.nodes[index + 1, ray]
        part = np.clip((distance - low) / np.maximum(high - low, 1e-12), 0.0, 1.0)
        return self.optical[index, ray] + part * (self.optical[index + 1, ray] - self.optical[index, ray])
