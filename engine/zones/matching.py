"""Which zones of a run continue which zones of an earlier one, by where they lie."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import geopandas as gpd
import numpy as np
import shapely
from affine import Affine
from numpy.typing import NDArray
from rasterio.features import rasterize
from scipy import ndimage
from shapely.geometry.base import BaseGeometry

from ..core.arrays import Index
from .fields import SLIDING

MIN_COMMON_SHARE = 0.2
"""Of the smaller zone's outline: with less in common, zones only touch."""
_CLOSING_M = 0.5
"""Metres out and back: zones under plants are scattered cells, of which two runs seldom have the same ones."""
_MIN_PIXEL_M, _MAX_PIXELS = 0.1, 1500
"""Metres, wider where a zone would be longer than so many: outlines of thousands of cells are slow as polygons."""


@dataclass(frozen=True)
class Matches:
    """What became of the zones of an earlier run.

    Attributes:
        heirs: for each earlier zone the later ones (row numbers) that it lives on in, that with most in common first.
        sources: for each later zone the earlier ones that live on in it, that with most in common first.
        met: whether an earlier zone has enough in common with any later zone, of whatever kind.
    """

    heirs: tuple[tuple[int, ...], ...]
    sources: tuple[tuple[int, ...], ...]
    met: tuple[bool, ...]


def match_zones(old: gpd.GeoDataFrame, new: gpd.GeoDataFrame, *, persistent_ids: bool = False) -> Matches:
    """Match zones of one kind whose outlines have a fifth of the smaller one in common.

    Ground that slid is one zone whatever its heights did: it continues zones of both kinds, and they it.

    An earlier zone lives on in the later one with which it has most in common, and in each later zone that has most
    in common with it. So zones that grew together have several sources, and one that came apart several heirs, but the
    neighbour of a zone that has a history of its own is no part of it.

    Args:
        old, new: zones with ``zone_id``, ``kind`` (empty: any) and polygons, in one reference system.
        persistent_ids: zones of one id are the same zone before all others, if they have enough in common.
    """
    bounds = np.concatenate([old.geometry.bounds.to_numpy(), new.geometry.bounds.to_numpy()])
    longest = np.nanmax(bounds[:, 2:] - bounds[:, :2], initial=0.0)
    pixel = max(_MIN_PIXEL_M, float(longest) / _MAX_PIXELS)
    outlines = [[_outline(shape, pixel) for shape in frame.geometry] for frame in (old, new)]
    first, second, common = _common(outlines[0], outlines[1])
    sizes = [np.array([np.count_nonzero(o.pixels) for o in part], dtype=np.int64) for part in outlines]
    areas = sizes[0][first], sizes[1][second]
    enough = (common >= MIN_COMMON_SHARE * np.minimum(*areas)) & (common > 0)
    # of the union: a small zone that lies in the outline of a large one has most in common with itself
    likeness = common / np.maximum(areas[0] + areas[1] - common, 1)
    if persistent_ids:
        same = old["zone_id"].to_numpy()[first] == new["zone_id"].to_numpy()[second]
        likeness = likeness + same
    kinds = old["kind"].fillna("").to_numpy()[first], new["kind"].to_numpy()[second]
    linked = enough & ((kinds[0] == kinds[1]) | (kinds[0] == "") | (kinds[0] == SLIDING) | (kinds[1] == SLIDING))
    met = np.zeros(len(old), dtype=bool)
    met[first[enough]] = True
    first, second, likeness = first[linked], second[linked], likeness[linked]
    kept = _best(first, second, likeness) | _best(second, first, likeness)
    order = np.lexsort((second, first, -likeness))
    heirs: list[list[int]] = [[] for _ in range(len(old))]
    sources: list[list[int]] = [[] for _ in range(len(new))]
    for pair in order[kept[order]]:
        heirs[first[pair]].append(int(second[pair]))
        sources[second[pair]].append(int(first[pair]))
    return Matches(tuple(map(tuple, heirs)), tuple(map(tuple, sources)), tuple(met.tolist()))


def _common(old: Sequence[_Outline], new: Sequence[_Outline]) -> tuple[Index, Index, Index]:
    """Pairs of outlines that have pixels in common: which, in the order of the earlier ones, and how many."""
    windows = np.array([o.window for o in old]).reshape(-1, 4), np.array([o.window for o in new]).reshape(-1, 4)
    first, second = _meeting(*windows)
    low = np.maximum(windows[0][first, :2], windows[1][second, :2])
    high = np.minimum(windows[0][first, 2:], windows[1][second, 2:])
    count = np.array(
        [
            np.count_nonzero(old[i].part(start, end) & new[j].part(start, end))
            for i, j, start, end in zip(first.tolist(), second.tolist(), low, high, strict=True)
        ],
        dtype=np.int64,
    )
    return first, second, count


def _meeting(old: Index, new: Index) -> tuple[Index, Index]:
    """Pairs of windows (rows of top, left, bottom and right) that overlap, found by a tree: most lie far apart."""
    boxes = [shapely.box(w[:, 0], w[:, 1], w[:, 2], w[:, 3]) for w in (old, new)]
    first, second = shapely.STRtree(boxes[1]).query(boxes[0])
    low = np.maximum(old[first, :2], new[second, :2])
    overlap = (np.minimum(old[first, 2:], new[second, 2:]) > low).all(axis=1)  # windows may touch, or hold nothing
    first, second = first[overlap], second[overlap]
    order = np.lexsort((second, first))
    return first[order], second[order]


@dataclass(frozen=True)
class _Outline:
    """Pixels of a zone and the gaps between its cells; ``top`` and ``left`` of their window on the common lattice."""

    top: int
    left: int
    pixels: NDArray[np.bool_]

    @property
    def window(self) -> tuple[int, int, int, int]:
        return self.top, self.left, self.top + self.pixels.shape[0], self.left + self.pixels.shape[1]

    def part(self, low: Index, high: Index) -> NDArray[np.bool_]:
        return self.pixels[low[0] - self.top : high[0] - self.top, low[1] - self.left : high[1] - self.left]


def _outline(shape: BaseGeometry | None, pixel: float) -> _Outline:
    if shape is None or shape.is_empty:
        return _Outline(0, 0, np.zeros((0, 0), dtype=bool))
    reach = max(1, round(_CLOSING_M / pixel))
    west, south, east, north = shape.bounds
    left, top = math.floor(west / pixel) - reach, math.floor(-north / pixel) - reach
    size = math.ceil(-south / pixel) + reach - top, math.ceil(east / pixel) + reach - left
    transform = Affine(pixel, 0.0, left * pixel, 0.0, -pixel, -top * pixel)
    inside = np.zeros(size, dtype=np.uint8)
    for touched in (False, True):  # by their middles, but no zone is too small for a pixel
        if not inside.any():
            inside = rasterize([shape], out_shape=size, transform=transform, all_touched=touched, dtype=np.uint8)
    wide = ndimage.maximum_filter(inside, 2 * reach + 1)
    return _Outline(top, left, ndimage.minimum_filter(wide, 2 * reach + 1, mode="constant", cval=0) > 0)


def _best(one: NDArray[np.intp], other: NDArray[np.intp], likeness: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Of the pairs (``one``, ``other``), the likeliest of each ``one``; of equal ones that with the first ``other``."""
    order = np.lexsort((other, -likeness, one))
    leads = np.ones(len(order), dtype=bool)
    leads[1:] = one[order][1:] != one[order][:-1]
    best = np.zeros(len(order), dtype=bool)
    best[order[leads]] = True
    return best
