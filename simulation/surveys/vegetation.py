"""Shrubs and trees as volumes of leaves, kept as optical density in voxels that follow the slope's profile."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float
from ...engine.core.progress import Progress
from .scene import Scene

DENSITY_UNIT = 0.05
"""Optical density of one count in a voxel, 1/m; a ray passes s m with probability exp(-density s) (Beer-Lambert)."""
ENVELOPE = 1.0
NOWHERE = -1e6
ROAD_EDGE = 0.3
"""Nothing grows at smaller v, m."""
MAX_CANOPY_VOXELS = 120_000_000
"""Voxels at most (one byte each); a larger scene gets wider columns."""


@dataclass(frozen=True)
class Growth:
    """Plants of one kind, uniform within each range: crown radius and height in m, the crown's share of the height.

    ``optical_depth`` is that of a vertical ray through the crown's centre; ``clumping`` the coefficient of variation
    of the leaf density between voxels, which opens gaps. With a ``stem`` the crown is an ellipsoid above it,
    without one it reaches down to the ground around.
    """

    radius: tuple[float, float]
    height: tuple[float, float]
    crown_share: tuple[float, float]
    optical_depth: tuple[float, float]
    stem: bool
    clumping: float = 1.0


SHRUBS = Growth((0.4, 1.3), (0.5, 2.0), (1.0, 1.0), optical_depth=(2.0, 4.0), stem=False)
TREES = Growth((1.0, 2.2), (3.0, 6.5), (0.5, 0.7), optical_depth=(2.0, 4.0), stem=True)
STEM_COUNT = 60


@dataclass(frozen=True)
class Canopy:
    """Leaf density: ``density[i, j, k]`` (v, u, height above the plain profile) in DENSITY_UNIT, and its envelope.

    ``top`` (same columns) is the highest local z with leaves within ENVELOPE m, NOWHERE where there are none;
    ``covered`` (same columns) says which columns lie under a crown.
    """

    u0: float
    v0: float
    w0: float
    step: float
    layer: float
    clearance: float
    density: NDArray[np.uint8]
    floor: Float
    top: Float
    covered: NDArray[np.bool_]

    def column(self, u: Float, v: Float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Row and column of the voxel column at (u, v), the nearest one outside."""
        rows, columns = self.covered.shape
        i = np.clip((v - self.v0) / self.step, 0, rows - 1).astype(np.int64)
        j = np.clip((u - self.u0) / self.step, 0, columns - 1).astype(np.int64)
        return i, j

    def density_at(self, u: Float, v: Float, z: Float) -> Float:
        """Optical density at local places, 1/m."""
        i, j = self.column(u, v)
        layers = self.density.shape[2]
        k = np.floor((z - self.floor[i]) / self.layer).astype(np.int64)
        inside = (k >= 0) & (k < layers)
        value = self.density.ravel().take((i * self.density.shape[1] + j) * layers + np.clip(k, 0, layers - 1))
        return np.where(inside, value * DENSITY_UNIT, 0.0)

    def top_at(self, u: Float, v: Float) -> Float:
        """Envelope of the canopy around (u, v), local z."""
        i, j = self.column(u, v)
        return self.top.ravel().take(i * self.top.shape[1] + j)

    @property
    def depth(self) -> float:
        """Largest height of leaves above the plain profile, m."""
        return self.w0 + self.layer * self.density.shape[2]

    def cover(self, area: tuple[float, float, float, float]) -> float:
        """Share of the rectangle (u and v from, u and v to) that lies under a crown."""
        (i0, i1), (j0, j1) = self.column(np.array(area[::2]), np.array(area[1::2]))
        return float(self.covered[i0 : i1 + 1, j0 : j1 + 1].mean())


def grow(
    scene: Scene,
    cover: float,
    rng: np.random.Generator,
    tree_share: float = 0.25,
    clearance: float = 0.15,
    step: float = 0.2,
    progress: Progress | None = None,
) -> Canopy:
    """Plant shrubs and trees at random behind the road until ``cover`` of the slope lies under crowns.

    Args:
        cover: share of the managed slope under crowns, seen from above; ground around it is planted alike.
        tree_share: share of the cover that trees start with; shrubs fill up.
        clearance: no leaves lower than this above the ground, m.
    """
    u0, v0, u1, v1 = scene.extent
    tallest = max(TREES.height[1], SHRUBS.height[1]) + 0.5
    layer = 0.15
    # Downhill of its stem, a level crown is higher above the ground.
    overhang = 1.2 * TREES.radius[1] * min(scene.profile.slopes[1], 4.0)
    layers = math.ceil((_spread(scene) + tallest + overhang) / layer)
    step = max(step, math.sqrt((u1 - u0) * (v1 - v0) * layers / MAX_CANOPY_VOXELS))
    rows, columns = math.ceil((v1 - v0) / step), math.ceil((u1 - u0) / step)
    u: Float = u0 + step * (np.arange(columns, dtype=np.float64) + 0.5)
    v: Float = v0 + step * (np.arange(rows, dtype=np.float64) + 0.5)
    ground = scene.base(*np.meshgrid(u, v))
    plain = scene.profile(v)
    w0 = float((ground - plain[:, None]).min()) - 0.1
    canopy = _Planting(u, v, plain + w0, ground, np.zeros((rows, columns, layers), np.uint8), layer, clearance)
    counted = ((v > max(scene.slope[1], ROAD_EDGE)) & (v < scene.slope[3]))[:, None]
    canopy.counted = counted & ((u > scene.slope[0]) & (u < scene.slope[2]))[None, :]
    total = int(canopy.counted.sum())
    if cover > 0 and total:
        corner = (u0, max(v0, ROAD_EDGE))
        for kind, goal in ((TREES, cover * tree_share), (SHRUBS, cover)):
            plants = 0
            # Near enough: the last columns would only be met by very many tiny plants.
            while canopy.count < (goal - 0.002) * total:
                canopy.plant(kind, rng.uniform(corner, (u1, v1)), rng, goal * total)
                plants += 1
                if progress is not None and plants % 100 == 0:
                    progress.update(canopy.count / (cover * total), "planting")
    top = np.full((rows, columns), NOWHERE)
    used = canopy.density.any(axis=2)
    highest = layers - np.argmax(canopy.density[:, :, ::-1] > 0, axis=2)
    top[used] = (canopy.floor[:, None] + highest * layer)[used]
    reach = math.ceil(ENVELOPE / step) + 1
    return Canopy(u0, v0, w0, step, layer, clearance, canopy.density, canopy.floor, _dilate(top, reach), canopy.covered)


def _spread(scene: Scene) -> float:
    """Height range of the ground about the plain profile, m."""
    _, v = scene.base.nodes()
    residual = scene.base.values - scene.profile(v)[:, None]
    return float(residual.max() - residual.min())


def _dilate(values: Float, reach: int) -> Float:
    """Largest value within ``reach`` cells, along rows and columns."""
    for axis in (0, 1):
        padding = [(0, 0), (0, 0)]
        padding[axis] = (reach, reach)
        padded = np.pad(values, padding, constant_values=NOWHERE)
        values = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis=axis).max(axis=-1)
    return np.ascontiguousarray(values)


class _Planting:
    """The canopy while it grows."""

    def __init__(
        self,
        u: Float,
        v: Float,
        floor: Float,
        ground: Float,
        density: NDArray[np.uint8],
        layer: float,
        clearance: float,
    ) -> None:
        self.u, self.v, self.floor, self.ground = u, v, floor, ground
        self.density, self.layer, self.clearance = density, layer, clearance
        self.covered = np.zeros(ground.shape, dtype=bool)
        self.counted = np.ones(ground.shape, dtype=bool)
        self.count = 0

    def plant(self, kind: Growth, place: Float, rng: np.random.Generator, goal: float) -> None:
        """One plant at ``place`` (u, v); its crown shrinks if it would overshoot ``goal`` columns by much."""
        step = self.u[1] - self.u[0]
        radius = rng.uniform(*kind.radius)
        missing = math.sqrt(max(goal - self.count, 1.0) / math.pi) * step
        radius = max(min(radius, 1.5 * missing), 0.6 * step)
        radii = radius * rng.uniform(0.8, 1.2, 2)
        height, share, depth = (
            rng.uniform(*kind.height),
            rng.uniform(*kind.crown_share),
            rng.uniform(*kind.optical_depth),
        )
        rows = slice(*np.searchsorted(self.v, (place[1] - radii[1], place[1] + radii[1])))
        columns = slice(*np.searchsorted(self.u, (place[0] - radii[0], place[0] + radii[0])))
        across, along = (self.u[columns] - place[0]) / radii[0], (self.v[rows] - place[1]) / radii[1]
        square = across[None, :] ** 2 + along[:, None] ** 2
        if not (square < 1).any():
            return
        i = min(int(np.searchsorted(self.v, place[1])), len(self.v) - 1)
        j = min(int(np.searchsorted(self.u, place[0])), len(self.u) - 1)
        half = height * share / 2
        # A crown on a stem is level; a bush leans with the slope.
        lean = 0.0 if kind.stem else 0.6
        centre = self.ground[i, j] + height - half
        centres = centre + lean * (self.ground[rows, columns, None] - self.ground[i, j])
        thickness = np.where(square < 1, np.maximum(half * np.sqrt(np.maximum(1 - square, 0.0)), self.layer), 0.0)
        levels = self.floor[rows, None, None] + self.layer * (np.arange(self.density.shape[2]) + 0.5)
        leaves = levels - centres < thickness[:, :, None]
        if kind.stem:
            leaves &= centres - levels < thickness[:, :, None]
            here = self.floor[i] + self.layer * (np.arange(self.density.shape[2]) + 0.5)
            bare = (here > self.ground[i, j] + self.clearance) & (here < centre)
            self.density[i, j, bare] = STEM_COUNT
        leaves &= (square < 1)[:, :, None]
        leaves &= levels > self.ground[rows, columns, None] + self.clearance
        shape = 1.0 / kind.clumping**2
        density = depth / (2 * half) / DENSITY_UNIT * rng.gamma(shape, 1.0 / shape, leaves.shape)
        crown = np.where(leaves, np.clip(density, 1, 255), 0).astype(np.uint8)
        block = self.density[rows, columns]
        np.maximum(block, crown, out=block)
        under = leaves.any(axis=2)
        self.count += int((under & ~self.covered[rows, columns] & self.counted[rows, columns]).sum())
        self.covered[rows, columns] |= under
