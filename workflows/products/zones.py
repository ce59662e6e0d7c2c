"""The GeoPackage of zones."""

from __future__ import annotations

from datetime import date
from pathlib import Path
from typing import Any

import geopandas as gpd
import pandas as pd

from ...engine.maps.qgis_styles import footprints_qml, not_seen_qml, unsure_qml, zones_qml
from ...engine.vector.geopackage import Layer, write_layers
from ...engine.vector.review_fields import is_located, own_columns
from ...engine.zones.fields import FIELDS


def write_zones(
    path: Path,
    frame: gpd.GeoDataFrame,
    *,
    footprints: gpd.GeoDataFrame | None = None,
    unsure: gpd.GeoDataFrame | None = None,
    not_seen: gpd.GeoDataFrame | None = None,
    volumes: pd.DataFrame | None = None,
    stamp: date | None = None,
) -> None:
    """Write zones (see ``extraction.extract_zones``; there may be none) as layer ``zones``, styled by kind and
    severity.

    Only what people enter can be edited afterwards: ``review_fields.REVIEW_FIELDS`` and columns of their own.

    Args:
        footprints: where the volumes were taken, as layer ``footprints``.
        unsure: groups that are no zones (see ``unsure.unsure_frame``), as layer ``unsure``.
        not_seen: what was not compared (see ``not_seen.not_seen_frame``), as layer ``not_seen``.
        volumes: summary of the change (see ``volume_table``), as table ``volumes`` without geometry.
    """
    layers = [
        Layer(
            frame,
            "zones",
            zones_qml(located=is_located(frame)),
            "MultiPolygon",
            own_columns(frame, FIELDS),
            guarded=True,
        )
    ]
    if footprints is not None:
        layers.append(Layer(footprints, "footprints", footprints_qml(), "MultiPolygon", guarded=True))
    if unsure is not None:
        layers.append(Layer(unsure, "unsure", unsure_qml(), "MultiPolygon", guarded=True))
    if not_seen is not None:
        layers.append(Layer(not_seen, "not_seen", not_seen_qml(), "MultiPolygon", guarded=True))
    if volumes is not None:
        layers.append(Layer(volumes, "volumes", guarded=True))
    write_layers(path, layers, stamp=stamp)


def zone_figures(frame: gpd.GeoDataFrame) -> dict[str, Any]:
    """Number of zones, and areas (m²) and net volumes (m³) of all of them: their own, and of their footprints."""
    columns = {"zone_area_m2": "area_m2", "zone_net_m3": "zone_net_m3", "footprint_area_m2": "vol_area_m2"}
    sums = {name: float(frame[column].sum()) for name, column in columns.items()}
    return {"zone_count": len(frame), **sums, "footprint_net_m3": float(frame["vol_net_m3"].sum())}
