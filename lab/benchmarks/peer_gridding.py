"""Heights of cells against PDAL's writers.gdal, gdal_grid and SciPy: a known plane, and real ground held back."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pandas
import rasterio
import scipy
from scipy.ndimage import map_coordinates

from ...engine.core.arrays import Float
from ...engine.core.version import VERSION
from ...engine.grid.grid import Grid, snapped_grid
from ...engine.pointcloud.pdal_program import find_pdal
from .peer_case import Case, Judged, Tool, own_tool
from .peers import PeerMissingError
from .strips import FILE

AREA_M, SLOPES, NOISE_M = (60.0, 40.0), (0.3, 0.8), 0.03
POINTS, QUICK_POINTS = 2_000_000, 200_000
CELL_M, REAL_CELL_M = 0.1, 1.0
HEAD = """
import json, sys, time
import numpy as np
folder = sys.argv[1]
xyz = np.load(f"{folder}/points.npy")
west, north, cell, rows, columns = np.load(f"{folder}/grid.npy")
rows, columns = int(rows), int(columns)
"""
TAIL = """
np.save(f"{folder}/found/height.npy", height)
print(json.dumps({"seconds": taken[0], "cpu": taken[1]}))
"""
OWN = (
    HEAD
    + """
from slopewatch.engine.grid.cell_statistics import cell_statistics
from slopewatch.engine.grid.grid import Grid
started, cpu = time.perf_counter(), time.process_time()
found = cell_statistics(xyz, Grid(west, north, cell, rows, columns), plane=True)
taken = time.perf_counter() - started, time.process_time() - cpu
height = np.full(rows * columns, np.nan)
height[found.cell] = found.height
"""
    + TAIL
)
SCIPY = (
    HEAD
    + """
from scipy.stats import binned_statistic_dd
edges = north - cell * np.arange(rows, -1, -1), west + cell * np.arange(columns + 1)
started, cpu = time.perf_counter(), time.process_time()
place = None
for kind in ("mean", "std", "count"):
    found = binned_statistic_dd(xyz[:, 1::-1], xyz[:, 2], kind, bins=edges, binned_statistic_result=place)
    place = place or found
    height = found.statistic if kind == "mean" else height
taken = time.perf_counter() - started, time.process_time() - cpu
height = height[::-1]
"""
    + TAIL
)


def cases(quick: bool) -> list[Case]:
    """An inclined plane with noise, whose height at each cell's centre is known; half of a real gullied hillside."""
    tools = (
        own_tool("SlopeWatch cells with planes", VERSION, OWN),
        _pdal(),
        _gdal_grid(),
        own_tool("SciPy binned_statistic_dd", scipy.__version__, SCIPY, peer=True),
    )
    count = QUICK_POINTS if quick else POINTS
    found = [
        Case("gridding", f"simulated plane, {count / 1e6:g} M points", lambda f: _plane(f, count), _judge_plane, tools)
    ]
    if FILE.exists():
        found.append(
            Case("gridding", "real gullied hillside, half held back", lambda f: _hillside(f, quick), _judge_held, tools)
        )
    return found


def _plane(folder: Path, count: int) -> Grid:
    rng = np.random.default_rng(1)
    x, y = (rng.integers(0, int(side * 1000), count) / 1000 for side in AREA_M)
    xyz = np.column_stack(
        [500_000 + x, 3_500_000 + y, 50 + SLOPES[0] * x + SLOPES[1] * y + rng.normal(0, NOISE_M, count)]
    )
    return _write(folder, xyz, CELL_M if count > QUICK_POINTS else 4 * CELL_M)


def _hillside(folder: Path, quick: bool) -> tuple[Grid, Float]:
    """Every second point is gridded; the others are the truth."""
    xyz = np.array(laspy.read(FILE).xyz)
    if quick:
        xyz = xyz[(xyz[:, :2] < np.median(xyz[:, :2], axis=0)).all(axis=1)]
    half = np.random.default_rng(1).permutation(len(xyz)) < len(xyz) // 2
    return _write(folder, xyz[half], REAL_CELL_M), xyz[~half]


def _write(folder: Path, xyz: Float, cell: float) -> Grid:
    """The points as an array, a LAS file and a table with its layer for GDAL; the grid."""
    grid = snapped_grid((*xyz[:, :2].min(0), *xyz[:, :2].max(0)), cell)
    np.save(folder / "points.npy", xyz)
    np.save(folder / "grid.npy", np.array([grid.west, grid.north, grid.cell, grid.rows, grid.columns]))
    cloud = laspy.create(point_format=6, file_version="1.4")
    cloud.header.scales, cloud.header.offsets = [0.001] * 3, xyz.min(0).round()
    cloud.header.global_encoding.wkt = True  # PDAL expects it of point format 6
    cloud.x, cloud.y, cloud.z = xyz.T
    cloud.write(folder / "points.las")
    pandas.DataFrame(xyz, columns=["x", "y", "z"]).to_csv(folder / "points.csv", index=False, float_format="%.3f")
    layer = (
        f'<OGRVRTDataSource><OGRVRTLayer name="points"><SrcDataSource>{folder / "points.csv"}</SrcDataSource>'
        '<GeometryType>wkbPoint25D</GeometryType><GeometryField encoding="PointFromColumns" x="x" y="y" z="z"/>'
        "</OGRVRTLayer></OGRVRTDataSource>"
    )
    (folder / "points.vrt").write_text(layer, encoding="utf-8")
    return grid


def _grid(folder: Path) -> Grid:
    west, north, cell, rows, columns = np.load(folder / "grid.npy")
    return Grid(float(west), float(north), float(cell), int(rows), int(columns))


def _pdal() -> Tool:
    program = find_pdal()

    def command(folder: Path, writer: dict[str, Any]) -> list[str]:
        if program.path is None:
            raise PeerMissingError("there is no pdal program here")
        pipeline = folder / f"{writer['type']}.json"
        pipeline.write_text(json.dumps([str(folder / "points.las"), writer]), encoding="utf-8")
        return [str(program.path), "pipeline", str(pipeline)]

    def writer(folder: Path) -> dict[str, Any]:
        grid = _grid(folder)
        return {
            "type": "writers.gdal",
            "filename": str(folder / "found" / "grid.tif"),
            "resolution": grid.cell,
            "radius": grid.cell / np.sqrt(2),  # else its circles reach twice as far
            "origin_x": grid.west,
            "origin_y": grid.north - grid.rows * grid.cell,
            "width": grid.columns,
            "height": grid.rows,
            "output_type": "mean,stdev,count",
            "data_type": "float64",
        }

    return Tool(
        "PDAL writers.gdal",
        program.version,
        lambda folder: command(folder, writer(folder)),
        lambda folder: command(folder, {"type": "writers.null"}),
    )


def _gdal_grid() -> Tool:
    """Means of circles that hold the cell; the same of one cell is what reading its table takes."""
    program = shutil.which("gdal_grid")
    said = subprocess.run([program, "--version"], capture_output=True, text=True, check=False) if program else None
    number = said.stdout.split(",")[0].removeprefix("GDAL ") if said else ""

    def command(folder: Path, whole: bool) -> list[str]:
        if program is None:
            raise PeerMissingError("there is no gdal_grid here")
        grid = _grid(folder)
        size = (grid.columns, grid.rows) if whole else (1, 1)
        east, south = grid.west + grid.columns * grid.cell, grid.north - grid.rows * grid.cell
        radius = grid.cell / np.sqrt(2)
        words: list[object] = [program, "-q", "-l", "points", "-ot", "Float64", "-of", "GTiff"]
        words += ["-a", f"average:radius1={radius:.6f}:radius2={radius:.6f}:nodata=-9999"]
        words += ["-txe", grid.west, east, "-tye", grid.north, south, "-outsize", *size]
        return [str(word) for word in (*words, folder / "points.vrt", folder / "found" / "grid.tif")]

    return Tool("gdal_grid average", number, lambda f: command(f, True), lambda f: command(f, False))


def heights(grid: Grid, found: Path) -> Float:
    """What a tool wrote as rows from the north, NaN where there is nothing."""
    if (found / "height.npy").exists():
        return np.load(found / "height.npy").reshape(grid.shape)
    with rasterio.open(found / "grid.tif") as raster:
        height = raster.read(1, masked=True).filled(np.nan).astype(np.float64)
        place = raster.transform
    if place.e > 0:
        height, north = height[::-1], place.f + height.shape[0] * place.e
    else:
        north = place.f
    return on(grid, height, north, place.c)


def on(grid: Grid, height: Float, north: float, west: float) -> Float:
    """A raster (rows, columns) on a grid, by its north-western corner: PDAL's can lie a row beside the grid."""
    row, column = round((grid.north - north) / grid.cell), round((west - grid.west) / grid.cell)
    found = np.full(grid.shape, np.nan)
    rows = slice(max(row, 0), min(row + height.shape[0], grid.rows))
    columns = slice(max(column, 0), min(column + height.shape[1], grid.columns))
    found[rows, columns] = height[rows.start - row : rows.stop - row, columns.start - column : columns.stop - column]
    return found


def _judge_plane(truth: Grid, found: Path, printed: Mapping[str, Any]) -> Judged:
    height = heights(truth, found)
    y = truth.north - (np.arange(truth.rows) + 0.5) * truth.cell - 3_500_000
    x = truth.west + (np.arange(truth.columns) + 0.5) * truth.cell - 500_000
    return _judged(height - (50 + SLOPES[0] * x + SLOPES[1] * y[:, None]), "cells")


def _judge_held(truth: tuple[Grid, Float], found: Path, printed: Mapping[str, Any]) -> Judged:
    """Between the centres of four cells heights are interpolated."""
    grid, held = truth
    row = (grid.north - held[:, 1]) / grid.cell - 0.5
    column = (held[:, 0] - grid.west) / grid.cell - 0.5
    height = map_coordinates(heights(grid, found), [row, column], order=1, cval=np.nan)
    return _judged(height - held[:, 2], "points held back")


def _judged(error: Float, what: str) -> Judged:
    known = np.isfinite(error)
    rms = 1000 * float(np.sqrt(np.mean(error[known] ** 2)))
    return Judged(rms, f"{rms:.1f} mm rms at {100 * known.mean():.1f} % of the {what}")
