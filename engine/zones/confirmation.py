"""Which zones of a screened survey the change since an earlier one confirms."""

from __future__ import annotations

import math
from dataclasses import dataclass

import geopandas as gpd
import numpy as np
from affine import Affine
from numpy.typing import NDArray
from rasterio.features import geometry_mask
from shapely.geometry.base import BaseGeometry

from ..change.result import Change
from ..core.arrays import Float
from ..grid.grid import Grid
from ..grid.partition import Partition
from ..vector.cell_polygons import field_kinds, table_column

MIN_COMPARED_SHARE = 0.25
"""Share of a zone that must have been compared for a verdict on it."""
MIN_COMPARED_CELLS = 5
"""Compared cells that it takes, too: of fewer, one that noise made significant would decide."""
MIN_CONFIRMING_SHARE = 0.3
"""Part of what was compared in a zone from which significant change of its sign confirms it; see docs/guide.md."""
MIN_PARTLY_CONFIRMING_SHARE, MIN_PARTLY_CONFIRMING_CELLS = 0.15, 40
"""From this part on, of at least so many cells, some of the zone has moved; noise hardly ever reaches it."""
MAX_OPPOSITE_SHARE = 0.5
"""Significant change of the other sign on more than this part contradicts it."""

CONFIRMED, PARTLY, CONTRADICTED = "confirmed", "confirmed in part", "contradicted"
NOT_CONFIRMED, NOT_MEASURED = "not confirmed", "not measured"
VERDICTS = (CONFIRMED, PARTLY, CONTRADICTED, NOT_CONFIRMED, NOT_MEASURED)
FIELDS = field_kinds("""
    text: confirmed
    real: compared_share change_share opposite_share dz_signif_m
""")
_MAX_PARTS_PER_SIDE = 16


@dataclass(frozen=True)
class Evidence:
    """Evidence of the change for one zone: shares from 0 to 1, lengths in metres.

    ``compared`` is the part of the zone that has a change at all, ``cells`` how many cells of the raster that
    is, or equal blocks where cells grew; ``matching`` and ``opposite`` are the parts of these with significant change
    of the zone's sign and of the other; ``mean`` is the mean significant change in the zone. The last three are NaN
    where there is nothing to take them of.
    """

    compared: float
    cells: float
    matching: float
    opposite: float
    mean: float


def confirm_zones(frame: gpd.GeoDataFrame, change: Change, *, outline_cell: float) -> gpd.GeoDataFrame:
    """The zones with the columns ``FIELDS``.

    Where the whole overlap rose or sank (``change.uniform_dz``), the change is one of the heights' datum, and no zone
    counts as measured.

    Args:
        frame: zones with ``kind`` and ``geometry``, in the reference system of the change.
        outline_cell: cell (m) along whose edges the zones were drawn.
    """
    evidence = [
        weigh(geometry, 1.0 if kind == "uplift" else -1.0, change, outline_cell=outline_cell)
        for geometry, kind in zip(frame.geometry, frame["kind"], strict=True)
    ]
    biased = change.uniform_dz is not None
    columns = {
        "confirmed": [NOT_MEASURED if biased else verdict(e) for e in evidence],
        "compared_share": [e.compared for e in evidence],
        "change_share": [e.matching for e in evidence],
        "opposite_share": [e.opposite for e in evidence],
        "dz_signif_m": [e.mean for e in evidence],
    }
    typed = {
        name: table_column(np.array(columns[name], dtype=object if kind == "text" else np.float64), kind, len(frame))
        for name, kind in FIELDS.items()
    }
    return frame.assign(**{name: column.to_numpy() for name, column in typed.items()})


def verdict(evidence: Evidence) -> str:
    """One of ``VERDICTS``."""
    if evidence.compared < MIN_COMPARED_SHARE or evidence.cells < MIN_COMPARED_CELLS:
        return NOT_MEASURED
    if evidence.opposite > MAX_OPPOSITE_SHARE:
        return CONTRADICTED
    if evidence.matching <= evidence.opposite:
        return NOT_CONFIRMED
    if evidence.matching >= MIN_CONFIRMING_SHARE:
        return CONFIRMED
    partly = evidence.matching >= MIN_PARTLY_CONFIRMING_SHARE and evidence.cells >= MIN_PARTLY_CONFIRMING_CELLS
    return PARTLY if partly else NOT_CONFIRMED


def weigh(geometry: BaseGeometry, sign: float, change: Change, *, outline_cell: float) -> Evidence:
    """Evidence of ``change`` for the polygon ``geometry``, whose ground is raised (``sign`` 1) or lowered (-1).

    A cell counts with the part of it that lies inside.
    """
    window, weights = _inside(geometry, change.grid, outline_cell)
    dz = change.partition.layout.window(change.dz, window)
    weights = np.where(np.isfinite(dz), weights, 0.0)
    cells = float(weights.sum())
    significant = np.where(change.partition.layout.window(change.significant, window), weights, 0.0)
    moved = float(significant.sum())
    with np.errstate(invalid="ignore"):
        matching = float(significant[dz * sign > 0].sum())
    return Evidence(
        compared=min(1.0, cells * change.grid.cell**2 / geometry.area) if geometry.area else 0.0,
        cells=_witnesses(change.partition.window(window), weights),
        matching=matching / cells if cells else math.nan,
        opposite=(moved - matching) / cells if cells else math.nan,
        mean=float(np.nansum(significant * dz) / moved) if moved else math.nan,
    )


def _witnesses(partition: Partition, weights: Float) -> float:
    """The cells of which ``weights`` are inside, or how many equal blocks would give a share as precisely as those with
    these weights, of which a few may hold most (Kish 1965, Survey Sampling: the square of the sum over the sum of
    squares).
    """
    if partition.block is None:
        return float(weights.sum())
    each = np.bincount(partition.block[weights > 0], weights[weights > 0])
    return float(each.sum() ** 2 / (each**2).sum()) if each.size else 0.0


def _inside(geometry: BaseGeometry, grid: Grid, outline_cell: float) -> tuple[tuple[slice, slice], Float]:
    """The cells about a polygon, and the part (rows, columns) of each that lies inside it."""
    west, south, east, north = geometry.bounds
    columns = _span((west - grid.west) / grid.cell, (east - grid.west) / grid.cell, grid.columns)
    rows = _span((grid.north - north) / grid.cell, (grid.north - south) / grid.cell, grid.rows)
    shape = rows.stop - rows.start, columns.stop - columns.start
    if not all(shape):
        return (rows, columns), np.zeros(shape)
    # parts of a cell no larger than half a cell of the outline, each in or out by its middle
    parts = min(_MAX_PARTS_PER_SIDE, max(1, math.ceil(2.0 * grid.cell / outline_cell - 1e-9)))
    side = grid.cell / parts
    corner = grid.west + columns.start * grid.cell, grid.north - rows.start * grid.cell
    fine: NDArray[np.bool_] = geometry_mask(
        [geometry],
        out_shape=(shape[0] * parts, shape[1] * parts),
        transform=Affine(side, 0.0, corner[0], 0.0, -side, corner[1]),
        invert=True,
    )
    return (rows, columns), fine.reshape(shape[0], parts, shape[1], parts).mean(axis=(1, 3))


def _span(low: float, high: float, count: int) -> slice:
    first = min(max(math.floor(low), 0), count)
    return slice(first, min(max(math.ceil(high), first), count))
