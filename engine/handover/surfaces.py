"""Heights of a ground raster at points, and as a triangle mesh of fewer points."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float
from ..grid.geotiff import Raster
from ..statistics.nearest_known import nearest_known


@dataclass(frozen=True)
class Mesh:
    """``points`` (n, 3) in metres and ``faces`` (m, 3), rows of them, counterclockwise seen from above.

    ``step_m`` is the distance of the points along the axes.
    """

    points: Float
    faces: NDArray[np.int64]
    step_m: float


def heights_at(surface: Raster, xy: Float) -> Float:
    """Heights (n,) at points (n, 2): of the cell that a point is in, of the nearest known where that is not known.

    At least one cell of the surface must be known.
    """
    grid = surface.grid
    columns = np.clip(np.floor((xy[:, 0] - grid.west) / grid.cell + 1e-6), 0, grid.columns - 1).astype(np.int64)
    rows = np.clip(np.floor((grid.north - xy[:, 1]) / grid.cell + 1e-6), 0, grid.rows - 1).astype(np.int64)
    near_row, near_column = nearest_known(np.isfinite(surface.array))
    return surface.array[near_row[rows, columns], near_column[rows, columns]].astype(np.float64)


def mesh(surface: Raster, most_points: int) -> Mesh:
    """Triangles between cells' middles, every so many cells that at most ``most_points`` remain.

    A point has the height of its cell as the raster has it. A square of four known corners is cut along the diagonal
    whose ends differ less in height; three known corners are one triangle; others are a hole.
    """
    grid, heights = surface.grid, surface.array.astype(np.float64)
    known = int(np.isfinite(heights).sum())
    step = max(1, math.ceil(math.sqrt(known / most_points))) if known else 1
    while np.isfinite(heights[step // 2 :: step, step // 2 :: step]).sum() > most_points:
        step += 1
    first = step // 2 if min(grid.shape) > step else 0
    z = heights[first::step, first::step]
    rows, columns = (np.arange(n) * step + first for n in z.shape)
    x, y = np.meshgrid(grid.west + (columns + 0.5) * grid.cell, grid.north - (rows + 0.5) * grid.cell)
    faces = _faces(z)
    used = np.unique(faces)
    number = np.full(z.size, -1)
    number[used] = np.arange(len(used))
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])[used]
    return Mesh(points, number[faces], step * grid.cell)


def _faces(z: Float) -> NDArray[np.int64]:
    """Triangles (m, 3) of the cells' flat numbers, row 0 in the north."""
    index = np.arange(z.size).reshape(z.shape)
    corners = [index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]]  # nw, sw, se, ne: counterclockwise
    nw, sw, se, ne = (c.ravel() for c in corners)
    flat = z.ravel()
    there = np.isfinite(flat)
    all_four = there[nw] & there[sw] & there[se] & there[ne]
    with np.errstate(invalid="ignore"):
        falling = np.abs(flat[nw] - flat[se]) <= np.abs(flat[sw] - flat[ne])
    cuts = [
        (all_four & falling, (nw, sw, se)), (all_four & falling, (nw, se, ne)),
        (all_four & ~falling, (nw, sw, ne)), (all_four & ~falling, (sw, se, ne)),
    ]  # fmt: skip
    for missing, triangle in ((nw, (sw, se, ne)), (sw, (nw, se, ne)), (se, (nw, sw, ne)), (ne, (nw, sw, se))):
        three = ~there[missing] & there[triangle[0]] & there[triangle[1]] & there[triangle[2]]
        cuts.append((three, triangle))
    return np.concatenate([np.column_stack([corner[where] for corner in triangle]) for where, triangle in cuts])
