"""The raster of what was seen: which cells were compared, and why the others were not."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date
from pathlib import Path

from pyproj import CRS

from ...engine.change.coverage import Seen
from ...engine.grid import geotiff
from ...engine.grid.grid import Grid
from ...engine.maps import palette, qgis_styles
from ...interface.seen import LABELS


def write_seen(
    path: Path, of_slope: Seen, grid: Grid, crs: CRS, tags: Mapping[str, str], shown: tuple[date, date] | None = None
) -> None:
    """Write the class of each cell, with a style next to it; its legend has only the classes that occur.

    ``shown``: the temporal controller shows the layer after the first day until the second.
    """
    present = [one for one in LABELS if of_slope.area(one)]
    looks = {one: (LABELS[one], palette.SEEN[one]) for one in LABELS}
    words = "Cells of the slope that were compared, and why others were not"
    geotiff.write_classes(path, of_slope.classes, grid, crs, looks, description=words, tags=tags)
    qgis_styles.write_qml_next_to(path, qgis_styles.seen_qml(present, shown))
