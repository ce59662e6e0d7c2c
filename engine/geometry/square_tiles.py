"""Work on a cloud in square tiles with a margin, where it needs memory by area."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float
from .columns import least, spans


def in_tiles(
    points: Float, work: Callable[[Float], NDArray[Any]], side: float, margin: float, step: float
) -> NDArray[Any]:
    """``work`` on parts of the points (n, 2+): a result (n, ...) for each point, from the tile that holds it.

    Args:
        work: takes points (m, 2+) and gives an array (m, ...).
        side: of a tile, m; a cloud that is little larger is one tile.
        margin: width around a tile from which points come along, m.
        step: the tiles' corners are multiples of it from the lowest point, m, so that grids of this cell fall together.
    """
    low = least(points[:, :2])
    if spans(points[:, :2]).max() <= 1.5 * side:
        return work(points)
    side = max(round(side / step), 1) * step
    margin = max(round(margin / step), 1) * step
    index = np.floor((points[:, :2] - low) / side).astype(np.int64)
    result: NDArray[Any] | None = None
    for tile in np.unique(index, axis=0):
        corner = low + tile * side
        inside = (points[:, :2] >= corner - margin).all(axis=1) & (points[:, :2] < corner + side + margin).all(axis=1)
        part = np.flatnonzero(inside)
        core = (index[part] == tile).all(axis=1)
        values = work(points[part])
        if result is None:
            result = np.empty((len(points), *values.shape[1:]), dtype=values.dtype)
        result[part[core]] = values[core]
    assert result is not None
    return result
