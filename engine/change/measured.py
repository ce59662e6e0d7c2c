"""What was measured of a change, before its errors are judged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float
from ..grid.partition import Partition
from ..grid.plant_cells import PlantCells


@dataclass(frozen=True)
class Measured:
    """A difference; arrays (rows, columns), or (n,) of the cells that ``partition`` lists; metres, NaN where not
    compared.

    Attributes:
        dz: change.
        sampling: its standard error from the points' scatter.
        slope: degrees to the horizontal, NaN where unknown.
        partition: which cells are one.
        plants: error of the heights by plants, where known.
    """

    dz: Float
    sampling: Float
    slope: Float
    partition: Partition
    plants: PlantCells | None = None

    @property
    def by_plants(self) -> Float | None:
        """Error of the change by plants."""
        return None if self.plants is None else self.plants.error

    def along_normal(self) -> Measured:
        """The distances square to the slope of what is vertical here: dz cos(slope)."""
        cosine = np.cos(np.radians(self.slope))
        plants = None if self.plants is None else self.plants.scaled(cosine)
        return Measured(self.dz * cosine, self.sampling * cosine, self.slope, self.partition, plants)
