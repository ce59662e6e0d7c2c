"""Segments given as a vector file: polygons with attributes, such as the zones of a run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import shapely
from pyproj import CRS

from ..core.json_values import plain
from ..core.messages import shown
from ..core.progress import Progress
from ..crs.reprojection import reprojected
from .polygon_file import read_polygons

_IDS = ("zone_id", "segment", "part", "id", "name")


@dataclass(frozen=True)
class Segment:
    """``shape`` in metres of the picture's reference system; ``attributes`` without empty ones."""

    name: str
    label: str
    shape: shapely.Geometry
    attributes: dict[str, Any]


def read_segments(path: Path, label_field: str, crs: CRS, progress: Progress) -> list[Segment]:
    """The polygons of the first layer of a vector file that has any, each named by its id.

    Raises:
        InputError: missing, not a vector file, without polygons or the field, or not transformable.
    """
    frame, field = read_polygons(path, label_field, "--label-field")
    columns = [str(c) for c in frame.columns if c != frame.geometry.name]
    frame = frame[~(frame.geometry.is_empty | frame.geometry.isna())]
    shapes = frame.geometry.to_numpy()
    notes: list[str] = []
    if frame.crs is not None:
        shapes = reprojected(list(shapes), frame.crs, crs, f"The layer {shown(path)}", notes)
    else:
        notes.append(f"The segments {shown(path)} declare no reference system; that of the picture is assumed.")
    for sentence in notes:
        progress.warning(sentence)
    key = next((name for name in _IDS if name in columns and frame[name].is_unique), None)
    found = []
    for place, (shape, row) in enumerate(zip(shapes, frame[columns].to_dict("records"), strict=True), 1):
        attributes = {name: _plain(value) for name, value in row.items() if not _empty(value)}
        name = str(row[key]) if key and not _empty(row[key]) else f"S{place:03d}"
        label = "" if _empty(row[field]) else str(row[field])
        found.append(Segment(name, label, shape, attributes))
    return found


def _empty(value: Any) -> bool:
    return value is None or value != value or value == ""


def _plain(value: Any) -> Any:
    known = plain(value)
    return known if isinstance(known, (str, int, float, bool)) else str(value)
