"""The part of a cloud that is dense and whole enough to be inspected, as polygons."""

from __future__ import annotations

from dataclasses import dataclass

import geopandas as gpd
import numpy as np
import shapely
from pyproj import CRS
from scipy import ndimage

from ...interface.parameters import RegionParameters, given
from ..core.arrays import Bool, Float, Index
from ..crs.working_frame import horizontal
from ..grid.grid import Grid
from .cell_polygons import cell_polygons

SIDES_M = (0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Sides of a square that are chosen from, metres."""
SPACINGS_A_SQUARE = 5.0
"""Mean distances of the points that a square is wide: 25 points, whose number varies by a fifth by chance."""
_MIN_OWN_SHARE = 0.75  # of the least density, in the square itself: its surroundings may be denser


@dataclass(frozen=True)
class SuggestedRegion:
    """Polygons in metres, and why they are smaller than the cloud; areas in m².

    Attributes:
        frame: a row a part, the largest first: ``part``, ``area_m2``, ``density`` (points/m²), ``reason``.
        typical_density: half of the cloud's points lie in denser squares, points/m².
        cloud_area: of the squares with points.
        sparse, thin, small: cut because the density is too low, as spikes and bridges, as small parts.
        filled: holes that belong to the region.
        points: share of the cloud's points in the region, 0 to 1, by squares.
    """

    frame: gpd.GeoDataFrame
    typical_density: float
    cloud_area: float
    sparse: float
    thin: float
    small: float
    filled: float
    points: float

    @property
    def area(self) -> float:
        return float(self.frame["area_m2"].sum())


def suggested_region(counts: Index, grid: Grid, crs: CRS, parameters: RegionParameters) -> SuggestedRegion:
    """Propose a region from the points counted in squares.

    A square is kept where the mean of it and the eight around it reaches the least density. Holes up to a size are
    filled, what is narrower than a spike is removed, small parts go, and the outline along the squares is simplified.

    Args:
        counts: (rows, columns) points in each square; one has some.

    Returns:
        The region; its frame is empty where nothing is left.
    """
    square = grid.cell**2
    typical = typical_density(counts) / square
    least = parameters.least_density * typical * square
    mean = ndimage.uniform_filter(counts.astype(np.float64), 3, mode="constant")
    occupied = counts > 0
    dense = (mean >= least) & (counts >= _MIN_OWN_SHARE * least)
    whole = _without_holes(dense, parameters.largest_hole / square)
    smooth = _without_spikes(whole, parameters.spike_width / grid.cell)
    kept = _without_small(smooth, parameters.smallest_part)
    labels, count = ndimage.label(kept)
    sides = given(parameters.simplification) or grid.cell
    shapes = [_simplified(shape, sides) for shape in cell_polygons(labels.astype(np.int32), count, grid)]
    areas = {
        "sparse": (occupied & ~dense & ~whole).sum() * square,
        "thin": (occupied & whole & ~smooth).sum() * square,
        "small": (occupied & smooth & ~kept).sum() * square,
        "filled": (kept & ~dense).sum() * square,
    }
    density = ndimage.sum_labels(counts, labels, np.arange(1, count + 1)) / np.maximum(
        ndimage.sum_labels(np.ones_like(counts), labels, np.arange(1, count + 1)) * square, 1e-9
    )
    reason = _reason(areas, parameters, typical)
    frame = _frame(shapes, density, reason, crs)
    cut = {name: float(value) for name, value in areas.items()}
    return SuggestedRegion(
        frame, typical, float(occupied.sum() * square), points=float(counts[kept].sum() / counts.sum()), **cut
    )


def typical_density(counts: Index) -> float:
    """Points in a square such that half of all points lie in squares with more: sparse edges hold few points.

    It is high where a part of the cloud is much denser than the rest, as a cliff seen from above.
    """
    held = np.sort(counts[counts > 0].ravel())
    return float(held[np.searchsorted(np.cumsum(held), held.sum() / 2)])


def _without_holes(dense: Bool, cells: float) -> Bool:
    """With the holes filled that are no larger than so many cells."""
    holes, count = ndimage.label(~dense & ndimage.binary_fill_holes(dense))
    size = ndimage.sum_labels(np.ones(dense.shape), holes, np.arange(1, count + 1))
    return np.asarray(dense | np.concatenate([[False], size <= cells])[holes])


def _without_spikes(whole: Bool, width: float) -> Bool:
    """Without what a disc of ``width`` cells does not fit into."""
    radius = width / 2
    if radius < 1:
        return whole
    inside = ndimage.distance_transform_edt(np.pad(whole, 1))[1:-1, 1:-1] > radius
    if not inside.any():
        return inside
    return np.asarray(ndimage.distance_transform_edt(~inside) <= radius)


def _without_small(smooth: Bool, share: float) -> Bool:
    """Without parts smaller than a share of the largest one."""
    parts, count = ndimage.label(smooth)
    size = ndimage.sum_labels(np.ones(smooth.shape), parts, np.arange(1, count + 1))
    return np.asarray(np.concatenate([[False], size >= share * size.max(initial=0.0)])[parts])


def _simplified(shape: shapely.MultiPolygon, distance: float) -> shapely.Polygon | shapely.MultiPolygon:
    simple = shapely.make_valid(shapely.simplify(shape, distance))
    parts = [part for part in shapely.get_parts(shapely.get_parts(simple)) if part.geom_type == "Polygon"]
    return shapely.MultiPolygon(parts)


def _reason(areas: dict[str, float], parameters: RegionParameters, typical: float) -> str:
    """Why the region is smaller than the cloud, in a sentence."""
    words = {
        "sparse": f"below {parameters.least_density:g} of the cloud's density of {typical:.3g} points/m²",
        "thin": f"in spikes or bridges narrower than {parameters.spike_width:g} m",
        "small": f"in parts below {parameters.smallest_part:g} of the largest",
    }
    cut = [f"{areas[name]:.0f} m² {text}" for name, text in words.items() if areas[name] > 0]
    said = f"Cut: {'; '.join(cut)}." if cut else "Nothing was cut."
    return said + (f" Filled: {areas['filled']:.0f} m² of holes." if areas["filled"] > 0 else "")


def _frame(shapes: list[shapely.MultiPolygon], density: Float, reason: str, crs: CRS) -> gpd.GeoDataFrame:
    area = np.array([shape.area for shape in shapes])
    order = np.argsort(-area, kind="stable")
    order = order[area[order] > 0]
    table = {
        "part": np.arange(1, len(order) + 1),
        "area_m2": np.round(area[order], 2),
        "density": np.round(density[order], 2),
        "reason": np.full(len(order), reason, dtype=object),
    }
    return gpd.GeoDataFrame(table, geometry=[shapes[k] for k in order], crs=horizontal(crs))
