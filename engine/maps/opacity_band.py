"""The second band of a raster of change: how opaque QGIS draws each cell, by its own level of detection."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Bool, Float

OPAQUE = 255.0
WITHIN = 45.0
"""Of a cell whose change is within its level: a pale veil, by which what was measured differs from what was not."""
NAME = "Opacity on a map: 255 beyond the level of detection of the cell, 45 within it"
BAND = 2
"""Number of the band in the file; the first one is the change itself."""
UNIT = "1"


def opacity(change: NDArray[np.floating], beyond: Bool) -> Float:
    """Opacity of each cell, 0 to 255 as QGIS takes it; NaN where there is no change.

    Args:
        change: (...), NaN for no data.
        beyond: (...), whether it is beyond the level of detection of its cell.
    """
    return np.where(np.isnan(change), np.nan, np.where(beyond, OPAQUE, WITHIN))
