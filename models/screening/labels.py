"""The classes of screening, and the most probable one of a point."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

BACKGROUND, UPLIFT, SUBSIDENCE = 0, 1, 2


def most_probable(probabilities: NDArray[np.floating], minimum: float) -> NDArray[np.uint8]:
    """(n,) the most probable class of (n, 3); background where a hazard is less probable than ``minimum``."""
    labels = probabilities.argmax(axis=1).astype(np.uint8)
    labels[(labels != BACKGROUND) & (probabilities.max(axis=1) < minimum)] = BACKGROUND
    return labels
