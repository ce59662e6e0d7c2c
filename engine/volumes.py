"""Volumes of zones over their footprints, with errors that account for the errors' spatial correlation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from .blocks import Blocks, first_cells
from .gridding import Float
from .plant_calibration import common_share, sum_by_plants
from .variogram import (
    FEWEST_CELLS,
    FEWEST_LAGS,
    VariogramModel,
    effective_samples,
    empirical_variogram,
    fit_variogram,
    sum_variance,
)

Z95 = 1.959963984540054
_RINGS = 8  # at most, around a zone
_MARGIN = 2  # cells around a zone that always belong to its footprint
_EDGE = 1.0  # m, radius of a disc that does not get into a survey's gaps, only along its edge
_STABLE_MARGIN = 0.5  # m around a footprint that may have moved with it


@dataclass(frozen=True)
class Cells:
    """The change of every cell; arrays (rows, columns), NaN where nothing was compared.

    Attributes:
        dz, error: change and its standard error, m.
        area: m² that ``dz`` acts on.
        block: number of the group of cells that are one, -1 for none (see ``change.Change``). None: cells did not grow.
        plants: the part of ``error`` that plants make, m; None where nothing is known of them.
        plant_like: cells whose change may be the plants' (see ``season``): no footprint reaches out for it.
    """

    dz: Float
    error: Float
    area: Float
    cell: float
    block: Blocks | None = None
    plants: Float | None = None
    plant_like: NDArray[np.bool_] | None = None


@dataclass(frozen=True)
class CorrelationModel:
    """How the errors of cells are related.

    The error of a cell is its sampling error, alike in near cells by ``variogram``, ``registration_error`` (m), which
    all cells share, and the error by plants, which counts as fully correlated: one season is alike all over. Over the
    whole slope only the share ``plants_in_common`` of it does, where stable ground tells that. Without a variogram the
    sampling errors count as fully correlated, which is the largest error possible; ``without`` says why. ``cells`` is
    the number of cells of stable ground that it was taken from.
    """

    registration_error: float
    variogram: VariogramModel | None
    cells: int = 0
    without: str = "too little stable ground for a variogram"
    plants_in_common: float = 1.0

    @property
    def name(self) -> str:
        """The model in words."""
        if self.variogram is None:
            return f"fully correlated ({self.without})"
        return "variogram of stable ground, registration error shared by all cells"

    def figures(self) -> dict[str, Any]:
        """For the run record."""
        known = {} if self.variogram is None else self.variogram.figures()
        return (
            {"model": self.name, "registration_error_m": self.registration_error, "cells": self.cells}
            | known
            | {"plants_in_common": self.plants_in_common}
        )

    def sampling_error(self, error: Float, plants: Float | None = None) -> Float:
        """The part of ``error`` (any shape, m) that neither the registration nor the ``plants``' part explain."""
        others = self.registration_error**2 + (0.0 if plants is None else np.nan_to_num(plants) ** 2)
        return np.sqrt(np.maximum(error**2 - others, 0.0))

    def sum_error(self, weights: Float, cells: Cells) -> float:
        """Standard error of the sum of ``weights`` (rows, columns; of any sign, 0 outside) times the changes."""
        return math.hypot(self.own_error(weights, cells), self.common_error(weights, cells))

    def whole_error(self, weights: Float, cells: Cells) -> float:
        """As ``sum_error`` of a sum over the whole slope, over which the plants' error cancels in part.

        A zone is no larger than what plants lift or lower alike, and was picked out where it stands out; there all of
        their error counts.
        """
        by_plants = 0.0
        if cells.plants is not None:
            weighted = np.abs(weights) * np.nan_to_num(cells.plants)
            if cells.block is not None:
                weighted = _in_first_cells(weighted, cells.block)
            by_plants = sum_by_plants(weighted, cells.cell, self.plants_in_common)
        by_registration = self.registration_error * float(weights.sum())
        return math.hypot(self.own_error(weights, cells), by_registration, by_plants)

    def own_error(self, weights: Float, cells: Cells) -> float:
        """The part of ``sum_error`` that the sampling errors make, which differ from place to place."""
        if self.variogram is None:
            return float(np.abs(self._weighted(weights, cells)).sum())
        return math.sqrt(sum_variance(self._weighted(weights, cells), cells.cell, self.variogram))

    def common_error(self, weights: Float, cells: Cells) -> float:
        """The part of ``sum_error`` that all cells share: the registration's and the plants'."""
        return math.hypot(self.registration_error * float(weights.sum()), shared_error(np.abs(weights), cells.plants))

    def samples(self, weights: Float, cells: Cells) -> float:
        """Effective number of samples of a sum (see ``variogram.effective_samples``)."""
        if self.variogram is None:
            return 1.0
        return effective_samples(self._weighted(weights, cells), cells.cell, self.variogram)

    def _weighted(self, weights: Float, cells: Cells) -> Float:
        """Weights times sampling errors; those of cells that are one are summed up in the first of them."""
        used = weights != 0
        weighted = np.zeros(weights.shape)
        plants = None if cells.plants is None else cells.plants[used]
        weighted[used] = weights[used] * self.sampling_error(cells.error[used], plants)
        return weighted if cells.block is None else _in_first_cells(weighted, cells.block)


def _in_first_cells(weighted: Float, block: Blocks) -> Float:
    """Sums (rows, columns) over cells that are one, in the first of them; changes ``weighted``."""
    inside = np.flatnonzero((weighted.ravel() != 0) & (block.ravel() >= 0))
    _, first, group = np.unique(block.ravel()[inside], return_index=True, return_inverse=True)
    sums = np.bincount(group, weighted.ravel()[inside])
    weighted.ravel()[inside] = 0.0
    weighted.ravel()[inside[first]] = sums
    return weighted


def shared_error(weights: Float, error: Float | None) -> float:
    """Of a sum of ``weights`` times values whose errors (rows, columns; NaN: none) are all one; 0 for None."""
    return 0.0 if error is None else float(np.sum(weights * np.nan_to_num(error)))


@dataclass(frozen=True)
class Footprint:
    """Where a zone's volume is taken.

    Attributes:
        window: rows and columns of the arrays below in the grid.
        inside: cells of the footprint.
        own: cells of the zone itself.
        weights: m² that each measured cell stands for.
        scatter: standard error of the volume by what was interpolated, m³.
        measured: share of the footprint's cells that were measured in both epochs.
    """

    window: tuple[slice, ...]
    inside: NDArray[np.bool_]
    own: NDArray[np.bool_]
    weights: Float
    scatter: float
    measured: float


@dataclass(frozen=True)
class ZoneVolumes:
    """Volumes of n zones, arrays of shape (n,).

    Attributes:
        net: m³ over the footprint, gaps included; negative where the ground sank.
        error: its standard error, m³.
        area: of the footprint, m².
        measured: share of the footprint's cells that were measured in both epochs.
        samples: effective number of samples.
        mean_error: standard error of the mean change over the zone's own cells, m.
        lowering, raising, total: of all zones that sank, all that rose, all: sum of ``net``, and its standard error.
    """

    net: Float
    error: Float
    area: Float
    measured: Float
    samples: Float
    mean_error: Float
    lowering: tuple[float, float]
    raising: tuple[float, float]
    total: tuple[float, float]

    def in_order(self, order: NDArray[np.integer]) -> ZoneVolumes:
        """The zones in another order."""
        columns = ("net", "error", "area", "measured", "samples", "mean_error")
        return replace(self, **{name: getattr(self, name)[order] for name in columns})


def fit_correlation(cells: Cells, stable: NDArray[np.bool_], registration_error: float) -> CorrelationModel:
    """The variogram of change over error on ``stable`` cells (rows, columns).

    Too little stable ground, or too few distances in it, leave the model without a variogram.

    The change is taken in units of the error without the registration's part, which is one constant for all cells and
    therefore not to be seen in a variogram. Where plants make more of a cell's error than its points, it tells of the
    plants; such cells are left out where enough others are, else what plants make counts in the unit.
    """
    model = CorrelationModel(registration_error, None, plants_in_common=_in_common(cells, stable, registration_error))
    usable = stable & np.isfinite(cells.dz) & np.isfinite(cells.error)
    plants = None if cells.plants is None else cells.plants[usable]
    of_usable = model.sampling_error(np.asarray(cells.error[usable], dtype=np.float64), plants)
    sampling = np.zeros(cells.dz.shape)
    sampling[usable] = of_usable
    usable &= sampling > 0
    if cells.block is not None:
        usable &= first_cells(cells.block) | (cells.block < 0)
    if cells.plants is not None:
        little = usable & (np.nan_to_num(cells.plants) <= sampling)
        if int(little.sum()) >= FEWEST_CELLS:
            usable = little
        else:
            # what plants make of a cell is counted beside its sampling, not as a part of it
            sampling = np.hypot(sampling, np.nan_to_num(cells.plants))
    count = int(usable.sum())
    if count < FEWEST_CELLS:
        return replace(model, cells=count)
    standardised = np.full(cells.dz.shape, np.nan)
    standardised[usable] = cells.dz[usable] / sampling[usable]
    empirical = empirical_variogram(standardised, cells.cell)
    if len(empirical.lag) < FEWEST_LAGS:
        return replace(model, cells=count, without="too few distances between stable cells")
    return replace(model, cells=count, variogram=fit_variogram(empirical))


def _in_common(cells: Cells, stable: NDArray[np.bool_], registration_error: float) -> float:
    """Share of the plants' error that the whole slope has in common, 1 where nothing is known of plants."""
    if cells.plants is None:
        return 1.0
    # a change that the plants' height explains tells of them too, and mown grass is not taken as stable
    told = stable if cells.plant_like is None else stable | cells.plant_like
    if cells.block is not None:
        told = told & (first_cells(cells.block) | (cells.block < 0))
    sampling = CorrelationModel(registration_error, None).sampling_error(cells.error, cells.plants)
    return common_share(cells.dz, sampling, cells.plants, told, cells.cell)


def outside(footprints: Sequence[Footprint], valid: NDArray[np.bool_], cell: float) -> NDArray[np.bool_]:
    """Cells of ``valid`` farther than half a metre, and at least two cells, from every footprint.

    Single cells beyond their level stay in: they are the noise's own, and without them it would look too small.
    """
    moved = np.zeros(valid.shape, dtype=bool)
    for footprint in footprints:
        moved[footprint.window] |= footprint.inside
    return valid & ~ndimage.maximum_filter(moved, size=2 * max(2, round(_STABLE_MARGIN / cell)) + 1)


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

    Cells that were not measured, but have a measured one within ``gap`` m, get the weighted mean of these. Its error is
    that of the measured cells, and the scatter beyond noise that the change has from cell to cell. Larger gaps, and
    what lies outside of the survey's edge, are left out.

    Args:
        labels: (rows, columns), 0 or 1 to ``count``.
    """
    taken = np.zeros(labels.shape, dtype=bool)
    reach = max(1, round(gap / cells.cell))
    found = []
    for number, box in enumerate(ndimage.find_objects(labels, max_label=count), start=1):
        assert box is not None
        # as far as rings can reach (see _Surroundings.grown), the gaps' neighbours, and what tells the survey's edge
        margin = max(s.stop - s.start for s in box) + 2 * _MARGIN + reach + _edge_reach(cells.cell)
        window = tuple(slice(max(0, s.start - margin), s.stop + margin) for s in box)
        near = in_window(cells, window)
        zone = _Surroundings(near, labels[window], number, taken[window], reach)
        inside = zone.grown(registration_error)
        taken[window] |= inside
        weights, scatter = zone.weights(inside)
        weights *= np.where(zone.known, near.area, 0.0)
        measured = float((inside & zone.known).sum() / inside.sum())
        found.append(Footprint(window, inside, zone.own > 0, weights, scatter, measured))
    return tuple(found)


def zone_volumes(footprints: Sequence[Footprint], cells: Cells, model: CorrelationModel) -> ZoneVolumes:
    """Volume of each zone over its footprint, with its standard error."""
    figures = np.zeros((len(footprints), 6))
    sides = np.zeros((2, *cells.dz.shape)) if footprints else np.zeros((2, 1, 1))  # weights of all that sank, that rose
    scatters = np.zeros(2)
    for row, footprint in zip(figures, footprints, strict=True):
        near = in_window(cells, footprint.window)
        weights = footprint.weights
        volume = float(np.sum(weights * np.nan_to_num(near.dz)))
        row[:] = (
            volume,
            math.hypot(model.sum_error(weights, near), footprint.scatter),
            float(weights.sum()),
            footprint.measured,
            model.samples(weights, near),
            model.sum_error(footprint.own / footprint.own.sum(), near),
        )
        sides[int(volume > 0)][footprint.window] += weights
        scatters[int(volume > 0)] += footprint.scatter**2

    def together(volumes: Float, weights: Float, scatter: float) -> tuple[float, float]:
        if not volumes.size:
            return 0.0, 0.0
        return float(volumes.sum()), math.hypot(model.sum_error(weights, cells), math.sqrt(scatter))

    net, error, area, measured, samples, mean_error = (np.ascontiguousarray(column) for column in figures.T)
    return ZoneVolumes(
        net,
        error,
        area,
        measured,
        samples,
        mean_error,
        lowering=together(net[net <= 0], sides[0], scatters[0]),
        raising=together(net[net > 0], sides[1], scatters[1]),
        total=together(net, sides.sum(axis=0), float(scatters.sum())),
    )


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
        self.within = closed(self.known, _edge_reach(cells.cell))
        self.usable = free & (self.known | (self.within & (self.near > 0)))

    def grown(self, least: float) -> NDArray[np.bool_]:
        """The footprint, of rings in which the change is at least ``least`` m, and the plants' error, on average."""
        core: NDArray[np.bool_] = ndimage.binary_fill_holes(self.distance <= _MARGIN) & self.usable
        core |= self.own > 0
        radius = max(math.sqrt(float(core.sum()) / math.pi) - _MARGIN, 1.0)
        width = max(1.0, radius / _RINGS)
        reached = float(_MARGIN)
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
        # measured cells told from their neighbours, as the gaps are
        told = known & (self.near > 0)
        mean = _around(self.dz, self.kernel) / normal
        noise = _around(self.variance, self.kernel**2) / normal**2 + self.variance
        beyond = float(np.mean((self.dz - mean)[told] ** 2 - noise[told])) if told.any() else 0.0
        return weights, math.sqrt(max(beyond, 0.0) * float(gaps.sum())) * self.area


def _edge_reach(cell: float) -> int:
    """Cells in the radius of the disc that runs along the survey's edge from outside."""
    return max(5, round(_EDGE / cell))


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
    block = None if cells.block is None else cells.block[window]
    plants = None if cells.plants is None else cells.plants[window]
    plant_like = None if cells.plant_like is None else cells.plant_like[window]
    return Cells(cells.dz[window], cells.error[window], cells.area[window], cells.cell, block, plants, plant_like)
