"""What change, M3C2, plain correlation and patch-wise ICP see of a motion along the surface."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from ..engine.change.difference import difference
from ..engine.core.arrays import Float
from ..engine.displacement.facets import find_facets
from ..engine.displacement.frame import Frame
from ..engine.displacement.start import NODES, best_shifts, relief
from ..engine.displacement.surface import NODE_M, gridded, kernel_of
from ..engine.m3c2.distances import Cylinder, m3c2_distances
from ..engine.m3c2.lattice import Lattice
from ..engine.m3c2.normals import fit_planes
from ..interface.parameters import ChangeParameters

_CYLINDER_RADIUS_M, _HALF_LENGTH_M, _NORMAL_RADIUS_M = 0.5, 1.0, 1.0
_WINDOW_RADIUS_M, _LIMIT_M = 2.5, 1.0
_PLANE_POINTS, _ROUNDS = 24, 20

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
        "plain correlation, along the dip": _correlation(first, later, frame, spread),
        "patch-wise ICP, along the dip": _icp(first, later, frame, spread[::10]),
    }


def _m3c2(first: Float, later: Float, core: Float) -> float:
    normal = fit_planes(Lattice(first, _NORMAL_RADIUS_M), core, 2 * _NORMAL_RADIUS_M).normal
    lattices = (Lattice(first, _CYLINDER_RADIUS_M), Lattice(later, _CYLINDER_RADIUS_M))
    found = m3c2_distances(lattices, core, normal, Cylinder(_CYLINDER_RADIUS_M, _HALF_LENGTH_M))
    return float(np.nanmedian(found.distance))


def _correlation(first: Float, later: Float, frame: Frame, core: Float) -> float:
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
    return float(np.median(shifts[:, 0]))


def _icp(first: Float, later: Float, frame: Frame, middles: Float) -> float:
    """Median motion of patches by point-to-plane ICP with Tukey's weights, three unknowns."""
    tree = cKDTree(later)
    found = []
    for middle in middles:
        patch = first[np.hypot(*(frame.to_plane(first) - frame.to_plane(middle[None]))[:, :2].T) < _WINDOW_RADIUS_M]
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
        found.append(frame.axes[0] @ motion)
    return float(np.median(found))
