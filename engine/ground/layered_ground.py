"""The ground under plants: a surface from below, and which returns about it are ground.

1. Candidates, the lowest supported returns of cells, are densified from seeds near the cloth (``densification``).
2. Planes on square windows follow the triangulated surface: in each window the lowest layer (``lowest_layer``) says
   which returns are ground, a plane is laid through them, and heights are taken over it; twice, then the layers again.
3. A window whose lowest layer is as narrow as bare ground, and shaped like it, is bare: all returns within the
   threshold of their mean are ground. Elsewhere plants stand in the layer, and returns up to ``Layers.top`` are ground.
4. Where returns are dense, smaller windows look for bare ground that bends within a larger one (edges of berms, cones).

Nothing is ground because it is dense. Windows are as large as the density of returns demands. The constants were
measured on real and simulated clouds, see benchmarks/real_ground.py and docs/ground.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..core.arrays import Bool, Float
from ..geometry.plane_cells import Planes
from ..geometry.square_tiles import in_tiles
from .bare_scatter import bare_scatter
from .closer_look import looked_closer
from .densification import Triangles, densified, lowest_supported
from .lowest_layer import HIGHEST_M, LEAST_BELOW_SHARE, LOWEST_M, Layers, histograms, lowest_layers, separate_layers
from .narrow_windows import narrow_windows
from .squares import square_numbers
from .stray_low import NOTEWORTHY, stray_below

SURFACE_CELL_M = 0.25
RETURNS_A_WINDOW, FEWEST_RETURNS = 150.0, 60.0
"""Returns that a window is made for, and below which the windows around it help."""
SMALLEST_WINDOW_M, LARGEST_WINDOW_M = 0.5, 1.5
"""Half of the width over which returns are pooled."""
WIDEST_POOL = 3
"""Windows on each side that help at most."""
ROUNDS = 2
BARE_SCATTER_M, ROUGHNESS = 0.022, 0.016
"""Scatter of returns about bare ground in windows of a metre, and what the ground's relief adds for each metre more."""
PLANT_SCATTER = 0.73
"""Scatter of the ground under plants, as a share of the largest that bare ground may have."""
CLOSER_WINDOW_M = 0.8
"""Windows at most this large hold enough returns to be divided."""
SEPARATE_WINDOW_M = 1.2
"""In larger windows relief and forest floor fill the gap between rough ground and what grows on it."""
DENSE_TOLERANCE_M, SPARSE_TOLERANCE_M = 0.0025, 0.012
"""Height over the ground of the mean of what is taken under plants: where returns are few, each counts."""
SPARSE_THRESHOLD_M = 0.1
"""Least threshold where returns are few, and triangles are as wide as relief."""
TRIANGLE_REACH = 1.5
"""Where returns are few: thresholds from the windows' ground up to which the triangles decide."""
STEEPEST_STRETCH = 1.55
"""Of heights on steep ground: beyond 50 degrees the triangles say little about its inclination."""
SPREAD = 2.5
"""The threshold is at least so many times the scatter."""
PLANT_ERROR_M, ENOUGH_GROUND = 0.012, 110.0
"""Error of the ground under plants in windows of a metre with many ground returns, and the number of them below which
it grows: fitted to real forests and to simulated grass, ferns and forest, so that about 5 % of the cells lie beyond
1.96 errors, see docs/ground.md."""
CLEARLY_BARE = 0.5
"""Share of the lower returns that is ground, from which bare ground has no error by plants."""
LARGEST_PLANT_ERROR_M = 0.25
"""Where plants make a larger error, no ground is known."""
FARTHEST_CELLS = 4.0
"""Cells from the nearest known ground up to which a return's height over it is known."""
SLICE_M, CLOSE_SLICE_M, STRAY_ROUNDS = 0.1, 0.05, 3
"""Slices in which strays are looked for: of the slope, and of heights over the triangles, in so many rounds."""
STRAYS_LEFT = 0.5
"""Strays close below the ground that no slice distinguishes from it, as a share of those found: with less, the ground
under grass comes out too low where 5 % of the returns are strays."""
TILE_M, MARGIN_M = 60.0, 9.0


@dataclass(frozen=True)
class LayeredGround:
    """What was found; arrays of shape (n,) for the points given.

    ``height`` is that over the ground, NaN where no ground is known near; ``ground`` the returns taken for ground;
    ``bare`` says whether the window of a point is bare, ``plant_error`` (NaN where no ground is known) and
    ``plant_height`` what its plants cost and how high half of its lower returns stand, metres. ``scatter`` is the
    largest that bare ground may show, ``threshold`` the largest distance of ground from its surface.
    """

    height: Float
    ground: Bool
    bare: Bool
    plant_error: Float
    plant_height: Float
    scatter: float
    threshold: float


@dataclass(frozen=True)
class _Windows:
    """Side of the windows, largest scatter of bare ground in them and threshold, metres.

    ``wider`` is how much more returns scatter there than in small windows; ``least_below`` see ``lowest_layers``.
    """

    side: float
    scatter: float
    threshold: float
    wider: float
    least_below: float

    @property
    def tolerance(self) -> float:
        """Height (m) over the ground that the mean of what is taken may have."""
        return DENSE_TOLERANCE_M if self.side <= CLOSER_WINDOW_M else SPARSE_TOLERANCE_M


def layered_ground(xyz: Float, anchored: Bool, taken: Bool, threshold: float) -> LayeredGround:
    """Ground among points (n, 3) in a frame in which the slope lies flat.

    Args:
        anchored: (n,) points near the settled cloth.
        taken: (n,) points that may be ground.
        threshold: least distance (m) from the surface within which a point of bare ground is ground.
    """
    if not taken.any():
        return _nothing(len(xyz), BARE_SCATTER_M, threshold)
    height, taken, strays = _above_strays(xyz, anchored, taken)
    index = np.flatnonzero(taken & (height > LOWEST_M) & (height < HIGHEST_M))
    side = _window_side(xyz[index])
    level = xyz[index, 2] - np.median(xyz[:, 2])
    low = np.column_stack([xyz[index, :2] - xyz[:, :2].min(axis=0), height[index], level])
    bare_ground = BARE_SCATTER_M
    if len(index) and side <= CLOSER_WINDOW_M:
        bare_ground = bare_scatter(low[:, [0, 1, 3, 2]], side) or BARE_SCATTER_M
    scatter = math.hypot(bare_ground, ROUGHNESS * max(2.0 * side - 1.0, 0.0))
    threshold = max(threshold, SPREAD * scatter, SPARSE_THRESHOLD_M if side > CLOSER_WINDOW_M else 0.0)
    windows = _Windows(side, scatter, threshold, scatter / bare_ground, LEAST_BELOW_SHARE + STRAYS_LEFT * strays)
    if not len(index):
        return _nothing(len(xyz), scatter, windows.threshold)
    judged = in_tiles(low, partial(_judged, windows=windows), TILE_M, MARGIN_M, side)
    ground, bare = (np.zeros(len(xyz), dtype=bool) for _ in range(2))
    ground[index], bare[index] = judged[:, 1] > 0, judged[:, 2] > 0
    known = np.column_stack([height[index] - judged[:, 0], judged[:, 3:]])
    offset, error, plants = _everywhere(xyz, index, known, side).T
    over = height - offset
    over[index] = judged[:, 0]
    return LayeredGround(over, ground, bare, error, plants, scatter, windows.threshold)


def _nothing(count: int, scatter: float, threshold: float) -> LayeredGround:
    nowhere, none = np.full(count, np.nan), np.zeros(count, dtype=bool)
    return LayeredGround(nowhere, none, none, nowhere, nowhere, scatter, threshold)


def _above_strays(xyz: Float, anchored: Bool, taken: Bool) -> tuple[Float, Bool, float]:
    """Height (n,) over triangles, the points (n,) left to take part, and the share of strays that were left out."""
    everything = max(int(np.count_nonzero(taken)), 1)
    left = _without_strays(xyz, taken, SLICE_M)
    height = _over_triangles(xyz, anchored, left)
    for _ in range(STRAY_ROUNDS):
        # over the triangles the ground is level, so that what is not shows better
        level = _without_strays(np.column_stack([xyz[:, :2], height]), left & np.isfinite(height), CLOSE_SLICE_M)
        if np.count_nonzero(level) > (1.0 - NOTEWORTHY) * np.count_nonzero(left):
            break
        left = level
        height = _over_triangles(xyz, anchored, left)
    return height, left, 1.0 - int(np.count_nonzero(left)) / everything


def _without_strays(xyz: Float, taken: Bool, slice_m: float) -> Bool:
    """(n,) those ``taken`` without stray returns below the ground, where the cloud has a noteworthy share of them."""
    index = np.flatnonzero(taken)
    stray = stray_below(xyz[index], slice_m)
    left = taken.copy()
    if np.count_nonzero(stray) >= NOTEWORTHY * len(index):
        left[index[stray]] = False
    return left


def _everywhere(xyz: Float, index: NDArray[np.int64], known: Float, side: float) -> Float:
    """(n, k) values at all points from those ``known`` (m, k) at ``index``: mean of the cell, else of the nearest."""
    cells = np.floor((xyz[:, :2] - xyz[:, :2].min(axis=0)) / side).astype(np.int64)
    shape = tuple(int(n) + 1 for n in cells.max(axis=0))
    key = cells[:, 0] * shape[1] + cells[:, 1]
    finite = np.isfinite(known).all(axis=1)
    place, values = key[index[finite]], known[finite]
    number = np.bincount(place, minlength=shape[0] * shape[1])
    with np.errstate(invalid="ignore"):
        means = np.column_stack([np.bincount(place, column, len(number)) / number for column in values.T])
    distance, (rows, columns) = ndimage.distance_transform_edt((number == 0).reshape(shape), return_indices=True)
    nearest = (rows * shape[1] + columns).ravel()
    found = means[nearest[key]]
    found[distance.ravel()[key] > FARTHEST_CELLS] = np.nan
    found[index[finite]] = values
    found[index[~finite]] = np.nan
    return found


def plant_error(layers: Layers, wider: float) -> Float:
    """Standard error (m) of the ground's height by plants, in windows.

    It grows with the width of the windows that returns are gathered over, and where few returns are ground among
    others; ``wider`` is how much more bare ground scatters there than in small windows.
    """
    taken = np.maximum(layers.taken, 1.0)
    plants = 1.0 - np.minimum(taken / np.maximum(layers.returns, 1.0), 1.0)
    return PLANT_ERROR_M * wider**3 * np.sqrt(1.0 + ENOUGH_GROUND * plants / taken)


def _judged(points: Float, windows: _Windows) -> Float:
    """(n, 5) height over the ground, ground, bare, plant error and plant height of points (n, 3).

    ``points`` are x, y, the height over the triangles and that in the frame.
    """
    low = np.floor(points[:, :2].min(axis=0) / windows.side) * windows.side
    planes = Planes((points[:, :2] - low) / windows.side)
    stretch = _stretch(points[:, 3] - points[:, 2], planes, windows.side)
    over, sigma = points[:, 2] / stretch, PLANT_SCATTER * windows.scatter
    for _ in range(ROUNDS):
        layers = _pooled_layers(over, planes, sigma, windows)
        over = over - _through(over, planes, layers, windows.threshold)
    layers = _pooled_layers(over, planes, sigma, windows)
    rough = np.zeros(planes.shape, dtype=bool)
    if CLOSER_WINDOW_M < windows.side <= SEPARATE_WINDOW_M:
        counts = histograms(over, planes.key, planes.shape[0] * planes.shape[1]).reshape(*planes.shape, -1)
        rough, middle, spread = separate_layers(planes.pooled(counts), layers.ground)

    def each(values: NDArray[np.generic]) -> Float:
        return np.asarray(values.ravel()[planes.key], dtype=np.float64)

    narrow, mean = narrow_windows(over - each(layers.ground), planes, windows.scatter)
    bare = each(narrow) > 0
    height = over - each(layers.ground) - np.where(bare, each(mean), 0.0)
    top = np.where(bare, windows.threshold, each(layers.top - layers.ground))
    if rough.any():
        stony = (each(rough) > 0) & ~bare
        height = np.where(stony, over - each(middle), height)
        bare = bare | stony
        top = np.where(stony, np.maximum(SPREAD * each(spread), windows.threshold), top)
    sure = narrow & (layers.taken >= CLEARLY_BARE * layers.returns)
    error = each(np.where(sure, 0.0, plant_error(layers, windows.wider)))
    if windows.side <= CLOSER_WINDOW_M:
        places = points[:, :2] - low
        height, found = looked_closer(height, bare, places, windows.side, windows.scatter, windows.threshold)
        bare, top = bare | found, np.where(found, windows.threshold, top)
        error = np.where(found, 0.0, error)
    ground = (height >= -windows.threshold) & (height <= top)
    if windows.side > CLOSER_WINDOW_M:
        # planes of such windows are wider than relief; the triangles follow it
        about = np.abs(height) <= TRIANGLE_REACH * windows.threshold
        ground = (np.abs(points[:, 2]) <= windows.threshold) & (about | ~np.isfinite(height))
    ground &= ~(error > LARGEST_PLANT_ERROR_M)
    unknown = ~np.isfinite(height) | (error > LARGEST_PLANT_ERROR_M)
    height[unknown], error[unknown] = np.nan, np.nan
    return np.column_stack([height * stretch, ground, bare, error, np.maximum(each(layers.median), 0.0)])


def _stretch(surface: Float, planes: Planes, side: float) -> Float:
    """(n,) heights over a surface, at the points (n,) of which it has the heights given, a metre square to it.

    Noise that is as large everywhere seems larger where ground is inclined in the frame, as a road below a slope is.
    """
    _, along, across = planes.fit(surface, np.ones(len(surface)), 0.0, 1e-6)
    stretch = np.minimum(np.sqrt(1.0 + (along**2 + across**2) / side**2), STEEPEST_STRETCH)
    return np.asarray(stretch.ravel()[planes.key], dtype=np.float64)


def _over_triangles(xyz: Float, anchored: Bool, taken: Bool) -> Float:
    """(n,) height over triangles through the ground's candidates, by a grid of SURFACE_CELL_M."""
    usable = np.flatnonzero(taken)
    if not len(usable):
        return np.full(len(xyz), np.inf)
    candidates = usable[lowest_supported(xyz[usable])]
    vertices = candidates[densified(xyz[candidates], anchored[candidates])]
    if len(vertices) < 3:
        return np.full(len(xyz), np.inf)
    low = xyz[:, :2].min(axis=0)
    place = (xyz[:, :2] - low) / SURFACE_CELL_M
    node = np.floor(place).astype(np.int64)
    # a slope that lies across the axes fills little of the grid, and only nodes about its points are looked up
    needed = np.zeros(node.max(axis=0) + 2, dtype=bool)
    for right, up in ((0, 0), (0, 1), (1, 0), (1, 1)):
        needed[node[:, 0] + right, node[:, 1] + up] = True
    surface = np.zeros(needed.shape)
    surface[needed] = Triangles(xyz[vertices]).height(low + SURFACE_CELL_M * np.argwhere(needed))
    return np.asarray(xyz[:, 2] - ndimage.map_coordinates(surface, place.T, order=1, mode="nearest"), dtype=np.float64)


def _window_side(xyz: Float) -> float:
    """Side (m) of windows so that those pooled hold RETURNS_A_WINDOW returns of the lowest layers."""
    if len(xyz) == 0:
        return LARGEST_WINDOW_M
    _, counts = np.unique(square_numbers(xyz, 1.0), return_counts=True)
    side = math.sqrt(RETURNS_A_WINDOW / 4.0 / float(np.median(counts)))
    return min(max(side, SMALLEST_WINDOW_M), LARGEST_WINDOW_M)


def _pooled_layers(over: Float, planes: Planes, sigma: float, windows: _Windows) -> Layers:
    """The layers of windows, each with (half of) the windows around it; of more windows where returns are few."""
    counts = histograms(over, planes.key, planes.shape[0] * planes.shape[1]).reshape(*planes.shape, -1)
    asked = sigma, windows.threshold, windows.tolerance, windows.least_below
    layers = lowest_layers(planes.pooled(counts), *asked)
    for reach in range(2, WIDEST_POOL + 1):
        few = (layers.returns < FEWEST_RETURNS) & (layers.returns > 0)
        if not few.any():
            break
        width = 2 * reach + 1
        wider = ndimage.uniform_filter(counts, (width, width, 1), mode="constant") * width**2
        layers = layers.where(few, lowest_layers(wider[few], *asked))
    return layers


def _through(over: Float, planes: Planes, layers: Layers, threshold: float) -> Float:
    """(n,) height, at each return, of planes through the windows' ground returns."""
    ground, top = (values.ravel()[planes.key] for values in (layers.ground, layers.top))
    weight = ((over >= ground - threshold) & (over <= top)).astype(np.float64)
    height, along, across = planes.fit(over, weight, 0.0, 0.05)
    enough = planes.pooled(planes.sum(weight)) >= 3.0
    height = np.where(enough, height, np.nan_to_num(layers.ground))
    return planes.at_points(height, along, across)
