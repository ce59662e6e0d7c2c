"""The clouds that a batch made as a virtual point cloud: a STAC ItemCollection, which QGIS opens as one layer.

STAC 1.0 (https://stacspec.org) with its extensions pointcloud 1.0 and projection 1.1, as PDAL's wrench writes ``.vpc``.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import laspy
import numpy as np
import shapely
from pyproj import CRS, Transformer
from pyproj.exceptions import ProjError
from shapely.geometry import box, mapping

from ...engine.crs.working_frame import horizontal
from ...engine.handover.stac import point_schemas
from ...engine.pointcloud.declared_crs import declared_crs
from ...engine.pointcloud.header import CloudHeader, preflight

_EXTENSIONS = (
    "https://stac-extensions.github.io/pointcloud/v1.0.0/schema.json",
    "https://stac-extensions.github.io/projection/v1.1.0/schema.json",
)


@dataclass(frozen=True)
class MadeCloud:
    """A cloud of a slope: its file, the day of its survey, and the word for what it is."""

    slope: str
    path: Path
    day: str
    kind: str


def item_collection(clouds: Sequence[MadeCloud], folder: Path) -> tuple[dict[str, Any], list[str]]:
    """The document, and sentences on clouds that are not in it because they say too little of themselves.

    Args:
        folder: where the document will lie: files are named from there.

    Raises:
        InputError: a cloud cannot be read.
    """
    items, notes = [], []
    for cloud in clouds:
        header = preflight(cloud.path)
        crs, _ = declared_crs(header)
        flat = None if crs is None else horizontal(crs)
        if crs is None or flat is None or not header.bounds_trusted:
            notes.append(f"{cloud.path.name} of {cloud.slope} has no reference system or extent, so no catalogue.")
            continue
        try:
            items.append(_item(cloud, header, crs, flat, folder))
        except ProjError as error:
            notes.append(f"{cloud.path.name} of {cloud.slope} has no place on the globe ({error}), so no catalogue.")
    return {"type": "FeatureCollection", "features": items}, notes


def _item(cloud: MadeCloud, header: CloudHeader, crs: CRS, flat: CRS, folder: Path) -> dict[str, Any]:
    (west, south, bottom), (east, north, top) = header.bounds_low, header.bounds_high
    extent = box(west, south, east, north)
    globe = _on_the_globe(extent, flat)
    west_deg, south_deg, east_deg, north_deg = globe.bounds
    href = quote(Path(os.path.relpath(cloud.path, folder)).as_posix(), errors="surrogateescape")
    return {
        "type": "Feature",
        "stac_version": "1.0.0",
        "stac_extensions": list(_EXTENSIONS),
        "id": f"{cloud.slope} {cloud.day} {cloud.kind}",
        "geometry": mapping(globe),
        "bbox": [west_deg, south_deg, bottom, east_deg, north_deg, top],
        "properties": {
            "datetime": f"{cloud.day}T00:00:00Z",
            "title": f"{cloud.slope}, {cloud.day}, {cloud.kind}",
            "pc:count": header.count,
            "pc:type": "lidar",
            "pc:encoding": "application/vnd.laszip" if header.compressed else "application/vnd.las",
            "pc:schemas": point_schemas(laspy.PointFormat(header.point_format)),
            "proj:wkt2": crs.to_wkt(),
            "proj:bbox": [west, south, bottom, east, north, top],
            "proj:geometry": mapping(extent),
        },
        "links": [],
        "assets": {"data": {"href": f"./{href}", "roles": ["data"], "title": cloud.path.name}},
    }


def _on_the_globe(extent: shapely.Polygon, crs: CRS) -> shapely.Polygon:
    """The extent in degrees, its edges with as many corners as their bend needs here: those of a slope are short."""
    transformer = Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    moved = shapely.transform(
        extent, lambda xy: np.column_stack(transformer.transform(xy[:, 0], xy[:, 1], errcheck=True))
    )
    if not np.isfinite(shapely.get_coordinates(moved)).all():
        raise ProjError("outside of where its reference system holds")
    return moved
