"""The ground under plants: a surface from below, and which returns about it are ground.

1. Candidates, the lowest supported returns of cells, are densified from seeds near the cloth (``densification``).
2. Planes on square windows follow the triangulated surface: in each window the lowest layer (``lowest_layer``) says
   which returns are ground, a plane is laid through them, and heights are taken over it; twice, then the layers again.
3. A window whose lowest layer is as narrow as bare ground, and shaped like it, is bare: all returns within the
   threshold of their mean are ground. Elsewhere plants stand in the layer, and returns up to ``Layers.top`` are ground.
4. Where returns are dense, smaller windows look for bare ground that bends within a larger one (edges of berms, cones).

Nothing is ground because it is dense. Windows are as large as the density of returns demands. The constants were
measured on real and simulated clouds, see lab/benchmarks/real_ground.py and docs/ground.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..core.arrays import Bool, Float, Index
from ..geometry.columns import greatest, least
from ..geometry.numbered import counts_of_each
from ..geometry.plane_cells import Planes
from ..geometry.square_tiles import in_tiles
from .bare_scatter import bare_scatter
from .closer_look import looked_closer
from .lowest_layer import (
    HIGHEST_M,
    LOWEST_M,
    MIN_BELOW_SHARE,
    Layers,
    counts_around,
    histograms,
    lowest_layers,
    separate_layers,
)
from .narrow_windows import narrow_windows
from .relief import SINGLE_DISTANCE_M
from .sheet_edges import to_edges
from .squares import lowest_corner, square_numbers
from .surface_heights import Whole, surface_heights

WINDOW_RETURNS, MIN_WINDOW_RETURNS = 150.0, 60.0
"""Returns that a window is made for, and below which the windows around it help."""
MIN_WINDOW_M, MAX_WINDOW_M = 0.5, 1.5
"""Half of the width over which returns are pooled."""
MAX_POOL_WINDOWS = 3
"""Windows on each side that help at most."""
ROUNDS = 2
BARE_SCATTER_M, ROUGHNESS = 0.022, 0.016
"""Scatter of returns about bare ground in windows of a metre, and what the ground's relief adds for each metre more."""
PLANT_SCATTER = 0.73
"""Scatter of the ground under plants, as a share of the largest that bare ground may have."""
MAX_CLOSER_WINDOW_M = 0.8
"""Windows at most this large hold enough returns to be divided."""
MAX_SEPARATE_WINDOW_M = 1.2
"""In larger windows relief and forest floor fill the gap between rough ground and what grows on it."""
DENSE_TOLERANCE_M, SPARSE_TOLERANCE_M = 0.0025, 0.012
"""Height over the ground of the mean of what is taken under plants: where returns are few, each counts."""
SPARSE_THRESHOLD_M = 0.1
"""Least threshold where returns are few and triangles as wide as relief."""
TRIANGLE_REACH = 1.5
"""Where returns are few: thresholds from the windows' ground up to which the triangles decide."""
MAX_HEIGHT_STRETCH = 1.55
"""Of heights on steep ground: beyond 50 degrees the triangles say little about its inclination."""
MIN_THRESHOLD_SCATTERS = 2.5
"""The threshold is at least so many times the scatter."""
PLANT_ERROR_M, ENOUGH_GROUND = 0.012, 110.0
"""Error of the ground under plants in windows of a metre with many ground returns, and the number of them below which
it grows: fitted to real forests and to simulated grass, ferns and forest, so that about 5 % of the cells lie beyond
1.96 errors, see docs/ground.md."""
MIN_CLEARLY_BARE_SHARE = 0.5
"""Share of the lower returns that is ground, from which bare ground has no error by plants."""
MAX_PLANT_ERROR_M = 0.25
"""Where plants make a larger error, no ground is known."""
MAX_DISTANCE_CELLS = 4.0
"""Cells from the nearest known ground up to which a return's height over it is known."""
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
class Windows:
    """Side of the windows, largest scatter of bare ground in them and threshold, metres.

    ``wider`` is how much more returns scatter there than in small windows; ``least_below`` see ``lowest_layers``;
    ``single``: windows are far wider than relief, and only the triangles decide.
    """

    side: float
    scatter: float
    threshold: float
    wider: float
    least_below: float
    single: bool = False

    @property
    def tolerance(self) -> float:
        """Height (m) over the ground that the mean of what is taken may have."""
        return DENSE_TOLERANCE_M if self.side <= MAX_CLOSER_WINDOW_M else SPARSE_TOLERANCE_M


def layered_ground(
    xyz: Float, anchored: Bool, taken: Bool, threshold: float, whole: Whole | None = None
) -> LayeredGround:
    """Ground among points (n, 3) in a frame in which the slope lies flat.

    Args:
        anchored: (n,) points near the settled cloth.
        taken: (n,) points that may be ground.
        threshold: least distance (m) from the surface within which a point of bare ground is ground.
        whole: what is decided for the cloud of which these points are a part.
    """
    if not taken.any():
        return _nothing(len(xyz), BARE_SCATTER_M, threshold)
    surface = surface_heights(xyz, anchored, taken, whole)
    height = surface.height
    index = np.flatnonzero(of_lowest_layers(height, surface.left))
    side = window_side(returns_by_square(xyz[index]))
    level = xyz[index, 2] - np.median(xyz[:, 2])
    low = np.column_stack([xyz[index, :2] - least(xyz[:, :2]), height[index], level])
    bare_ground = BARE_SCATTER_M
    if len(index) and side <= MAX_CLOSER_WINDOW_M:
        bare_ground = bare_scatter(low[:, [0, 1, 3, 2]], side) or BARE_SCATTER_M
    windows = windows_for(side, bare_ground, threshold, surface.strays, single=surface.single)
    if not len(index):
        return _nothing(len(xyz), windows.scatter, windows.threshold)
    return _ground_of(xyz, height, index, low, windows)


def layered_part(xyz: Float, height: Float, left: Bool, windows: Windows, origin: Float) -> LayeredGround:
    """The same as ``layered_ground`` for a part of a cloud (n, 3), of which everything else is known.

    Args:
        height, left: (n,) as ``surface_heights`` gave them.
        windows: as for the whole cloud.
        origin: (2,) where the windows of the whole cloud begin, m; no point lies before it.
    """
    index = np.flatnonzero(of_lowest_layers(height, left))
    if not len(index):
        return _nothing(len(xyz), windows.scatter, windows.threshold)
    side = windows.side
    corner = origin + side * np.floor((least(xyz[:, :2]) - origin) / side)
    places = np.column_stack([xyz[:, :2] - corner, xyz[:, 2]])
    low = np.column_stack([places[index, :2], height[index], xyz[index, 2]])
    return _ground_of(places, height, index, low, windows, corner=np.zeros(2))


def of_lowest_layers(height: Float, left: Bool) -> Bool:
    """(n,) returns so near the triangles that they take part in the windows; arrays as of ``surface_heights``."""
    return left & (height > LOWEST_M) & (height < HIGHEST_M)


def windows_for(side: float, bare_ground: float, threshold: float, strays: float, *, single: bool = False) -> Windows:
    """The windows of a cloud, of ``side`` m, whose bare ground scatters by ``bare_ground`` m.

    Args:
        threshold: least distance (m) from the surface within which a point of bare ground is ground.
        strays: share of stray returns that were left out.
        single: see ``surface_heights.Whole``.
    """
    scatter = math.hypot(bare_ground, ROUGHNESS * max(2.0 * side - 1.0, 0.0))
    least = SPARSE_THRESHOLD_M if side > MAX_CLOSER_WINDOW_M else 0.0
    threshold = max(threshold, MIN_THRESHOLD_SCATTERS * scatter, SINGLE_DISTANCE_M if single else least)
    return Windows(side, scatter, threshold, scatter / bare_ground, MIN_BELOW_SHARE + STRAYS_LEFT * strays, single)


def _ground_of(
    xyz: Float, height: Float, index: Index, low: Float, windows: Windows, corner: Float | None = None
) -> LayeredGround:
    """The ground among points (n, 3), of which those at ``index`` take part as ``low`` (m, 4)."""
    judged = in_tiles(low, partial(_judged, windows=windows), TILE_M, MARGIN_M, windows.side)
    ground, bare = (np.zeros(len(xyz), dtype=bool) for _ in range(2))
    ground[index], bare[index] = judged["ground"], judged["bare"]
    known = np.column_stack([height[index] - judged["height"], judged["plant_error"], judged["plant_height"]])
    offset, error, plants = _everywhere(xyz, index, known, windows.side, corner).T
    over = height - offset
    over[index] = judged["height"]
    return LayeredGround(over, ground, bare, error, plants, windows.scatter, windows.threshold)


def _nothing(count: int, scatter: float, threshold: float) -> LayeredGround:
    nowhere, none = np.full(count, np.nan), np.zeros(count, dtype=bool)
    return LayeredGround(nowhere, none, none, nowhere, nowhere, scatter, threshold)


def _everywhere(xyz: Float, index: Index, known: Float, side: float, corner: Float | None = None) -> Float:
    """(n, k) values at all points from those ``known`` (m, k) at ``index``: mean of the cell, else of the nearest."""
    cells = np.floor((xyz[:, :2] - lowest_corner(xyz, corner)) / side).astype(np.int64)
    shape = tuple(int(n) + 1 for n in greatest(cells))
    key = cells[:, 0] * shape[1] + cells[:, 1]
    finite = np.isfinite(known).all(axis=1)
    place, values = key[index[finite]], known[finite]
    number = np.bincount(place, minlength=shape[0] * shape[1])
    with np.errstate(invalid="ignore"):
        means = np.column_stack([np.bincount(place, column, len(number)) / number for column in values.T])
    distance, (rows, columns) = ndimage.distance_transform_edt((number == 0).reshape(shape), return_indices=True)
    nearest = (rows * shape[1] + columns).ravel()
    found = means[nearest[key]]
    found[distance.ravel()[key] > MAX_DISTANCE_CELLS] = np.nan
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


_JUDGED = np.dtype([("height", "f8"), ("ground", "?"), ("bare", "?"), ("plant_error", "f8"), ("plant_height", "f8")])
"""What becomes of a return: metres over the ground, and of the plants there."""


def _judged(points: Float, windows: Windows) -> NDArray[np.void]:
    """(n,) ``_JUDGED`` of points (n, 4): x, y, the height over the triangles and that in the frame."""
    low = np.floor(least(points[:, :2]) / windows.side) * windows.side
    planes = Planes((points[:, :2] - low) / windows.side)
    stretch = _stretch(points[:, 3] - points[:, 2], planes, windows.side)
    over, sigma = points[:, 2] / stretch, PLANT_SCATTER * windows.scatter
    for _ in range(ROUNDS):
        layers = _pooled_layers(over, planes, sigma, windows)
        over = over - _through(over, planes, layers, windows.threshold)
    layers = _pooled_layers(over, planes, sigma, windows)
    rough = np.zeros(planes.shape, dtype=bool)
    if MAX_CLOSER_WINDOW_M < windows.side <= MAX_SEPARATE_WINDOW_M:
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
        top = np.where(stony, np.maximum(MIN_THRESHOLD_SCATTERS * each(spread), windows.threshold), top)
    sure = narrow & (layers.taken >= MIN_CLEARLY_BARE_SHARE * layers.returns)
    error = each(np.where(sure, 0.0, plant_error(layers, windows.wider)))
    if windows.side <= MAX_CLOSER_WINDOW_M:
        places = points[:, :2] - low
        height, found = looked_closer(height, bare, places, windows.side, windows.scatter, windows.threshold)
        bare, top = bare | found, np.where(found, windows.threshold, top)
        error = np.where(found, 0.0, error)
    ground = (height >= -windows.threshold) & (height <= top)
    if windows.side > MAX_CLOSER_WINDOW_M:
        # planes of such windows are wider than relief; the triangles follow it
        about = np.abs(height) <= TRIANGLE_REACH * windows.threshold
        ground = (np.abs(points[:, 2]) <= windows.threshold) & (about | ~np.isfinite(height))
    ground &= ~(error > MAX_PLANT_ERROR_M)
    unknown = ~np.isfinite(height) | (error > MAX_PLANT_ERROR_M)
    height[unknown], error[unknown] = np.nan, np.nan
    if windows.single:
        # all so near the triangles are taken, alike whether they are ground or plants
        ground = np.abs(points[:, 2]) <= windows.threshold
        height[ground], error[ground] = (points[:, 2] / stretch)[ground], windows.threshold / math.sqrt(3.0)
    else:
        over, found = to_edges(
            points[:, 3], ground, points[:, :2] - low, windows.side, (windows.scatter, windows.threshold)
        )
        ground, bare = ground | found, bare | found
        height, error = np.where(found, over / stretch, height), np.where(found, 0.0, error)
    judged = np.empty(len(points), dtype=_JUDGED)
    judged["height"], judged["ground"], judged["bare"] = height * stretch, ground, bare
    judged["plant_error"], judged["plant_height"] = error, np.maximum(each(layers.median), 0.0)
    return judged


def _stretch(surface: Float, planes: Planes, side: float) -> Float:
    """(n,) heights over a surface, at the points (n,) of which it has the heights given, a metre square to it.

    Noise that is as large everywhere seems larger where ground is inclined in the frame, as a road below a slope is.
    """
    _, along, across = planes.fit(surface, np.ones(len(surface)), 0.0, 1e-6)
    stretch = np.minimum(np.sqrt(1.0 + (along**2 + across**2) / side**2), MAX_HEIGHT_STRETCH)
    return np.asarray(stretch.ravel()[planes.key], dtype=np.float64)


def returns_by_square(xyz: Float) -> Index:
    """Numbers of points (n, 2+), m, in the squares of a metre that hold any."""
    if len(xyz) == 0:
        return np.zeros(0, dtype=np.int64)
    return counts_of_each(square_numbers(xyz, 1.0))


def window_side(counts: Index) -> float:
    """Side (m) of windows so that those pooled hold WINDOW_RETURNS returns of the lowest layers.

    Args:
        counts: returns of these in squares of a metre, see ``returns_by_square``.
    """
    if len(counts) == 0:
        return MAX_WINDOW_M
    side = math.sqrt(WINDOW_RETURNS / 4.0 / float(np.median(counts)))
    return min(max(side, MIN_WINDOW_M), MAX_WINDOW_M)


def _pooled_layers(over: Float, planes: Planes, sigma: float, windows: Windows) -> Layers:
    """The layers of windows, each with (half of) the windows around it; of more windows where returns are few."""
    counts = histograms(over, planes.key, planes.shape[0] * planes.shape[1]).reshape(*planes.shape, -1)
    asked = sigma, windows.threshold, windows.tolerance, windows.least_below
    layers = lowest_layers(planes.pooled(counts), *asked)
    for reach in range(2, MAX_POOL_WINDOWS + 1):
        few = (layers.returns < MIN_WINDOW_RETURNS) & (layers.returns > 0)
        if not few.any():
            break
        row, column = np.nonzero(few)
        layers = layers.where(few, lowest_layers(counts_around(counts, row, column, reach), *asked))
    return layers


def _through(over: Float, planes: Planes, layers: Layers, threshold: float) -> Float:
    """(n,) height, at each return, of planes through the windows' ground returns."""
    ground, top = (values.ravel()[planes.key] for values in (layers.ground, layers.top))
    weight = ((over >= ground - threshold) & (over <= top)).astype(np.float64)
    height, along, across = planes.fit(over, weight, 0.0, 0.05)
    enough = planes.pooled(planes.sum(weight)) >= 3.0
    height = np.where(enough, height, np.nan_to_num(layers.ground))
    return planes.at_points(height, along, across)
