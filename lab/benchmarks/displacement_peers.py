"""What change, M3C2, plain correlation and patch-wise ICP see of a motion along the surface."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from ...engine.change.difference import difference
from ...engine.core.arrays import Float, Index
from ...engine.displacement.facets import find_facets
from ...engine.displacement.frame import Frame
from ...engine.displacement.surface import NODE_M, gridded, kernel_of
from ...engine.m3c2.distances import Cylinder, m3c2_distances
from ...engine.m3c2.lattice import Lattice
from ...engine.m3c2.normals import fit_planes
from ...interface.parameters import ChangeParameters

_CYLINDER_RADIUS_M, _HALF_LENGTH_M, _NORMAL_RADIUS_M = 0.5, 1.0, 1.0
RADII_M, _LIMIT_M = (2.5, 4.0), 1.0  # of windows; of the motion that is looked for
_PLANE_POINTS, _ROUNDS = 24, 20
_POINTS_PER_M2, _STEP, _MIN_SEEN = 70.0, 3, 0.15  # of the ground; nodes to a cell; share of a window seen in both

Radius = Callable[[Float, Float], tuple[Float, Float]]


def seen_by_others(first: Float, later: Float, radius: Radius, core: float) -> dict[str, float]:
    """Median of each measure over the ellipse's core, metres."""
    change = difference(first, later, ChangeParameters(adaptive=False))
    rows, columns = np.nonzero(np.isfinite(change.dz))
    grid = change.grid
    xy = np.column_stack([grid.west + (columns + 0.5) * grid.cell, grid.north - (rows + 0.5) * grid.cell])
    _, places = find_facets(first).places(xy)
    inside = radius(places, first)[0] < core
    middle = first[radius(first, first)[0] < core]
    spread = middle[:: max(len(middle) // 200, 1)]
    return {
        "change of heights": float(np.median(change.dz[rows, columns][inside])),
        "M3C2": _m3c2(first, later, spread),
    } | {
        f"{name}, along the dip": float(np.nanmedian(motion[:, 0]))
        for name, motion in motion_by_others(first, later, spread[::10]).items()
    }


def motion_by_others(first: Float, later: Float, places: Float) -> dict[str, Float]:
    """(n, 2) motion along the dip and across it, metres, at ``places`` (n, 3), by each method and width of windows.

    NaN where plain correlation sees too little.
    """
    frame = find_facets(first).frames[0]
    found = {}
    for radius in RADII_M:
        found[f"plain correlation, {2 * radius:g} m"] = _correlations(first, later, frame, places, radius)
        found[f"patch-wise ICP, {2 * radius:g} m"] = _icps(first, later, frame, places, radius)[:, :2]
    return found


def _m3c2(first: Float, later: Float, core: Float) -> float:
    normal = fit_planes(Lattice(first, _NORMAL_RADIUS_M), core, 2 * _NORMAL_RADIUS_M).normal
    lattices = (Lattice(first, _CYLINDER_RADIUS_M), Lattice(later, _CYLINDER_RADIUS_M))
    found = m3c2_distances(lattices, core, normal, Cylinder(_CYLINDER_RADIUS_M, _HALF_LENGTH_M))
    return float(np.nanmedian(found.distance))


def _correlations(first: Float, later: Float, frame: Frame, places: Float, radius: float) -> Float:
    """(n, 2) shift of best normalised correlation of heights without their plane, in windows around ``places`` (n, 3),
    to parts of a cell by a parabola, along the axes of the plane, metres.
    """
    flat = frame.to_plane(places)[:, :2]
    reach = radius + _LIMIT_M + 1.0
    corner = flat.min(axis=0) - reach
    shape = tuple(int(n) for n in np.ceil((flat.max(axis=0) + reach - corner) / NODE_M) + 1)
    one, two = (
        gridded(frame.to_plane(xyz), corner, (shape[0], shape[1]), kernel_of(_POINTS_PER_M2)).values[
            0, ::_STEP, ::_STEP
        ]
        for xyz in (first, later)
    )
    cell = _STEP * NODE_M
    middles = np.rint((flat - corner) / cell).astype(np.int64)
    return np.array([cell * _best(one, two, middle, round(radius / cell)) for middle in middles])


def _best(one: Float, two: Float, middle: Index, half: int) -> Float:
    """(2,) cells by which ``two`` is shifted against ``one`` around a cell; NaN where too little is seen of both."""
    limit = round(_LIMIT_M / (_STEP * NODE_M))
    still = _without_plane(_part(one, middle, half))
    found = np.full((2 * limit + 1, 2 * limit + 1), -1.0)
    for shift in np.ndindex(*found.shape):
        moved = _without_plane(_part(two, middle + shift - limit, half))
        both = np.isfinite(still) & np.isfinite(moved)
        if both.mean() > _MIN_SEEN:
            found[shift] = np.corrcoef(still[both], moved[both])[0, 1]
    if found.max() <= -1.0:
        return np.full(2, np.nan)
    best = np.array(np.unravel_index(np.argmax(found), found.shape))
    parts = np.zeros(2)
    for axis in range(2):
        if 0 < best[axis] < 2 * limit:
            step = np.eye(2, dtype=np.int64)[axis]
            low, high = found[tuple(best - step)], found[tuple(best + step)]
            parts[axis] = 0.5 * (low - high) / (low + high - 2 * found[tuple(best)])
    return best - limit + parts


def _part(values: Float, middle: Index, half: int) -> Float:
    row, column = middle - half
    return values[row : row + 2 * half + 1, column : column + 2 * half + 1]


def _without_plane(values: Float) -> Float:
    rows, columns = np.indices(values.shape)
    known = np.isfinite(values)
    design = np.column_stack([np.ones(values.size), rows.ravel(), columns.ravel()])
    plane = np.linalg.lstsq(design[known.ravel()], values[known], rcond=None)[0]
    return values - (design @ plane).reshape(values.shape)


def _icps(first: Float, later: Float, frame: Frame, middles: Float, radius: float) -> Float:
    """(n, 3) motion of patches along the axes of the plane by point-to-plane ICP with Tukey's weights."""
    tree, patches = cKDTree(later), cKDTree(frame.to_plane(first)[:, :2])
    near = later[tree.query(later, k=_PLANE_POINTS)[1]]
    centres = near.mean(axis=1)
    off = near - centres[:, None]
    normals = np.linalg.eigh(np.einsum("nki,nkj->nij", off, off))[1][..., 0]
    found = []
    for middle in frame.to_plane(middles)[:, :2]:
        patch = first[patches.query_ball_point(middle, radius)]
        motion = np.zeros(3)
        for _ in range(_ROUNDS):
            nearest = tree.query(patch + motion)[1]
            normal = normals[nearest]
            residual = ((patch + motion - centres[nearest]) * normal).sum(axis=1)
            scale = max(1.4826 * float(np.median(np.abs(residual))), 1e-4)
            weight = np.where(np.abs(residual) < 5 * scale, (1 - (residual / (5 * scale)) ** 2) ** 2, 0.0)
            step = np.linalg.solve(normal.T @ (weight[:, None] * normal), normal.T @ (weight * residual))
            motion = motion - step
            if np.abs(step).max() < 1e-4:
                break
        found.append(frame.axes @ motion)
    return np.array(found)
