"""From screened voxels to a map: probabilities on a grid, and zones of hazard cells as polygons with their figures."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import geopandas as gpd
import numpy as np
from numpy.typing import NDArray
from pyproj import CRS
from scipy import ndimage

from ...engine.core.arrays import Float
from ...engine.core.errors import InputError
from ...engine.crs.working_frame import horizontal
from ...engine.grid.grid import Grid, cell_index, snapped_grid
from ...engine.grid.partition import Partition
from ...engine.vector.cell_polygons import cell_polygons, inclination, table_column
from ...engine.vector.review_fields import LOCATION_FIELDS, UNREVIEWED
from ...engine.zones.groups import label_groups
from ...interface.parameters import ScreeningParameters, ZoneParameters
from .labels import SUBSIDENCE
from .much_marked import much_stands_out
from .result import Screening

# Name and kind of every field, in the order of the attribute table.
FIELDS: dict[str, str] = {
    "zone_id": "text",
    "slope_id": "text",
    "route": "text",
    "chain_from": "real",
    "chain_to": "real",
    "side": "text",
    **LOCATION_FIELDS,
    "class": "integer",
    "kind": "text",
    "confidence": "text",
    "probability": "real",
    "height_med_m": "real",
    "height_p95_m": "real",
    "area_m2": "real",
    "plan_m2": "real",
    "slope_deg": "real",
    "points": "integer",
    "n_cells": "integer",
    "review_status": "text",
    "reviewer": "text",
    "remarks": "text",
    "method": "text",
    "run_id": "text",
}
KINDS = ("", "uplift", "subsidence")
GRADES = ("high", "medium", "low")
HIGH, MEDIUM = 0.85, 0.65
"""Mean probability of a zone from which its confidence is high, or medium; see ``_confidence``."""
UNLEARNED = ("residual", "filter")
"""Methods whose memberships are no probabilities."""
_MIN_SURE_POINTS, _MIN_SURE_AREA_M2 = 50, 1.0
_MAX_CELLS = 25_000_000  # about 2 GB while they are worked on
_BRIDGED_CELLS = 2.0  # cells


@dataclass(frozen=True)
class Hazards:
    """Rasters (rows, columns) on ``grid``, NaN where nothing was screened, and zones.

    ``probability`` (3, rows, columns) of background, uplift and subsidence; ``labels`` uint8, background where nothing
    was screened; ``heights`` over the trend, m; ``smallest`` by width (m) the height that a hazard needs to be found,
    NaN also where that is not known. ``frame`` has a row a zone, most certain first, with columns ``FIELDS``
    and a MultiPolygon ``geometry``.
    """

    grid: Grid
    probability: NDArray[np.float32]
    labels: NDArray[np.uint8]
    heights: NDArray[np.float32]
    smallest: dict[float, NDArray[np.float32]]
    frame: gpd.GeoDataFrame


def outline_hazards(
    screening: Screening, crs: CRS | None, parameters: ScreeningParameters, *, run_id: str = ""
) -> Hazards:
    """Put the voxels on a grid and join hazard cells of one class into zones.

    A cell has the mean probability of its points. Where voxels are wider than cells, or farther apart, a cell between
    them has no point and takes after the nearest. Cells of one class that share an edge or a corner are a zone; empty
    cells between them, up to two in a row, do not divide it.

    Raises:
        InputError: the grid would be too large.
    """
    grid = _grid(screening.points, parameters.probability_cell)
    index = cell_index(screening.points, grid)
    count = np.bincount(index, weights=screening.count, minlength=grid.rows * grid.columns)

    def mean(values: NDArray[np.floating]) -> Float:
        with np.errstate(invalid="ignore"):
            total = np.bincount(index, weights=values * screening.count, minlength=len(count))
            return np.asarray(total / count, dtype=np.float64).reshape(grid.shape)

    probability = np.stack([mean(screening.probabilities[:, k]) for k in range(3)])
    heights = mean(screening.heights)
    needed = screening.detectable.heights
    # NaN where that of one of its voxels is not known
    smallest = np.stack([mean(values) for values in needed]) if len(needed) else np.empty((0, *grid.shape))
    labels = screening.decision.of_cells(index, screening.count, probability.reshape(3, -1).T).reshape(grid.shape)
    known = (count > 0).reshape(grid.shape)
    for cells, (row, column) in _between(known, math.ceil(screening.bridged / grid.cell - 1e-9) - 1):
        probability[:, cells], heights[cells] = probability[:, row, column], heights[row, column]
        smallest[:, cells], labels[cells] = smallest[:, row, column], labels[row, column]
        known |= cells
    signed = np.where(known, np.where(labels == SUBSIDENCE, -1.0, 1.0), np.nan)
    joined = label_groups(
        signed,
        labels > 0,
        ZoneParameters(
            minimum_area=parameters.minimum_hazard_area, minimum_cells=2, bridged_gap=_BRIDGED_CELLS * grid.cell
        ),
        Partition(grid.shape, grid.cell),
    )
    found = int(joined.max(initial=0))
    order, columns = _figures(joined, found, labels, probability, screening, index, grid)
    renumbered = np.zeros(found + 1, dtype=np.int32)
    renumbered[order + 1] = np.arange(1, len(order) + 1)
    columns |= {
        name: np.full(len(order), text, dtype=object)
        for name, text in {
            "method": _method(screening),
            "run_id": run_id,
            "review_status": UNREVIEWED,
        }.items()
    }
    columns["zone_id"] = np.array([f"H{i:03d}" for i in range(1, len(order) + 1)], dtype=object)
    frame = gpd.GeoDataFrame(
        {name: table_column(columns.get(name), kind, len(order)) for name, kind in FIELDS.items()},
        geometry=cell_polygons(renumbered[joined], len(order), grid),
        crs=horizontal(crs),
    )
    by_width = dict(zip(screening.detectable.diameters, smallest.astype(np.float32), strict=True))
    return Hazards(grid, probability.astype(np.float32), labels, heights.astype(np.float32), by_width, frame)


def _between(known: NDArray[np.bool_], reach: int) -> Iterator[tuple[NDArray[np.bool_], tuple[NDArray, NDArray]]]:
    """Cells in gaps of up to ``2 * reach`` cells, and the cells (row, column) they take after, from the edges inwards.

    What is yielded is to be marked in ``known`` before the next is asked for. The outer edge stays where it is.
    """
    if reach < 1:
        return
    closed = ndimage.binary_closing(np.pad(known, reach), np.ones((3, 3)), iterations=reach)
    closed = closed[reach:-reach, reach:-reach]
    while (closed & ~known).any():
        distance, (row, column) = ndimage.distance_transform_edt(~known, return_indices=True)
        # only neighbours at a time, so that what takes after a cell is connected with it
        cells = closed & ~known & (distance < 1.5)
        yield cells, (row[cells], column[cells])


def _grid(points: Float, cell: float) -> Grid:
    # a little wider to the east and north: cell_index rounds a point that nearly touches a cell's edge into that cell
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0) + 1e-5 * cell
    grid = snapped_grid((float(low[0]), float(low[1]), float(high[0]), float(high[1])), cell)
    if grid.rows * grid.columns > _MAX_CELLS:
        raise InputError(
            f"The probability raster would have {grid.rows} x {grid.columns} cells; give a probability_cell above "
            f"{cell:g} m, or cut the cloud with --roi."
        )
    return grid


def _figures(
    joined: NDArray[np.int32],
    count: int,
    labels: NDArray[np.uint8],
    probability: Float,
    screening: Screening,
    index: NDArray[np.int64],
    grid: Grid,
) -> tuple[NDArray[np.int64], dict[str, NDArray]]:
    """The zones' order, the most certain first, and their columns in that order."""
    inside = np.flatnonzero(joined)
    zone = joined.ravel()[inside].astype(np.int64) - 1
    cells = np.bincount(zone, minlength=count)
    kind = np.zeros(count, dtype=np.int64)
    kind[zone] = labels.ravel()[inside]
    own = probability.reshape(3, -1)[labels.ravel()[inside], inside]
    points = np.bincount(index, weights=screening.count, minlength=grid.rows * grid.columns)[inside]
    mean = np.bincount(zone, weights=own * points, minlength=count) / np.bincount(zone, points, minlength=count)
    sign = np.where(kind == SUBSIDENCE, -1.0, 1.0)
    median, extreme = _heights(joined, count, sign, screening, index)
    slope = inclination(zone, inside, count, _surface(screening, index, grid).ravel()[inside], grid)
    # a zone of cells in one line has no plane of its own
    slope = np.where(np.isfinite(slope), slope, screening.plane.dip)
    plan = cells * grid.cell**2
    columns: dict[str, NDArray] = {
        "class": kind,
        "kind": np.array(KINDS, dtype=object)[kind],
        "probability": mean,
        "height_med_m": median,
        "height_p95_m": extreme,
        "area_m2": plan / np.cos(np.radians(np.minimum(slope, 85.0))),
        "plan_m2": plan,
        "slope_deg": slope,
        "points": np.bincount(zone, weights=points, minlength=count).astype(np.int64),
        "n_cells": cells,
    }
    rank = _confidence(columns, learned=screening.method not in UNLEARNED)
    if much_stands_out(screening.labels, screening.count):
        rank[:] = GRADES.index("low")
    columns["confidence"] = np.array(GRADES, dtype=object)[rank]
    order = np.lexsort((np.arange(count), -columns["area_m2"], rank))
    return order, {name: column[order] for name, column in columns.items()}


def _confidence(columns: dict[str, NDArray], *, learned: bool) -> NDArray[np.int64]:
    """0 high, 1 medium, 2 low.

    By the mean probability; one step lower where the zone is small or has few points, or where its median height over
    the trend has not the sign of its class; never high without learning.
    """
    rank = np.where(columns["probability"] >= HIGH, 0, np.where(columns["probability"] >= MEDIUM, 1, 2))
    sign = np.where(columns["class"] == SUBSIDENCE, -1.0, 1.0)
    doubtful = (
        (columns["area_m2"] < _MIN_SURE_AREA_M2)
        | (columns["points"] < _MIN_SURE_POINTS)
        | (columns["height_med_m"] * sign <= 0)
    )
    return np.clip(rank + doubtful, 0 if learned else 1, 2).astype(np.int64)


def _heights(
    joined: NDArray[np.int32], count: int, sign: Float, screening: Screening, index: NDArray[np.int64]
) -> tuple[Float, Float]:
    """Median height over the trend of each zone's voxels, and the height that 95 % of them keep within, both signed."""
    owner = joined.ravel()[index].astype(np.int64) - 1
    inside = owner >= 0
    owner, height = owner[inside], screening.heights[inside].astype(np.float64)
    order = np.argsort(owner, kind="stable")
    parts = np.split(height[order], np.cumsum(np.bincount(owner, minlength=count))[:-1]) if count else []
    median = np.array([np.median(part) for part in parts])
    extreme = np.array([s * np.percentile(s * part, 95) for s, part in zip(sign, parts, strict=True)])
    return median, extreme


def _surface(screening: Screening, index: NDArray[np.int64], grid: Grid) -> Float:
    """Mean height (rows, columns) of each cell, m; NaN without points."""
    number = np.bincount(index, minlength=grid.rows * grid.columns)
    with np.errstate(invalid="ignore"):
        mean = np.bincount(index, weights=screening.points[:, 2], minlength=len(number)) / number
    return np.asarray(mean, dtype=np.float64).reshape(grid.shape)


def _method(screening: Screening) -> str:
    name = str(screening.model.get("name", ""))
    digest = str(screening.model.get("sha256", ""))
    return " ".join(dict.fromkeys(word for word in (screening.method, name, digest[:12]) if word))
