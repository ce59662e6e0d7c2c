"""Shaded relief."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float

# Pixels: a gap no wider than twice this closes. Farther would invent surface where nothing was measured.
_AT_ONCE = 1_000_000  # pixels that are shaded at a time


def shaded_relief(heights: NDArray[np.floating], cell: float) -> NDArray[np.float32]:
    """Relief (rows, columns, 3), 0 to 255, lit from the north-west at 45 degrees and tinted by height.

    ``heights`` in metres, NaN where unknown (those pixels take the value of flat ground). Shading as in Horn 1981,
    doi:10.1109/PROC.1981.11918, from the differences to the neighbours that are known.
    """
    known = heights[np.isfinite(heights)]
    low, high = np.percentile(known, (2, 98)) if known.size else (0.0, 1.0)
    relief = np.empty((*heights.shape, 3), dtype=np.float32)
    lines = max(1, _AT_ONCE // max(heights.shape[1], 1))
    for top in range(0, len(heights), lines):
        # with a line more on either side, for the slope
        first = max(top - 1, 0)
        part = _shaded(heights[first : top + lines + 1], cell, low, high)
        relief[top : top + lines] = part[top - first : top - first + lines]
    return relief


def _shaded(heights: NDArray[np.floating], cell: float, low: float, high: float) -> NDArray[np.float32]:
    """As ``shaded_relief``, of heights that are tinted from ``low`` to ``high``."""
    eastward, northward = _gradients(heights.astype(np.float64), cell)
    east, north, up = -0.5, 0.5, np.sqrt(0.5)  # towards the light
    shade = (up - east * eastward - north * northward) / np.sqrt(1.0 + eastward**2 + northward**2)
    share = np.clip(np.nan_to_num((heights - low) / max(high - low, 1e-6)), 0.0, 1.0)[..., np.newaxis]
    tint = np.array([150.0, 158.0, 138.0]) * (1 - share) + np.array([236.0, 230.0, 214.0]) * share
    relief: NDArray[np.float32] = (tint * (0.35 + 0.9 * np.clip(shade, 0.0, 1.0)[..., np.newaxis])).astype(np.float32)
    return np.minimum(relief, 255.0)


def _gradients(z: Float, cell: float) -> tuple[Float, Float]:
    """Slope towards east and towards north: mean of the one-sided differences that are known, 0 where none is."""

    def along(step: Float) -> Float:
        """``step`` (r, c - 1): differences between neighbours along the rows."""
        known = np.isfinite(step).astype(np.float64)
        step = np.nan_to_num(step)
        edge = np.zeros((len(step), 1))
        total = np.hstack((step, edge)) + np.hstack((edge, step))
        return total / np.maximum(np.hstack((known, edge)) + np.hstack((edge, known)), 1.0) / cell

    return along(np.diff(z, axis=1)), -along(np.diff(z, axis=0).T).T
