"""What plants do to a ground cloud, by point: the error of its heights, and how high the plants stand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

ERROR, HEIGHT = "plant_error", "plant_height"
"""Names of the dimensions in a cloud's file, metres."""
MIN_HEIGHT_DIFFERENCE_M = 0.05
"""Metres by which the vegetation of two surveys must differ in height to have changed."""


@dataclass(frozen=True)
class PlantCover:
    """Of each of a cloud's n points, metres; a cloud of another program may lack either.

    Attributes:
        error: (n,) one standard error of the ground's height by plants, 0 on bare ground. Neighbours share it, so it
            does not average out over the points of a cell.
        height: (n,) median height of all returns over the ground around the point; None where it is not known.
    """

    error: NDArray[np.floating]
    height: NDArray[np.floating] | None = None

    def __post_init__(self) -> None:
        # what is no number is unknown, and counts as bare
        for name in ("error", "height"):
            values = getattr(self, name)
            if values is not None and not (np.isfinite(values) & (values >= 0)).all():
                object.__setattr__(self, name, np.maximum(np.nan_to_num(values, nan=0.0, posinf=0.0), 0.0))
