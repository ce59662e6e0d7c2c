"""Results as xarray and as pictures; both libraries are loaded where they are asked for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from ..engine.core.arrays import Float
from ..engine.core.errors import InputError
from ..engine.grid.grid import Grid
from ..engine.pointcloud.cloud import PointCloud

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

Named = Mapping[str, tuple[NDArray[np.generic], str, str]]
"""Arrays with their meaning and unit, by name."""
_MAX_SHOWN_POINTS = 200_000


def raster_dataset(values: Named, grid: Grid, crs: CRS) -> xarray.Dataset:
    """Arrays (rows, columns) as variables over y and x, the middles of the cells; the reference system as CF has it."""
    xarray = _xarray()
    # edges are multiples of the cell: counted from 0, so that two grids of one cell have equal coordinates
    x = (round(grid.west / grid.cell) + np.arange(grid.columns) + 0.5) * grid.cell
    y = (round(grid.north / grid.cell) - np.arange(grid.rows) - 0.5) * grid.cell
    return _with_crs(xarray.Dataset(_variables(values, ("y", "x")), coords={"y": y, "x": x}), crs)


def listed_dataset(values: Named, xyz: Float, crs: CRS) -> xarray.Dataset:
    """Arrays (n,) as variables at places (n, 3)."""
    places = {name: ("point", xyz[:, axis]) for axis, name in enumerate("xyz")}
    return _with_crs(_xarray().Dataset(_variables(values, ("point",)), coords=places), crs)


def points_dataset(points: PointCloud) -> xarray.Dataset:
    """A cloud with the plants over its points."""
    plants = {
        "plant_error": (points.plant_error, "standard error of the ground's height by plants"),
        "plant_height": (points.plant_height, "median height of all returns over the ground"),
    }
    named: Named = {name: (array, text, "m") for name, (array, text) in plants.items() if array is not None}
    return listed_dataset(named, points.xyz, points.crs)


def stacked(every: list[xarray.Dataset], dimension: str) -> xarray.Dataset:
    """Datasets one after the other along a dimension that each of them has."""
    return _xarray().concat(every, dim=dimension)


def _xarray() -> Any:
    try:
        import xarray
    except ImportError:
        raise InputError("xarray is not installed; install slopewatch[xarray].") from None
    return xarray


def _variables(values: Named, dimensions: tuple[str, ...]) -> dict[str, object]:
    return {
        name: (dimensions, array, {"long_name": text, "units": unit, "grid_mapping": "spatial_ref"})
        for name, (array, text, unit) in values.items()
    }


def _with_crs(found: xarray.Dataset, crs: CRS) -> xarray.Dataset:
    return found.assign_coords(spatial_ref=((), 0, {"crs_wkt": crs.to_wkt()}))


def axes_or_new(ax: Axes | None) -> Axes:
    """Axes to draw on, with metres of one length in both directions."""
    import matplotlib.pyplot as plt

    chosen = plt.subplots(layout="constrained")[1] if ax is None else ax
    chosen.set_aspect("equal")
    chosen.ticklabel_format(useOffset=False, style="plain")
    return chosen


def heights_picture(points: PointCloud, ax: Axes | None) -> Axes:
    """A cloud from above, evenly thinned."""
    shown = points.xyz[:: -(-len(points) // _MAX_SHOWN_POINTS)]
    return values_picture(shown, shown[:, 2], "Height (m)", None, ax)


def values_picture(xyz: Float, values: Float, label: str, limit: float | None, ax: Axes | None) -> Axes:
    """Values (n,) at places (n, 3); with a ``limit`` in colours from lowered to raised."""
    chosen = axes_or_new(ax)
    ramp, low, high = ("viridis", None, None) if limit is None else ("RdBu", -limit, limit)
    drawn = chosen.scatter(xyz[:, 0], xyz[:, 1], c=values, s=1, linewidths=0, cmap=ramp, vmin=low, vmax=high)
    chosen.figure.colorbar(drawn, ax=chosen, label=label)
    return chosen


def raster_picture(values: Float, grid: Grid, label: str, limit: float, ax: Axes | None) -> Axes:
    """An array (rows, columns) in colours from lowered to raised."""
    chosen = axes_or_new(ax)
    east, south = grid.west + grid.columns * grid.cell, grid.north - grid.rows * grid.cell
    drawn = chosen.imshow(values, cmap="RdBu", vmin=-limit, vmax=limit, extent=(grid.west, east, south, grid.north))
    chosen.figure.colorbar(drawn, ax=chosen, label=label)
    return chosen
