"""The slope's relief in outline, by which its points are lowered before ground is looked for among them.

On ridges and in hollows triangles between a few sure points are far off the ground. The outline follows such relief. It
is a progressive morphological opening of the lowest points of squares (Zhang et al. 2003, doi:10.1109/TGRS.2003.810682;
Pingel et al. 2013, doi:10.1016/j.isprsjprs.2012.12.002): what stands out more steeply than ``MAX_SLOPE`` of wider and
wider windows is cut off. An opening leaves an inclined plane as it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ..core.arrays import Float
from ..geometry.columns import greatest, least
from ..statistics.nearest_known import nearest_known
from .squares import lowest_corner

SQUARE_M = 1.0
REACHES_M = (1, 2, 3, 4, 6, 8, 10)
"""Half of the windows' widths."""
MAX_SLOPE = 0.5
"""Height over a window's opening, by half of its width, from which it is cut off: ridges and flanks of scarps stay."""
SMOOTHING_M = 2.0
DENSE_RETURNS = 60.0
"""Returns of a square from which no outline is needed: windows of the lowest layer then follow the relief themselves
(see ``layered_ground.MIN_WINDOW_RETURNS``)."""


@dataclass(frozen=True)
class Relief:
    """Heights (rows, columns) of the outline in squares, metres, and the corner (2,) where these begin."""

    surface: Float
    corner: Float

    def at(self, xyz: Float) -> Float:
        """Height (n,) of the outline at points (n, 2+) in the frame of the slope, metres."""
        place = (xyz[:, :2] - self.corner) / SQUARE_M - 0.5
        return np.asarray(ndimage.map_coordinates(self.surface, place.T, order=3, mode="nearest"), dtype=np.float64)


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
    surface = surface[nearest_known(np.isfinite(surface))]
    for reach in REACHES_M:
        opened = ndimage.grey_opening(surface, 2 * round(reach / SQUARE_M) + 1, mode="nearest")
        surface = np.where(surface - opened > MAX_SLOPE * reach, opened, surface)
    return Relief(ndimage.gaussian_filter(surface, SMOOTHING_M / SQUARE_M, mode="nearest"), corner)
