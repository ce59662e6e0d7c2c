"""Motion against gravity: ground does not slide up a slope, so that an error of the surveys is the likelier reason."""

from __future__ import annotations

import numpy as np

from ..core.arrays import Bool, Float
from ..statistics.normal import Z95

_MIN_INCLINATION_DEG = 10.0  # below it ground heaves at the toe of a slide, and the dip is no direction to go by


def is_uphill(dip: Float, along: Float, error: Float) -> Bool:
    """(...) whether ground on a slope moves up it beyond chance, of which 2.5 % are left.

    Args:
        dip: (..., 3) unit vector down the slope, in the map.
        along: (...) motion down the dip, metres, and its standard ``error``.
    """
    steep = np.abs(dip[..., 2]) > np.sin(np.radians(_MIN_INCLINATION_DEG))
    return np.asarray(steep & (np.nan_to_num(along) < -Z95 * np.nan_to_num(error)))
