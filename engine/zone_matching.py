"""Which zones of a run continue which zones of an earlier one, by where they lie."""

from __future__ import annotations

from dataclasses import dataclass

import geopandas as gpd
import numpy as np
import shapely
from numpy.typing import NDArray

LEAST_SHARE = 0.2
"""Of the smaller zone's outline: with less in common, zones only touch."""
_GATHERED = 0.5
"""Metres out and back: zones under plants are scattered cells, of which two runs seldom have the same ones."""


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

    An earlier zone lives on in the later one with which it has most in common, and in each later zone that has most
    in common with it. So zones that grew together have several sources, and one that came apart several heirs, but the
    neighbour of a zone that has a history of its own is no part of it.

    Args:
        old, new: zones with ``zone_id``, ``kind`` (empty: any) and polygons, in one reference system.
        persistent_ids: zones of one id are the same zone before all others, if they have enough in common.
    """
    shapes = _gathered(old.geometry), _gathered(new.geometry)
    first, second = shapely.STRtree(shapes[1]).query(shapes[0], predicate="intersects")
    common = shapely.area(shapely.intersection(shapes[0][first], shapes[1][second]))
    areas = shapely.area(shapes[0])[first], shapely.area(shapes[1])[second]
    enough = common >= LEAST_SHARE * np.minimum(*areas)
    enough &= common > 0
    # of the union: a small zone that lies in the outline of a large one has most in common with itself
    likeness = np.divide(common, areas[0] + areas[1] - common, out=np.zeros_like(common), where=enough)
    if persistent_ids:
        same = old["zone_id"].to_numpy()[first] == new["zone_id"].to_numpy()[second]
        likeness = likeness + same
    kinds = old["kind"].fillna("").to_numpy()[first], new["kind"].to_numpy()[second]
    linked = enough & ((kinds[0] == kinds[1]) | (kinds[0] == ""))
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


def _gathered(geometry: gpd.GeoSeries) -> NDArray[np.object_]:
    """Outlines around cells that lie close; an empty one where there is no polygon."""
    shapes = np.array([shapely.Polygon() if g is None else g for g in geometry], dtype=object)
    closed = shapely.buffer(shapely.buffer(shapely.make_valid(shapes), _GATHERED, quad_segs=2), -_GATHERED, quad_segs=2)
    return np.asarray(closed, dtype=object)


def _best(one: NDArray[np.intp], other: NDArray[np.intp], likeness: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Of the pairs (``one``, ``other``), the likeliest of each ``one``; of equal ones that with the first ``other``."""
    order = np.lexsort((other, -likeness, one))
    leads = np.ones(len(order), dtype=bool)
    leads[1:] = one[order][1:] != one[order][:-1]
    best = np.zeros(len(order), dtype=bool)
    best[order[leads]] = True
    return best
