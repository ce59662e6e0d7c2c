"""Elevation models of a known surface, and their files as other programs write them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import rasterio
from affine import Affine
from numpy.typing import NDArray
from rasterio.transform import from_origin
from scipy import ndimage

WEST, NORTH = 500_000.0, 3_300_000.0


def hills(rows: int, columns: int, cell: float = 1.0, *, east: float = 0.0, north: float = 0.0) -> NDArray[np.float64]:
    """Hills and valleys of some 10 m at the middles of the cells, all moved by ``east`` and ``north`` metres."""
    x = (np.arange(columns) + 0.5) * cell - east
    y = -(np.arange(rows)[:, None] + 0.5) * cell - north
    return hills_at(x, y)


def hills_at(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """The surface of ``hills``, metres from ``WEST`` and ``NORTH``, where y is negative."""
    heights = 50.0 + 6.0 * np.sin(x / 17.0 + 0.4 * y / 17.0) + 4.0 * np.cos(y / 11.0) + 2.0 * np.sin((x - y) / 6.0)
    return np.asarray(heights + 0.05 * x)


def noise(shape: tuple[int, int], sigma: float, reach: float, seed: int) -> NDArray[np.float64]:
    """Errors of the standard deviation ``sigma`` that are alike over some ``reach`` cells."""
    white = np.random.default_rng(seed).normal(size=shape)
    smooth = ndimage.gaussian_filter(white, reach / 2.0, mode="wrap") if reach else white
    return np.asarray(sigma * smooth / smooth.std())


def write_model(
    path: Path,
    heights: NDArray,
    *,
    cell: float = 1.0,
    crs: str | None = "EPSG:32651",
    nodata: float | None = -9999.0,
    west: float = WEST,
    north: float = NORTH,
    dtype: str = "float32",
    unit: str = "",
) -> Path:
    """A GeoTIFF of one band, or of several (bands, rows, columns); NaN becomes ``nodata``."""
    bands = heights if heights.ndim == 3 else heights[None]
    filled = bands if nodata is None else np.where(np.isnan(bands), nodata, bands)
    profile = {"count": len(bands), "height": bands.shape[1], "width": bands.shape[2], "dtype": dtype}
    transform = from_origin(west, north, cell, cell)
    with rasterio.open(path, "w", driver="GTiff", crs=crs, transform=transform, nodata=nodata, **profile) as target:
        target.write(filled.astype(dtype))
        if unit:
            target.units = (unit,) * len(bands)
    return path


def write_turned(
    path: Path,
    angle: float,
    sides: tuple[float, float],
    shape: tuple[int, int],
    *,
    shear: float = 0.0,
    upside_down: bool = False,
    middle: tuple[float, float] = (WEST + 35.0, NORTH - 30.0),
    noise_m: float = 0.0,
    raised: Callable[[NDArray, NDArray], NDArray] | None = None,
) -> Path:
    """The surface of ``hills`` on a grid that is turned counterclockwise by ``angle`` degrees about its ``middle``.

    Args:
        sides: width and height of a cell, metres.
        shape: rows and columns.
        shear: degrees by which the columns lean.
        upside_down: the first row is the southernmost.
        raised: what is added to the heights, from x and y in metres from ``WEST`` and ``NORTH``.
    """
    rows, columns = shape
    flip = 1.0 if upside_down else -1.0
    affine = (
        Affine.translation(*middle)
        * Affine.rotation(angle)
        * Affine.shear(shear)
        * Affine.scale(sides[0], flip * sides[1])
        * Affine.translation(-columns / 2, -rows / 2)
    )
    column, row = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
    x, y = affine * (column, row)
    heights = hills_at(x - WEST, y - NORTH)
    if raised is not None:
        heights = heights + raised(x - WEST, y - NORTH)
    if noise_m:
        heights = heights + np.random.default_rng(7).normal(0.0, noise_m, shape)
    profile = {"count": 1, "height": rows, "width": columns, "dtype": "float32", "nodata": -9999.0}
    with rasterio.open(path, "w", driver="GTiff", crs="EPSG:32651", transform=affine, **profile) as target:
        target.write(heights.astype("float32")[None])
    return path
