"""A mosaic of the slopes' rasters as a VRT: an XML file that names them, so that no cell is written twice.

The format is GDAL's (https://gdal.org/en/stable/drivers/raster/vrt.html). Rasters of another reference system than the
first are left out.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import escape

import rasterio
from rasterio.crs import CRS
from rasterio.errors import RasterioIOError

from ...engine.core.errors import EngineError
from ...engine.grid.geotiff import NODATA


@dataclass(frozen=True)
class Tile:
    """A raster of the mosaic: its file, place and cell."""

    path: Path
    crs: CRS | None
    west: float
    north: float
    cell: float
    rows: int
    columns: int

    @property
    def south(self) -> float:
        return self.north - self.rows * self.cell

    @property
    def east(self) -> float:
        return self.west + self.columns * self.cell


def read_tile(path: Path) -> Tile:
    """The place of a raster.

    Raises:
        EngineError: it cannot be read.
    """
    try:
        with rasterio.open(path) as source:
            transform = source.transform
            return Tile(path, source.crs, transform.c, transform.f, transform.a, source.height, source.width)
    except RasterioIOError as error:
        raise EngineError(f"{path} cannot be read ({error}); remove the folder of its slope and run again.") from error


def mosaic(tiles: Sequence[Tile], folder: Path) -> tuple[str, tuple[Path, ...]]:
    """The VRT's text, and the rasters that it leaves out because of their reference system.

    Cells of the smallest size; larger ones are repeated, not smoothed. Where rasters overlap, the last one counts.

    Args:
        tiles: at least one.
        folder: where the VRT will lie: files are named from there.
    """
    crs = tiles[0].crs
    used = [tile for tile in tiles if tile.crs == crs]
    cell = min(tile.cell for tile in used)
    west, north = min(t.west for t in used), max(t.north for t in used)
    columns = math.ceil(round((max(t.east for t in used) - west) / cell, 6))
    rows = math.ceil(round((north - min(t.south for t in used)) / cell, 6))
    lines = [f'<VRTDataset rasterXSize="{columns}" rasterYSize="{rows}">']
    if crs is not None:
        lines.append(f'  <SRS dataAxisToSRSAxisMapping="1,2">{escape(crs.to_wkt())}</SRS>')
    lines.append(f"  <GeoTransform>{west!r}, {cell!r}, 0.0, {north!r}, 0.0, {-cell!r}</GeoTransform>")
    lines.append('  <VRTRasterBand dataType="Float32" band="1">')
    lines += [f"    <NoDataValue>{NODATA:g}</NoDataValue>", "    <UnitType>m</UnitType>"]
    lines.append("    <Description>Elevation change of all slopes</Description>")
    lines.append("    <ColorInterp>Gray</ColorInterp>")
    for tile in used:
        lines += _source(tile, folder, (west, north), cell)
    lines += ["  </VRTRasterBand>", "</VRTDataset>", ""]
    return "\n".join(lines), tuple(tile.path for tile in tiles if tile.crs != crs)


def _source(tile: Tile, folder: Path, origin: tuple[float, float], cell: float) -> list[str]:
    name = Path(os.path.relpath(tile.path, folder)).as_posix()
    west, north = origin
    left, top = round((tile.west - west) / cell, 6), round((north - tile.north) / cell, 6)
    width, height = round(tile.columns * tile.cell / cell, 6), round(tile.rows * tile.cell / cell, 6)
    size = f'xSize="{tile.columns}" ySize="{tile.rows}"'
    return [
        '    <ComplexSource resampling="nearest">',
        f'      <SourceFilename relativeToVRT="1">{escape(name)}</SourceFilename>',
        "      <SourceBand>1</SourceBand>",
        f'      <SourceProperties RasterXSize="{tile.columns}" RasterYSize="{tile.rows}" DataType="Float32"/>',
        f'      <SrcRect xOff="0" yOff="0" {size}/>',
        f'      <DstRect xOff="{left:g}" yOff="{top:g}" xSize="{width:g}" ySize="{height:g}"/>',
        f"      <NODATA>{NODATA:g}</NODATA>",
        "    </ComplexSource>",
    ]
