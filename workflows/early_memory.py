"""Whether the grid of a comparison can fit into the memory, decided on headers and samples before other work."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from shapely.geometry import box

from ..engine.core.arrays import Float
from ..engine.grid.common_grid import refuse_too_large
from ..engine.pointcloud.reading import open_cloud, sample_cloud
from ..engine.vector.area import read_roi
from ..interface.parameters import AUTO, GridChangeParameters, InputParameters

_SQUARE_M = 20.0  # m: squares with points of a sample are on the slope
_MIN_EXTENT_SHARE = 0.1  # share of the header's extent that a sample covers, where no stray point makes the extent


def refuse_grid_early(
    clouds: Sequence[Path], inputs: InputParameters, parameters: GridChangeParameters, roi: Path | None
) -> None:
    """Raise InputError where the grid of the clouds' ground will need more than ``memory_limit``.

    The extent is that of the headers within the region of interest, the slope's area that of a sample's squares, so
    that nothing is refused here that the ground itself would not be. A cell left to the clouds is never refused; where
    a sample covers little of the extent, as with stray points far away, the ground decides later.

    Raises:
        InputError: see there, or a cloud or the region cannot be read.
    """
    if parameters.cell == AUTO:
        return
    low, high, samples = np.full(2, np.inf), np.full(2, -np.inf), []
    for path in clouds:
        header, frame = open_cloud(path, inputs)
        if not header.bounds_trusted:
            return
        factor = frame.horizontal_factor
        low = np.minimum(low, np.array(header.bounds_low[:2]) * factor)
        high = np.maximum(high, np.array(header.bounds_high[:2]) * factor)
        samples.append(sample_cloud(path, inputs))
    seen = np.vstack(samples)
    spread = np.quantile(seen[:, :2], 0.99, axis=0) - np.quantile(seen[:, :2], 0.01, axis=0)
    if float(np.prod(spread)) < _MIN_EXTENT_SHARE * float(np.prod(high - low)):
        return
    area = _area(seen)
    if roi is not None:
        polygons = read_roi(roi, open_cloud(clouds[0], inputs)[1].crs).geometry
        common = polygons.intersection(box(*low, *high))
        if common.is_empty:
            return
        low, high = np.array(common.bounds[:2]), np.array(common.bounds[2:])
        area = min(area, common.area)
    refuse_too_large((float(low[0]), float(low[1]), float(high[0]), float(high[1])), area, parameters, plants=True)


def _area(points: Float) -> float:
    places = np.floor(points[:, :2] / _SQUARE_M).astype(np.int64)
    return float(len(np.unique(places, axis=0))) * _SQUARE_M**2
