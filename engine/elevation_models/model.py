"""An elevation model as read from its file: heights in metres, and what its file says of them."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from affine import Affine
from pyproj import CRS
from rasterio.errors import NotGeoreferencedWarning
from rasterio.io import DatasetReader

from ...interface.parameters import InputParameters
from ..core.arrays import Float
from ..core.errors import InputError
from ..core.messages import shown
from ..crs.working_frame import given_crs, plausibility, working_frame
from ..grid.geotiff import open_any_grid, rows_of
from ..grid.grid import Grid
from ..statistics.robust import nmad
from .north_up import has_extent, laid_straight, plain_grid, resampled, sides_of, straight_grid

MAX_CELLS = 30_000_000
"""Cells of a model that are held in memory: about 3 GB while two are compared."""
SURFACE_BAND = "Height of the {} surface"
"""Band of a run's ``surface_heights.tif``, for the words of ``EPOCHS``."""
EPOCHS = ("earlier", "later")
_HEIGHTS_M = (-11_000.0, 9_000.0)  # what there is on Earth; beyond it, a value stands for none
_STEPS = (1.0, 0.5, 0.25, 0.1, 0.05)  # of the file's unit; a hundredth is how heights are written
_UNITS = {"m": "metre", "metre": "metre", "meter": "metre", "metres": "metre", "ft": "foot", "foot": "foot",
          "us survey foot": "us-survey-foot", "us-survey-foot": "us-survey-foot", "ftus": "us-survey-foot"}  # fmt: skip


@dataclass(frozen=True)
class ElevationModel:
    """Heights (rows, columns) of ``grid``, metres, NaN where unknown.

    Attributes:
        crs: with metre axes, and its vertical part where the file declares one.
        vertical: name of the vertical system; empty where none is declared.
        step: the heights are whole multiples of this, metres; 0 where they are of a centimetre or less.
        holes: number of cells without a height.
        notes: sentences for the user.
        regridded: how the heights were brought to ``grid``, in a sentence; empty where the file has them on it.
    """

    heights: Float
    grid: Grid
    crs: CRS
    vertical: str
    step: float
    holes: int
    notes: tuple[str, ...]
    path: Path
    regridded: str = ""

    @property
    def name(self) -> str:
        return self.path.stem


def read_model(path: Path, inputs: InputParameters | None = None, *, later_surface: bool = False) -> ElevationModel:
    """Read an elevation model. One on another grid than north-up squares is interpolated to such a grid.

    Args:
        inputs: ``crs`` instead of what the file declares, ``height_unit``.
        later_surface: of a run's ``surface_heights.tif``, which has two bands, the later one is taken, and a note says
            so.

    Raises:
        InputError: no GeoTIFF, no place, several bands or one of 8 bits, no or a geographic reference system, more than
            ``MAX_CELLS`` cells, or no heights.
    """
    inputs = inputs or InputParameters()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)  # is refused in words
        return _read(path, inputs, later_surface)


def _read(path: Path, inputs: InputParameters, later_surface: bool) -> ElevationModel:
    with open_any_grid(path) as source:
        both = later_surface and source.descriptions == tuple(map(SURFACE_BAND.format, EPOCHS))
        _refuse_pictures(source, path, 2 if both else 1)
        _refuse_no_place(source.transform, path)
        crs = CRS.from_wkt(source.crs.to_wkt(version="WKT2_2019")) if source.crs else None
        unit = (source.units[0] or "").strip().lower()
        heights = np.asarray(rows_of(source, source.count, 0, source.height), dtype=np.float64)
        affine = source.transform
    _refuse_geographic(crs, inputs, path)
    declared = working_frame(crs, _with_unit(inputs, crs, unit), path)
    notes = [*declared.notes, *([f"Of the two surfaces in {shown(path)} the later one is taken."] if both else [])]
    heights, unknown = _without_senseless(heights, declared.vertical_factor)
    if unknown:
        notes.append(
            f"{shown(path)} holds {unknown} cells whose values are no heights on Earth; they count as unknown."
        )
    known = heights[np.isfinite(heights)]
    if not known.size:
        raise InputError(f"{shown(path)} holds no height in any of its {heights.size} cells; check its no-data value.")
    step = _step(known)
    holes = int(heights.size - known.size)
    heights, grid, how = _on_squares(heights, affine, path, declared.horizontal_factor)
    factor = declared.horizontal_factor
    metric = Grid(grid.west * factor, grid.north * factor, grid.cell * factor, grid.rows, grid.columns)
    west, south, east, north = metric.bounds
    notes += plausibility(declared, (west + east) / 2, (south + north) / 2)
    if step:
        notes.append(_step_note(path, step * declared.vertical_factor))
    return ElevationModel(
        heights=heights * declared.vertical_factor,
        grid=metric,
        crs=declared.crs,
        vertical=declared.crs.sub_crs_list[-1].name if declared.crs.is_compound else "",
        step=step * declared.vertical_factor,
        holes=holes,
        notes=tuple(notes),
        path=path,
        regridded=how,
    )


def _on_squares(heights: Float, affine: Affine, path: Path, factor: float) -> tuple[Float, Grid, str]:
    """The heights on a north-up grid of square cells, in the file's unit, and what was done in a sentence.

    Args:
        factor: metres of the file's unit.
    """
    grid = plain_grid(affine, heights.shape)
    if grid is not None:
        return heights, grid, ""
    name, sides = shown(path), sides_of(affine)
    straight, its_affine = laid_straight(heights, affine)
    grid = plain_grid(its_affine, straight.shape)
    if grid is not None:
        return straight, grid, f"The rows or columns of {name} run the other way; they were put in order."
    grid = straight_grid(affine, heights.shape)
    if grid.rows * grid.columns > MAX_CELLS:
        raise InputError(
            f"{name} needs {grid.rows * grid.columns:,} cells to lie north up, more than the {MAX_CELLS:,} that are "
            "compared at once; clip it, or resample it to larger cells."
        )
    lean = " and sheared" if sides.sheared else ""
    how = (
        f"{name} has cells of {sides.width * factor:.3g} by {sides.height * factor:.3g} m, turned by "
        f"{sides.turned:.3g} degrees{lean}; their heights were interpolated to a north-up grid of "
        f"{grid.cell * factor:.3g} m, which smooths them."
    )
    return resampled(heights, affine, grid), grid, how


def _refuse_no_place(affine: Affine, path: Path) -> None:
    if affine.is_identity:
        raise InputError(f"{shown(path)} does not say where it lies; give a GeoTIFF with its place.")
    if not has_extent(affine):
        sides = sides_of(affine)
        raise InputError(
            f"{shown(path)} has cells of {sides.width:.3g} by {sides.height:.3g}, which are no areas to compare; "
            "resample it to square ones."
        )


def _refuse_pictures(source: DatasetReader, path: Path, bands: int) -> None:
    if source.count > bands:
        raise InputError(
            f"{shown(path)} has {source.count} bands; an elevation model has one, so give that band alone."
        )
    if source.dtypes[0] in ("uint8", "int8"):
        raise InputError(
            f"{shown(path)} holds whole numbers of 8 bits, as a hillshade or another picture does, and no heights; "
            "give the elevation model that it was made of."
        )
    cells = source.width * source.height
    if cells > MAX_CELLS:
        raise InputError(
            f"{shown(path)} has {cells:,} cells, more than the {MAX_CELLS:,} that are compared at once; clip it, or "
            "resample it to larger cells."
        )


def _refuse_geographic(crs: CRS | None, inputs: InputParameters, path: Path) -> None:
    """A cloud's sentence would not do: rasters are warped."""
    used = given_crs(inputs.crs) if inputs.crs else crs
    if used is not None and used.is_geographic:
        raise InputError(
            f"{shown(path)} is in the reference system {used.name}, which is geographic (degrees); warp it to a "
            "projected one."
        )


def _with_unit(inputs: InputParameters, crs: CRS | None, unit: str) -> InputParameters:
    """The unit of heights that the file names, where none is given and no vertical system says it."""
    named = _UNITS.get(unit)
    vertical = crs is not None and (crs.is_compound or len(crs.axis_info) > 2)
    if inputs.height_unit != "auto" or named is None or vertical:
        return inputs
    return InputParameters(crs=inputs.crs, height_unit=named)


def _without_senseless(heights: Float, factor: float) -> tuple[Float, int]:
    """NaN for values that are no heights, and their number."""
    with np.errstate(invalid="ignore"):
        senseless = (heights * factor < _HEIGHTS_M[0]) | (heights * factor > _HEIGHTS_M[1])
    return np.where(senseless, np.nan, heights), int(senseless.sum())


def _step(known: Float) -> float:
    """The largest step that all heights are whole multiples of, in the file's unit; 0 for finer ones."""
    sample = known[:: max(1, known.size // 200_000)]
    tolerance = 4.0 * np.spacing(np.float32(np.abs(sample).max()))
    if nmad(sample) == 0 and np.ptp(sample) == 0:
        return 0.0
    for step in _STEPS:
        if np.abs(sample - np.round(sample / step) * step).max() <= tolerance:
            return step
    return 0.0


def _step_note(path: Path, step: float) -> str:
    return (
        f"The heights of {shown(path)} are whole multiples of {step:.3g} m; each errs by {step / np.sqrt(12.0):.2f} m "
        "for that alone, and smaller change cannot be seen in a cell; give heights that were not rounded."
    )
