"""Heatmap: the change half-transparent over the top view, as a georeferenced picture and as an annotated PNG."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import geopandas as gpd
from pyproj import CRS

from ...interface.parameters import HeatmapParameters
from ..change.result import Change
from ..core.staged_outputs import atomic_output
from ..grid.geotiff import write_rgba
from ..zones.extraction import Zones
from .heatmap_image import Heatmap, make_heatmap
from .top_view import TopView


def write_heatmap(
    png: Path,
    raster: Path,
    change: Change,
    view: TopView,
    found: Zones,
    crs: CRS | None,
    parameters: HeatmapParameters | None = None,
    *,
    limit: float | None = None,
    epochs: tuple[str, str] = ("", ""),
    name: str = "",
    tags: Mapping[str, str] | None = None,
) -> Heatmap:
    """Make the heatmap of a change and write it as annotated PNG and as georeferenced RGBA raster.

    Args:
        limit: end of the legend, metres; from the data and ``parameters`` if not given.
        epochs: what the title calls the two epochs.
        name: of the slope, for the title.

    Raises:
        InputError: a folder is missing or not writable.
    """
    picture = make_heatmap(change.dz, change.significant, change.level, change.grid, view, parameters, limit=limit)
    write_heatmap_png(png, picture, zones=found.frame, epochs=epochs, name=name)
    write_rgba(raster, picture.rgba, picture.grid, crs, tags=tags)
    return picture


def write_heatmap_png(
    path: Path,
    heatmap: Heatmap,
    *,
    zones: gpd.GeoDataFrame | None = None,
    epochs: tuple[str, str] = ("", ""),
    name: str = "",
) -> None:
    """Write the heatmap as an annotated PNG: zone outlines and ids, legend, scale bar, north arrow, coordinates.

    Args:
        zones: as of ``extraction.extract_zones``, in the heatmap's horizontal reference system, most severe first.

    Raises:
        InputError: the folder is missing or not writable.
    """
    # matplotlib takes half a second to import; nothing else of the engine should wait for it
    from .figure import DPI, check_png, make_figure

    with atomic_output(Path(path), check_png) as partial:
        figure = make_figure(heatmap, zones=zones, epochs=epochs, name=name)
        figure.savefig(partial, format="png", dpi=DPI, metadata={"Software": "SlopeWatch"})
