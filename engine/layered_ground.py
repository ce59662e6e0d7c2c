"""The ground under plants: a surface from below, and which returns about it are ground.

1. Candidates, the lowest supported returns of cells, are densified from seeds near the cloth (``densification``).
2. Planes on square windows follow the triangulated surface: in each window the lowest layer (``lowest_layer``) says which
   returns are ground, a plane is laid through them, and heights are taken over it; twice, then the layers once more.
3. A window is bare where all returns within the threshold of the ground scatter about it alike; elsewhere plants stand in the
   layer, and only the returns up to ``Layers.top`` are ground.

Windows are as large as the density of returns demands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from .densification import Triangles, densified, lowest_supported
from .lowest_layer import HIGHEST_M, LOWEST_M, Layers, histograms, lowest_layers
from .plane_cells import Planes

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

SURFACE_CELL_M = 0.25
RETURNS_A_WINDOW, FEWEST_RETURNS = 150.0, 60.0
"""Returns that a window is made for, and below which the windows around it help."""
SMALLEST_WINDOW_M, LARGEST_WINDOW_M = 0.5, 1.5
"""Half of the width over which returns are pooled."""
WIDEST_POOL = 3
"""Windows on each side that help at most."""
ROUNDS = 2
TYPICAL_SCATTER_M, SCATTER_LIMITS_M = 0.02, (0.01, 0.04)
"""Scatter of returns from bare ground where no window is bare, and its limits."""
NARROW_M, FEWEST_NARROW = 0.05, 0.05
"""A window whose lowest layer scatters less is taken for bare when the scatter is judged; the least share of those."""
SPREAD = 2.5
"""The threshold is at least so many times the scatter."""
LARGEST_SURPLUS_M = 0.007
"""A window is bare where the mean within the threshold lies no more than this above the ground."""
_POOL = (0.5, 1.0, 0.5)


@dataclass(frozen=True)
class LayeredGround:
    """What was found; arrays of shape (n,) for the points given.

    ``height`` is that over the surface (infinite far from it), ``ground`` the returns taken for ground, ``allowed``
    those that a closer look may still take (all over bare ground, those up to the layer's top under plants); ``bare``
    says whether the point's window is bare, ``plant_error`` and ``plant_height`` what its plants are and cost, metres.
    ``scatter`` and ``threshold`` are those of the whole cloud.
    """

    height: Float
    ground: Bool
    allowed: Bool
    bare: Bool
    plant_error: Float
    plant_height: Float
    scatter: float
    threshold: float


def layered_ground(xyz: Float, anchored: Bool, threshold: float) -> LayeredGround:
    """Ground among points (n, 3) in a frame in which the slope lies flat.

    Args:
        anchored: (n,) points near the settled cloth.
        threshold: least distance (m) from the surface within which a point of bare ground is ground.
    """
    low = lowest_supported(xyz)
    vertices = low[densified(xyz[low], anchored[low])]
    height = _over_triangles(xyz, xyz[vertices])
    index = np.flatnonzero((height > LOWEST_M) & (height < HIGHEST_M))
    side = _window_side(xyz[index])
    planes = Planes((xyz[index, :2] - xyz[:, :2].min(axis=0)) / side)
    over = height[index]
    scatter = TYPICAL_SCATTER_M
    for _ in range(ROUNDS):
        layers = _pooled_layers(over, planes, scatter, max(threshold, SPREAD * scatter))
        over = over - _through(over, planes, layers, max(threshold, SPREAD * scatter))
        scatter = _scatter(over, planes, layers)
    threshold = max(threshold, SPREAD * scatter)
    layers = _pooled_layers(over, planes, scatter, threshold)
    return _judged(len(xyz), index, over, planes, layers, scatter, threshold)


def _judged(
    count: int, index: NDArray[np.int64], over: Float, planes: Planes, layers: Layers, scatter: float, threshold: float
) -> LayeredGround:
    """The answer for all points from the windows."""
    def each(values: Float) -> Float:
        return values.ravel()[planes.key]

    ground, top = each(layers.ground), each(layers.top)
    is_bare = each((layers.surplus <= LARGEST_SURPLUS_M).astype(float)) > 0
    error = np.where(layers.surplus <= LARGEST_SURPLUS_M, 0.0, plant_error(layers, scatter))
    height, plant_height = np.full(count, np.inf), np.full(count, np.nan)
    height[index] = over - ground
    found, allowed, bare = (np.zeros(count, dtype=bool) for _ in range(3))
    found[index] = (over >= ground - threshold) & (over <= np.where(is_bare, ground + threshold, top))
    allowed[index] = found[index] | is_bare
    bare[index] = is_bare
    errors = np.full(count, np.nan)
    errors[index], plant_height[index] = each(error), each(np.maximum(layers.median, 0.0))
    return LayeredGround(height, found, allowed, bare, errors, plant_height, scatter, threshold)


def plant_error(layers: Layers, scatter: float) -> Float:
    """Standard error (m) of the ground's height in windows, from the returns that reached it."""
    return 1.3 * scatter / np.sqrt(np.maximum(layers.below, 1.0))


def _over_triangles(xyz: Float, vertices: Float) -> Float:
    """(n,) height over the triangles through ``vertices``, by a grid of SURFACE_CELL_M."""
    low = xyz[:, :2].min(axis=0)
    shape = np.ceil(np.ptp(xyz[:, :2], axis=0) / SURFACE_CELL_M).astype(int) + 2
    rows, columns = np.meshgrid(*(np.arange(n) for n in shape), indexing="ij")
    nodes = low + SURFACE_CELL_M * np.column_stack([rows.ravel(), columns.ravel()])
    surface = Triangles(vertices).height(nodes).reshape(shape)
    place = ((xyz[:, :2] - low) / SURFACE_CELL_M).T
    return xyz[:, 2] - ndimage.map_coordinates(surface, place, order=1, mode="nearest")


def _window_side(xyz: Float) -> float:
    """Side (m) of windows so that those pooled hold RETURNS_A_WINDOW returns of the lowest layers."""
    if len(xyz) == 0:
        return LARGEST_WINDOW_M
    cells = np.floor(xyz[:, :2] - xyz[:, :2].min(axis=0)).astype(np.int64)
    _, counts = np.unique(cells[:, 0] * (int(cells[:, 1].max()) + 1) + cells[:, 1], return_counts=True)
    side = math.sqrt(RETURNS_A_WINDOW / 4.0 / float(np.median(counts)))
    return min(max(side, SMALLEST_WINDOW_M), LARGEST_WINDOW_M)


def _pooled_layers(over: Float, planes: Planes, scatter: float, threshold: float) -> Layers:
    """The layers of windows, each with (half of) the windows around it; of more windows where returns are few."""
    counts = histograms(over, planes.key, planes.shape[0] * planes.shape[1]).reshape(*planes.shape, -1)
    pooled = counts
    for axis in (0, 1):
        pooled = ndimage.correlate1d(pooled, _POOL, axis=axis, mode="constant")
    layers = lowest_layers(pooled, scatter, threshold)
    for reach in range(2, WIDEST_POOL + 1):
        few = (layers.returns < FEWEST_RETURNS) & (layers.returns > 0)
        if not few.any():
            break
        width = 2 * reach + 1
        wider = ndimage.uniform_filter(counts, (width, width, 1), mode="constant") * width**2
        help_ = lowest_layers(wider[few], scatter, threshold)
        for name in Layers.__dataclass_fields__:
            getattr(layers, name)[few] = getattr(help_, name)
    return layers


def _through(over: Float, planes: Planes, layers: Layers, threshold: float) -> Float:
    """(n,) height, at each return, of planes through the windows' ground returns."""
    ground, top = (values.ravel()[planes.key] for values in (layers.ground, layers.top))
    weight = ((over >= ground - threshold) & (over <= top)).astype(np.float64)
    height, along, across = planes.fit(over, weight, 0.0, 0.05)
    enough = planes.pooled(planes.sum(weight)) >= 3.0
    height = np.where(enough, height, np.nan_to_num(layers.ground))
    return planes.at_points(height, along, across)


def _scatter(over: Float, planes: Planes, layers: Layers) -> float:
    """Scatter (m) of returns about bare ground: the lower quartile over the windows whose lowest layer is narrow."""
    from_ground = over - layers.ground.ravel()[planes.key]
    weight = (np.abs(from_ground) < 2.0 * NARROW_M).astype(np.float64)
    value = np.nan_to_num(from_ground)
    number = planes.sum(weight)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = planes.sum(weight * value) / number
        spread = np.sqrt(planes.sum(weight * value**2) / number - mean**2)
    enough = number >= 10
    narrow = enough & (spread < NARROW_M)
    if np.count_nonzero(narrow) < max(1.0, FEWEST_NARROW * np.count_nonzero(enough)):
        return TYPICAL_SCATTER_M
    return float(np.clip(np.quantile(spread[narrow], 0.25), *SCATTER_LIMITS_M))
