"""A georeferenced raster as PNG pictures that a labelling program shows, with world files."""

from __future__ import annotations

import hashlib
import math
import warnings
from collections.abc import Iterator
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
import rasterio
from numpy.typing import NDArray
from pyproj import CRS
from rasterio.enums import ColorInterp
from rasterio.errors import NotGeoreferencedWarning, RasterioError
from rasterio.io import DatasetReader
from rasterio.windows import Window

from ...interface.input_files import RASTER
from ..core.errors import InputError
from ..core.input_files import check_input
from ..core.messages import shown
from ..core.staged_outputs import atomic_output
from ..grid.geotiff import grid_of
from ..grid.grid import Grid

_LOOK_PIXELS = 1500  # along a side of the raster that is looked at for black and white


class PictureSource:
    """A raster of colours (3 or 4 bands of 8 bits), or of one band, which becomes grey between its 2nd and 98th
    percentile; to be used as a context.

    Raises:
        InputError: no GeoTIFF, not north-up with square pixels, without a reference system or of other bands.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        check_input(path, RASTER)
        try:
            self._source: DatasetReader = rasterio.open(path, driver="GTiff")
        except RasterioError as error:
            raise self._unreadable() from error
        source = self._source
        self.grid = grid_of(source, path)
        colours = source.count in (3, 4) and set(source.dtypes) == {"uint8"}
        if not colours and source.count != 1:
            raise InputError(
                f"{shown(path)} has {source.count} bands of {source.dtypes[0]}; give a picture of 3 or 4 bands of 8 "
                "bits, or a raster of one band."
            )
        if source.crs is None:
            raise InputError(f"{shown(path)} has no reference system; give a raster that has one.")
        self.crs = CRS.from_wkt(source.crs.to_wkt(version="WKT2_2019"))
        try:
            self._levels = None if colours else self._black_and_white()
        except (RasterioError, ValueError) as error:
            raise self._unreadable() from error

    def _unreadable(self) -> InputError:
        return InputError(f"{shown(self.path)} cannot be read as a raster; give a GeoTIFF such as top_view.tif.")

    def __enter__(self) -> PictureSource:
        return self

    def __exit__(self, *error: object) -> None:
        self._source.close()

    def tiles(self, largest: int) -> Iterator[tuple[str, Grid, NDArray[np.uint8]]]:
        """Parts of at most ``largest`` pixels a side that show anything: ending of the name, grid, picture."""
        down, across = (-(-n // largest) for n in self.grid.shape)
        rows, columns = (math.ceil(n / parts) for n, parts in zip(self.grid.shape, (down, across), strict=True))
        for i in range(down):
            for j in range(across):
                window = Window.from_slices(
                    (i * rows, min((i + 1) * rows, self.grid.rows)),
                    (j * columns, min((j + 1) * columns, self.grid.columns)),
                )
                try:
                    rgba = self._rgba(window)
                except (RasterioError, ValueError) as error:
                    raise self._unreadable() from error
                west, north = self.grid.west + j * columns * self.grid.cell, self.grid.north - i * rows * self.grid.cell
                if rgba[..., 3].any():
                    ending = f"_{i + 1}_{j + 1}" if down * across > 1 else ""
                    yield ending, Grid(west, north, self.grid.cell, *rgba.shape[:2]), rgba

    def _rgba(self, window: Window) -> NDArray[np.uint8]:
        values = self._source.read(window=window)
        alpha = self._source.dataset_mask(window=window)
        if self._levels is not None:
            low, high = self._levels
            known = alpha > 0
            share = (np.where(known, values[0], low) - low) / max(high - low, 1e-9)
            values = np.stack([np.rint(np.clip(share, 0.0, 1.0) * 255.0)] * 3)
        rgba = np.dstack([*values[:3].astype(np.uint8), alpha])
        rgba[alpha == 0] = 0
        return rgba

    def _black_and_white(self) -> tuple[float, float]:
        shape = tuple(min(n, _LOOK_PIXELS) for n in self.grid.shape)
        look = self._source.read(1, out_shape=shape, masked=True).compressed()
        look = look[np.isfinite(look)]
        low, high = np.percentile(look, (2, 98)) if look.size else (0.0, 1.0)
        return float(low), float(high)


def write_png(path: Path, rgba: NDArray[np.uint8], grid: Grid, crs: CRS) -> str:
    """Write a picture (rows, columns, 4), its world file and its reference system next to it; its SHA-256."""
    bands = np.moveaxis(rgba, -1, 0)

    def check(written: Path) -> None:
        with rasterio.open(written) as source:
            if not np.array_equal(source.read(), bands):
                raise InputError(f"{path.name} read back differs from what was written; try again.")

    profile = {"driver": "PNG", "width": grid.columns, "height": grid.rows, "count": 4, "dtype": "uint8"}
    with rasterio.Env(GDAL_PAM_ENABLED="NO"), warnings.catch_warnings(), atomic_output(path, check) as partial:
        warnings.simplefilter("ignore", NotGeoreferencedWarning)  # the world file says where it lies
        with rasterio.open(partial, "w", **profile) as target:
            target.colorinterp = (ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha)
            target.write(bands)
    half = grid.cell / 2
    numbers = (grid.cell, 0.0, 0.0, -grid.cell, grid.west + half, grid.north - half)
    path.with_suffix(".pgw").write_text("".join(f"{n!r}\n" for n in numbers), encoding="ascii")
    known = f"<PAMDataset>\n  <SRS>{escape(crs.to_wkt())}</SRS>\n</PAMDataset>\n"
    path.with_name(f"{path.name}.aux.xml").write_text(known, encoding="utf-8")
    return hashlib.sha256(path.read_bytes()).hexdigest()
