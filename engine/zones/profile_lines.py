"""Lines along which profiles are taken: given in a vector file, or the steepest ones through the zones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import geopandas as gpd
import numpy as np
import pyogrio
import shapely
from affine import Affine
from numpy.typing import NDArray
from pyproj import CRS
from rasterio.features import geometry_mask
from shapely.geometry import LineString
from shapely.geometry.base import BaseGeometry

from ..core.errors import InputError
from ..core.gdal_names import readable
from ..core.messages import shown
from ..core.progress import Progress
from ..crs.reprojection import reprojected
from ..grid.grid import Grid
from ..statistics.layout import Layout, layout_of
from ..vector.geopackage import READ_FAULTS

GIVEN, STEEPEST = "given", "steepest"
_NAMES = ("name", "label", "profile", "id")  # fields that name a line, where none is asked for
_MAX_LENGTH_M = 100_000.0  # metres
_MAX_LINES = 1_000  # each is a table and a chart of the report, which take 0.1 s
_MIN_MARGIN_M = 2.0  # metres beyond a zone, so that its line shows unchanged ground too
_MIN_STEEPNESS = math.tan(math.radians(2.0))  # a flatter surface has no distinct steepest line


@dataclass(frozen=True)
class ProfileLine:
    """``geometry`` is in metres of the clouds' reference system; ``zone_id`` is empty for a line that was given."""

    name: str
    geometry: LineString
    kind: str
    zone_id: str = ""


def read_lines(path: Path, crs: CRS, field: str = "") -> tuple[tuple[ProfileLine, ...], tuple[str, ...]]:
    """The lines of the first line layer of a vector file, and sentences on what was assumed or left out.

    Args:
        crs: the clouds' reference system in metres.
        field: field that names the lines; the first of name, label, profile and id where it is empty, else numbers.

    Raises:
        InputError: missing, not a vector file, without lines or without that field, not transformable, with more than
            1,000 lines, or with one of more than 100 km.
    """
    name = shown(path)
    if not Path(path).exists():
        raise InputError(f"The profiles' lines {name} do not exist; check the path.")
    notes: list[str] = []
    try:
        with readable(Path(path)) as plain:
            frame = pyogrio.read_dataframe(plain, layer=_line_layer(plain, name), force_2d=True)
    except READ_FAULTS as error:
        raise InputError(
            f"The profiles' lines {name} cannot be read as a vector file; give lines as GeoPackage, shapefile, GeoJSON "
            "or KML."
        ) from error
    names = _names(frame, field, name)
    frame = frame.set_geometry(_transformed(frame, crs, name, notes), crs=None)
    found: list[ProfileLine] = []
    left_out = 0
    for label, geometry in zip(names, frame.geometry, strict=True):
        parts = [] if geometry is None else [p for p in _parts(geometry) if p.length > 0]
        left_out += not parts
        found += [ProfileLine(label, part, GIVEN) for part in parts]
    if not found:
        raise InputError(f"The profiles' lines {name} hold no line; draw one across the slope.")
    if len(found) > _MAX_LINES:
        raise InputError(
            f"The profiles' lines {name} hold {len(found):,} lines, and at most {_MAX_LINES:,} are drawn; give those "
            "that you need."
        )
    if left_out:
        notes.append(f"The profiles' lines {name} hold {left_out} features that are no line, which are left out.")
    for line in found:
        if not np.isfinite(line.geometry.length) or line.geometry.length > _MAX_LENGTH_M:
            raise InputError(
                f"The line {line.name!r} of {name} is {line.geometry.length / 1000:.4g} km long; draw it across the "
                "slope, and check its reference system."
            )
    return _distinct(found), tuple(notes)


def given_lines(path: Path | None, crs: CRS, field: str, progress: Progress) -> tuple[ProfileLine, ...]:
    """As ``read_lines``, reporting its sentences as warnings; no lines without a file."""
    if path is None:
        return ()
    lines, notes = read_lines(path, crs, field)
    for note in notes:
        progress.warning(note)
    return lines


def steepest_lines(
    zones: gpd.GeoDataFrame,
    heights: NDArray[np.floating],
    dz: NDArray[np.floating],
    grid: Grid,
    count: int,
    layout: Layout | None = None,
) -> tuple[ProfileLine, ...]:
    """The steepest line through each of the first ``count`` zones, from the top down.

    It runs down the plane through the surface at and around the zone, through the middle of its change, and beyond it
    by half its length or at least two metres. On nearly flat ground it follows the zone's longer axis.

    Args:
        zones: as of ``extraction.extract_zones``, the most severe first, in the grid's horizontal reference system.
        heights, dz: surface and change, metres, NaN where unknown.
        layout: of these; all cells (rows, columns) by default.
    """
    layout = layout or layout_of(dz)
    lines = []
    for zone_id, geometry in zip(zones["zone_id"].iloc[:count], zones.geometry.iloc[:count], strict=True):
        line = _steepest(geometry, heights, dz, grid, layout)
        lines.append(ProfileLine(f"Steepest line through {zone_id}", line, STEEPEST, str(zone_id)))
    return tuple(lines)


def _steepest(
    zone: BaseGeometry, heights: NDArray[np.floating], dz: NDArray[np.floating], grid: Grid, layout: Layout
) -> LineString:
    west, south, east, north = zone.bounds
    margin = max(_MIN_MARGIN_M, 4.0 * grid.cell)
    rows = _span((grid.north - north - margin) / grid.cell, (grid.north - south + margin) / grid.cell, grid.rows)
    columns = _span((west - margin - grid.west) / grid.cell, (east + margin - grid.west) / grid.cell, grid.columns)
    x = grid.west + (np.arange(columns.start, columns.stop) + 0.5) * grid.cell
    y = grid.north - (np.arange(rows.start, rows.stop) + 0.5) * grid.cell
    x, y = (a.ravel() for a in np.meshgrid(x, y))
    corner = Affine(*grid.affine) * Affine.translation(columns.start, rows.start)
    shape = rows.stop - rows.start, columns.stop - columns.start
    weight = np.where(
        geometry_mask([zone], shape, corner, invert=True), np.abs(layout.window(dz, (rows, columns))), 0.0
    )
    weight = np.nan_to_num(weight).ravel()
    point = zone.representative_point()
    middle = np.array([point.x, point.y])
    if weight.sum() > 0:
        middle = np.array([np.average(x, weights=weight), np.average(y, weights=weight)])
    down = _downhill(x - middle[0], y - middle[1], layout.window(heights, (rows, columns)).ravel())
    if down is None:
        down = _long_axis(zone)
    along = (shapely.get_coordinates(zone.convex_hull) - middle) @ down
    beyond = max(margin, 0.5 * float(np.ptp(along)))
    return LineString([middle + (along.min() - beyond) * down, middle + (along.max() + beyond) * down])


def _downhill(x: NDArray, y: NDArray, z: NDArray) -> NDArray[np.float64] | None:
    """Unit vector down the least-squares plane; None if it is nearly flat or not fixed."""
    known = np.isfinite(z)
    if known.sum() < 3:
        return None
    design = np.column_stack([x[known], y[known], np.ones(known.sum())])
    solution, _, rank, _ = np.linalg.lstsq(design, z[known] - z[known].mean(), rcond=1e-6)
    steepness = float(np.hypot(*solution[:2]))
    if rank < 3 or steepness < _MIN_STEEPNESS:
        return None
    return np.asarray(-solution[:2] / steepness)


def _long_axis(zone: BaseGeometry) -> NDArray[np.float64]:
    corners = shapely.get_coordinates(zone.minimum_rotated_rectangle)
    sides = np.diff(corners[:3], axis=0)
    side = sides[np.argmax(np.hypot(sides[:, 0], sides[:, 1]))]
    side = side if (side[0], side[1]) > (0.0, 0.0) else -side  # from the west, whichever corner comes first
    return np.asarray(side / np.hypot(*side))


def _span(low: float, high: float, count: int) -> slice:
    first = min(max(math.floor(low), 0), count - 1)
    return slice(first, min(max(math.ceil(high), first + 1), count))


def _line_layer(path: Path, name: str) -> str:
    """The first layer of lines, or the first that does not declare what it holds."""
    layers = [(str(layer), str(kind)) for layer, kind in pyogrio.list_layers(path)]
    for wanted in (("Line", "Curve"), ("Unknown", "Collection")):
        for layer, kind in layers:
            if any(word in kind for word in wanted):
                return layer
    kinds = ", ".join(sorted({kind for _, kind in layers if kind != "None"})) or "no geometry"
    raise InputError(f"The profiles' lines {name} hold no lines ({kinds}); draw lines across the slope.")


def _names(frame: gpd.GeoDataFrame, field: str, name: str) -> list[str]:
    fields = [str(f) for f in frame.columns if f != frame.geometry.name]
    if field and field not in fields:
        raise InputError(
            f"The profiles' lines {name} have no field {field!r}; their fields are {', '.join(fields) or 'none'}."
        )
    if not field:
        by_name = {f.lower(): f for f in reversed(fields)}
        field = next((by_name[n] for n in _NAMES if n in by_name), "")
    texts = ["" if v is None or v != v else str(v).strip() for v in frame[field]] if field else [""] * len(frame)
    return [text or f"Profile {number}" for number, text in enumerate(texts, 1)]


def _distinct(lines: Sequence[ProfileLine]) -> tuple[ProfileLine, ...]:
    """Lines of one name are distinguished by a number."""
    taken: set[str] = set()
    result = []
    for line in lines:
        name, number = line.name, 1
        while name in taken:
            number += 1
            name = f"{line.name} ({number})"
        taken.add(name)
        result.append(replace(line, name=name))
    return tuple(result)


def _parts(geometry: BaseGeometry) -> list[LineString]:
    parts = shapely.get_parts(shapely.get_parts(geometry))
    return [LineString(p) for p in parts if p.geom_type in ("LineString", "LinearRing")]


def _transformed(frame: gpd.GeoDataFrame, crs: CRS, name: str, notes: list[str]) -> gpd.GeoSeries:
    if frame.crs is None:
        notes.append(f"The profiles' lines {name} declare no reference system; the clouds' ({crs.name}) is assumed.")
        return frame.geometry
    moved = reprojected(list(frame.geometry), frame.crs, crs, f"The file of the profiles' lines {name}", notes)
    return gpd.GeoSeries(moved, index=frame.index)
