"""Zones of a change that is given as arrays, and parts of grids."""

from __future__ import annotations

from typing import Any

import numpy as np
from pyproj import CRS
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.grid.partition import Partition
from slopewatch.engine.zones.extraction import Origin, Zones, extract_zones
from slopewatch.engine.zones.footprints import Cells, Detected
from slopewatch.interface.parameters import ZoneParameters


def single(dz: np.ndarray, cell: float = 1.0) -> Partition:
    """Every cell of ``dz`` a part of its own."""
    return Partition((dz.shape[0], dz.shape[1]), cell)


def blocks_of(block: np.ndarray, cell: float, size: np.ndarray) -> Partition:
    """Parts ``block`` (rows, columns), ``size`` (rows, columns) being the side of each cell's, metres."""
    side = np.full(int(block.max(initial=-1)) + 1, cell)
    side[block[block >= 0]] = size[block >= 0]
    return Partition.of_blocks(block, cell, side)


def zones_of(
    dz: np.ndarray,
    significant: np.ndarray,
    level: np.ndarray,
    error: np.ndarray,
    count: np.ndarray,
    grid: Grid,
    crs: CRS | None = None,
    parameters: ZoneParameters | None = None,
    **options: Any,
) -> Zones:
    """``extract_zones`` of these arrays (rows, columns); ``options``: fields of what it takes, by their names."""

    def given(*names: str) -> dict[str, Any]:
        return {name: options.pop(name) for name in names if name in options}

    partition = options.pop("partition", Partition(grid.shape, grid.cell))
    cells = Cells(dz, error, np.full(grid.shape, grid.cell**2), partition, **given("plants", "plant_like"))
    found = Detected(significant, level, count, **given("stable", "heights", "explained"))
    origin = Origin(**given("epochs", "method", "run_id"))
    return extract_zones(cells, found, grid, crs, parameters, origin=origin, **options)
