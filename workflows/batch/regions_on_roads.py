"""Where the regions of a corridor's slopes lie on their roads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import geopandas as gpd
import numpy as np
from pyproj import CRS

from ...engine.core.errors import InputError
from ...engine.road.centreline import Roads, read_roads
from ...engine.road.locating import PLACED, located
from ...engine.vector.cell_polygons import table_column
from ...engine.vector.field_mapping import read_field_mapping
from ...interface.parameters import RoadParameters


@dataclass(frozen=True)
class Road:
    """A centreline, the agency's names of its fields, and how its chainages are to be read."""

    path: Path
    field_names: Path | None
    parameters: RoadParameters


def placed_regions(frame: gpd.GeoDataFrame, roads: Mapping[str, Road]) -> gpd.GeoDataFrame:
    """The regions with their places; empty where a slope has no region or no road.

    Args:
        frame: one row a slope, with the column ``slope``.
    """
    if not roads or frame.crs is None:
        return frame
    columns: dict[str, list[object]] = {
        name: ["" if kind == "text" else np.nan] * len(frame) for name, kind in PLACED.items()
    }
    for number, (slope, shape) in enumerate(zip(frame["slope"], frame.geometry, strict=True)):
        if shape is None or slope not in roads:
            continue
        try:
            network, _ = _roads(roads[slope], CRS.from_user_input(frame.crs)).network(shape)
        except InputError:  # the slope itself has failed with that sentence
            continue
        placed = located(frame.iloc[[number]][["slope", frame.geometry.name]], network).frame
        for name in PLACED:
            columns[name][number] = placed[name].iloc[0]
    kinds = {
        name: np.array(values, dtype=object if PLACED[name] == "text" else float) for name, values in columns.items()
    }
    return frame.assign(
        **{name: table_column(kinds[name], PLACED[name], len(frame)).set_axis(frame.index) for name in kinds}
    )


@lru_cache(maxsize=16)
def _roads(road: Road, crs: CRS) -> Roads:
    return read_roads(road.path, crs, road.parameters, read_field_mapping(road.field_names))
