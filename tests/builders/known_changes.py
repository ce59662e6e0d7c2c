"""Pairs of files with a known change, written by the engine's Python: ``python -m ... models|clouds FOLDER``."""

from __future__ import annotations

import sys
from pathlib import Path

import laspy
import numpy as np
from pyproj import CRS
from slopewatch.tests.builders import known_truth as truth
from slopewatch.tests.builders.elevation_models import hills, noise, write_model
from slopewatch.tests.builders.rough_ground import axes, relief, sampled


def write_models(folder: Path) -> list[Path]:
    """Two elevation models of hills; the later has a bias and a pit."""
    shape = (truth.MODEL_SIZE_M, truth.MODEL_SIZE_M)
    first, later = (hills(*shape) + noise(shape, 0.03, 3.0, seed) for seed in (1, 2))
    column, row = truth.PIT_WEST_NORTH_M
    later[row : row + truth.PIT_SIZE_M, column : column + truth.PIT_SIZE_M] += truth.PIT_M
    surfaces = zip(truth.DAYS, (first, later + truth.BIAS_M), strict=True)
    return [write_model(folder / f"{day}.tif", heights) for day, heights in surfaces]


def write_clouds(folder: Path) -> list[Path]:
    """Two clouds of rough ground; the northern half of the later moved down the dip."""
    heights = relief(truth.CLOUD_SIZE_M, 0.15, seed=7)
    first, later = (sampled(heights, 60.0, 0.02, seed, truth.DIP_DEG) for seed in (1, 2))
    north = later[:, 1] > np.median(later[:, 1])
    later[north] += truth.MOTION_M * axes(truth.DIP_DEG)[0]
    return [_written(folder / f"{day}.laz", xyz) for day, xyz in zip(truth.DAYS, (first, later), strict=True)]


def _written(path: Path, xyz: np.ndarray) -> Path:
    las = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
    las.header.scales, las.header.offsets = [0.001] * 3, np.floor(xyz.min(axis=0))
    las.header.add_crs(CRS.from_epsg(32651))
    las.xyz = xyz
    las.return_number[:], las.number_of_returns[:] = 1, 1
    las.write(path)
    return path


if __name__ == "__main__":
    {"models": write_models, "clouds": write_clouds}[sys.argv[1]](Path(sys.argv[2]))
