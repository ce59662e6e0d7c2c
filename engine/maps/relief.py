"""Shaded relief."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float

_DARK_TINT = np.array([150.0, 158.0, 138.0])
_LIGHT_TINT = np.array([236.0, 230.0, 214.0])
_AT_ONCE = 1_000_000  # pixels that are shaded at a time


def shaded_relief(heights: NDArray[np.floating], cell: float) -> NDArray[np.float32]:
    """Relief (rows, columns, 3), 0 to 255, lit from the north-west at 45 degrees and tinted by height.

    ``heights`` in metres, NaN where unknown (those pixels take the value of flat ground). Shading as in Horn 1981,
    doi:10.1109/PROC.1981.11918, from the differences to the neighbours that are known.
    """
    known = heights[np.isfinite(heights)]
    low, high = np.percentile(known, (2, 98)) if known.size else (0.0, 1.0)
    relief = np.empty((*heights.shape, 3), dtype=np.float32)
    east, north, up = -0.5, 0.5, np.sqrt(0.5)  # towards the light
    for lines, eastward, northward in _slopes(heights, cell):
        shade = (up - east * eastward - north * northward) / np.sqrt(1.0 + eastward**2 + northward**2)
        share = np.clip(np.nan_to_num((heights[lines] - low) / max(high - low, 1e-6)), 0.0, 1.0)[..., np.newaxis]
        tint = _DARK_TINT * (1 - share) + _LIGHT_TINT * share
        relief[lines] = np.minimum(tint * (0.35 + 0.9 * np.clip(shade, 0.0, 1.0)[..., np.newaxis]), 255.0)
    return relief


def hillshade(heights: NDArray[np.floating], cell: float) -> NDArray[np.float32]:
    """Brightness (rows, columns), 0 to 255, under light from four sides at 45 degrees; NaN where a height is.

    From the south-west to the north, each counting most on slopes across it, so that a slope that faces away from one
    is not black: Mark 1992, doi:10.3133/ofr92422. ``heights`` in metres, NaN where unknown.
    """
    relief = np.empty(heights.shape, dtype=np.float32)
    for lines, eastward, northward in _slopes(heights, cell):
        total, weights = np.zeros_like(eastward), np.full_like(eastward, 1e-9)
        steepness = np.hypot(eastward, northward)
        for azimuth in np.radians((225.0, 270.0, 315.0, 360.0)):
            east, north = np.sin(azimuth), np.cos(azimuth)
            # sine of the angle between the fall line and the light
            across = (eastward * north - northward * east) / np.maximum(steepness, 1e-9)
            weight = np.where(steepness > 1e-9, across**2, 1.0)
            shade = (1.0 - east * eastward - north * northward) * np.sqrt(0.5) / np.sqrt(1.0 + steepness**2)
            total += weight * np.clip(shade, 0.0, 1.0)
            weights += weight
        relief[lines] = np.where(np.isnan(heights[lines]), np.nan, 255.0 * total / weights)
    return relief


def _slopes(heights: NDArray[np.floating], cell: float) -> Iterator[tuple[slice, Float, Float]]:
    """Slope towards east and towards north, some lines at a time."""
    count = max(1, _AT_ONCE // max(heights.shape[1], 1))
    for top in range(0, len(heights), count):
        # with a line more on either side
        first = max(top - 1, 0)
        eastward, northward = _gradients(heights[first : top + count + 1].astype(np.float64), cell)
        lines = slice(top, min(top + count, len(heights)))
        own = slice(top - first, lines.stop - first)
        yield lines, eastward[own], northward[own]


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
