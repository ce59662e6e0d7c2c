"""Zones of cells as polygons, the inclination of their ground, and columns of their table."""

from __future__ import annotations

import numpy as np
import pandas as pd
import shapely
from affine import Affine
from numpy.typing import NDArray
from rasterio.features import shapes

from ..core.arrays import Float
from ..geometry.plane_gradient import gradient_parts
from ..grid.grid import Grid


def cell_polygons(labels: NDArray[np.int32], count: int, grid: Grid) -> NDArray[np.object_]:
    """One MultiPolygon a label, along the cells' edges.

    The parts are traced through edges only: a ring traced through corners would touch itself, which is not valid.
    """
    if not count:
        return np.empty(0, dtype=object)
    corners: list[tuple[float, float]] = []
    lengths: list[int] = []  # corners of each ring
    rings: list[int] = []  # rings of each part, the shell first
    owners: list[int] = []  # zone of each part
    for outline, label in shapes(labels, mask=labels > 0, connectivity=4, transform=Affine(*grid.affine)):
        rings.append(len(outline["coordinates"]))
        owners.append(int(label) - 1)
        for ring in outline["coordinates"]:
            lengths.append(len(ring))
            corners.extend(ring)
    loops = shapely.linearrings(np.array(corners), indices=np.repeat(np.arange(len(lengths)), lengths))
    parts = shapely.polygons(loops, indices=np.repeat(np.arange(len(rings)), rings))
    order = np.argsort(owners, kind="stable")
    return shapely.multipolygons(parts[order], indices=np.array(owners)[order])


def inclination(
    zone: NDArray[np.int64], inside: NDArray[np.int64], count: int, heights: NDArray[np.floating], grid: Grid
) -> Float:
    """Degrees to the horizontal of the least-squares plane through each zone's heights; NaN where there is none.

    Args:
        zone: (n,) zone of each cell, from 0.
        inside: (n,) flat index of each cell in the grid.
        heights: (n,) metres, NaN where unknown.
    """
    z = heights.astype(np.float64)
    known = np.isfinite(z)
    zone, z = zone[known], z[known]
    row, column = np.divmod(inside[known], grid.columns)
    cells = np.bincount(zone, minlength=count)

    def centred(values: NDArray) -> Float:
        values = values.astype(np.float64)
        with np.errstate(invalid="ignore", divide="ignore"):
            return values - (np.bincount(zone, weights=values, minlength=count) / cells)[zone]

    x, y, z = centred(column * grid.cell), centred(-row * grid.cell), centred(z)

    def total(products: Float) -> Float:
        return np.bincount(zone, weights=products, minlength=count).astype(np.float64, copy=False)

    xx, yy, xy, xz, yz = (total(w) for w in (x * x, y * y, x * y, x * z, y * z))
    east, north, determinant = gradient_parts(xx, yy, xy, xz, yz)
    with np.errstate(invalid="ignore", divide="ignore"):
        a, b = east / determinant, north / determinant
    # cells in one line leave the plane free to turn about it
    return np.where(determinant > 1e-9 * (xx + yy) ** 2, np.degrees(np.arctan(np.hypot(a, b))), np.nan)


def field_kinds(table: str) -> dict[str, str]:
    """Kind by field, in order, from lines such as ``real: chain_from chain_to``."""
    lines = (line.split(":") for line in table.strip().splitlines())
    return {name: kind.strip() for kind, names in lines for name in names.split()}


def table_column(values: NDArray | None, kind: str, count: int) -> pd.Series:
    """A column of ``kind`` text, integer or real with ``count`` rows; without values it is empty."""
    if kind == "text":
        return pd.Series(np.full(count, "", dtype=object) if values is None else values, dtype=object)
    if kind == "integer":
        return pd.Series([pd.NA] * count if values is None else values, dtype="Int64")
    # micrometres and cubic centimetres: what lies beyond is noise that clutters the attribute table
    return pd.Series(np.full(count, np.nan) if values is None else np.round(values, 6), dtype=np.float64)
