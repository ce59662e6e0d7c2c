"""A quick surface under a raw cloud, through the lowest returns of squares: to look at, not to measure with.

Each square of about a metre gives its lowest return. Planes are fitted through the squares around, again and again with
less weight for what lies above them (Kraus and Pfeifer 1998, doi:10.1016/S0924-2716(98)00009-4), so that squares whose
lowest return is a plant do not raise the surface as long as some around saw the ground.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ..core.arrays import Bool, Float
from ..geometry.plane_gradient import gradient_parts
from ..grid.grid import Grid, cell_index

SQUARE_SIDE_M = 1.0
"""Side of a square, at least."""
SQUARE_SPACINGS = 3.0
"""... and in spacings of the points."""
GROUND_WITHIN_M = 0.2
"""Distance from the surface up to which a return counts as ground."""
_SCALES_M = (3.0, 1.5, 0.75, 0.4, 0.2, 0.1, 0.1)  # heights over the plane at which the weight is a half, one fit each
_STRAY_DEPTH_M = 1.5  # a low return this far below all around it is none of the ground
_RADII = (1, 2, 4, 8, 16)  # squares around one that its plane is fitted to, as many as it takes
_FIT_RADIUS = 2
_MIN_OWN_WEIGHT = 0.5  # from which a square's own lowest return is ground
_MIN_WEIGHT, _MIN_SPREAD = 4.0, 0.15  # that fix a plane: squares' weight, and variance of their places over side²


@dataclass(frozen=True)
class QuickSurface:
    """Heights (rows, columns) over a base in the middles of squares of ``side`` metres, which are joined bilinearly.

    ``west`` and ``north`` are the edges of the first square, m.
    """

    west: float
    north: float
    side: float
    height: Float

    def at(self, xy: Float) -> Float:
        """Heights (n,) over the base at places (n, 2+), m; beyond the outer middles as steep as up to there."""
        across, down = (xy[:, 0] - self.west) / self.side - 0.5, (self.north - xy[:, 1]) / self.side - 0.5
        rows, columns = self.height.shape
        row = np.clip(np.floor(down).astype(np.int64), 0, max(rows - 2, 0))
        column = np.clip(np.floor(across).astype(np.int64), 0, max(columns - 2, 0))
        lower, right = np.minimum(row + 1, rows - 1), np.minimum(column + 1, columns - 1)
        x, y = across - column, down - row
        z = self.height
        upper_line = z[row, column] * (1 - x) + z[row, right] * x
        return np.asarray(upper_line * (1 - y) + (z[lower, column] * (1 - x) + z[lower, right] * x) * y)


class LowestReturns:
    """The lowest return of each square of some metres over a grid, from a cloud that is added part by part."""

    def __init__(self, grid: Grid, base: float, spacing: float) -> None:
        """``spacing``: of the cloud's points, m; sparse clouds get larger squares. Heights count from ``base``."""
        side = max(SQUARE_SIDE_M, SQUARE_SPACINGS * spacing)
        south = grid.bounds[1]
        rows, columns = (math.ceil(n * grid.cell / side) for n in grid.shape)
        self.squares = Grid(grid.west, south + rows * side, side, rows, columns)
        self.base = base
        # east, north and height; place of the square's middle where there is none
        self.found = np.zeros((3, rows, columns))
        self.found[2] = np.inf

    def add(self, xyz: Float) -> None:
        """Add points (n, 3)."""
        place = cell_index(xyz, self.squares)
        inside = place >= 0
        place, xyz = place[inside], xyz[inside]
        flat = self.found.reshape(3, -1)
        z = xyz[:, 2] - self.base
        np.minimum.at(flat[2], place, z)
        lowest = z == flat[2][place]
        place, xyz = place[lowest], xyz[lowest]
        row, column = np.divmod(place, self.squares.columns)
        side = self.squares.cell
        # of squares that occur several times the last value stays
        flat[0][place] = xyz[:, 0] - self.squares.west - (column + 0.5) * side
        flat[1][place] = xyz[:, 1] - self.squares.north + (row + 0.5) * side

    def of_squares(self) -> Float:
        """(3, rows, columns): place of each, m east and north of its square's middle, and height; NaN without one."""
        lows = self.found.copy()
        lows[2][np.isinf(lows[2])] = np.nan
        return lows


def quick_surface(lowest: LowestReturns, *, plants: bool = True) -> QuickSurface:
    """The surface through the lowest returns; there is one at least.

    Args:
        plants: whether some are plants, which get less weight.
    """
    lows, side = lowest.of_squares(), lowest.squares.cell
    known = np.isfinite(lows[2])
    kept = known & ~_stray(lows, known.astype(np.float64), side)
    weight = kept.astype(np.float64)
    for scale in _SCALES_M if plants else ():
        over = _over(lows, _planes(lows, weight, side, _FIT_RADIUS), side)
        weight = kept / (1.0 + (over / scale) ** 2)
    planes = np.full((3, *known.shape), np.nan)
    for radius in _RADII:
        found, missing = _planes(lows, weight, side, radius), np.isnan(planes[0])
        planes[:, missing] = found[:, missing]
    height, (east, north) = planes[0], np.nan_to_num(planes[1:])
    # what lies on the ground is taken as it is, so that the surface bends where the ground does
    own = (weight > _MIN_OWN_WEIGHT) | (known & np.isnan(height))
    height[own] = (lows[2] - east * lows[0] - north * lows[1])[own]
    return QuickSurface(lowest.squares.west, lowest.squares.north, side, _nearest(height))


def _nearest(heights: Float) -> Float:
    """Heights whose gaps hold that of the nearest square that has one."""
    missing = np.isnan(heights)
    if not missing.any():
        return heights
    place = ndimage.distance_transform_edt(missing, return_distances=False, return_indices=True)
    return np.asarray(heights[tuple(place)])


def _over(lows: Float, planes: Float, side: float) -> Float:
    """How high (rows, columns) the lowest return of each square lies over the plane of its surroundings, not below 0.

    At an edge of the ground that is the plane on one side of it: the lowest over the planes of the squares around.
    """
    _, rows, columns = lows.shape
    least = np.full((rows, columns), np.inf)
    padded = np.pad(planes, ((0, 0), (_FIT_RADIUS,) * 2, (_FIT_RADIUS,) * 2), constant_values=np.nan)
    for i in (-_FIT_RADIUS, 0, _FIT_RADIUS):
        for j in (-_FIT_RADIUS, 0, _FIT_RADIUS):
            # the plane of the square i lines farther north and j columns farther east
            z, east, north = padded[:, _FIT_RADIUS - i :, _FIT_RADIUS + j :][:, :rows, :columns]
            least = np.fmin(least, np.abs(lows[2] - z - east * (lows[0] - j * side) - north * (lows[1] - i * side)))
    own = lows[2] - planes[0] - planes[1] * lows[0] - planes[2] * lows[1]
    return np.asarray(np.nan_to_num(np.clip(np.fmin(own, least), 0.0, None), posinf=0.0))


def _stray(lows: Float, weight: Float, side: float) -> Bool:
    """Squares whose lowest return is far below all around it."""
    planes = _planes(lows, weight, side, _FIT_RADIUS)
    over = lows[2] - planes[0] - planes[1] * lows[0] - planes[2] * lows[1]
    over[np.isnan(over)] = np.inf
    around = np.ones((3, 3), dtype=bool)
    around[1, 1] = False
    others = ndimage.minimum_filter(over, footprint=around, mode="constant", cval=np.inf)
    return np.asarray(np.isfinite(over) & np.isfinite(others) & (over < others - _STRAY_DEPTH_M))


def _planes(lows: Float, weight: Float, side: float, radius: int) -> Float:
    """(3, rows, columns) height in the middle of each square and rise towards east and north of the plane through the
    weighted lowest returns of the squares around it; NaN where they do not fix one.
    """
    rows, columns = weight.shape
    # places from the middle of the grid, so that their products keep their digits
    across = (np.arange(columns) - (columns - 1) / 2) * side
    down = ((rows - 1) / 2 - np.arange(rows)) * side
    x, y, z = lows[0] + across, lows[1] + down[:, None], np.nan_to_num(lows[2])
    size = 2 * radius + 1

    def total(values: Float) -> Float:
        return ndimage.uniform_filter(values, size, mode="constant") * float(size * size)

    w = total(weight)
    w[w < 1e-6] = np.nan
    mx, my, mz = (total(weight * v) / w for v in (x, y, z))
    xx, yy, xy = (
        total(weight * x * x) / w - mx * mx,
        total(weight * y * y) / w - my * my,
        total(weight * x * y) / w - mx * my,
    )
    xz, yz = total(weight * x * z) / w - mx * mz, total(weight * y * z) / w - my * mz
    east, north, determinant = gradient_parts(xx, yy, xy, xz, yz)
    with np.errstate(invalid="ignore", divide="ignore"):
        spread = determinant / (xx + yy)  # about the smaller of both variances of the places
        fixed = (w >= _MIN_WEIGHT) & (spread >= _MIN_SPREAD * side**2)
        east, north = east / determinant, north / determinant
        planes = np.stack([mz + east * (across - mx) + north * (down[:, None] - my), east, north])
    planes[:, ~fixed] = np.nan
    return planes
