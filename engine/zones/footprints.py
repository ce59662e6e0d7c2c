"""The area a zone's volume is measured over: its cells and the surroundings that changed with it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..core.arrays import Float
from ..grid.partition import Partition
from ..statistics.layout import Layout

_MAX_RINGS = 8  # at most, around a zone
_MARGIN_CELLS = 2  # cells around a zone that always belong to its footprint
_EDGE_RADIUS_M = 1.0  # m, radius of a disc that does not get into a survey's gaps, only along its edge


@dataclass(frozen=True)
class Cells:
    """The change of every cell; NaN where nothing was compared.

    Arrays are (rows, columns), or (n,) of the cells that ``partition`` lists.

    Attributes:
        dz, error: change and its standard error, m.
        area: m² that ``dz`` acts on.
        partition: which cells are one.
        plants: the part of ``error`` that plants cause, m; None where nothing is known of them.
        plant_like: cells whose change may be the plants' (see ``season``): no footprint reaches out for it.
        shared: the part of ``error``, m, that is one for all of a zone: by a tilt or bend that was taken off, or by
            how much of the cells on a survey's edge was seen.
    """

    dz: Float
    error: Float
    area: Float
    partition: Partition
    plants: Float | None = None
    plant_like: NDArray[np.bool_] | None = None
    shared: Float | None = None

    @property
    def cell(self) -> float:
        """Side of a cell, m."""
        return self.partition.cell

    @property
    def layout(self) -> Layout:
        """How the arrays hold the cells."""
        return self.partition.layout


@dataclass(frozen=True)
class Detected:
    """Judgement of the cells; arrays as in ``Cells``.

    Attributes:
        significant: cells beyond their level of detection.
        level: level of detection of each cell at 95 % confidence, metres.
        count_min: points of each cell in the epoch that has fewer.
        stable: cells that are taken as stable ground, on which the errors' correlation is measured; without it, those
            outside of every footprint.
        heights: heights of the surface, metres, for the zones' inclination.
        explained: cells beyond their level that a change of the plants explains.
    """

    significant: NDArray[np.bool_]
    level: NDArray[np.floating]
    count_min: NDArray[np.integer]
    stable: NDArray[np.bool_] | None = None
    heights: NDArray[np.floating] | None = None
    explained: NDArray[np.bool_] | None = None


@dataclass(frozen=True)
class Footprint:
    """Where a zone's volume is taken.

    Attributes:
        window: rows and columns of the arrays below in the grid.
        inside: cells of the footprint.
        own: cells of the zone itself.
        weights: m² that each measured cell stands for.
        scatter: standard error of the volume by what was interpolated and by cells across the edge, m³.
        measured: share of the footprint's cells that were measured in both epochs.
    """

    window: tuple[slice, ...]
    inside: NDArray[np.bool_]
    own: NDArray[np.bool_]
    weights: Float
    scatter: float
    measured: float


def footprint_labels(footprints: Sequence[Footprint], shape: tuple[int, int]) -> NDArray[np.int32]:
    """0, or the number of the zone (from 1) whose footprint holds the cell."""
    labels = np.zeros(shape, dtype=np.int32)
    for number, footprint in enumerate(footprints, start=1):
        labels[footprint.window][footprint.inside] = number
    return labels


def outline_footprints(
    cells: Cells, labels: NDArray[np.int32], count: int, *, gap: float, registration_error: float = 0.0
) -> tuple[Footprint, ...]:
    """The footprint of each of ``count`` zones.

    Zones are made of the cells that stand out, so a sum over them leans outward: cells that noise made look larger are
    in, the others out, and so is what lies below the level around them. The footprint takes the cells regardless of
    their own value: the zone, all cells within it and within two cells of it, and rings around for as long as their
    mean has the zone's sign and exceeds the registration error, which lifts or lowers everything alike; at most to
    twice the zone's radius. Other zones' cells, and those nearer to these, stay theirs.

    A grown cell may lie across the footprint's edge. Its change may all be within, or all outside: between these the
    volume counts as uniform (JCGM 100:2008, 4.3.7).

    Cells that were not measured, but have a measured one within ``gap`` m, get the weighted mean of these. Its error is
    that of the measured cells, and the scatter beyond noise that the change has from cell to cell. Larger gaps, and
    what lies outside of the survey's edge, are left out.

    Args:
        labels: of each cell, 0 or 1 to ``count``.
    """
    layout = cells.layout
    labels = layout.on_grid(labels)
    taken = np.zeros(labels.shape, dtype=bool)
    reach = max(1, round(gap / cells.cell))
    found = []
    for number, box in enumerate(ndimage.find_objects(labels, max_label=count), start=1):
        assert box is not None
        # as far as rings can reach (see _Surroundings.grown), the gaps' neighbours, and what shows the survey's edge
        margin = max(s.stop - s.start for s in box) + 2 * _MARGIN_CELLS + reach + edge_reach(cells.cell)
        window = tuple(slice(max(0, s.start - margin), s.stop + margin) for s in box)
        near = in_window(cells, window)
        zone = _Surroundings(near, labels[window], number, taken[window], reach)
        inside = zone.grown(registration_error)
        taken[window] |= inside
        weights, scatter = zone.weights(inside)
        weights *= np.where(zone.known, near.area, 0.0)
        measured = float((inside & zone.known).sum() / inside.sum())
        scatter = math.hypot(scatter, _divided(near, inside & zone.known))
        found.append(Footprint(window, inside, zone.own > 0, weights, scatter, measured))
    return tuple(found)


def plain_footprints(cells: Cells, labels: NDArray[np.int32], count: int, *, gap: float) -> tuple[Footprint, ...]:
    """The footprints of ``count`` zones as they are, without surroundings; gaps and arguments as for outlines."""
    layout = cells.layout
    labels = layout.on_grid(labels)
    reach = max(1, round(gap / cells.cell))
    nothing = np.zeros(labels.shape, dtype=bool)
    found = []
    for number, box in enumerate(ndimage.find_objects(labels, max_label=count), start=1):
        assert box is not None
        margin = reach + edge_reach(cells.cell)
        window = tuple(slice(max(0, s.start - margin), s.stop + margin) for s in box)
        near = in_window(cells, window)
        zone = _Surroundings(near, labels[window], number, nothing[window], reach)
        inside = zone.own > 0
        weights, scatter = zone.weights(inside & zone.usable)
        weights *= np.where(zone.known, near.area, 0.0)
        measured = float((inside & zone.known).sum() / inside.sum())
        found.append(Footprint(window, inside, inside & zone.known, weights, scatter, measured))
    return tuple(found)


class _Surroundings:
    """A zone and what is around it; arrays of the window's shape."""

    def __init__(
        self, cells: Cells, labels: NDArray[np.int32], number: int, taken: NDArray[np.bool_], reach: int
    ) -> None:
        self.known = np.isfinite(cells.dz)
        self.dz = np.where(self.known, cells.dz, 0.0).astype(np.float64)
        self.variance = np.where(self.known, cells.error, 0.0).astype(np.float64) ** 2
        self.area = cells.cell**2
        self.plants = np.zeros(self.dz.shape) if cells.plants is None else np.nan_to_num(cells.plants)
        self.moved = self.dz if cells.plant_like is None else np.where(cells.plant_like, 0.0, self.dz)
        self.own = (labels == number).astype(np.float64)
        self.sign = float(np.sign(np.sum(self.dz * self.own)))
        offsets = np.arange(-reach, reach + 1)
        distance = np.hypot(offsets[:, None], offsets)
        self.kernel = np.where(distance <= reach + 0.5, 1.0 / np.maximum(distance, 1.0) ** 2, 0.0)
        self.kernel[reach, reach] = 0.0
        self.near = _around(self.known.astype(np.float64), self.kernel)
        self.distance: Float = ndimage.distance_transform_edt(self.own == 0)
        free = ~taken
        others = (labels > 0) & (labels != number)
        if others.any():
            free &= self.distance < ndimage.distance_transform_edt(~others)
        self.within = closed(self.known, edge_reach(cells.cell))
        self.usable = free & (self.known | (self.within & (self.near > 0)))

    def grown(self, least: float) -> NDArray[np.bool_]:
        """The footprint, of rings in which the change is at least ``least`` m, and the plants' error, on average."""
        core: NDArray[np.bool_] = ndimage.binary_fill_holes(self.distance <= _MARGIN_CELLS) & self.usable
        core |= self.own > 0
        radius = max(math.sqrt(float(core.sum()) / math.pi) - _MARGIN_CELLS, 1.0)
        width = max(1.0, radius / _MAX_RINGS)
        reached = float(_MARGIN_CELLS)
        while reached < radius:
            ring = (self.distance > reached) & (self.distance <= reached + width) & self.usable & ~core
            measured = max(int((ring & self.known).sum()), 1)
            by_plants = float(self.plants[ring & self.known].sum()) / measured
            if self.sign * float(self.moved[ring].sum()) <= math.hypot(least, by_plants) * measured:
                break
            core |= ring
            reached += width
        return core

    def weights(self, footprint: NDArray[np.bool_]) -> tuple[Float, float]:
        """For how many cells each measured one stands, and the interpolation's standard error of the volume, m³."""
        known, gaps = footprint & self.known, footprint & ~self.known
        weights = known.astype(np.float64)
        if not gaps.any():
            return weights, 0.0
        normal = np.where(self.near > 0, self.near, 1.0)
        share = np.where(gaps, 1.0 / normal, 0.0)
        weights += np.where(self.known, _around(share, self.kernel), 0.0)
        # measured cells estimated from their neighbours, as the gaps are
        judged = known & (self.near > 0)
        mean = _around(self.dz, self.kernel) / normal
        noise = _around(self.variance, self.kernel**2) / normal**2 + self.variance
        beyond = float(np.mean((self.dz - mean)[judged] ** 2 - noise[judged])) if judged.any() else 0.0
        return weights, math.sqrt(max(beyond, 0.0) * float(gaps.sum())) * self.area


def _divided(cells: Cells, inside: NDArray[np.bool_]) -> float:
    """Standard error, m³, of the volume of the cells ``inside`` by grown cells of which they are a part."""
    if not cells.partition.grown:
        return 0.0
    part = cells.partition.number
    inside = inside & (part >= 0)
    found, own = np.unique(part[inside], return_counts=True)
    around = part[np.isin(part, found)]
    size = np.bincount(np.searchsorted(found, around), minlength=len(found))
    change = np.bincount(np.searchsorted(found, part[inside]), np.abs(cells.dz[inside]), len(found)) / own
    return float(np.linalg.norm((change * size)[own < size])) * cells.cell**2 / math.sqrt(12.0)


def edge_reach(cell: float) -> int:
    """Cells in the radius of the disc that runs along the survey's edge from outside."""
    return max(5, round(_EDGE_RADIUS_M / cell))


def closed(known: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """``known`` and the gaps into which no disc of radius ``reach`` cells fits; nothing outside of its edge."""
    padded = np.pad(known, 2 * reach + 1)
    grown = ndimage.distance_transform_edt(~padded) <= reach
    whole: NDArray[np.bool_] = ndimage.distance_transform_edt(grown) > reach
    inner = slice(2 * reach + 1, -(2 * reach + 1))
    return whole[inner, inner] | known


def _around(values: Float, kernel: Float) -> Float:
    """Sum over the cells around each, by the kernel's weights."""
    total: Float = ndimage.correlate(values, kernel, mode="constant")
    return total


def in_window(cells: Cells, window: tuple[slice, ...]) -> Cells:
    """The part of ``cells`` in some rows and columns."""
    layout = cells.layout
    dz, error, area = (layout.window(values, window) for values in (cells.dz, cells.error, cells.area))
    plants, plant_like, shared = (
        None if values is None else layout.window(values, window)
        for values in (cells.plants, cells.plant_like, cells.shared)
    )
    return Cells(dz, error, area, cells.partition.window(window), plants, plant_like, shared)
