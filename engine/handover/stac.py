"""A hand-over as an item of a SpatioTemporal Asset Catalog (STAC 1.1, https://stacspec.org), an asset a file."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import laspy
import rasterio
import shapely
from shapely.geometry import mapping

from ..core.checksums import sha256
from ..core.json_values import plain
from ..core.staged_outputs import atomic_output
from .about import About, footprint

_EXTENSION = "https://stac-extensions.github.io/{}/schema.json"
FILE, PROJECTION, RASTER, POINTS = (
    _EXTENSION.format(name) for name in ("file/v2.1.0", "projection/v2.0.0", "raster/v2.0.0", "pointcloud/v1.0.0")
)
_SHA256_MULTIHASH = "1220"
"""Before the digest: the hash's code and its length (https://multiformats.io/multihash)."""
_TYPES = {
    ".tif": "image/tiff; application=geotiff; profile=cloud-optimized", ".gpkg": "application/geopackage+sqlite3",
    ".geojson": "application/geo+json", ".kml": "application/vnd.google-earth.kml+xml", ".csv": "text/csv",
    ".dxf": "image/vnd.dxf", ".xml": "application/xml", ".html": "text/html", ".png": "image/png",
    ".pdf": "application/pdf",
    ".qml": "application/xml", ".sld": "application/vnd.ogc.sld+xml", ".laz": "application/vnd.laszip+copc",
}  # fmt: skip
_CLOUDS = (".copc.laz",)
_KINDS = {"u": "unsigned", "i": "signed", "f": "floating"}
_ROLES = {".qml": "style", ".sld": "style", ".html": "overview", ".png": "overview", ".pdf": "overview"}


def write_item(
    path: Path, about: About, folder: Path, files: Iterable[str], collection: tuple[str, str] | None = None
) -> None:
    """Write the item; ``files`` are the names of the assets from ``folder``, in which the item lies, too.

    Args:
        collection: path from the item, and id, of the collection that the item belongs to.
    """
    assets = {name: _asset(folder / name, name) for name in sorted(files)}
    points = [_points(folder / name) for name in sorted(files) if name.endswith(_CLOUDS)]
    rasters = any("bands" in asset for asset in assets.values())  # an item without may not name their extension
    days = about.days or (about.stamp,)
    document: dict[str, Any] = {
        "type": "Feature",
        "stac_version": "1.1.0",
        "stac_extensions": [FILE, PROJECTION, *([RASTER] if rasters else []), *([POINTS] if points else [])],
        "id": about.identifier,
        "geometry": mapping(footprint(about)),
        "bbox": list(about.globe),
        "properties": {
            "title": about.title,
            "description": about.abstract,
            "datetime": f"{days[-1]}T00:00:00Z",
            "start_datetime": f"{days[0]}T00:00:00Z",
            "end_datetime": f"{days[-1]}T23:59:59Z",
            "license": "other",
            **_providers(about),
            "proj:code": None if about.epsg is None else f"EPSG:{about.epsg}",
            "proj:wkt2": about.crs.to_wkt(),
            "proj:bbox": list(about.bounds),
            "proj:geometry": mapping(shapely.box(*about.bounds, ccw=True)),
            **(points[-1] if points else {}),
        },
        "links": [],
        "assets": assets,
    }
    if collection is not None:
        href, identifier = collection
        document["collection"] = identifier
        document["links"] = [_link(word, href) for word in ("root", "parent", "collection")]
    _write(path, document)


def write_collection(path: Path, identifier: str, items: Sequence[tuple[str, About]]) -> None:
    """Write the collection of items.

    Args:
        identifier: the collection's id.
        items: path of each from the collection, and what it says; the first speaks for all of them.
    """
    first = items[0][1]
    boxes = [about.globe for _, about in items]
    whole = [min(b[0] for b in boxes), min(b[1] for b in boxes), max(b[2] for b in boxes), max(b[3] for b in boxes)]
    spans = [_span(about) for _, about in items]
    document = {
        "type": "Collection",
        "stac_version": "1.1.0",
        "id": identifier,
        "title": first.title,
        "description": first.abstract,
        "license": "other",
        **_providers(first),
        "extent": {
            "spatial": {"bbox": [whole, *map(list, boxes)] if len(boxes) > 1 else [whole]},
            "temporal": {"interval": [[min(s[0] for s in spans), max(s[1] for s in spans)]]},
        },
        "links": [
            _link("root", "./collection.json"),
            *(_link("item", href, "application/geo+json", about.title) for href, about in items),
        ],
    }
    _write(path, document)


def _span(about: About) -> tuple[str, str]:
    """From the first day of the surveys to the end of the last; such texts stand in the order of time."""
    days = about.days or (about.stamp,)
    return f"{days[0]}T00:00:00Z", f"{days[-1]}T23:59:59Z"


def _link(relation: str, href: str, kind: str = "application/json", title: str = "") -> dict[str, str]:
    return {"rel": relation, "href": href, "type": kind, **({"title": title} if title else {})}


def _write(path: Path, document: Mapping[str, Any]) -> None:
    with atomic_output(path) as partial:
        text = json.dumps(plain(document), indent=1, ensure_ascii=True, allow_nan=False)
        partial.write_text(text + "\n", encoding="utf-8")


def _providers(about: About) -> dict[str, Any]:
    return {"providers": [{"name": about.organisation, "roles": ["producer"]}]} if about.organisation else {}


def _asset(path: Path, name: str) -> dict[str, Any]:
    kind = path.suffix.lower()
    found = {
        "href": f"./{quote(name)}",
        "title": name,
        "type": _TYPES.get(kind, "application/octet-stream"),
        "roles": ["metadata" if name.startswith("metadata/") else _ROLES.get(kind, "data")],
        "file:size": path.stat().st_size,
        "file:checksum": _SHA256_MULTIHASH + sha256(path),
    }
    if kind == ".tif":
        found |= _raster(path)
    return found


def _raster(path: Path) -> dict[str, Any]:
    with rasterio.open(path) as source:
        bands = []
        for number, kind in enumerate(source.dtypes, 1):
            band = {"name": f"band{number}", "description": source.descriptions[number - 1] or "", "data_type": kind,
                    "nodata": source.nodatavals[number - 1], "unit": source.units[number - 1] or "",
                    "raster:spatial_resolution": float(source.transform.a), "raster:sampling": "area"}  # fmt: skip
            bands.append({key: value for key, value in band.items() if value not in (None, "")})
        return {
            "bands": bands,
            "proj:shape": [source.height, source.width],
            "proj:transform": list(source.transform)[:6],
            "proj:bbox": list(source.bounds),
        }


def _points(path: Path) -> dict[str, Any]:
    """What the extension asks of an item; that of the last cloud stands for all."""
    with laspy.open(path) as source:
        header = source.header
        return {
            "pc:count": header.point_count,
            "pc:type": "lidar",
            "pc:encoding": "application/vnd.laszip+copc",
            "pc:schemas": point_schemas(header.point_format),
        }


def point_schemas(point_format: laspy.PointFormat) -> list[dict[str, Any]]:
    """Dimensions of a point as they are read: coordinates as numbers with fraction."""
    found = []
    for dimension in point_format.dimensions:
        place = dimension.name in ("X", "Y", "Z")
        kind = "floating" if place else _KINDS[dimension.kind.value if dimension.kind.value in _KINDS else "u"]
        size = 8 if place else max(1, dimension.num_bits // 8)
        found.append({"name": dimension.name, "size": size, "type": kind})
    return found
