"""What a batch shows people of all slopes: the page, and the report to sign."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import geopandas as gpd
import pandas as pd
import rasterio
from pyproj import CRS
from pyproj.exceptions import CRSError
from shapely import box
from shapely.geometry.base import BaseGeometry

from ...engine.core.progress import Progress
from ...engine.core.version import VERSION
from ...engine.report.corridor import corridor_page, corridor_pictures
from ...engine.report.corridor_alerts import levels_of_zones, withdrawn_of
from ...engine.report.signed.corridor import SignedCorridor, write_corridor_pdf
from ...engine.report.signed.corridor_pictures import Span
from .ranking import Ranked

_RASTERS = ("elevation_change.tif", "velocity.tif", "screened_probability.tif")
"""Of a slope's results, whose extent stands for its region where none was given."""


@dataclass(frozen=True)
class Shown:
    """Slopes that are done in their order, slope and sentence of those that failed, the tables of ``zones``, of open
    ``alerts`` and of ``slopes`` (see corridor.gpkg), the ``folders`` of results by slope, the name of the
    ``manifest``, and the ``count`` of all slopes.
    """

    ranked: Sequence[Ranked]
    failed: Sequence[tuple[str, str]]
    zones: gpd.GeoDataFrame
    alerts: gpd.GeoDataFrame
    slopes: gpd.GeoDataFrame
    folders: Mapping[str, Path]
    manifest: str
    count: int


def page_of(shown: Shown) -> str:
    """The page as HTML."""
    alerts = shown.alerts.drop(columns=shown.alerts.geometry.name).to_dict("records")
    facts = {"software": f"SlopeWatch {VERSION}", "manifest": shown.manifest, "count": shown.count}
    attention = _attentions(shown)
    pictures = corridor_pictures(shown.zones, _regions(shown), attention, _spans(shown, attention))
    facts |= {"zones": len(shown.zones), "levels": levels_of_zones(shown.zones), "withdrawn": withdrawn_of(shown.zones)}
    return corridor_page(shown.ranked, shown.failed, alerts, facts, pictures)


def write_pdf_of(shown: Shown, path: Path, details: Mapping[str, Any], started: str, progress: Progress) -> None:
    """Write the report to sign.

    Raises:
        InputError: the details do not fit, or what makes a PDF is missing.
    """
    corridor = SignedCorridor(
        shown.ranked, shown.failed, shown.zones, shown.alerts, _regions(shown), shown.manifest,
        _spans(shown, _attentions(shown)), shown.folders,
    )  # fmt: skip
    write_corridor_pdf(path, corridor, details, started, progress)


def _attentions(shown: Shown) -> dict[str, int]:
    return {slope.slope: slope.attention for slope in shown.ranked}


def _regions(shown: Shown) -> list[tuple[str, BaseGeometry]]:
    """The slopes that have a place, by their names."""
    named = zip(shown.slopes["slope"], shown.slopes.geometry, strict=True)
    places = ((str(name), _place(str(name), shape, shown)) for name, shape in named)
    return [(name, place) for name, place in places if place is not None]


def _place(slope: str, region: BaseGeometry | None, shown: Shown) -> BaseGeometry | None:
    """The region of a slope, else the extent of a raster of its results in the same reference system."""
    if region is not None and not region.is_empty:
        return region
    crs = shown.zones.crs
    for name in _RASTERS if slope in shown.folders else ():
        path = shown.folders[slope] / name
        if path.is_file():
            try:
                with rasterio.open(path) as raster:
                    system = None if raster.crs is None else CRS.from_user_input(raster.crs)
                    return box(*raster.bounds) if crs is None or system == CRS.from_user_input(crs) else None
            except (rasterio.errors.RasterioError, CRSError):
                return None
    return None


def _spans(shown: Shown, attention: Mapping[str, int]) -> list[Span]:
    """Where slopes lie on their roads: their regions, or else what their zones reach."""
    found: dict[str, Span] = {}
    for table in (shown.slopes, shown.zones):
        if not {"slope", "chain_from", "chain_to"} <= set(table.columns):
            continue
        for name, own in table.groupby("slope", sort=False):
            slope = str(name)
            ends = pd.concat([own["chain_from"], own["chain_to"]]).astype(float).dropna()
            if slope in found or ends.empty:
                continue
            routes = [str(route) for route in own["route"] if isinstance(route, str) and route]
            found[slope] = Span(
                slope, routes[0] if routes else "", float(ends.min()), float(ends.max()), attention.get(slope)
            )
    return list(found.values())
