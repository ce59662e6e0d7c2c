"""Gridding (mean, variance, count) from memory, and PDAL's writers.gdal on the same points."""

from __future__ import annotations

import json
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np

from ...engine.grid.cell_statistics import cell_statistics
from ...engine.grid.grid import snapped_grid
from ...engine.pointcloud.pdal_program import find_pdal
from .table import Row

POINTS = 3_000_000
AREA = (60.0, 40.0)
CELL = 0.1
REPEATS = 3


def rows() -> list[Row]:
    """Points a second from memory, and the ratio to writers.gdal net of reading the file."""
    rng = np.random.default_rng(1)
    x, y = (rng.integers(0, int(side * 1000), POINTS) / 1000 for side in AREA)
    xyz = np.column_stack([500_000 + x, 3_500_000 + y, 50 + 0.8 * y + rng.normal(0, 0.03, POINTS)])
    grid = snapped_grid((*xyz[:, :2].min(0), *xyz[:, :2].max(0)), CELL)
    own = min(_seconds(lambda: cell_statistics(xyz, grid)) for _ in range(REPEATS))
    plane = min(_seconds(lambda: cell_statistics(xyz, grid, plane=True)) for _ in range(REPEATS))
    with tempfile.TemporaryDirectory() as folder:
        peer = _pdal_seconds(xyz, Path(folder))
    rate = POINTS / own / 1e6
    return [
        Row(
            "gridding, mean + variance + count",
            f"{rate:.1f} M points/s",
            "at least 10 M points/s",
            f"plane in the cell {POINTS / plane / 1e6:.1f} M points/s",
            rate >= 10,
        ),
        Row(
            "gridding, ratio to PDAL's writers.gdal",
            f"{peer / own:.0f} x",
            "at least 5 x",
            f"writers.gdal {POINTS / peer / 1e6:.2f} M points/s, net of reading (PDAL {find_pdal().version})",
            peer / own >= 5,
        ),
    ]


def _pdal_seconds(xyz: np.ndarray, folder: Path) -> float:
    """Seconds that writers.gdal adds to reading the file."""
    cloud = laspy.create(point_format=6, file_version="1.4")
    cloud.header.scales, cloud.header.offsets = [0.001] * 3, xyz.min(0).round()
    cloud.header.global_encoding.wkt = True  # PDAL expects it of point format 6
    cloud.x, cloud.y, cloud.z = xyz.T
    cloud.write(folder / "points.las")
    grid = {
        "type": "writers.gdal",
        "filename": str(folder / "grid.tif"),
        "resolution": CELL,
        "output_type": "mean,stdev,count",
        "data_type": "float32",
    }
    best = {}
    for name, writer in (("null", {"type": "writers.null"}), ("gdal", grid)):
        pipeline = json.dumps([str(folder / "points.las"), writer])
        command = [str(find_pdal().path), "pipeline", "--stdin"]
        best[name] = min(
            _seconds(lambda: subprocess.run(command, input=pipeline.encode(), check=True))  # noqa: B023
            for _ in range(2)
        )
    return best["gdal"] - best["null"]


def _seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start
