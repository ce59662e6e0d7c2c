"""The gradient of the least-squares plane, in closed form."""

from __future__ import annotations

from ..core.arrays import Float


def gradient_parts(xx: Float, yy: Float, xy: Float, xz: Float, yz: Float) -> tuple[Float, Float, Float]:
    """Rise along x and along y, both times the determinant, and the determinant; Cramer's rule, arrays of one shape.

    The determinant shows how well the gradient is fixed: it is 0 where all places lie in one line.

    Args:
        xx, yy, xy: sums of products of the places' coordinates about their means.
        xz, yz: ... of the coordinates and the heights.
    """
    return xz * yy - yz * xy, yz * xx - xz * xy, xx * yy - xy * xy
