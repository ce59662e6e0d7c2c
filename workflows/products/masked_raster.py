"""A raster of change that a map draws pale where it is within the level of detection of its cell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from pyproj import CRS

from ...engine.core.arrays import Bool, Float
from ...engine.grid import geotiff
from ...engine.grid.grid import Grid
from ...engine.maps import opacity_band, qgis_styles
from ...engine.statistics.layout import Laid, laid


@dataclass(frozen=True)
class Legend:
    """What the change is, in words; its colours run from ``-limit`` to ``limit``, in ``unit``.

    ``shown`` as of ``qgis_styles.change_qml``.
    """

    description: str
    limit: float
    unit: str = "m"
    shown: tuple[date, date] | None = None


def write_masked_raster(
    path: Path,
    change: Float | Laid,
    beyond: Bool,
    grid: Grid,
    crs: CRS | None,
    legend: Legend,
    tags: Mapping[str, str] | None = None,
) -> None:
    """Write ``change`` as the first band, the opacity of its cells as the second, and the style that draws both.

    Args:
        change: (rows, columns), or a list of cells; NaN for no data.
        beyond: of the same shape, whether the change is beyond the level of detection of its cell.

    Raises:
        EngineError, InputError: as of ``geotiff.write_raster``.
    """
    held = laid(change)
    bands = {legend.description: held, opacity_band.NAME: Laid(opacity_band.opacity(held.values, beyond), held.layout)}
    geotiff.write_bands(path, bands, grid, crs, unit=(legend.unit, opacity_band.UNIT), tags=tags)
    qml = qgis_styles.change_qml(legend.limit, unit=legend.unit, shown=legend.shown, opacity_band=opacity_band.BAND)
    qgis_styles.write_qml_next_to(path, qml)
