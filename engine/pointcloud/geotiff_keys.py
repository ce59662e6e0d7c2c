"""Reference system of the GeoTIFF keys in a LAS file (records 34735, 34736 and 34737), as GDAL reads them."""

from __future__ import annotations

import math
import struct

import rasterio
from pyproj import CRS
from rasterio.errors import RasterioError
from rasterio.io import MemoryFile

_GEOGRAPHIC, _PROJECTED, _VERTICAL_UNIT = 2048, 3072, 4099
_USER_DEFINED = 32767
_LINEAR_UNITS = {9001: ("metre", 1.0), 9002: ("foot", 0.3048), 9003: ("US survey foot", 1200 / 3937)}


def crs_from_keys(directory: bytes, doubles: bytes, text: bytes) -> CRS | None:
    """The reference system, or None where the keys name none.

    Args:
        directory: record 34735, ``doubles``: record 34736, ``text``: record 34737.

    Raises:
        ValueError: the directory is cut short or points outside of the other records.
        pyproj.exceptions.CRSError: an unknown code.
    """
    entries = struct.iter_unpack("<4H", directory[8 : len(directory) // 8 * 8])
    keys = {key: value for key, place, _, value in entries if place == 0}
    code = keys.get(_PROJECTED) or keys.get(_GEOGRAPHIC)
    crs = _through_gdal(directory, doubles, text)
    if crs is None or not (crs.is_projected or crs.is_geographic):
        # GDAL reads no code next to broken keys, nor one of another kind than the model's
        if code and code != _USER_DEFINED:
            return CRS.from_epsg(code)
        if crs is None:
            raise ValueError("GDAL finds no reference system in them")
        return crs if code else None
    if not crs.is_compound:
        # writers often put an ellipsoid where a vertical system belongs
        return crs.to_2d() if len(crs.axis_info) > 2 else crs
    return _with_height_unit(crs, keys.get(_VERTICAL_UNIT))


def _with_height_unit(crs: CRS, unit: int | None) -> CRS:
    """A unit of heights overrides that of a vertical system's code, of which GDAL takes the code alone."""
    json = crs.to_json_dict()
    if "+" not in json["name"]:  # the keys' own text names the horizontal one alone
        json["name"] = " + ".join(part.name for part in crs.sub_crs_list)
    name, factor = _LINEAR_UNITS.get(unit or 0, ("", crs.axis_info[-1].unit_conversion_factor))
    if not math.isclose(crs.axis_info[-1].unit_conversion_factor, factor, rel_tol=1e-9):
        vertical = json["components"][1]
        axis = vertical.get("source_crs", vertical)["coordinate_system"]["axis"][0]
        axis["unit"] = {"type": "LinearUnit", "name": name, "conversion_factor": factor}
        for described in (json, vertical):
            described.pop("id", None)
    return CRS.from_json_dict(json)


def _through_gdal(directory: bytes, doubles: bytes, text: bytes) -> CRS | None:
    """The keys are put into a GeoTIFF of one pixel, which GDAL reads."""
    data = _one_pixel_tiff(directory, doubles, text)
    try:
        with rasterio.Env(GTIFF_REPORT_COMPD_CS=True), MemoryFile(data) as memory, memory.open() as dataset:
            return dataset.crs and CRS.from_wkt(dataset.crs.to_wkt(version="WKT2_2019"))
    except RasterioError as error:
        raise ValueError(str(error)) from error


def _one_pixel_tiff(directory: bytes, doubles: bytes, text: bytes) -> bytes:
    shorts = {256: 1, 257: 1, 258: 8, 259: 1, 262: 1, 277: 1, 278: 1}
    entries = [(tag, 3, 1, struct.pack("<H", value)) for tag, value in shorts.items()]
    entries += [(273, 4, 1, struct.pack("<I", 8)), (279, 4, 1, struct.pack("<I", 1))]
    entries += [(33550, 12, 3, struct.pack("<3d", 1, 1, 0)), (33922, 12, 6, bytes(48))]
    for tag, kind, size, payload in ((34735, 3, 2, directory), (34736, 12, 8, doubles), (34737, 2, 1, text)):
        if len(payload) >= size:
            entries.append((tag, kind, len(payload) // size, payload[: len(payload) // size * size]))
    start = 12 + 2 + 12 * len(entries) + 4
    ifd, tail = struct.pack("<H", len(entries)), b""
    for tag, kind, number, payload in sorted(entries):
        place = payload.ljust(4, b"\0") if len(payload) <= 4 else struct.pack("<I", start + len(tail))
        ifd += struct.pack("<HHI", tag, kind, number) + place
        tail += b"" if len(payload) <= 4 else payload.ljust(len(payload) + len(payload) % 2, b"\0")
    return b"II*\0" + struct.pack("<I", 12) + bytes(4) + ifd + bytes(4) + tail
