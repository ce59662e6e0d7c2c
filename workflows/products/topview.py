"""The files of a top view: rasters to draw on."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from ...engine.core.version import VERSION
from ...engine.grid import geotiff
from ...engine.maps import qgis_styles
from ...engine.maps.drawing_rasters import DrawingRasters
from ..run import Run

TOP_VIEW_OUTPUTS = ("top_view.tif", "hillshade.tif", "density.tif", "ground_density.tif", "canopy_height.tif")

_PICTURES = {
    "rgb": "Colours of the highest returns",
    "intensity": "Intensity of the highest returns",
    "height": "Relief of the highest returns",
}
_GROUND = {
    "class_2": "Ground returns (class 2)",
    "estimate": "Returns near a quick estimate of the ground",
}
_UNIT = "returns/m²"
_DENSITIES = ("density", "ground_density")


@dataclass(frozen=True)
class Source:
    """What the files state about their origin; ``hashes`` of the inputs, empty for one that was not given.

    ``coarse``: the points are those of a COPC's coarser levels, of which no densities are written.
    """

    crs: CRS
    day: date | None
    hashes: tuple[str, ...]
    coarse: bool = False


def write_top_view(run: Run, rasters: DrawingRasters, source: Source) -> None:
    """Write the rasters of a top view with their styles; ``run`` gets their paths, and a sentence on each choice."""
    tags = geotiff.raster_tags(
        epochs=(None, source.day),
        software=f"SlopeWatch {VERSION}",
        input_sha256=" ".join(filter(None, source.hashes)),
    )
    view, grid, stage = rasters.view, rasters.grid, run.stage
    picture = stage.path("top_view.tif")
    geotiff.write_rgba(picture, view.rgba, grid, source.crs, tags=tags, description=_PICTURES[view.source])
    run.outputs["top_view"] = stage.final(picture.name)
    ground = _GROUND[rasters.ground]
    layers: tuple[tuple[str, NDArray[np.float32], str, str, str], ...] = (
        (
            "hillshade",
            rasters.hillshade,
            f"Hillshade of the {rasters.hillshade_of} returns, 0 to 255",
            "1",
            qgis_styles.shade_qml(*_ends(rasters.hillshade, (1, 99))),
        ),
        ("density", rasters.density, "Returns per square metre", _UNIT, _amounts(rasters.density, _UNIT)),
        (
            "ground_density",
            rasters.ground_density,
            f"{ground} per square metre",
            _UNIT,
            _amounts(rasters.ground_density, _UNIT),
        ),
        (
            "canopy_height",
            rasters.canopy_height,
            f"Height of the highest return over the ground ({rasters.ground.replace('_', ' ')})",
            "m",
            _amounts(rasters.canopy_height, "m"),
        ),
    )
    if source.coarse:
        layers = tuple(layer for layer in layers if layer[0] not in _DENSITIES)
        for name in _DENSITIES:  # of an earlier run
            for suffix in ("tif", "qml"):
                stage.discard(f"{name}.{suffix}")
    for number, (name, array, description, unit, qml) in enumerate(layers, 1):
        run.progress.update(number / (len(layers) + 1))
        path = stage.path(f"{name}.tif")
        geotiff.write_raster(path, array, grid, source.crs, description=description, unit=unit, tags=tags)
        qgis_styles.write_qml_next_to(path, qml)
        run.outputs[name] = stage.final(path.name)
    run.facts["top_view"] = {
        "picture": _PICTURES[view.source],
        "hillshade": layers[0][2],
        "ground": ground,
    }
    if rasters.ground == "estimate":
        run.progress.info(
            "Ground density and canopy height are those of a quick surface through the lowest returns, which is no "
            "ground extraction; the cloud has no points of class 2, or --ground-returns estimate was given."
        )


def top_view_figures(rasters: DrawingRasters, *, coarse: bool = False) -> dict[str, Any]:
    """The figures that a user reads first; densities, of all points only, are medians over the cells with returns."""
    returns = rasters.density > 0
    densities = {"density": rasters.density, "ground_density": rasters.ground_density}
    return {
        "points": rasters.look.points,
        "noise_points": rasters.look.noise,
        "cell_m": rasters.grid.cell,
        "rows": rasters.grid.rows,
        "columns": rasters.grid.columns,
        "picture": rasters.view.source,
        "ground": rasters.ground,
        "area_m2": float(np.count_nonzero(returns) * rasters.grid.cell**2),
        **({} if coarse else {name: float(np.median(array[returns])) for name, array in densities.items()}),
        "canopy_height_p95_m": float(np.percentile(rasters.canopy_height[returns], 95)),
    }


def _amounts(array: NDArray[np.float32], unit: str) -> str:
    return qgis_styles.level_qml(max(_ends(array, (2, 98))[1], 0.01), unit=unit)


def _ends(array: NDArray[np.float32], percentiles: tuple[float, float]) -> tuple[float, float]:
    known = array[np.isfinite(array)]
    low, high = np.percentile(known, percentiles) if known.size else (0.0, 1.0)
    return float(low), float(high)
