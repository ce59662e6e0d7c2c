"""Along which direction a change is measured, where that is left to the ground."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...interface.parameters import GridChangeParameters
from ..core.arrays import Float

STEEP_DEG = 50.0
"""Median slope beyond which differences of heights are misleading: a shift of 1 cm towards the face looks like 1.2 cm
of height there."""
SENTENCE = (
    f"Changes are distances square to the slope, because half of the compared ground is steeper than {STEEP_DEG:g} "
    "degrees, where heights show small shifts enlarged; choose the direction vertical for differences of heights."
)


def with_direction(parameters: GridChangeParameters, slope: Float) -> GridChangeParameters:
    """Parameters whose direction is vertical or normal: the one asked for, or by the ``slope`` of the cells, degrees.

    Args:
        slope: of any shape, NaN where unknown.
    """
    if parameters.direction != "auto":
        return parameters
    known = slope[np.isfinite(slope)]
    # where fewer than half are, the median is not
    may_be = 2 * np.count_nonzero(known > STEEP_DEG) >= known.size > 0
    steep = may_be and float(np.median(known)) > STEEP_DEG
    return replace(parameters, direction="normal" if steep else "vertical")
