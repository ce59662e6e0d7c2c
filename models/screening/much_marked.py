"""Whether more of a cloud is marked than can be believed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...engine.core.progress import Progress

_MAX_MARKED_SHARE = 0.25
"""Three simulated slopes with hazards as rare as on real ones had 3 to 9 % of it labelled, rolling ones half."""


def much_stands_out(labels: NDArray[np.uint8], count: NDArray[np.integer]) -> float:
    """Share of the ground that is labelled a hazard where that is more than any maintained slope has; else 0.

    Args:
        labels: (m,) of voxels. count: (m,) their points.
    """
    share = float(count[labels > 0].sum() / max(1, count.sum()))
    return share if share > _MAX_MARKED_SHARE else 0.0


def warn_if_much_stands_out(labels: NDArray[np.uint8], count: NDArray[np.integer], progress: Progress) -> None:
    """Say so where ``much_stands_out``."""
    share = much_stands_out(labels, count)
    if share:
        progress.warning(
            f"{share:.0%} of the ground stands out of the slope or lies below it, so the slope is unlike those that "
            "screening is made for (natural rolling ground, or a trend that does not fit); its zones say little and "
            "are of low confidence."
        )
