"""The slope's relief in outline, by which its points are lowered before ground is looked for among them.

On ridges and in hollows triangles between a few sure points are far off the ground. The outline follows such relief. It
is a progressive morphological opening of the lowest points of squares (Zhang et al. 2003, doi:10.1109/TGRS.2003.810682;
Pingel et al. 2013, doi:10.1016/j.isprsjprs.2012.12.002): what stands out of wider and wider windows is cut out, and the
gap is spanned from its edges. An opening leaves an inclined plane as it is, but for the upper edge of the cloud.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.interpolate import LinearNDInterpolator

from ..core.arrays import Bool, Float
from ..geometry.columns import greatest, least
from ..statistics.nearest_known import nearest_known
from .squares import lowest_corner

SQUARE_M = 1.0
REACHES_M = (1, 2, 3, 4, 6, 8, 10, 13, 16)
"""Half of the windows' widths."""
STANDS_OUT_M, RELIEF_EXPONENT = 0.8, 0.7
"""Height over the opening of a window of 1 m reach from which a square is cut out, and the power of the reach with
which that height grows, as relief of natural ground does (Hurst exponent)."""
SMOOTHING_M, SINGLE_SMOOTHING_M = 2.0, 0.5
SINGLE_REACH_M = 25
"""Half of the widest window, round and of each width, in which single returns are looked at: buildings are as wide."""
SINGLE_STANDS_OUT_M, SINGLE_EXPONENT = 0.25, 0.8
"""As STANDS_OUT_M and RELIEF_EXPONENT. Pingel et al. take 0.15 and 1, which cuts ridges and keeps wide low roofs."""
SINGLE_DISTANCE_M, SINGLE_DISTANCE_SLOPE = 0.4, 1.25
"""Distance from the outline within which a single return is ground, and what it gains with the outline's slope (0.5 m
and 1.25 in Pingel et al.; on the ISPRS samples the mean total error is 3.9 to 4.0 % from 0.3 to 0.5 m)."""
PIT_SLOPE = 5.0
"""A square that lies more steeply below all four beside it holds an error of ranging (Pingel et al. 2013)."""
DENSE_RETURNS, SINGLE_RETURNS = 60.0, 3.0
"""Returns of a square from which no outline is needed, because windows of the lowest layer follow the relief themselves
(see ``layered_ground.MIN_WINDOW_RETURNS``), and below which they are single: none is known to be the lowest of its
place, and ground differs more between them than a surface through others can tell."""


@dataclass(frozen=True)
class Relief:
    """Heights (rows, columns) of the outline in squares, metres, and the corner (2,) where these begin.

    ``single``: returns are single (see SINGLE_RETURNS), and the outline is followed closely.
    """

    surface: Float
    corner: Float
    single: bool

    def at(self, xyz: Float) -> Float:
        """Height (n,) of the outline at points (n, 2+) in the frame of the slope, metres."""
        return self._between(self.surface, xyz, 3)

    def holds(self, xyz: Float) -> Bool:
        """(n,) which of the points (n, 3), with heights over the outline, are ground by it, if returns are single."""
        if min(self.surface.shape) < 2:
            return np.abs(xyz[:, 2]) < SINGLE_DISTANCE_M
        slope = self._between(np.hypot(*np.gradient(self.surface, SQUARE_M)), xyz, 1)
        return np.asarray(np.abs(xyz[:, 2]) < SINGLE_DISTANCE_M + SINGLE_DISTANCE_SLOPE * slope, dtype=np.bool_)

    def _between(self, values: Float, xyz: Float, order: int) -> Float:
        """Values (rows, columns) of the squares, at points (n, 2+)."""
        place = (xyz[:, :2] - self.corner) / SQUARE_M - 0.5
        return np.asarray(ndimage.map_coordinates(values, place.T, order=order, mode="nearest"), dtype=np.float64)


def relief(low: Float, returns: int, origin: Float | None = None) -> Relief | None:
    """The outline of a slope that lies flat in its frame; None if its returns are dense.

    Args:
        low: (m, 3) the lowest point of each square, metres.
        returns: how many there are of all.
        origin: (2+,) where the squares begin, see ``square_numbers``.
    """
    if returns >= DENSE_RETURNS * len(low):
        return None
    corner = lowest_corner(low, origin)
    corner = corner + SQUARE_M * np.floor((least(low[:, :2]) - corner) / SQUARE_M)
    place = np.floor((low[:, :2] - corner) / SQUARE_M).astype(np.int64)
    surface = np.full(greatest(place) + 1, np.inf)
    np.minimum.at(surface, tuple(place.T), low[:, 2])
    single = returns < SINGLE_RETURNS * len(low)
    spanned = _single_outline(surface) if single else _outline(surface)
    smoothing = SINGLE_SMOOTHING_M if single else SMOOTHING_M
    return Relief(ndimage.gaussian_filter(spanned, smoothing / SQUARE_M, mode="nearest"), corner, single)


def _outline(surface: Float) -> Float:
    """Lowest heights (rows, columns), infinite where there is none, without what stands out of square windows."""
    surface = surface[nearest_known(np.isfinite(surface))]
    lowered, cut = surface, np.zeros(surface.shape, dtype=bool)
    for reach in REACHES_M:
        opened = ndimage.grey_opening(lowered, 2 * round(reach / SQUARE_M) + 1, mode="nearest")
        out = lowered - opened > STANDS_OUT_M * reach**RELIEF_EXPONENT
        lowered, cut = np.where(out, opened, lowered), cut | out
    return _spanned(surface, cut)


def _single_outline(surface: Float) -> Float:
    """The same of single returns: a square may hold no ground, and its neighbours decide in windows of each width."""
    cut = ~np.isfinite(surface)
    surface = _spanned(np.where(cut, 0.0, surface), cut)
    beside = ndimage.generate_binary_structure(2, 1)
    cut |= ndimage.grey_closing(surface, footprint=beside, mode="nearest") - surface > PIT_SLOPE * SQUARE_M
    surface = _spanned(surface, cut)
    opened = surface
    for reach in range(1, round(SINGLE_REACH_M / SQUARE_M) + 1):
        away = np.arange(-reach, reach + 1)
        lowered = ndimage.grey_opening(opened, footprint=np.hypot(away[:, None], away) <= reach, mode="nearest")
        cut |= opened - lowered > SINGLE_STANDS_OUT_M * (reach * SQUARE_M) ** SINGLE_EXPONENT
        opened = lowered
    return _spanned(surface, cut)


def _spanned(surface: Float, cut: Bool) -> Float:
    """Heights (rows, columns) with those that are ``cut`` out spanned from what is left around them."""
    if not cut.any():
        return surface
    filled = surface[nearest_known(~cut)]
    if np.ptp(np.argwhere(~cut), axis=0).min(initial=1) > 0:
        across = LinearNDInterpolator(np.argwhere(~cut), surface[~cut])(np.argwhere(cut))
        filled[cut] = np.where(np.isfinite(across), across, filled[cut])
    return filled
