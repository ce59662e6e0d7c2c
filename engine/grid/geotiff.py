"""GeoTIFFs of a run: written in one layout, reopened and compared before they get their name."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
import rasterio.shutil
from affine import Affine
from numpy.typing import ArrayLike, NDArray
from pyproj import CRS
from rasterio.enums import ColorInterp
from rasterio.errors import CRSError, RasterioError
from rasterio.io import DatasetReader, DatasetWriter, MemoryFile
from rasterio.windows import Window

from ...interface.input_files import RASTER
from ..core.errors import EngineError, InputError
from ..core.input_files import check_input
from ..core.staged_outputs import atomic_output
from ..statistics.layout import Laid, laid
from .grid import Grid

NODATA = -9999.0
NO_CLASS = 255
"""Nodata of rasters of classes."""
_MAX_DECODED_RATIO = 1100
"""Bytes that one of a file may stand for: DEFLATE makes at most 1032 of one."""
_MIN_SIZE_B = 10_000
"""Below it nothing is too large to be read."""

_CACHE_BYTES = 128 * 2**20  # of blocks that GDAL keeps, in place of a twentieth of the machine's memory
# One thread: the bytes must not depend on the machine. No .aux.xml: everything is inside the file.
_ENVIRONMENT = {"GDAL_PAM_ENABLED": "NO", "GDAL_NUM_THREADS": "1", "GDAL_CACHEMAX": _CACHE_BYTES}
_TILE = 512  # pixels along the side of a tile
_PLAIN = {"tiled": True, "blockxsize": _TILE, "blockysize": _TILE, "SPARSE_OK": "TRUE"}
_LAYOUT = {
    "COMPRESS": "DEFLATE",
    "BLOCKSIZE": str(_TILE),
    "BIGTIFF": "IF_SAFER",
    "OVERVIEW_RESAMPLING": "AVERAGE",
}


@dataclass(frozen=True)
class Raster:
    """A single-band raster as read: ``array`` is float32 (rows, columns) with NaN where there is no data."""

    array: NDArray[np.float32]
    grid: Grid
    crs: CRS | None
    description: str
    unit: str
    tags: dict[str, str]


def raster_tags(
    *,
    epochs: tuple[date | None, date | None] = (None, None),
    median_level: float | None = None,
    translation: ArrayLike | None = None,
    software: str = "",
    input_sha256: str = "",
) -> dict[str, str]:
    """The tags that every raster of a run carries; what is not known is left out.

    Args:
        median_level: median level of detection, metres.
        translation: the three translations of the co-registration, metres.
        input_sha256: hashes of the inputs, separated by spaces.
    """
    tags = {
        "EPOCH_FROM": epochs[0].isoformat() if epochs[0] else "",
        "EPOCH_TO": epochs[1].isoformat() if epochs[1] else "",
        "LOD95_MEDIAN": "" if median_level is None or not np.isfinite(median_level) else f"{median_level:.6f}",
        "SOFTWARE": software,
        "INPUT_SHA256": input_sha256,
    }
    if translation is not None:
        for name, value in zip(("COREG_DX", "COREG_DY", "COREG_DZ"), np.asarray(translation, float), strict=True):
            tags[name] = f"{value:.6f}"
    return {name: value for name, value in tags.items() if value}


def write_raster(
    path: Path,
    array: NDArray[np.floating] | Laid,
    grid: Grid,
    crs: CRS | None,
    *,
    description: str,
    unit: str = "m",
    tags: Mapping[str, str] | None = None,
) -> None:
    """Write ``array`` (NaN for no data) as a Float32 cloud-optimised GeoTIFF with nodata -9999.

    Args:
        array: (rows, columns), or a list of cells.

    Raises:
        EngineError: the array does not fit the grid or is infinite somewhere, or the file read back differs.
        InputError: the folder is missing or not writable.
    """
    write_bands(path, {description: array}, grid, crs, unit=unit, tags=tags)


def write_bands(
    path: Path,
    bands: Mapping[str, NDArray[np.floating] | Laid],
    grid: Grid,
    crs: CRS | None,
    *,
    unit: str | Sequence[str] = "m",
    tags: Mapping[str, str] | None = None,
) -> None:
    """Like ``write_raster`` with several bands, by their descriptions; ``unit`` of all bands, or of each."""
    name, held = Path(path).name, [laid(band) for band in bands.values()]
    for band in held:
        if band.layout.shape != grid.shape or band.values.shape != band.layout.array_shape:
            raise EngineError(f"{name}: an array of {band.values.shape} does not fit a grid of {grid.shape}")
        if np.isinf(band.values).any():
            raise EngineError(f"{name}: the raster has infinite values")
    profile = {"count": len(bands), "dtype": "float32", "nodata": NODATA}

    def lines(rows: slice) -> NDArray[np.float32]:
        found = np.stack([band.layout.lines(band.values, rows).astype(np.float32) for band in held])
        found[np.isnan(found)] = NODATA
        return found

    def describe(target: DatasetWriter) -> None:
        for number, description in enumerate(bands, 1):
            target.set_band_description(number, description)
        target.units = (unit,) * len(bands) if isinstance(unit, str) else tuple(unit)

    _write(Path(path), grid, crs, profile, tags, describe, lines)


def write_rgba(
    path: Path,
    rgba: NDArray[np.uint8],
    grid: Grid,
    crs: CRS | None,
    *,
    tags: Mapping[str, str] | None = None,
    description: str = "",
) -> None:
    """Write ``rgba`` (rows, columns, 4) as a cloud-optimised GeoTIFF whose fourth band is transparency.

    Raises:
        EngineError: the picture does not fit the grid, or the file read back differs.
        InputError: the folder is missing or not writable.
    """
    if rgba.shape != (*grid.shape, 4) or rgba.dtype != np.uint8:
        raise EngineError(f"{Path(path).name}: a picture of {rgba.shape} does not fit a grid of {grid.shape}")
    profile = {"count": 4, "dtype": "uint8", "photometric": "RGB", "alpha": "unspecified"}

    def lines(rows: slice) -> NDArray[np.uint8]:
        return np.ascontiguousarray(np.moveaxis(rgba[rows], -1, 0))

    def describe(target: DatasetWriter) -> None:
        target.colorinterp = (ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha)

    _write(Path(path), grid, crs, profile, {"DESCRIPTION": description, **(tags or {})}, describe, lines)


def write_classes(
    path: Path,
    classes: NDArray[np.uint8],
    grid: Grid,
    crs: CRS | None,
    looks: Mapping[int, tuple[str, tuple[int, int, int, int]]],
    *,
    description: str,
    tags: Mapping[str, str] | None = None,
) -> None:
    """Write ``classes`` (rows, columns) as a cloud-optimised GeoTIFF with a colour table and nodata 255.

    Args:
        looks: name and colour (red, green, blue, opacity) of each class; the tag ``CLASS_n`` names class n.

    Raises:
        EngineError: the classes do not fit the grid, or the file read back differs.
        InputError: the folder is missing or not writable.
    """
    if classes.shape != grid.shape or classes.dtype != np.uint8:
        raise EngineError(f"{Path(path).name}: classes of {classes.shape} do not fit a grid of {grid.shape}")
    names = {f"CLASS_{number}": name for number, (name, _) in looks.items()}

    def describe(target: DatasetWriter) -> None:
        target.set_band_description(1, description)
        target.write_colormap(1, {number: colour for number, (_, colour) in looks.items()})

    profile = {"count": 1, "dtype": "uint8", "nodata": NO_CLASS, "photometric": "PALETTE"}
    _write(Path(path), grid, crs, profile, names | dict(tags or {}), describe, lambda rows: classes[np.newaxis, rows])


def read_raster(path: Path, band: int = 1) -> Raster:
    """Read one band with NaN where there is no data: what the file declares as such, NaN, and -9999 in any case.

    Raises:
        InputError: not a GeoTIFF, not north-up with square cells, without that band, or larger than its bytes can be.
    """
    with open_raster(path, band) as opened:
        source = opened.source
        return Raster(
            array=opened.rows(0, source.height),
            grid=opened.grid,
            crs=CRS.from_wkt(source.crs.to_wkt(version="WKT2_2019")) if source.crs else None,
            description=source.descriptions[band - 1] or "",
            unit=source.units[band - 1] or "",
            tags={k: v for k, v in source.tags().items() if k != "AREA_OR_POINT"},
        )


@dataclass(frozen=True)
class OpenRaster:
    """A band of a file that is open, on its ``grid``."""

    source: DatasetReader
    band: int
    grid: Grid

    def rows(self, first: int, last: int) -> NDArray[np.float32]:
        """Rows ``first`` to before ``last`` (rows, columns), NaN where there is no data, as ``read_raster`` says."""
        return rows_of(self.source, self.band, first, last)


def rows_of(source: DatasetReader, band: int, first: int, last: int) -> NDArray[np.float32]:
    """Rows ``first`` to before ``last`` of a band (rows, columns), NaN where there is no data."""
    window = Window(0, first, source.width, last - first)
    with np.errstate(invalid="ignore"):  # NaN of a kind that signals
        values = source.read(band, window=window).astype(np.float32, copy=False)
        # other programs leave our -9999 behind where they declare NaN, or nothing
        values[(source.read_masks(band, window=window) == 0) | (values == NODATA) | np.isnan(values)] = np.nan
    return np.asarray(values)


@contextlib.contextmanager
def open_raster(path: Path, band: int = 1) -> Iterator[OpenRaster]:
    """A band to be read in parts.

    Raises:
        InputError: as ``read_raster``, here or while it is read.
    """
    with open_any_grid(path, band) as source:
        yield OpenRaster(source, band, grid_of(source, Path(path)))


@contextlib.contextmanager
def open_any_grid(path: Path, band: int = 1) -> Iterator[DatasetReader]:
    """A file whose grid may be turned, upside down or of other cells than squares.

    Raises:
        InputError: as ``read_raster`` but for the grid, here or while it is read.
    """
    check_input(path, RASTER)
    try:
        # no other format: some refer to files elsewhere
        with rasterio.Env(**_ENVIRONMENT), rasterio.open(path, driver="GTiff") as source:
            _refuse_senseless(source, Path(path), band)
            yield source
    except (RasterioError, CRSError, ValueError) as error:
        raise InputError(f"{path} cannot be read as a raster; give a GeoTIFF.") from error


def _refuse_senseless(source: DatasetReader, path: Path, band: int) -> None:
    """Raise InputError for a band that is not there, and for sizes that no bytes of the file stand behind."""
    if source.count < band:
        raise InputError(f"{path} has {source.count} bands where {band} are needed; give the raster of a run.")
    decoded = source.height * source.width * np.dtype(source.dtypes[band - 1]).itemsize
    if decoded > _MAX_DECODED_RATIO * max(path.stat().st_size, _MIN_SIZE_B):
        raise InputError(
            f"{path} declares {source.width} by {source.height} cells, more than its bytes can hold; it is damaged, so "
            "make it again."
        )
    if not np.isfinite(tuple(source.transform)).all():
        raise InputError(f"{path} has a place that is no number; it is damaged, so make it again.")


_FARTHEST_M = 1e9
"""Of a corner from its system's origin: beyond it a cell is lost in the digits, and no projected system reaches it."""


def grid_of(source: DatasetReader, path: Path) -> Grid:
    """The grid of a raster; InputError where it is not north-up with square cells."""
    a, b, west, d, e, north = tuple(source.transform)[:6]
    if b or d or a <= 0 or not np.isclose(a, -e, rtol=1e-9):
        raise InputError(f"{path} is not north-up with square cells; warp it first.")
    if not max(abs(west), abs(north)) <= _FARTHEST_M:
        raise InputError(
            f"{path} has a corner at {west:.3g}, {north:.3g}, which is no place on Earth; georeference it."
        )
    return Grid(west=west, north=north, cell=a, rows=source.height, columns=source.width)


def _write(
    path: Path,
    grid: Grid,
    crs: CRS | None,
    profile: dict[str, object],
    tags: Mapping[str, str] | None,
    describe: Callable[[DatasetWriter], None],
    lines: Callable[[slice], NDArray[Any]],
) -> None:
    """A plain GeoTIFF in memory, then a copy in the cloud-optimised layout (that driver can only copy).

    Rows are made as they are needed; of the plain one, tiles without data take no memory.

    Args:
        lines: all bands (bands, rows, columns) of some rows.
    """
    wkt = rasterio.crs.CRS.from_wkt(crs.to_wkt()) if crs is not None else None
    options = {**profile, "height": grid.rows, "width": grid.columns, "transform": Affine(*grid.affine), "crs": wkt}

    def check(written: Path) -> None:
        _check(written, grid, wkt, lines)

    try:
        with rasterio.Env(**_ENVIRONMENT), atomic_output(path, check) as partial, MemoryFile() as memory:
            with memory.open(driver="GTiff", BIGTIFF="IF_SAFER", **_PLAIN, **options) as target:
                describe(target)
                for rows in _rows(grid):
                    target.write(lines(rows), window=_window(rows, grid))
                target.update_tags(**{name: str(value) for name, value in (tags or {}).items() if value != ""})
            with memory.open() as source:
                predictor = "3" if profile["dtype"] == "float32" else "2"
                layout = _LAYOUT | ({"OVERVIEW_RESAMPLING": "MODE"} if profile.get("nodata") == NO_CLASS else {})
                rasterio.shutil.copy(source, partial, driver="COG", PREDICTOR=predictor, **layout)
    except RasterioError as error:
        raise EngineError(f"{path.name} could not be written: {error}") from error


def _rows(grid: Grid) -> list[slice]:
    """The rows that are written at a time: a row of tiles."""
    return [slice(top, min(top + _TILE, grid.rows)) for top in range(0, grid.rows, _TILE)]


def _window(rows: slice, grid: Grid) -> Window:
    return Window(0, rows.start, grid.columns, rows.stop - rows.start)


def _check(written: Path, grid: Grid, crs: rasterio.crs.CRS | None, lines: Callable[[slice], NDArray[Any]]) -> None:
    with rasterio.open(written) as source:
        sound = (
            source.shape == grid.shape
            and source.transform.almost_equals(Affine(*grid.affine), precision=1e-6)
            and (source.crs is None) == (crs is None)
            and all(np.array_equal(source.read(window=_window(rows, grid)), lines(rows)) for rows in _rows(grid))
        )
    if not sound:
        raise EngineError(f"{written.name} read back differs from what was written")
