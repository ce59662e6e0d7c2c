"""Figures of a change for its run record, in addition to the main ones: what the report's tables and histograms
show.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import geopandas as gpd
import numpy as np
import pandas as pd
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from ..change.result import Change
from ..core.arrays import Float
from ..epochs.epoch import Epoch
from ..grid.grid import Grid
from ..maps.palette import rounded_up
from ..statistics.layout import Laid, Layout, laid, layout_of
from ..statistics.robust import nmad
from ..vector.review_fields import is_located

_HALF_BINS = 60
_MAX_ZONES = 100
_DAYS_PER_YEAR = 365.25
_COURSE = (
    "epoch", "days", "dz_mean_m", "dz_err_m", "area_m2", "vol_net_m3", "vol_err_m3", "vol_measured", "days_before",
    "rate_mm_day", "rate_err", "motion_m", "motion_err_m", "alert_level", "alert_state", "alert_reason",
)  # fmt: skip
ROAD_WORDS = ("route", "side", "carriageway", "location", "location_note")
"""Fields with words of a zone's place on a road."""
_SLOPE_LIMITS_DEG = (0.0, 15.0, 30.0, 45.0, 60.0, 90.0)  # degrees, classes of the level's table


def change_facts(
    change: Change, frame: gpd.GeoDataFrame, epochs: tuple[Epoch, Epoch], crs: CRS, limit: float
) -> dict[str, Any]:
    """Entries for the run record.

    Args:
        frame: the zones, the most severe first.
        limit: end of the pictures' colour scale, metres.
    """
    days = days_between(*epochs)
    return {
        "epochs": [{"name": e.name, "date": e.date.isoformat() if e.date else None} for e in epochs],
        "days": days,
        "reference_system": {"name": crs.name, "epsg": crs.to_epsg()},
        "grid": {"cell_m": change.grid.cell, "rows": change.grid.rows, "columns": change.grid.columns},
        "cell": None if change.choice is None else change.choice.facts(),
        "cell_sizes": cell_sizes(change),
        "colour_limit_m": limit,
        "uniform_dz_m": change.uniform_dz,
        "level": level_facts(change),
        "distribution": distribution(change, limit),
        "stable_ground": stable_ground(change),
        "density": [density(count, change.grid, change.layout) for count in change.points],
        "rates": None if days is None else rates(change, days),
        "zones": zone_rows(frame, ("severity", "movement", *ROAD_WORDS)),
    }


def distribution(change: Change, limit: float) -> dict[str, Any]:
    """Counts of cells in bins of dz that have an edge at zero: all that were compared, those beyond, stable ones."""
    dz = change.dz[change.valid]
    reach = rounded_up(max(1.5 * limit, 3.0 * change.median_level, float(np.percentile(np.abs(dz), 99.8)), 1e-3))
    edges = np.linspace(-reach, reach, 2 * _HALF_BINS + 1)
    chosen = {
        "compared": change.valid,
        "beyond": change.valid & change.significant,
        "stable": change.valid & change.stable,
    }
    counts = {name: np.histogram(change.dz[cells], edges)[0].tolist() for name, cells in chosen.items()}
    outside = int((dz < -reach).sum()), int((dz > reach).sum())
    return {
        "cells": int(dz.size),
        "bin_m": reach / _HALF_BINS,
        "reach_m": reach,
        "lower": outside[0],
        "higher": outside[1],
        **counts,
    }


def stable_ground(change: Change) -> dict[str, Any] | None:
    """How the change scatters where the ground is taken as stable; None without such cells.

    ``beyond_share``: part of these cells beyond their own level of detection.
    """
    cells = change.valid & change.stable
    dz = change.dz[cells]
    if not dz.size:
        return None
    median = float(np.median(dz))
    return {
        "cells": int(dz.size),
        "share": float(dz.size / change.valid.sum()),
        "median_m": median,
        "nmad_m": nmad(dz, median),
        "rms_m": float(np.sqrt(np.mean(dz**2))),
        "beyond_share": float(change.beyond[cells].mean()),
    }


def level_facts(change: Change) -> dict[str, Any]:
    """The level of detection: percentiles, and its median by the surface's inclination."""
    level, slope = change.level[change.valid], change.slope[change.valid]
    classes = []
    for low, high in pairwise(_SLOPE_LIMITS_DEG):
        cells = (slope >= low) & ((slope < high) | (high == _SLOPE_LIMITS_DEG[-1]))
        if cells.any():
            classes.append(
                {
                    "slope_from_deg": low,
                    "slope_to_deg": high,
                    "cells": int(cells.sum()),
                    "median_m": float(np.median(level[cells])),
                    "p95_m": float(np.percentile(level[cells], 95)),
                }
            )
    low, median, high = (float(v) for v in np.percentile(level, (5, 50, 95)))
    return {"p05_m": low, "median_m": median, "p95_m": high, "by_slope": classes}


def error_terms(change: Change) -> list[dict[str, Any]]:
    """Parts of the cells' errors: median standard error, metres, and share of the cells where it is the largest.

    Without knowledge of plants there are no terms to be distinguished.
    """
    if change.plants is None or change.sampling is None:
        return []
    parts = {
        "points": change.sampling,
        "registration": np.full(change.dz.shape, change.registration_error),
        "plants": change.plants.error,
    }
    values = np.stack([part[change.valid] for part in parts.values()])
    largest = np.argmax(values, axis=0)
    return [
        {"term": name, "median_m": float(np.median(part)), "largest_share": float(np.mean(largest == number))}
        for number, (name, part) in enumerate(zip(parts, values, strict=True))
    ]


def cell_sizes(change: Change) -> list[dict[str, Any]]:
    """Where cells grew: their number, area and median level by their side, the smallest first; else nothing."""
    if not change.partition.grown:
        return []
    rows, sizes = [], change.partition.sizes
    for side in np.unique(sizes[change.valid]):
        cells = sizes == side
        rows.append(
            {
                "side_m": round(float(side), 6),
                "cells": change.partition.parts_among(cells),
                "area_m2": float(cells.sum() * change.grid.cell**2),
                "share": float(cells.sum() / change.valid.sum()),
                "level_median_m": float(np.median(change.level[cells])),
            }
        )
    return rows


def density(count: NDArray[np.signedinteger[Any]], grid: Grid, layout: Layout | None = None) -> dict[str, Any]:
    """Ground points of one epoch a square metre of the map, over the blocks (of a metre at least) that it reached."""
    side = block_cells(grid)
    blocks = (layout or layout_of(count)).block_sums(count, side) / (side * grid.cell) ** 2
    reached = blocks[blocks > 0]
    p05, median, p95 = (float(v) for v in np.percentile(reached, (5, 50, 95)))
    return {
        "points": int(count.sum()),
        "reached_cells": int((count > 0).sum()),
        "p05_points_m2": p05,
        "median_points_m2": median,
        "p95_points_m2": p95,
    }


def points_a_square_metre(count: NDArray[Any] | Laid, grid: Grid, block: float = 1.0) -> Float:
    """Density in blocks of as many whole cells as make at least ``block`` metres, of whole numbers of points."""
    side = block_cells(grid, block)
    total = laid(count).layout.block_sums(laid(count).values, side)
    return np.asarray(total / (side * grid.cell) ** 2)


def block_cells(grid: Grid, block: float = 1.0) -> int:
    """Cells a side of a block of at least ``block`` metres."""
    return max(1, math.ceil(block / grid.cell - 1e-9))


def rates(change: Change, days: int) -> dict[str, Any]:
    """What a steady movement must be to reach the level of detection within the interval, at half of the cells."""
    detectable = 1000.0 * change.median_level / days
    return {
        "days": days,
        "years": days / _DAYS_PER_YEAR,
        "detectable_mm_day": detectable,
        "detectable_mm_year": detectable * _DAYS_PER_YEAR,
    }


def zone_rows(frame: gpd.GeoDataFrame, texts: tuple[str, ...] = ("severity", "movement")) -> list[dict[str, Any]]:
    """The first hundred zones as rows of a table, with a point inside each; fields that are empty are left out.

    Args:
        texts: fields with words that the rows keep, in addition to id and kind.
    """
    first = frame.iloc[:_MAX_ZONES]
    points = shapely.get_coordinates(shapely.point_on_surface(np.asarray(first.geometry)))
    texts = tuple(name for name in texts if name not in ROAD_WORDS or is_located(first))
    numbers = [name for name in first.columns if pd.api.types.is_numeric_dtype(first[name].dtype)]
    fields = ["zone_id", "kind", *texts, *numbers]
    rows = []
    for (_, row), (x, y) in zip(first.iterrows(), points.tolist(), strict=True):
        values = {name: _plain(row[name]) for name in fields}
        rows.append(
            {name: v for name, v in values.items() if v not in (None, "")} | {"x": round(x, 2), "y": round(y, 2)}
        )
    return rows


def course_rows(table: pd.DataFrame, zone_ids: Sequence[str]) -> dict[str, list[dict[str, Any]]]:
    """Of each zone named, its surveys from the second on, as ``series_tables.series_frame`` has them.

    What a survey did not measure is left out, so that its row has only its day.
    """
    rows: dict[str, list[dict[str, Any]]] = {}
    for name in zone_ids:
        own = table[table["zone_id"] == name]
        values = [{field: _plain(row[field]) for field in _COURSE} for _, row in own.iterrows()]
        rows[name] = [{k: v for k, v in row.items() if v is not None} for row in values]
    return rows


def _plain(value: Any) -> Any:
    """A table's value as JSON takes it; what is not known is None."""
    if isinstance(value, str):
        return value
    if pd.isna(value) or not np.isfinite(float(value)):
        return None
    return int(value) if isinstance(value, (int, np.integer)) else float(value)


def days_between(first: Epoch, last: Epoch) -> int | None:
    """Of two surveys; None where a day is not known."""
    days = (last.date - first.date).days if first.date and last.date else 0
    return days if days > 0 else None
