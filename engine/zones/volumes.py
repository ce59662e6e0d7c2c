"""Volumes of zones over their footprints, with errors that account for the errors' spatial correlation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..change.plant_calibration import common_share, sum_by_plants
from ..core.arrays import Float
from ..statistics.layout import Layout, layout_of
from ..statistics.variogram import (
    MIN_CELLS,
    MIN_LAGS,
    VariogramModel,
    effective_samples,
    empirical_variogram,
    fit_variogram,
    sum_variance,
)
from .footprints import Cells, Footprint, in_window

_COLUMNS = ("net", "error", "area", "measured", "samples", "mean_error")
_ALL = slice(None)
_STABLE_MARGIN_M = 0.5  # m around a footprint that may have moved with it


@dataclass(frozen=True)
class CorrelationModel:
    """How the errors of cells are related.

    The error of a cell is its sampling error, alike in near cells by ``variogram``, ``registration_error`` (m), which
    all cells share, and the error by plants, which counts as fully correlated: one season is alike all over. Over the
    whole slope only the share ``plants_in_common`` of it does, where stable ground shows that. Without a variogram the
    sampling errors count as fully correlated, which is the largest error possible; ``without`` states why. ``cells`` is
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

    def sampling_error(self, cells: Cells, used: NDArray[np.bool_] | slice = _ALL) -> Float:
        """The part of the errors of cells (n,) or (rows, columns), m, that no part explains that near cells share."""
        parts = (part[used] for part in (cells.plants, cells.shared) if part is not None)
        others = self.registration_error**2 + sum(np.nan_to_num(part) ** 2 for part in parts)
        return np.sqrt(np.maximum(np.asarray(cells.error[used], dtype=np.float64) ** 2 - others, 0.0))

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
            weighted = cells.partition.gathered(weighted, weighted != 0)
            by_plants = sum_by_plants(weighted, cells.cell, self.plants_in_common, cells.layout)
        by_registration = self.registration_error * float(weights.sum())
        by_shared = shared_error(np.abs(weights), cells.shared)
        return math.hypot(self.own_error(weights, cells), by_registration, by_plants, by_shared)

    def own_error(self, weights: Float, cells: Cells) -> float:
        """The part of ``sum_error`` that the sampling errors make, which differ from place to place."""
        if self.variogram is None:
            return float(np.abs(self._weighted(weights, cells)).sum())
        return math.sqrt(sum_variance(self._weighted(weights, cells), cells.cell, self.variogram, cells.layout))

    def common_error(self, weights: Float, cells: Cells) -> float:
        """The part of ``sum_error`` that all cells share: the registration's, the plants' and what a zone shares."""
        others = (shared_error(np.abs(weights), part) for part in (cells.plants, cells.shared))
        return math.hypot(self.registration_error * float(weights.sum()), *others)

    def samples(self, weights: Float, cells: Cells) -> float:
        """Effective number of samples of a sum (see ``variogram.effective_samples``)."""
        if self.variogram is None:
            return 1.0
        return effective_samples(self._weighted(weights, cells), cells.cell, self.variogram, cells.layout)

    def _weighted(self, weights: Float, cells: Cells) -> Float:
        """Weights times sampling errors; those of cells that are one are summed up in the first of them."""
        used = weights != 0
        weighted = np.zeros(weights.shape)
        weighted[used] = weights[used] * self.sampling_error(cells, used)
        return cells.partition.gathered(weighted, used)


def _add(to: Float, layout: Layout, window: tuple[slice, ...], weights: Float) -> None:
    """Add ``weights`` of a window of the grid, 0 where no cell is held, to those of all cells."""
    if layout.listed is None:
        to[window] += weights
        return
    row, column = np.nonzero(weights)
    flat = (row + window[0].start) * layout.shape[1] + column + window[1].start
    to[np.searchsorted(layout.listed, flat)] += weights[row, column]


def shared_error(weights: Float, error: Float | None) -> float:
    """Of a sum of ``weights`` times values whose errors (rows, columns; NaN: none) are all one; 0 for None."""
    return 0.0 if error is None else float(np.sum(weights * np.nan_to_num(error)))


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
        lowering, raising, total: of all zones that sank, all that rose, both: sum of ``net``, and its standard error.
        sliding: the same of zones that slid, which are in none of these: their heights changed as ground moved on.
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
    sliding: tuple[float, float] = (0.0, 0.0)

    def in_order(self, order: NDArray[np.integer]) -> ZoneVolumes:
        """The zones in another order."""
        return replace(self, **{name: getattr(self, name)[order] for name in _COLUMNS})

    def with_sliding(self, slides: ZoneVolumes) -> ZoneVolumes:
        """These zones, and after them others that slid."""
        joined: dict[str, Any] = {
            name: np.concatenate([getattr(self, name), getattr(slides, name)]) for name in _COLUMNS
        }
        return replace(self, **joined, sliding=slides.total)


def fit_correlation(cells: Cells, stable: NDArray[np.bool_], registration_error: float) -> CorrelationModel:
    """The variogram of change over error on ``stable`` cells.

    Too little stable ground, or too few distances in it, leave the model without a variogram.

    The change is taken in units of the error without the registration's part, which is one constant for all cells and
    therefore not to be seen in a variogram. Where plants cause more of a cell's error than its points, it shows the
    plants; such cells are left out where enough others are, else the error by plants counts in the unit.
    """
    model = CorrelationModel(registration_error, None, plants_in_common=_in_common(cells, stable, registration_error))
    usable = stable & np.isfinite(cells.dz) & np.isfinite(cells.error)
    sampling = np.zeros(cells.dz.shape)
    sampling[usable] = model.sampling_error(cells, usable)
    usable &= sampling > 0
    usable = cells.partition.one_each(usable)
    if cells.plants is not None:
        little = usable & (np.nan_to_num(cells.plants) <= sampling)
        if int(little.sum()) >= MIN_CELLS:
            usable = little
        else:
            # a cell's error by plants is counted in addition to its sampling error, not as a part of it
            sampling = np.hypot(sampling, np.nan_to_num(cells.plants))
    count = int(usable.sum())
    if count < MIN_CELLS:
        return replace(model, cells=count)
    standardised = np.full(cells.dz.shape, np.nan)
    standardised[usable] = cells.dz[usable] / sampling[usable]
    empirical = empirical_variogram(standardised, cells.cell, cells.layout)
    if len(empirical.lag) < MIN_LAGS:
        return replace(model, cells=count, without="too few distances between stable cells")
    return replace(model, cells=count, variogram=fit_variogram(empirical))


def _in_common(cells: Cells, stable: NDArray[np.bool_], registration_error: float) -> float:
    """Share of the plants' error that the whole slope has in common, 1 where nothing is known of plants."""
    if cells.plants is None:
        return 1.0
    # a change that the plants' height explains is evidence for them too, and mown grass is not taken as stable
    calibrating = stable if cells.plant_like is None else stable | cells.plant_like
    calibrating = cells.partition.one_each(calibrating)
    sampling = CorrelationModel(registration_error, None).sampling_error(cells)
    return common_share(cells.dz, sampling, cells.plants, calibrating, cells.cell, cells.layout)


def outside(
    footprints: Sequence[Footprint], valid: NDArray[np.bool_], cell: float, layout: Layout | None = None
) -> NDArray[np.bool_]:
    """Cells of ``valid`` farther than half a metre, and at least two cells, from every footprint.

    Single cells beyond their level stay in: they are the noise's own, and without them it would look too small.
    """
    layout = layout or layout_of(valid)
    moved = np.zeros(layout.shape, dtype=bool)
    for footprint in footprints:
        moved[footprint.window] |= footprint.inside
    near = ndimage.maximum_filter(moved, size=2 * max(2, round(_STABLE_MARGIN_M / cell)) + 1)
    return valid & ~layout.of(near)


def zone_volumes(footprints: Sequence[Footprint], cells: Cells, model: CorrelationModel) -> ZoneVolumes:
    """Volume of each zone over its footprint, with its standard error."""
    figures = np.zeros((len(footprints), 6))
    # weights of all that sank, that rose
    sides = np.zeros((2, *cells.dz.shape)) if footprints else np.zeros((2, *(1 for _ in cells.dz.shape)))
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
        _add(sides[int(volume > 0)], cells.layout, footprint.window, weights)
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
