"""Which width of windows counts at a place of a series."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Bool
from ...displacement.vectors import Vectors, likelihood_ratio


def narrower_tells(narrow: Vectors, wide: Vectors, confidence: float) -> Bool:
    """(n,) at which places the narrower window counts: the wide one has no motion, or none that is significant while
    the narrow one has, and rather moves with it than stands still.

    To take the narrow one wherever it is significant would choose its largest errors.

    Args:
        confidence: of each of both.
    """
    alone = narrow.significant(confidence) & ~wide.significant(confidence)
    agrees = likelihood_ratio(wide, narrow.in_plane[:, :2]) > 0
    return np.asarray((alone & agrees) | (~wide.measured & narrow.measured))
