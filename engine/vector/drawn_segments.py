"""Segments cut into polygons that Label Studio can hold, and regions from there put together to segments again."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import geopandas as gpd
import numpy as np
import pandas as pd
import shapely
from pyproj import CRS
from shapely.ops import split

from ..core.errors import InputError
from ..crs.working_frame import horizontal
from ..grid.grid import Grid
from .label_pictures import LabelPicture
from .label_regions import Region

OWN_FIELDS = (
    "class", "shape", "annotator", "task_id", "annotation_id", "region_id", "segment", "picture", "drawn_at", "area_m2",
)  # fmt: skip
_GRID_SHARE = 1e-6  # of a pixel: edges this close are one, which makes the cut pieces of a segment whole again


def without_holes(shape: shapely.Geometry) -> list[shapely.Polygon]:
    """Polygons without holes that cover the same area: each is cut through the middle of its holes."""
    todo = [part for part in shapely.get_parts(shapely.get_parts(shape)) if part.geom_type == "Polygon"]
    done: list[shapely.Polygon] = []
    while todo:
        part = todo.pop()
        if not part.interiors:
            done.append(part)
            continue
        west, _, east, _ = shapely.Polygon(part.interiors[0]).bounds
        low, high = part.bounds[1] - 1.0, part.bounds[3] + 1.0
        middle = (west + east) / 2
        todo += [p for p in split(part, shapely.LineString([(middle, low), (middle, high)])).geoms if p.area > 0]
    return sorted(done, key=lambda p: (p.bounds, p.area))


def percent(shape: shapely.Polygon, grid: Grid) -> list[list[float]]:
    """The corners of a polygon in per cent of a picture's width and height, from its upper left corner."""
    corners = np.asarray(shape.exterior.coords)[:-1]
    across = (corners[:, 0] - grid.west) / (grid.cell * grid.columns)
    down = (grid.north - corners[:, 1]) / (grid.cell * grid.rows)
    return [[float(x), float(y)] for x, y in np.column_stack([across, down]) * 100.0]


def refuse_off_the_cloud(regions: Iterable[Region], pictures: Mapping[str, LabelPicture]) -> None:
    """Raise InputError for a region over nothing but pixels in which nothing was measured."""
    measured = {}
    for region in regions:
        picture = pictures[region.picture]
        if picture.name not in measured:
            measured[picture.name] = picture.measured()
        if not _touches(region.shape, measured[picture.name], picture.grid):
            raise InputError(
                f"{region.name} lies off the cloud on {picture.name}; move it onto what was measured, or delete it, "
                "and export again."
            )


def _touches(shape: shapely.Geometry, measured: np.ndarray, grid: Grid) -> bool:
    """Whether a measured pixel's middle lies in the shape."""
    west, south, east, north = shape.bounds
    first = max(int((west - grid.west) / grid.cell), 0), max(int((grid.north - north) / grid.cell), 0)
    last = int((east - grid.west) / grid.cell) + 1, int((grid.north - south) / grid.cell) + 1
    row, column = np.nonzero(measured[first[1] : max(last[1], 0), first[0] : max(last[0], 0)])
    if not len(row):
        return False
    x = grid.west + (column + first[0] + 0.5) * grid.cell
    y = grid.north - (row + first[1] + 0.5) * grid.cell
    shapely.prepare(shape)
    # a region narrower than a pixel may hold no middle
    return bool(shapely.contains_xy(shape, x, y).any()) or shape.area < grid.cell**2


def label_layer(regions: Sequence[Region], pictures: Mapping[str, LabelPicture], crs: CRS | None) -> gpd.GeoDataFrame:
    """A row for each segment and each region that is part of none, with its label and attributes.

    Regions of one segment with one label by one annotator are put together, as they were before they were cut.
    """
    groups: dict[tuple[str, ...], list[Region]] = {}
    for place, region in enumerate(regions):
        segment = str(_of_segment(region, pictures).get("segment", ""))
        key = (segment or f"#{place}", ", ".join(region.labels), region.annotator)
        groups.setdefault(key, []).append(region)
    rows, shapes = [], []
    for members in groups.values():
        first, cell = members[0], pictures[members[0].picture].grid.cell
        known = _of_segment(first, pictures)
        shape = first.shape
        if len(members) > 1:
            shape = shapely.union_all([m.shape for m in members], grid_size=_GRID_SHARE * cell)
        shapes.append(_multi(shape))
        own = (
            ", ".join(first.labels), first.kind, first.annotator, first.task_id, first.annotation_id, first.region_id,
            str(known.get("segment", "")), first.picture, first.drawn_at, round(float(shape.area), 4),
        )  # fmt: skip
        attributes = {**dict(known.get("attributes", {})), **first.attributes}
        rows.append({**dict(zip(OWN_FIELDS, own, strict=True)), **_named(attributes)})
    table = pd.DataFrame(rows)
    for column in table.columns[len(OWN_FIELDS) :]:
        values = table[column].dropna()
        if not all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in values):
            table[column] = [None if v is None or v != v else str(v) for v in table[column]]
    return gpd.GeoDataFrame(table, geometry=shapes, crs=horizontal(crs))


def _of_segment(region: Region, pictures: Mapping[str, LabelPicture]) -> Mapping[str, Any]:
    """What is known of the region from before it was shown; nothing of one that is new."""
    return pictures[region.picture].segments.get(region.region_id, {})


def _multi(shape: shapely.Geometry) -> shapely.MultiPolygon:
    parts = shapely.get_parts(shapely.get_parts(shape))
    return shapely.MultiPolygon([part for part in parts if part.geom_type == "Polygon"])


def _named(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Attributes by names that a field may have."""
    found: dict[str, Any] = {}
    for name, value in attributes.items():
        plain = re.sub(r"[^a-z0-9_]+", "_", name.lower())[:26].strip("_") or "attribute"
        plain = f"was_{plain}" if plain in OWN_FIELDS or plain in ("fid", "geom", "geometry") else plain
        found.setdefault(plain, value)
    return found
