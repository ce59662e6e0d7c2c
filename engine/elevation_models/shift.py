"""An elevation model moved by parts of a cell."""

from __future__ import annotations

import math

import numpy as np
from scipy import ndimage

from ..core.arrays import Float


def shifted(heights: Float, columns: float, rows: float) -> Float:
    """The heights that lie ``columns`` to the right of each cell and ``rows`` below it, both in cells.

    Cubic convolution (Keys 1981, doi:10.1109/TASSP.1981.1163711), which keeps a curved surface; linear next to gaps,
    where four cells in line are not known. NaN outside and in gaps.

    Args:
        heights: (rows, columns), NaN where unknown.
    """
    moved = heights
    for axis, by in ((1, columns), (0, rows)):
        moved = _along(moved, by, axis)
    return moved


def _along(heights: Float, by: float, axis: int) -> Float:
    whole = math.floor(by + 1e-9)
    part = by - whole
    if abs(part) < 1e-9:
        return _from(heights, whole, axis)
    # of the cells at -1, 0, 1 and 2 from the lower one
    cubic = (
        -0.5 * part + part**2 - 0.5 * part**3,
        1.0 - 2.5 * part**2 + 1.5 * part**3,
        0.5 * part + 2.0 * part**2 - 1.5 * part**3,
        -0.5 * part**2 + 0.5 * part**3,
    )
    cells = [_from(heights, whole + step, axis) for step in (-1, 0, 1, 2)]
    smooth = sum(weight * cell for weight, cell in zip(cubic, cells, strict=True))
    linear = (1.0 - part) * cells[1] + part * cells[2]
    return np.where(np.isfinite(smooth), smooth, linear)


def _from(heights: Float, by: int, axis: int) -> Float:
    step = [0, 0]
    step[axis] = -by
    moved: Float = ndimage.shift(heights, step, order=0, mode="constant", cval=np.nan, prefilter=False)
    return moved
