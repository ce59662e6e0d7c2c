"""What change, M3C2, plain correlation and patch-wise ICP see of a motion along the surface."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from ..engine.change.difference import difference
from ..engine.core.arrays import Float
from ..engine.displacement.facets import Frame, find_facets
from ..engine.displacement.start import NODES, best_shifts, relief
from ..engine.displacement.surface import NODE_M, gridded, kernel_of
from ..engine.m3c2.distances import Cylinder, m3c2_distances
from ..engine.m3c2.lattice import Lattice
from ..engine.m3c2.normals import fit_planes
from ..interface.parameters import ChangeParameters

_CYLINDER_RADIUS_M, _HALF_LENGTH_M, _NORMAL_RADIUS_M = 0.5, 1.0, 1.0
_WINDOW_RADIUS_M, _LIMIT_M = 2.5, 1.0
_PLANE_POINTS, _ROUNDS = 24, 20
_EDGE_M, _APART_M = 3.0, 6.0  # of windows from the edge of the surveys, and from each other

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
    frame = find_facets(first).frames[0]
    return {
        "change of heights": float(np.median(change.dz[rows, columns][inside])),
        "M3C2": _m3c2(first, later, spread),
        "plain correlation, along the dip": float(np.median(_correlations(first, later, frame, spread)[:, 0])),
        "patch-wise ICP, along the dip": float(np.median(_icps(first, later, frame, spread[::10])[:, 0])),
    }


def still_by_others(first: Float, later: Float) -> dict[str, list[list[float]]]:
    """Errors across and along the dip (m) of plain correlation and patch-wise ICP in windows of 5 m, nothing moved."""
    frame = find_facets(first).frames[0]
    flat = frame.to_plane(first)
    inner = (flat[:, :2] > flat[:, :2].min(axis=0) + _EDGE_M) & (flat[:, :2] < flat[:, :2].max(axis=0) - _EDGE_M)
    square = np.floor(flat[:, :2] / _APART_M).astype(np.int64)
    _, one_each = np.unique(square[inner.all(axis=1)], axis=0, return_index=True)
    places = first[inner.all(axis=1)][one_each]
    return {
        "plain correlation": _correlations(first, later, frame, places)[:, ::-1].tolist(),
        "patch-wise ICP": _icps(first, later, frame, places)[:, 1::-1].tolist(),
    }


def _m3c2(first: Float, later: Float, core: Float) -> float:
    normal = fit_planes(Lattice(first, _NORMAL_RADIUS_M), core, 2 * _NORMAL_RADIUS_M).normal
    lattices = (Lattice(first, _CYLINDER_RADIUS_M), Lattice(later, _CYLINDER_RADIUS_M))
    found = m3c2_distances(lattices, core, normal, Cylinder(_CYLINDER_RADIUS_M, _HALF_LENGTH_M))
    return float(np.nanmedian(found.distance))


def _correlations(first: Float, later: Float, frame: Frame, core: Float) -> Float:
    """(n, 2) motion of best correlation along the axes of the plane, metres."""
    flat = frame.to_plane(core)[:, :2]
    reach = _WINDOW_RADIUS_M + _LIMIT_M + 1.0
    corner = flat.min(axis=0) - reach
    shape = tuple(int(n) for n in np.ceil((flat.max(axis=0) + reach - corner) / NODE_M) + 1)
    kernel = kernel_of(70.0)
    one, two = (
        relief(gridded(frame.to_plane(xyz), corner, (shape[0], shape[1]), kernel).values) for xyz in (first, later)
    )
    middles = np.rint((flat - corner) / NODE_M).astype(np.int64) // NODES
    shifts, _ = best_shifts(one, two, middles, _WINDOW_RADIUS_M, _LIMIT_M)
    return shifts


def _icps(first: Float, later: Float, frame: Frame, middles: Float) -> Float:
    """(n, 3) motion of patches along the axes of the plane by point-to-plane ICP with Tukey's weights."""
    tree, flat = cKDTree(later), frame.to_plane(first)
    found = []
    for middle in middles:
        patch = first[np.hypot(*(flat - frame.to_plane(middle[None]))[:, :2].T) < _WINDOW_RADIUS_M]
        motion = np.zeros(3)
        for _ in range(_ROUNDS):
            near = later[tree.query(patch + motion, k=_PLANE_POINTS)[1]]
            centre = near.mean(axis=1)
            normal = np.linalg.eigh(np.einsum("nki,nkj->nij", near - centre[:, None], near - centre[:, None]))[1][
                ..., 0
            ]
            residual = ((patch + motion - centre) * normal).sum(axis=1)
            scale = max(1.4826 * float(np.median(np.abs(residual))), 1e-4)
            weight = np.where(np.abs(residual) < 5 * scale, (1 - (residual / (5 * scale)) ** 2) ** 2, 0.0)
            step = np.linalg.solve(normal.T @ (weight[:, None] * normal), normal.T @ (weight * residual))
            motion = motion - step
            if np.abs(step).max() < 1e-4:
                break
        found.append(frame.axes @ motion)
    return np.array(found)
