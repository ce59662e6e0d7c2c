"""How the points of a cylinder lie across its axis: what uneven sampling of a tilted surface does to a mean.

Where a surface is tilted within the cylinder, as in gullies, a mean is that of the place where the points are. Two
surveys whose points are at different places there have a distance that is none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float, Index
from ..geometry.plane_gradient import gradient_parts
from .lattice import runs

_MIN_EXTENT_SHARE = 1e-3  # of the points' extent: across a line of points the tilt is taken as none


@dataclass(frozen=True)
class Spread:
    """Points of m cylinders in two directions across their axes: ``place`` (m, 2), their mean from the core point,
    metres, NaN without points; ``products`` (m, 5), sums of products about their means, m²: of the first direction with
    itself, of the second with itself, of both, and of each with the position along the axis.
    """

    place: Float
    products: Float

    def taken(self, rows: Index) -> Spread:
        return Spread(self.place[rows], self.products[rows])


class SpreadSums:
    """Gathers ``spread`` around axes ``unit`` (m, 3), which are zeros where there is none."""

    def __init__(self, unit: Float) -> None:
        self._across = [np.ascontiguousarray(axis.T) for axis in across(unit)]
        self.spread = Spread(np.full((len(unit), 2), np.nan), np.zeros((len(unit), 5)))

    def add(self, number: Index, offset: tuple[Float, Float, Float], along: Float) -> None:
        """Enter the cylinders ``number`` (k,), all points of which are given, one cylinder's after the other's.

        Args:
            offset: x, y and z of the points from their core points, metres.
            along: their positions along the axis, metres.
        """
        which, starts, members = runs(number)

        def about(values: Float) -> tuple[Float, Float]:
            mean = np.add.reduceat(values, starts) / members
            return mean, values - np.repeat(mean, members)

        _, height = about(along)
        places = []
        for direction, axis in enumerate(self._across):
            x, y, z = (component.take(number) for component in axis)
            mean, place = about(offset[0] * x + offset[1] * y + offset[2] * z)
            self.spread.place[which, direction] = mean
            places.append(place)
        u, v = places
        for column, product in enumerate((u * u, v * v, u * v, u * height, v * height)):
            self.spread.products[which, column] = np.add.reduceat(product, starts)


def across(unit: Float) -> tuple[Float, Float]:
    """Two directions (m, 3) square to each other and to axes ``unit`` (m, 3) of length 1; zeros where that is zeros."""
    # from the coordinate axis that is farthest from the axis
    other = np.eye(3)[np.abs(unit).argmin(axis=1)]
    first = np.cross(unit, other)
    length = np.linalg.norm(first, axis=1, keepdims=True)
    first = np.divide(first, length, out=np.zeros_like(first), where=length > 0)
    return first, np.cross(unit, first)


def tilt_of(*spreads: Spread) -> Float:
    """Rise along the axis in both directions across it, metres a metre (m, 2), of the plane through a cloud's points.

    Through those of several clouds, each about its own mean: what moved as a whole does not tilt it. 0 where there are
    no points.
    """
    uu, vv, uv, uh, vh = np.sum([spread.products for spread in spreads], axis=0).T
    extent = uu + vv
    uu, vv = uu + _MIN_EXTENT_SHARE * extent, vv + _MIN_EXTENT_SHARE * extent
    *rise, determinant = gradient_parts(uu, vv, uv, uh, vh)
    with np.errstate(divide="ignore", invalid="ignore"):
        tilt = np.column_stack(rise) / determinant[:, None]
    return np.nan_to_num(tilt, nan=0.0, posinf=0.0, neginf=0.0)


def uneven_sampling(first: Spread, second: Spread) -> Float:
    """By how much the means of two clouds along the axis differ because their points are at different places, metres
    (m,); 0 where a cloud has no points.

    A tilt that one cloud alone shows may be change itself, as at the edge of what slid. So the smaller of the
    errors by both clouds' tilts counts, and nothing where they contradict each other.
    """
    apart = second.place - first.place
    one, other = (np.nan_to_num(np.sum(tilt_of(spread) * apart, axis=1)) for spread in (first, second))
    smaller = np.minimum(np.abs(one), np.abs(other))
    return np.asarray(np.where(one * other > 0, np.sign(one) * smaller, 0.0))


def explained_squares(spread: Spread, tilt: Float) -> Float:
    """How much smaller the sum of squares along the axis is about the tilted plane than about the mean, m² (m,)."""
    uu, vv, uv, uh, vh = spread.products.T
    u, v = tilt.T
    return 2 * (u * uh + v * vh) - (u * u * uu + v * v * vv + 2 * u * v * uv)
