"""Surveys of one slope in several months, of which known shares of the pulses reach the ground.

``python -m slopewatch.tests.builders.season_surveys FOLDER`` writes dem.tif, roi.gpkg and a survey each of ``SHARES``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import laspy
import numpy as np
from pyproj import CRS
from slopewatch.tests.builders.elevation_models import write_model
from slopewatch.tests.builders.flights import NORTH, WEST, inclined, square, write_region

SHARES = {"2025-03-10": 0.6, "2025-07-15": 0.15, "2025-11-02": 0.57}
"""Of the pulses, by the day of the survey."""


def write_site(folder: Path) -> None:
    """The slope's elevation model and region."""
    write_model(folder / "dem.tif", inclined(relief=2.0).heights, west=WEST, north=NORTH)
    write_region(folder / "roi.gpkg", square())


def write_season(path: Path, passing: float, *, plants: float = 1.0, ground: bool = True, crs: int = 32651) -> Path:
    """A survey of the slope of ``write_site`` by 6 pulses a m², of which a share passes plants ``plants`` m high."""
    rng = np.random.default_rng([*path.name.encode()])
    xy = rng.uniform((WEST + 40, NORTH - 90), (WEST + 100, NORTH - 30), (21_600, 2))
    z = inclined(relief=2.0).at(xy) + rng.normal(0, 0.02, len(xy))
    passed = rng.uniform(size=len(xy)) < passing
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [WEST, NORTH, 0]
    header.add_crs(CRS.from_epsg(crs))
    las = laspy.LasData(header)
    las.x, las.y, las.z = *xy.T, np.where(passed, z, z + plants)
    las.return_number = las.number_of_returns = np.ones(len(xy), dtype=np.uint8)
    las.classification = np.where(passed & ground, 2, 5)
    las.write(path)
    return path


if __name__ == "__main__":
    target = Path(sys.argv[1])
    write_site(target)
    for name, share in SHARES.items():
        write_season(target / f"{name}.las", share)
