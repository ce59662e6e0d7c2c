"""The layers that results are related to: the road that zones lie on, and the classes of asset that changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import geopandas as gpd
import shapely
from pyproj import CRS
from shapely.geometry.base import BaseGeometry

from ..engine.core.errors import InputError
from ..engine.core.messages import shown
from ..engine.core.progress import Progress
from ..engine.pointcloud.reading import open_cloud
from ..engine.road.centreline import read_roads
from ..engine.road.locating import located
from ..engine.road.network import Network
from ..engine.vector.asset_classes import AssetClasses, read_asset_classes
from ..engine.vector.field_mapping import read_field_mapping
from ..interface.parameters import AssetParameters, InputParameters, RoadParameters
from .layer_files import NO_LAYERS, LayerFiles


@dataclass(frozen=True)
class Related:
    """What was read of ``LayerFiles``; None of what was not given."""

    road: Network | None = None
    classes: AssetClasses | None = None

    def placed(
        self, frame: gpd.GeoDataFrame, progress: Progress, what: str = "zones", name: str = "zone_id"
    ) -> gpd.GeoDataFrame:
        """The zones with their places on the road, where one was given; a warning names those that have none."""
        if self.road is None:
            return frame
        found = located(frame, self.road)
        for sentence in found.warnings(what, name):
            progress.warning(sentence)
        return found.frame


def read_layers(
    files: LayerFiles,
    parameters: tuple[RoadParameters, AssetParameters | None],
    crs: CRS,
    near: BaseGeometry | None,
    progress: Progress,
) -> Related:
    """Read what was given, with warnings on what was assumed.

    Args:
        near: where the slope is, metres of ``crs``.

    Raises:
        InputError: a file cannot be used.
    """
    road: Network | None = None
    classes: AssetClasses | None = None
    notes: Sequence[str] = ()
    if files.centreline is not None:
        names = read_field_mapping(files.field_names)
        road, notes = read_roads(files.centreline, crs, parameters[0], names).network(near)
    elif files.field_names is not None:
        raise InputError("--field-names was given without --centreline; give the road's centreline, too.")
    if files.classes is not None and parameters[1] is not None:
        classes, more = read_asset_classes(files.classes, parameters[1].class_field, crs)
        notes = (*notes, *more)
        if near is not None and not any(shape.intersects(near) for shape in classes.shapes):
            raise InputError(
                f"No polygon of the classes {shown(files.classes)} lies on the slope; check their reference system."
            )
    for note in notes:
        progress.warning(note)
    return Related(road, classes)


def layers_on_cloud(
    files: LayerFiles,
    parameters: tuple[RoadParameters, AssetParameters | None],
    cloud: Path,
    inputs: InputParameters | None,
    progress: Progress,
) -> Related:
    """``read_layers`` in the frame of a cloud, and where that lies by its header."""
    if files == NO_LAYERS:
        return Related()
    header, frame = open_cloud(cloud, inputs)
    near = None
    if header.bounds_trusted:
        low, high = (
            [v * frame.horizontal_factor for v in corner[:2]] for corner in (header.bounds_low, header.bounds_high)
        )
        near = shapely.box(*low, *high)
    return read_layers(files, parameters, frame.crs, near, progress)
