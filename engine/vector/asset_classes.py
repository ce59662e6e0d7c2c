"""Polygons of asset classes, such as bench, drain, berm, retaining wall and pavement."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import shapely
from affine import Affine
from numpy.typing import NDArray
from pyproj import CRS
from rasterio.features import geometry_mask
from shapely import STRtree
from shapely.geometry import MultiPolygon, Polygon

from ..core.errors import InputError
from ..core.messages import shown
from ..crs.reprojection import reprojected
from ..grid.grid import Grid
from .polygon_file import read_polygons

MAX_CLASSES = 1000
"""More are single assets rather than classes of them, and each costs a pass over the grid."""
SLIVER_M = 1.0  # width of an overlap that is refused whatever the cells


@dataclass(frozen=True)
class AssetClasses:
    """Classes in alphabetical order: ``names``, and the union of each one's polygons, metres."""

    names: tuple[str, ...]
    shapes: tuple[MultiPolygon, ...]
    path: Path

    def labels(self, grid: Grid) -> NDArray[np.int32]:
        """(rows, columns): 0, or 1 + the number of the class that holds the cell's centre.

        Raises:
            InputError: a cell's centre lies in two classes, or none in any.
        """
        found = np.zeros(grid.shape, dtype=np.int32)
        for number, (name, shape) in enumerate(zip(self.names, self.shapes, strict=True), 1):
            inside = geometry_mask([shape], grid.shape, Affine(*grid.affine), invert=True)
            both = inside & (found > 0)
            if both.any():
                self._refuse_overlap(both, found, name, grid)
            found[inside] = number
        if not found.any():
            raise InputError(
                f"No polygon of the classes {shown(self.path)} lies on the slope; check their reference system."
            )
        return found

    def _refuse_overlap(self, both: NDArray[np.bool_], found: NDArray[np.int32], name: str, grid: Grid) -> None:
        row, column = (int(i[0]) for i in np.nonzero(both))
        x, y = grid.west + (column + 0.5) * grid.cell, grid.north - (row + 0.5) * grid.cell
        other = self.names[int(found[row, column]) - 1]
        cells = int((both & (found == found[row, column])).sum())
        raise _overlap((other, name), self.path, cells * grid.cell**2, (x, y))

    def refuse_wide_overlaps(self) -> None:
        """Raise InputError where classes overlap on more than slivers, which is known before there is a grid."""
        for i, j in sorted(STRtree(self.shapes).query(self.shapes, predicate="intersects").T.tolist()):
            common = shapely.intersection(self.shapes[i], self.shapes[j]) if i < j else Polygon()
            wide = common.buffer(-SLIVER_M / 2)
            if not wide.is_empty:
                place = wide.representative_point()
                raise _overlap((self.names[i], self.names[j]), self.path, common.area, (place.x, place.y))


def _overlap(names: tuple[str, str], path: Path, area: float, place: tuple[float, float]) -> InputError:
    return InputError(
        f"The classes {names[0]} and {names[1]} of {shown(path)} overlap on {area:.2f} m², as at x {place[0]:.1f}, y "
        f"{place[1]:.1f}; cut one out of the other, so that no ground counts twice."
    )


def read_asset_classes(path: Path, field: str, crs: CRS) -> tuple[AssetClasses, tuple[str, ...]]:
    """The classes of a polygon layer in metres of ``crs``, and sentences on what was assumed.

    Raises:
        InputError: it cannot be read or has no such field, a polygon has no class, classes overlap, or there are more
            than a thousand.
    """
    name = shown(path)
    notes: list[str] = []
    frame, column = read_polygons(path, field, "--class-field")
    shapes = frame.geometry.to_numpy()
    if frame.crs is None:
        notes.append(f"The classes {name} declare no reference system; the surveys' ({crs.name}) is assumed.")
    else:
        shapes = reprojected(list(shapes), frame.crs, crs, f"The layer of classes {name}", notes)
    parts: dict[str, list[Polygon]] = {}
    for number, (value, shape) in enumerate(zip(frame[column].tolist(), shapes, strict=True), 1):
        polygons = [p for p in shapely.get_parts(shapely.get_parts(shape)) if isinstance(p, Polygon)] if shape else []
        if not polygons:
            continue
        text = "" if pd.isna(value) else str(value).strip()
        if not text:
            raise InputError(
                f"Polygon {number} of the classes {name} has no {column}; give it its class, or remove it."
            )
        parts.setdefault(text, []).extend(shapely.make_valid(p) for p in polygons)
    if not parts:
        raise InputError(f"The classes {name} hold no polygon; draw one around each asset.")
    if len(parts) > MAX_CLASSES:
        raise InputError(
            f"The field {column} of {name} has {len(parts)} values; give a field with at most {MAX_CLASSES} classes."
        )
    names = tuple(sorted(parts))
    unions = (shapely.union_all(parts[n]) for n in names)
    outlines = tuple(
        MultiPolygon([p for p in shapely.get_parts(shapely.get_parts(u)) if isinstance(p, Polygon)]) for u in unions
    )
    classes = AssetClasses(names, outlines, path)
    classes.refuse_wide_overlaps()
    return classes, tuple(notes)
