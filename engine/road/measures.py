"""M values of a layer of lines: the chainage at each corner, as GIS keep it for linear referencing."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from ..core.arrays import Float
from ..core.errors import InputError

_NO_M_BELOW = -1e38
"""What shapefiles write where a corner has no M value (ESRI Shapefile Technical Description, 1998)."""


def read_measures(path: Path, layer: str, flat: Sequence[BaseGeometry | None]) -> list[list[Float]] | None:
    """M values of the corners of each part of each feature, in the order of the file; None where they cannot be read.

    pyogrio drops them, so GDAL is asked for the geometries as bytes, in its SQLite dialect.

    Args:
        layer: the name of the layer.
        flat: the geometries of the same layer as pyogrio reads them, to which the corners must belong.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            column = pyogrio.read_info(path, layer=layer).get("geometry_name") or "geometry"
            sql = f"SELECT hex(ST_AsBinary({_name(column)})) AS wkb FROM {_name(layer)}"
            rows = pyogrio.read_dataframe(path, sql=sql, sql_dialect="SQLITE", read_geometry=False)["wkb"]
        shapes = [None if not isinstance(row, str) or not row else shapely.from_wkb(row) for row in rows]
    except (OSError, RuntimeError, ValueError, KeyError, shapely.errors.ShapelyError):
        return None
    if len(shapes) != len(flat):
        return None
    found = []
    for shape, known in zip(shapes, flat, strict=True):
        parts, expected = lines_of(shape), lines_of(known)
        if [len(p.coords) for p in parts] != [len(p.coords) for p in expected]:
            return None  # as of curves, which are read as lines of other corners
        found.append([_of_line(part) for part in parts])
    return found


def chainages_of(measures: Float, xy: NDArray[np.float64], metres: float, subject: str) -> Float | None:
    """Chainages (k,), metres, at the corners (k, 2) of a line; None where it has none.

    M values that are not set, or all the same on a line with a length, are none.

    Args:
        metres: of one unit of the values.
        subject: the line, for messages.

    Raises:
        InputError: only some of them are set, or they turn round.
    """
    known = np.isfinite(measures) & (measures > _NO_M_BELOW)
    if not known.any() or np.ptp(measures[known]) == 0:
        return None
    if not known.all():
        raise InputError(
            f"{subject} has M values at {int(known.sum())} of its {len(known)} corners; set all of them, or none."
        )
    steps = np.diff(measures)
    if (steps > 0).any() and (steps < 0).any():
        wrong = int(np.flatnonzero(np.sign(steps) == -np.sign(measures[-1] - measures[0] or 1.0))[0]) + 1
        x, y = xy[wrong]
        raise InputError(
            f"{subject} has M values that turn round at x {x:.1f}, y {y:.1f} ({measures[wrong - 1]:.6g}, then "
            f"{measures[wrong]:.6g}); correct them so that they only grow, or only fall."
        )
    return measures * metres


def lines_of(shape: BaseGeometry | None) -> list[BaseGeometry]:
    """Its lines, as ``centreline`` takes them apart."""
    if shape is None:
        return []
    parts = shapely.get_parts(shapely.get_parts(shape))
    return [part for part in parts if part.geom_type in ("LineString", "LinearRing")]


def _of_line(part: BaseGeometry) -> Float:
    if not getattr(part, "has_m", False):
        return np.full(len(part.coords), np.nan)
    return np.array([corner[-1] for corner in part.coords], dtype=np.float64)


def _name(text: str) -> str:
    return '"' + text.replace('"', '""') + '"'
