"""Returns of a cloud by cell, added part by part: how many, the highest one and its colour, heights over a surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Bool, Float, Float32
from ..pointcloud.cloud import PointCloud
from .grid import Grid, cell_index

GROUND = 2
"""Class of the ground (LAS 1.4 R15, table 9)."""
NOISE = (7, 18)
"""Classes of low and of high noise."""


class CellReturns:
    """What the returns in each cell of a grid are; arrays (rows, columns), heights in metres over ``base``.

    Attributes:
        highest: -inf where a cell has none.
        count: returns.
        ground_count: of class 2; None where that is not asked for.
        rgb: (rows, columns, 3) colour of the highest return, the last of equally high ones; 8 bits.
        intensity: its intensity.

    The result does not depend on how the cloud is cut in parts: heights have 32 bits before they are compared.
    """

    def __init__(self, grid: Grid, base: float, *, classified: bool, colours: str) -> None:
        """``colours`` is ``rgb``, ``intensity``, or empty for neither."""
        self.grid, self.base = grid, base
        self.highest: Float32 = np.full(grid.shape, -np.inf, dtype=np.float32)
        self.count = np.zeros(grid.shape, dtype=np.uint32)
        self.ground_count = np.zeros(grid.shape, dtype=np.uint32) if classified else None
        self.rgb = np.zeros((*grid.shape, 3), dtype=np.uint8) if colours == "rgb" else None
        self.intensity = np.zeros(grid.shape, dtype=np.uint16) if colours == "intensity" else None

    @property
    def filled(self) -> Bool:
        """Cells with a return."""
        return self.count > 0

    def add(self, part: PointCloud, rgb: NDArray[np.uint8] | None = None) -> None:
        """Add the points of a part that lie within the grid; ``rgb`` (n, 3) are their colours in 8 bits."""
        place = cell_index(part.xyz, self.grid)
        inside = place >= 0
        chosen: slice | Bool = slice(None) if inside.all() else inside
        place = place[chosen]
        z = (part.xyz[chosen, 2] - self.base).astype(np.float32)
        np.add.at(self.count.ravel(), place, np.uint32(1))
        np.maximum.at(self.highest.ravel(), place, z)
        top = z == self.highest.ravel()[place]
        # of cells that occur several times the last value stays
        if self.rgb is not None and rgb is not None:
            self.rgb.reshape(-1, 3)[place[top]] = rgb[chosen][top]
        if self.intensity is not None and part.intensity is not None:
            self.intensity.ravel()[place[top]] = part.intensity[chosen][top]
        if self.ground_count is not None and part.classification is not None:
            ground = part.classification[chosen] == GROUND
            np.add.at(self.ground_count.ravel(), place[ground], np.uint32(1))


class HeightsOverGround:
    """The highest and the lowest return over a surface in each cell (-inf and inf without one), m, and how many returns
    lie close to it; arrays (rows, columns).
    """

    def __init__(self, grid: Grid, base: float, tolerance: float) -> None:
        """``tolerance``: distance (m) from the surface up to which a return counts as ground."""
        self.grid, self.base, self.tolerance = grid, base, tolerance
        self.highest: Float32 = np.full(grid.shape, -np.inf, dtype=np.float32)
        self.lowest: Float32 = np.full(grid.shape, np.inf, dtype=np.float32)
        self.close = np.zeros(grid.shape, dtype=np.uint32)

    def add(self, xyz: Float, surface: Float) -> None:
        """Add points (n, 3) under each of which the ``surface`` (n,) lies so high over the base."""
        place = cell_index(xyz, self.grid)
        over = (xyz[:, 2] - self.base - surface).astype(np.float32)
        inside = place >= 0
        if not inside.all():
            place, over = place[inside], over[inside]
        np.maximum.at(self.highest.ravel(), place, over)
        np.minimum.at(self.lowest.ravel(), place, over)
        np.add.at(self.close.ravel(), place[np.abs(over) <= self.tolerance], np.uint32(1))
