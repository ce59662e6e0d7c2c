"""Plants that close: layers over the ground's height field with a density that depends on the relative height."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float
from ..fields import HeightField
from ..sources import LEAVES
from ..trace import Rays
from .scene import Scene
from .vegetation import Canopy

MIN_HEIGHT = 0.005
"""A layer lower than this is none, m."""
LOW, NODES_LOW, NODES_HIGH = 2.0, 28, 72
"""Nodes along a ray through layers up to LOW m and through higher ones; they lie closer towards the ground."""


@dataclass(frozen=True)
class Layer:
    """One kind of plant on a regular grid of the local frame, even within each cell.

    ``height`` (rows, columns) is in m above the ground, 0: none; ``depth`` (the same) is the optical depth of a
    vertical ray through the whole layer: exp(-depth) of the rays pass (Beer-Lambert). The middle of cell (0, 0) lies at
    ``origin`` (u, v). ``profile`` (k,) is the density at equally spaced relative heights from 0 to 1, of mean 1.
    ``source`` is what its echoes are (see ``returns``).
    """

    origin: tuple[float, float]
    step: float
    height: NDArray[np.float32]
    depth: NDArray[np.float32]
    profile: NDArray[np.float32]
    source: int

    @cached_property
    def tallest(self) -> float:
        return float(self.height.max())

    def cell(self, u: Float, v: Float) -> NDArray[np.int64]:
        """Flat index of the cell at (u, v), the nearest one outside."""
        rows, columns = self.height.shape
        i = np.clip((v - self.origin[1]) / self.step + 0.5, 0, rows - 1).astype(np.int64)
        j = np.clip((u - self.origin[0]) / self.step + 0.5, 0, columns - 1).astype(np.int64)
        return i * columns + j

    def density(self, cell: NDArray[np.int64], above: Float) -> Float:
        """Optical density ``above`` m over the ground in each cell (n,), 1/m."""
        low = np.flatnonzero(above <= self.tallest)
        height = self.height.ravel().take(cell[low])
        within = above[low] <= height
        low, height = low[within], np.maximum(height[within], MIN_HEIGHT)
        relative = np.maximum(above[low], 0.0) / height
        index = (relative * (len(self.profile) - 1) + 0.5).astype(np.int64)
        index = np.minimum(index, len(self.profile) - 1)
        density = np.zeros(len(above))
        density[low] = self.depth.ravel().take(cell[low]) / height * self.profile.take(index)
        return density


@dataclass(frozen=True)
class Cover:
    """What lies over the ground of one epoch in addition to shrubs, trees and turf.

    All layers have the same grid. ``litter`` is the thickness (m) of dead leaves or cuttings on the ground.
    ``multipath`` and ``stray`` are the shares of the returns that lie below the ground, and anywhere along their beam.
    """

    layers: tuple[Layer, ...] = ()
    litter: HeightField | None = None
    multipath: float = 0.0
    stray: float = 0.0

    @property
    def tallest(self) -> float:
        """Largest height of a layer above the ground, m."""
        return max((layer.tallest for layer in self.layers), default=0.0)


@dataclass(frozen=True)
class Landscape:
    """What is flown over in one epoch: the ground, its shrubs and trees, and what else covers it."""

    scene: Scene
    canopy: Canopy
    cover: Cover | None = None


@dataclass(frozen=True)
class LayerHits:
    """Where rays meet plants: index of the ray, optical depth and distance (m) so far, what it met."""

    ray: NDArray[np.intp]
    optical: Float
    distance: Float
    source: NDArray[np.uint8]


class Crossing:
    """Rays on their way from ``entry`` to ``ground`` (n,), distances, through all layers and the canopy at once.

    The optical depth is summed at nodes that lie closer towards the ground; between them it rises evenly, so that the
    place where a ray meets a plant is known exactly.
    """

    def __init__(self, landscape: Landscape, rays: Rays, entry: Float, ground: Float, rng: np.random.Generator) -> None:
        self.scene, self.cover, self.rays = landscape.scene, landscape.cover or Cover(), rays
        self.canopy = landscape.canopy if landscape.canopy.covered.any() else None
        cover = self.cover
        self.sources = np.array([*(layer.source for layer in cover.layers), LEAVES], dtype=np.uint8)
        count = NODES_LOW if cover.tallest <= LOW and self.canopy is None else NODES_HIGH
        # At random between rays, so that a layer's top does not lie at the same node in all.
        node = np.arange(count + 1, dtype=np.float64)[:, None] - rng.random(len(rays))
        node[0], node[-1] = 0.0, count
        self.nodes: Float = ground - np.maximum(ground - entry, 0.0) * (1.0 - node / count) ** 2
        self.optical = np.zeros_like(self.nodes)
        for k in range(count):
            middle = (self.nodes[k] + self.nodes[k + 1]) / 2
            density = sum(self._densities(rays, middle))
            self.optical[k + 1] = self.optical[k] + density * (self.nodes[k + 1] - self.nodes[k])

    def _densities(self, rays: Rays, distance: Float) -> list[Float]:
        u, v, z = rays.at(distance)
        above = z - self.scene.height(u, v)
        cell = self.cover.layers[0].cell(u, v)
        densities = [layer.density(cell, above) for layer in self.cover.layers]
        if self.canopy is not None:
            clear = np.flatnonzero(above >= self.canopy.clearance)
            leaves = np.zeros(len(above))
            leaves[clear] = self.canopy.density_at(u[clear], v[clear], z[clear])
            densities.append(leaves)
        return densities

    def hits(self, ray: NDArray[np.intp], threshold: Float, rng: np.random.Generator) -> LayerHits:
        """Where the optical depth of each ``ray`` (m,) reaches its ``threshold`` (m,), if above the ground."""
        index = np.count_nonzero(self.optical[1:, ray] < threshold, axis=0)
        met = index < len(self.optical) - 1
        ray, threshold, k = ray[met], threshold[met], index[met]
        low, high = self.optical[k, ray], self.optical[k + 1, ray]
        part = np.clip((threshold - low) / np.maximum(high - low, 1e-12), 0.0, 1.0)
        distance = self.nodes[k, ray] + part * (self.nodes[k + 1, ray] - self.nodes[k, ray])
        # Which plant it was: in proportion to the densities in the middle of the step.
        middle = (self.nodes[k, ray] + self.nodes[k + 1, ray]) / 2
        shares = np.cumsum(self._densities(self.rays.take(ray), middle), axis=0)
        chosen = np.count_nonzero(shares < rng.random(len(ray)) * shares[-1], axis=0)
        return LayerHits(ray, threshold, distance, self.sources[np.minimum(chosen, len(shares) - 1)])
