"""Reference system of the GeoTIFF keys in a LAS file (records 34735, 34736 and 34737)."""

from __future__ import annotations

import contextlib
import math
import struct
from typing import Any

from pyproj import CRS
from pyproj.exceptions import CRSError

_MODEL, _GEOGRAPHIC, _PROJECTED, _VERTICAL = 1024, 2048, 3072, 4096
_PROJECTED_UNIT, _VERTICAL_UNIT = 3076, 4099
_USER_DEFINED = 32767
_LINEAR_UNITS = {9001: 1.0, 9002: 0.3048, 9003: 1200 / 3937}
_EPSG_OF_UNIT = {9001: "metre", 9002: "foot", 9003: "US survey foot"}


def crs_from_keys(directory: bytes, doubles: bytes, text: bytes) -> CRS | None:
    """The reference system, or None where the keys name none.

    Args:
        directory: record 34735, ``doubles``: record 34736, ``text``: record 34737.

    Raises:
        ValueError: the directory is cut short or points outside of the other records.
        pyproj.exceptions.CRSError: an unknown code.
    """
    keys = read_keys(directory, doubles, text)
    if _USER_DEFINED in (keys.get(_PROJECTED), keys.get(_GEOGRAPHIC) if keys.get(_MODEL) == 2 else None):
        horizontal = _through_gdal(directory, doubles, text)
    else:
        code = keys.get(_PROJECTED) or keys.get(_GEOGRAPHIC)
        if not isinstance(code, int) or code == 0:
            return None
        horizontal = CRS.from_epsg(code)
        if isinstance(keys.get(_PROJECTED), int):
            horizontal = _with_unit(horizontal, keys.get(_PROJECTED_UNIT))
    return _with_heights(horizontal, keys.get(_VERTICAL), keys.get(_VERTICAL_UNIT))


def read_keys(directory: bytes, doubles: bytes, text: bytes) -> dict[int, int | float | str]:
    """Value of each key.

    Raises:
        ValueError: the directory is cut short or points outside of the other records.
    """
    if len(directory) < 8:
        raise ValueError("the key directory is cut short")
    count = struct.unpack_from("<4H", directory)[3]
    if len(directory) < 8 + 8 * count:
        raise ValueError(f"the key directory says {count} keys and holds {(len(directory) - 8) // 8}")
    keys: dict[int, int | float | str] = {}
    for index in range(count):
        key, place, number, value = struct.unpack_from("<4H", directory, 8 + 8 * index)
        if place == 0:
            keys[key] = value
        elif place == 34736:
            if 8 * (value + 1) > len(doubles):
                raise ValueError(f"key {key} points outside of the numbers")
            number_value = struct.unpack_from("<d", doubles, 8 * value)[0]
            if not math.isfinite(number_value):
                raise ValueError(f"key {key} is not a finite number")
            keys[key] = number_value
        elif place == 34737:
            if value + number > len(text):
                raise ValueError(f"key {key} points outside of the text")
            keys[key] = text[value : value + number].decode("latin-1").rstrip("|\0")
    return keys


def _with_unit(crs: CRS, unit: int | float | str | None) -> CRS:
    """A unit beside the code overrides the code's, as GeoTIFF readers do."""
    if unit not in _LINEAR_UNITS or not crs.is_projected:
        return crs
    json = crs.to_json_dict()
    for axis in json["coordinate_system"]["axis"]:
        if math.isclose(_factor(axis), _LINEAR_UNITS[int(unit)], rel_tol=1e-9):
            return crs
        axis["unit"] = _unit(int(unit))
    json.pop("id", None)
    json["name"] = f"{json['name']} in {_EPSG_OF_UNIT[int(unit)]}"
    return CRS.from_json_dict(json)


def _with_heights(horizontal: CRS, code: int | float | str | None, unit: int | float | str | None) -> CRS:
    if horizontal.is_compound or not horizontal.is_projected:
        return horizontal
    vertical: dict[str, Any] | None = None
    if isinstance(code, int) and code not in (0, _USER_DEFINED):
        # Writers often put an ellipsoid or a datum where a vertical system belongs.
        with contextlib.suppress(CRSError):
            candidate = CRS.from_epsg(code)
            vertical = candidate.to_json_dict() if candidate.is_vertical else None
    if vertical is None and unit not in _LINEAR_UNITS:
        return horizontal
    if vertical is None:
        vertical = {
            "type": "VerticalCRS",
            "name": "unknown height",
            "datum": {"type": "VerticalReferenceFrame", "name": "unknown"},
            "coordinate_system": {
                "subtype": "vertical",
                "axis": [{"name": "Gravity-related height", "abbreviation": "H", "direction": "up", "unit": "metre"}],
            },
        }
    if unit in _LINEAR_UNITS:
        axis = vertical["coordinate_system"]["axis"][0]
        if not math.isclose(_factor(axis), _LINEAR_UNITS[int(unit)], rel_tol=1e-9):
            axis["unit"] = _unit(int(unit))
            vertical.pop("id", None)
    return CRS.from_json_dict(
        {
            "type": "CompoundCRS",
            "name": f"{horizontal.name} + {vertical['name']}",
            "components": [horizontal.to_json_dict(), vertical],
        }
    )


def _factor(axis: dict[str, Any]) -> float:
    unit = axis.get("unit", "metre")
    return float(unit["conversion_factor"]) if isinstance(unit, dict) else 1.0


def _unit(code: int) -> object:
    if code == 9001:
        return "metre"
    return {"type": "LinearUnit", "name": _EPSG_OF_UNIT[code], "conversion_factor": _LINEAR_UNITS[code]}


def _through_gdal(directory: bytes, doubles: bytes, text: bytes) -> CRS:
    """A projection with its own parameters: the keys are put into a GeoTIFF of one pixel, which GDAL reads."""
    from rasterio.errors import RasterioError
    from rasterio.io import MemoryFile

    try:
        with MemoryFile(_one_pixel_tiff(directory, doubles, text)) as memory, memory.open() as dataset:
            if dataset.crs is None:
                raise ValueError("GDAL finds no reference system in them")
            return CRS.from_wkt(dataset.crs.to_wkt(version="WKT2_2019"))
    except RasterioError as error:
        raise ValueError(str(error)) from error


def _one_pixel_tiff(directory: bytes, doubles: bytes, text: bytes) -> bytes:
    entries: list[tuple[int, int, int, bytes]] = [
        (256, 3, 1, struct.pack("<HH", 1, 0)),
        (257, 3, 1, struct.pack("<HH", 1, 0)),
        (258, 3, 1, struct.pack("<HH", 8, 0)),
        (259, 3, 1, struct.pack("<HH", 1, 0)),
        (262, 3, 1, struct.pack("<HH", 1, 0)),
        (273, 4, 1, struct.pack("<I", 8)),
        (277, 3, 1, struct.pack("<HH", 1, 0)),
        (278, 3, 1, struct.pack("<HH", 1, 0)),
        (279, 4, 1, struct.pack("<I", 1)),
        (33550, 12, 3, struct.pack("<3d", 1.0, 1.0, 0.0)),
        (33922, 12, 6, struct.pack("<6d", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
        (34735, 3, len(directory) // 2, directory[: len(directory) // 2 * 2]),
    ]
    if len(doubles) >= 8:
        entries.append((34736, 12, len(doubles) // 8, doubles[: len(doubles) // 8 * 8]))
    if text:
        entries.append((34737, 2, len(text), text))
    start = 12 + 2 + 12 * len(entries) + 4
    ifd, tail = struct.pack("<H", len(entries)), b""
    for tag, kind, number, payload in entries:
        if len(payload) <= 4:
            ifd += struct.pack("<HHI", tag, kind, number) + payload.ljust(4, b"\0")
        else:
            ifd += struct.pack("<HHII", tag, kind, number, start + len(tail))
            tail += payload.ljust(len(payload) + len(payload) % 2, b"\0")
    return b"II*\0" + struct.pack("<I", 12) + b"\0\0\0\0" + ifd + struct.pack("<I", 0) + tail
