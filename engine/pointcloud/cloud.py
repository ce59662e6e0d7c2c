"""A point cloud in the working frame, as arrays."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from ..core.arrays import Float
from .plant_cover import PlantCover


@dataclass(frozen=True)
class PointCloud:
    """A cloud in metres.

    ``xyz`` (n, 3) float64 in ``crs``, whose axes are metres. ``rgb`` (n, 3) uint8, ``intensity`` (n,) uint16 and
    ``classification`` (n,) uint8 are None where the file has none or they were not asked for. ``plant_error`` and
    ``plant_height`` (n,) float32, metres, are None where the file does not have them (see ``plant_cover``). ``notes``
    are sentences about what was converted, repaired or left out.
    """

    xyz: Float
    crs: CRS
    path: Path
    rgb: NDArray[np.uint8] | None = None
    intensity: NDArray[np.uint16] | None = None
    classification: NDArray[np.uint8] | None = None
    notes: tuple[str, ...] = ()
    plant_error: NDArray[np.float32] | None = None
    plant_height: NDArray[np.float32] | None = None

    @property
    def plants(self) -> PlantCover | None:
        """What plants do to this ground; None where that is not known."""
        return None if self.plant_error is None else PlantCover(self.plant_error, self.plant_height)

    def __len__(self) -> int:
        return len(self.xyz)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north."""
        low, high = self.xyz[:, :2].min(axis=0), self.xyz[:, :2].max(axis=0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])
