"""Labels from polygons: points inside a polygon have its class."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj.exceptions import CRSError, ProjError

from ...engine.core.errors import InputError
from ...engine.core.messages import shown
from ...engine.core.progress import Progress
from ...engine.pointcloud.cloud import PointCloud
from ...engine.pointcloud.reading import open_cloud
from ...engine.vector.polygon_file import read_polygons
from ...interface.parameters import InputParameters
from ..preparation.prepare import UNKNOWN


@dataclass(frozen=True)
class LabelPolygons:
    """Polygons with their class: ``frame`` has a geometry and the column ``label``."""

    path: Path
    frame: geopandas.GeoDataFrame


def read_label_polygons(
    path: Path, class_field: str, mapping: Mapping[str, int], key: Callable[[Any], str]
) -> LabelPolygons:
    """The polygons of the first layer of a vector file that has any.

    Args:
        mapping: class of every value of ``class_field``, as ``key`` writes it.

    Raises:
        InputError: missing, not a vector file, without polygons or the field, or with a value that is no class.
    """
    name = shown(path)
    frame, field = read_polygons(path, class_field, "--class-field")
    values = frame[field]
    labels = np.full(len(frame), UNKNOWN, dtype=np.uint8)
    other = mapping.get("*")
    for place, value in enumerate(values.tolist()):
        empty = value is None or value != value
        label = other if empty else mapping.get(key(value), other)
        if label is None:
            content = "no value" if empty else f"the value {value!r}"
            raise InputError(
                f"A polygon of {name} has {content} in the field {field}, which is no class; give background, "
                "uplift, subsidence or unknown, or say what it is with --classes."
            )
        labels[place] = label
    kept = geopandas.GeoDataFrame({"label": labels}, geometry=frame.geometry.to_numpy(), crs=frame.crs)
    kept = kept[~(kept.geometry.is_empty | kept.geometry.isna())]
    if kept.empty:
        raise InputError(f"{name} holds no polygons; draw some around what moved and give them a class.")
    return LabelPolygons(Path(path), kept)


def label_by_polygons(
    cloud: PointCloud, polygons: LabelPolygons, outside: int, inputs: InputParameters, progress: Progress
) -> tuple[NDArray[np.uint8], int]:
    """(n,) the class of the polygon that each point lies in, ``outside`` where in none, unknown where polygons of
    different classes overlap; and how many polygons have points.

    Raises:
        InputError: the polygons cannot be brought into the cloud's reference system.
    """
    name = shown(polygons.path)
    labels = np.full(len(cloud), outside, dtype=np.uint8)
    inside = np.zeros(len(cloud), dtype=bool)
    disputed = np.zeros(len(cloud), dtype=bool)
    touching = 0
    frame = _in_cloud_system(cloud, polygons, inputs, progress)
    x, y = cloud.xyz[:, 0], cloud.xyz[:, 1]
    order = np.argsort(x, kind="stable")
    sorted_x = x[order]
    for geometry, label in zip(frame.geometry, frame["label"]):
        west, south, east, north = geometry.bounds
        near = order[np.searchsorted(sorted_x, west, "left") : np.searchsorted(sorted_x, east, "right")]
        near = near[(y[near] >= south) & (y[near] <= north)]
        near = near[shapely.contains_xy(geometry, x[near], y[near])]
        disputed[near] |= inside[near] & (labels[near] != label)
        labels[near] = label
        inside[near] = True
        touching += bool(len(near))
    labels[disputed] = UNKNOWN
    if not touching:
        progress.warning(f"No polygon of {name} lies on {shown(cloud.path)}.")
    if disputed.any():
        progress.warning(
            f"{int(disputed.sum())} points of {shown(cloud.path)} lie in polygons of different classes; they are not "
            "trained on."
        )
    return labels, touching


def _in_cloud_system(
    cloud: PointCloud, polygons: LabelPolygons, inputs: InputParameters, progress: Progress
) -> geopandas.GeoDataFrame:
    name, crs = shown(polygons.path), cloud.crs
    horizontal = crs.sub_crs_list[0] if crs.is_compound else crs
    frame = polygons.frame
    if frame.crs is None:
        progress.warning(f"The polygons {name} declare no reference system; that of the cloud is assumed.")
        unit = open_cloud(cloud.path, inputs)[1].horizontal_factor
        scaled = frame.geometry.affine_transform([unit, 0, 0, unit, 0, 0])
        return frame.set_geometry(scaled)
    try:
        moved = frame.to_crs(horizontal)
    except (CRSError, ProjError) as error:
        raise InputError(
            f"The polygons {name} cannot be brought into the reference system of {shown(cloud.path)}; save them in it."
        ) from error
    finite = np.isfinite(moved.geometry.bounds.to_numpy()).all(axis=1)
    return moved[finite]
