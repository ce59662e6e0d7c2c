"""Regions that people drew in Label Studio, from its JSON export, in the pixels of the picture.

Places are per cent of the picture's width and height from its upper left corner; a rectangle is turned clockwise about
its upper left corner, in pixels (https://labelstud.io/guide/task_format, https://labelstud.io/tags/rectanglelabels).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import shapely

from ...interface.input_files import LABELS
from ..core.errors import InputError
from ..core.json_shapes import anything, fields, maybe, number, read_json, rows, table, text
from ..core.messages import shown
from ..grid.grid import Grid
from .brush_masks import MaskError, brush_mask
from .cell_polygons import cell_polygons
from .label_pictures import LabelPicture

SHAPES = ("polygon", "rectangle", "brush")
"""Kinds of regions with an area that are read; each may be called with ``labels`` at its end."""
_ATTRIBUTES = {"choices": "choices", "textarea": "text", "rating": "rating", "number": "number", "taxonomy": "taxonomy"}
"""What may be said of one region: type of the result, and the field of its value."""
_PICTURE_ENDING = re.compile(r"\.(png|jpe?g|tiff?|webp|bmp|gif)$", re.IGNORECASE)
_PREFIX = re.compile(r"^[0-9a-f]{8}-")  # that Label Studio puts before the name of a file that was uploaded
_RESULT = fields({"type": text(), "value": table(anything)}, {"id": text(), "from_name": text()})
_ANNOTATION = fields({"result": rows(_RESULT)}, {"was_cancelled": anything})
_EXPORT = rows(fields({"data": table(anything)}, {"annotations": rows(_ANNOTATION)}))
_SENTENCE = "{path} is no JSON export of Label Studio ({why}); export the project there as JSON."
_PER_CENT = number(-1e4, 1e4)
_POINTS = rows(rows(_PER_CENT, 2, 2), 3)
_BOX = fields(dict.fromkeys(("x", "y", "width", "height"), _PER_CENT), {"rotation": maybe(number(-3600, 3600))})


@dataclass(frozen=True)
class Region:
    """A region: ``shape`` in metres of the picture's reference system, ``labels`` in the order of the export."""

    shape: shapely.Geometry
    kind: str
    labels: tuple[str, ...]
    picture: str
    task_id: str
    annotation_id: str
    region_id: str
    annotator: str
    drawn_at: str
    attributes: dict[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """For messages."""
        labels = ", ".join(self.labels) or "no label"
        return f"The region {self.region_id or 'without id'} ({labels}) of task {self.task_id}"


def read_regions(path: Path, pictures: Mapping[str, LabelPicture]) -> tuple[list[Region], list[str]]:
    """The regions of an export, and sentences about what is left out.

    Raises:
        InputError: no export of Label Studio, one of other pictures or of none, of pictures that were turned there, or
            without polygons, rectangles and masks.
    """
    try:
        tasks = read_json(path, _as_list(_EXPORT), _SENTENCE, LABELS)
    except FileNotFoundError:
        raise InputError(f"The export {shown(path)} does not exist; check its path.") from None
    tasks = tasks if isinstance(tasks, list) else [tasks]
    if any("annotations" not in task for task in tasks):
        raise InputError(
            f"{shown(path)} holds tasks without annotations, as a JSON-MIN export or a task file does; export the "
            "project as JSON."
        )
    found: list[Region] = []
    other: dict[str, int] = {}
    for place, task in enumerate(tasks):
        name = str(task.get("id", place + 1))
        picture = _picture_of(task, name, path, pictures)
        for annotation in task["annotations"]:
            if not annotation.get("was_cancelled"):
                found += _regions(annotation, picture, name, path, other)
    if not found:
        kinds = f" (there are {', '.join(sorted(other))})" if other else ""
        raise InputError(
            f"{shown(path)} has no polygons, rectangles or brush masks{kinds}; draw some in Label Studio and export "
            "again."
        )
    notes = [f"{shown(path)} has {n} regions of type {kind}, which are left out." for kind, n in sorted(other.items())]
    return found, notes


def _as_list(shape: Any) -> Any:
    def check(value: Any, place: str) -> None:
        shape([value] if isinstance(value, dict) else value, place)

    return check


def _picture_of(
    task: Mapping[str, Any], task_id: str, path: Path, pictures: Mapping[str, LabelPicture]
) -> LabelPicture:
    """The picture that a task is of, by the names in its data."""
    addresses = [str(task.get("file_upload") or ""), *(v for v in task["data"].values() if isinstance(v, str))]
    names = [unquote(a).replace("\\", "/").rsplit("/", 1)[-1].rsplit("=", 1)[-1] for a in addresses]
    for name in names:
        known = pictures.get(name) or pictures.get(_PREFIX.sub("", name))
        if known is not None:
            return known
    shown_names = [name for name in names if _PICTURE_ENDING.search(name)]
    if not shown_names:
        raise InputError(
            f"Task {task_id} of {shown(path)} has no picture, so it is of another type; export the project that the "
            "pictures were labelled in."
        )
    raise InputError(
        f"Task {task_id} of {shown(path)} is of another picture ({shown_names[0]}); give the tasks.json that its "
        "pictures were exported with."
    )


def _regions(
    annotation: Mapping[str, Any], picture: LabelPicture, task_id: str, path: Path, other: dict[str, int]
) -> Iterator[Region]:
    """The regions of one annotation; counts in ``other`` what has no area that is known here."""
    by_id: dict[str, list[Mapping[str, Any]]] = {}
    for number_, result in enumerate(annotation["result"]):
        by_id.setdefault(str(result.get("id") or f"#{number_}"), []).append(result)
    for region_id, results in by_id.items():
        drawn = [r for r in results if r["type"].removesuffix("labels") in SHAPES]
        if not drawn:
            for kind in {r["type"] for r in results if "original_width" in r and r["type"] not in _ATTRIBUTES}:
                other[kind] = other.get(kind, 0) + 1
            continue
        labels = tuple(dict.fromkeys(label for r in results for label in _labels(r)))
        region = Region(
            shapely.Polygon(), drawn[0]["type"].removesuffix("labels"), labels, picture.name, task_id,
            str(annotation.get("id", "")), "" if region_id[0] == "#" else region_id, _annotator(annotation),
            str(annotation.get("created_at") or ""), _attributes(results),
        )  # fmt: skip
        yield Region(**{**region.__dict__, "shape": _shape(drawn[0], picture, region, path)})


def _labels(result: Mapping[str, Any]) -> list[str]:
    named = result["value"].get(result["type"]) if result["type"].endswith("labels") else None
    return [str(label) for label in named] if isinstance(named, list) else []


def _annotator(annotation: Mapping[str, Any]) -> str:
    by = annotation.get("completed_by")
    if isinstance(by, Mapping):
        return str(by.get("email") or by.get("username") or by.get("id") or "")
    return "" if by is None else str(by)


def _attributes(results: list[Mapping[str, Any]]) -> dict[str, Any]:
    """What was said of a region, by the name of its control; several values as one text."""
    found: dict[str, Any] = {}
    for result in results:
        value = result["value"].get(_ATTRIBUTES.get(result["type"], ""))
        if value is not None and result.get("from_name"):
            found[result["from_name"]] = _one(value)
    meta = results[0].get("meta")
    if isinstance(meta, Mapping) and meta.get("text"):
        found["note"] = _one(meta["text"])
    return found


def _one(value: Any) -> Any:
    if isinstance(value, list):
        return ", ".join(" / ".join(map(str, v)) if isinstance(v, list) else str(v) for v in value)
    return value


def _shape(result: Mapping[str, Any], picture: LabelPicture, region: Region, path: Path) -> shapely.Geometry:
    """The shape in metres.

    Raises:
        InputError: the picture was turned or has another size there, or the shape is none.
    """
    if result.get("image_rotation") not in (None, 0, 0.0):
        raise InputError(
            f"{region.name} of {shown(path)} was drawn on a picture turned by {result['image_rotation']} degrees; "
            "turn it back in Label Studio and export again."
        )
    size, grid = (result.get("original_width"), result.get("original_height")), picture.grid
    if size != (grid.columns, grid.rows):
        raise InputError(
            f"{region.name} of {shown(path)} was drawn on a picture of {size[0]} by {size[1]} pixels, and "
            f"{picture.name} has {grid.columns} by {grid.rows}; give the tasks.json that its pictures "
            "were exported with."
        )
    value = result["value"]
    try:
        if region.kind == "brush":
            return _painted(value, grid)
        return _metres(_corners(value, region.kind, grid), grid)
    except ValueError as error:  # a misfit of the export's shape is one
        raise InputError(f"{region.name} of {shown(path)} cannot be read ({error}); draw it again.") from error


def _corners(value: Mapping[str, Any], kind: str, grid: Grid) -> np.ndarray:
    """Corners (n, 2) in pixels from the upper left corner."""
    side = np.array([grid.columns, grid.rows]) / 100.0
    if kind == "polygon":
        _POINTS(value.get("points"), "points")
        return np.asarray(value["points"], dtype=np.float64) * side
    _BOX(value, "")
    corner = np.array([value["x"], value["y"]]) * side
    width, height = np.array([value["width"], value["height"]]) * side
    turn = math.radians(value.get("rotation") or 0.0)
    across, down = np.array([math.cos(turn), math.sin(turn)]), np.array([-math.sin(turn), math.cos(turn)])
    return np.array([corner, corner + width * across, corner + width * across + height * down, corner + height * down])


def _metres(corners: np.ndarray, grid: Grid) -> shapely.Geometry:
    world = np.column_stack([grid.west + corners[:, 0] * grid.cell, grid.north - corners[:, 1] * grid.cell])
    shape = shapely.Polygon(world)
    if not shape.is_valid:
        parts = shapely.get_parts(shapely.get_parts(shapely.make_valid(shape)))
        shape = shapely.MultiPolygon([part for part in parts if part.geom_type == "Polygon"])
    if not shape.area > 0:
        raise ValueError("it has no area")
    return shape


def _painted(value: Mapping[str, Any], grid: Grid) -> shapely.Geometry:
    if value.get("format") != "rle" or not isinstance(value.get("rle"), list):
        raise MaskError("it has no run lengths")
    mask = brush_mask(value["rle"], *grid.shape)
    if not mask.any():
        raise MaskError("nothing is painted")
    return cell_polygons(mask.astype(np.int32), 1, grid)[0]
