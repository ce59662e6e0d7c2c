"""Bare ground followed to its edges, as of a slab, a berm or a scarp.

The surface that ground is measured from passes through the lowest returns of cells, so it leaves an upper sheet before
its edge: a slab of 4 m lost a third of its volume. Planes of bare cells are continued into the cells around them.
Returns there that lie on such a plane are ground if the sheet is bare, and if it ends at an edge: lower returns lie
beyond it. Under the top of a hedge they lie among its returns. Where such edges are, ground then grows from return to
return on both sides, as cells hold returns of both sheets.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from ..core.arrays import Bool, Float, Index
from ..geometry.plane_cells import Planes

WIDTH_M = 0.75
"""Width over which the surface leaves an edge: a cell of candidates and one of its grid. Cells are about as wide."""
REACH_M = 2.0 * WIDTH_M
"""How far sheets are continued."""
BARE_SHARE = 0.9
"""Share of a cell's returns that are ground where it is bare, and of those not below a sheet that lie on it."""
MIN_STEP_THRESHOLDS = 2.0
"""Times the largest distance of ground from its surface: what lies deeper is below a sheet."""
MIN_RETURNS = 3
POOLED_CELLS, MIN_APART = 5, 0.2
"""Mean distance of lower returns beyond the mean of those on a sheet, in cells, over so many cells a side. Beyond a
straight edge it is 0.5, of returns among those on the sheet 0."""
NEIGHBOURS = 5
"""Nearest ground returns on whose plane a further one must lie: two more than a plane needs."""
_LEVEL_PULL = 0.01
_AROUND = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)])


@dataclass(frozen=True)
class _Continued:
    """Of returns ``index`` (m,): height over the plane continued into their cell, and the way from there (m, 2)."""

    index: Index
    over: Float
    way: Float


def to_edges(
    height: Float, ground: Bool, places: Float, side: float, limits: tuple[float, float]
) -> tuple[Float, Bool]:
    """Heights (n,) over sheets of bare ground, and which returns lie on these up to their edges.

    Args:
        height: (n,) of the returns near the ground, in the slope's frame, m.
        ground: (n,) which are known to be ground.
        places: (n, 2) m, the windows' corners at whole multiples of ``side``.
        limits: largest scatter of bare ground, and largest distance of ground from its surface, m.
    """
    parts = max(round(side / WIDTH_M), 1)
    cells, known = Planes(places * (parts / side)), ground
    over, seen = np.full(len(height), np.inf), np.zeros((4, *cells.shape))
    for _ in range(math.ceil(REACH_M * parts / side)):
        found = _continued(height, known, cells, limits)
        on = np.abs(found.over) <= limits[1]
        sums = _counted(found, on, ~on & ~known[found.index], cells, limits[1])
        passed = (sums[0] >= MIN_RETURNS) & (sums[0] >= BARE_SHARE * (sums[0] + sums[1]))
        seen += sums * passed
        new = found.index[on & passed.ravel()[cells.key[found.index]] & ~known[found.index]]
        if not len(new):
            break
        over[found.index] = np.where(on, found.over, over[found.index])
        known = known.copy()
        known[new] = True
    ends = _ends(seen)
    joined = known & ~ground & ends.ravel()[cells.key]
    about = ends | ndimage.binary_dilation(cells.sum(joined.astype(np.float64)) > 0, np.ones((3, 3)))
    known = ground | joined
    left = np.flatnonzero(about.ravel()[cells.key] & ~known)
    base = np.flatnonzero(ndimage.binary_dilation(about, np.ones((3, 3))).ravel()[cells.key] & known)
    points = np.column_stack([places, height])
    over[left] = _grown(points[left], points[base], side / parts / 2.0, limits)
    joined[left] = np.isfinite(over[left])
    return np.where(joined, over, np.inf), joined


def _grown(points: Float, ground: Float, reach: float, limits: tuple[float, float]) -> Float:
    """Heights (n,) over the ground (m, 3) of those ``points`` (n, 3) that join it, infinite of the others.

    A point joins if its ``NEIGHBOURS`` nearest ones of the ground are within ``reach``, m, scatter about one plane as
    bare ground does, and if it is near that plane (``limits`` as of ``to_edges``). It is ground for the next ones.
    """
    over = np.full(len(points), np.inf)
    while len(ground) >= NEIGHBOURS and np.isinf(over).any():
        others = np.flatnonzero(np.isinf(over))
        distance, index = cKDTree(ground).query(points[others], NEIGHBOURS, distance_upper_bound=reach)
        others, index = others[np.isfinite(distance[:, -1])], index[np.isfinite(distance[:, -1])]
        middle = ground[index].mean(axis=1)
        off, way = ground[index] - middle[:, None], points[others] - middle
        tilt = np.linalg.pinv(off[..., :2]) @ off[..., 2:]
        above = way[:, 2] - (way[:, None, :2] @ tilt)[:, 0, 0]
        scatter = np.linalg.norm(off[..., 2] - (off[..., :2] @ tilt)[..., 0], axis=1) / math.sqrt(NEIGHBOURS - 3)
        fits = (np.abs(above) <= limits[1]) & (scatter <= limits[0])
        if not fits.any():
            break
        over[others[fits]] = above[fits]
        ground = np.concatenate([ground, points[others[fits]]])
    return over


def _continued(height: Float, ground: Bool, cells: Planes, limits: tuple[float, float]) -> _Continued:
    """Of each cell that is not bare the plane of that bare one beside it on which most of its further returns lie."""
    every, own = cells.sum(np.ones(len(height))), cells.sum(ground.astype(np.float64))
    bare = (own >= MIN_RETURNS) & (own >= BARE_SHARE * every)
    taken = ground & bare.ravel()[cells.key]
    planes = cells.fit(np.where(taken, height, 0.0), taken.astype(np.float64), 0.0, _LEVEL_PULL)
    off = np.where(taken, height - cells.at_points(*planes), 0.0)
    sound = np.pad(bare & (cells.sum(off**2) <= own * limits[0] ** 2), 1)
    beside = ndimage.binary_dilation(sound, np.ones((3, 3)))[1:-1, 1:-1] & ~bare
    index = np.flatnonzero(beside.ravel()[cells.key])
    row, column = np.divmod(cells.key[index], cells.shape[1])
    middle, along, across = (np.pad(np.nan_to_num(values), 1) for values in planes)
    best, most = np.full(len(index), np.inf), np.zeros(cells.shape)
    way = np.zeros((len(index), 2))
    for i, j in _AROUND:
        at = row + 1 + i, column + 1 + j
        over = height[index] - (middle[at] + along[at] * (cells.x[index] - i) + across[at] * (cells.y[index] - j))
        over[~sound[at]] = np.inf
        further = np.zeros(len(height))
        further[index] = (np.abs(over) <= limits[1]) & ~ground[index]
        number = cells.sum(further)
        better = (number > most).ravel()[cells.key[index]]
        best[better], way[better] = over[better], (-i, -j)
        most = np.maximum(number, most)
    kept = np.isfinite(best)
    return _Continued(index[kept], best[kept], way[kept])


def _counted(found: _Continued, on: Bool, off: Bool, cells: Planes, threshold: float) -> NDArray[np.float64]:
    """(4, rows, columns): numbers of returns ``on`` the plane, ``off`` but not below it, and below it; and how far the
    latter lie beyond the mean of those on it, as a sum, in cells. The direction is that from the cell of the plane.
    """
    way = found.way / np.maximum(np.hypot(*found.way.T), 1e-9)[:, None]
    away = way[:, 0] * cells.x[found.index] + way[:, 1] * cells.y[found.index]
    size, key = cells.shape[0] * cells.shape[1], cells.key[found.index]
    number = np.bincount(key[on], minlength=size)
    beyond = away - (np.bincount(key[on], away[on], size) / np.maximum(number, 1))[key]
    below = found.over < -MIN_STEP_THRESHOLDS * threshold
    near, lower = (np.bincount(key[which], minlength=size) for which in (off & ~below, below))
    sums = number, near, lower, np.bincount(key[below], beyond[below], size)
    return np.reshape(sums, (4, *cells.shape)).astype(np.float64)


def _ends(seen: NDArray[np.float64]) -> Bool:
    """(rows, columns) cells around which lower returns lie beyond the sheet, not among it; see ``_counted``."""
    _, _, below, farther = ndimage.convolve(seen, np.ones((1, POOLED_CELLS, POOLED_CELLS)), mode="constant")
    return np.asarray((below > 0.5) & (farther >= MIN_APART * below), dtype=np.bool_)
