"""Terrain of known shape, and flights over it, for tests of planned flights."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
import shapely
from pyproj import CRS
from slopewatch.engine.flight.terrain import Terrain
from slopewatch.engine.grid.grid import Grid
from slopewatch.interface.parameters import FlightParameters

CRS_CODE = "EPSG:32651"
WEST, NORTH = 500_000.0, 3_300_000.0


def flight(**values: Any) -> FlightParameters:
    """Parameters of a flight with few pulses."""
    return FlightParameters(**{"pulse_rate": 4000.0, "margin": 10.0, **values})


def inclined(rows: int = 120, columns: int = 140, slope: float = 0.7, relief: float = 0.0) -> Terrain:
    """Ground that rises to the north by ``slope``, with waves of ``relief`` m along east."""
    x = np.arange(columns) + 0.5
    y = rows - np.arange(rows)[:, None] - 0.5
    heights = 100.0 + slope * y + relief * np.sin(2 * np.pi * x / 40.0)
    grid = Grid(WEST, NORTH, 1.0, rows, columns)
    known = np.ones((rows, columns), dtype=bool)
    return Terrain(heights, known, heights.copy(), grid, CRS.from_user_input(CRS_CODE), Path("dem.tif"))


def square(east: float = 50.0, south: float = -80.0, side: float = 40.0) -> shapely.Polygon:
    """A square whose south-west corner lies so far from the terrain's north-west corner."""
    return shapely.box(WEST + east, NORTH + south, WEST + east + side, NORTH + south + side)


def write_region(path: Path, region: shapely.Geometry, crs: str = CRS_CODE) -> Path:
    gpd.GeoDataFrame({"name": ["slope"]}, geometry=[region], crs=crs).to_file(path, driver="GPKG")
    return path
