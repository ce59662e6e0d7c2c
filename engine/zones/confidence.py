"""Confidence of a zone: it was selected from a whole map, where noise alone makes groups of cells that stand out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr

from ...interface.parameters import ZoneParameters
from ..core.arrays import Float
from .discs import best_discs, log_of_discs
from .footprints import Cells, Detected, Footprint, in_window, outline_footprints
from .groups import without
from .volumes import CorrelationModel, fit_correlation, outside

MIN_SURE_CONFIDENCE = 0.95
"""A zone below this confidence gets no severity."""
_LOG_SHAPES_PER_SAMPLE = 1.8
"""Logarithm of how many more shapes a zone may have for each effective sample: groups of n cells that touch by edge or
corner are about 6.2 times as many as those of n - 1."""
_LOG_SHAPES_PER_NEAR_SAMPLE, _MAX_LOG_SHAPES_OF_NEAR_SAMPLES = 0.7, 2.0
"""More for each of the first few samples, and altogether at most: where errors are partly correlated, a zone of few
effective samples has more cells than these to choose its shape from."""
_CELL_DEGREES_OF_FREEDOM = 12.0
"""Degrees of freedom of a cell's error: eight of its neighbourhood (``pooled_variance``), about four of its points."""
_MAX_ERRORS_OF_ONE_POINT = 3.0  # errors that a cell of one point counts for, at most: it may be a stray one
_NODES = np.linspace(-6.0, 6.0, 241)
_WEIGHTS = np.exp(-0.5 * _NODES**2) / np.exp(-0.5 * _NODES**2).sum()


def mean_that_counts(dz: Float, sigma: Float, points: NDArray[np.integer], own: Float) -> float:
    """Mean change of a zone, metres, in which a cell with a single point of an epoch counts for three errors at most.

    Args:
        dz, sigma: change and its standard error, metres, of any shape.
        points: points of each cell in the epoch that has fewer.
        own: weight of each cell, 0 outside of the zone; their sum is 1.
    """
    used = own > 0
    change, limit = dz[used], _MAX_ERRORS_OF_ONE_POINT * sigma[used]
    counted = np.where(points[used] <= 1, np.clip(change, -limit, limit), change)
    return float(np.sum(own[used] * counted))


def confidence_after_selection(
    mean: float, sampling: float, shared: float, *, samples: float, cells: float, compared: float
) -> float:
    """Probability that noise alone makes no zone as strong as this one anywhere on the map.

    A mean change so far beyond its own error would be rare at a place named before. But a zone is the place where it is
    large, with the shape that makes it so: the probability of the mean is multiplied by the number of places of its
    size on the map, and by the number of shapes, which grows with the number of effective samples (Bonferroni's bound,
    as for scan statistics). The error that all cells share is the same at all places; it is drawn once for the
    map, not once a place.

    The errors are themselves estimated from few points, so the mean follows Student's t, with twelve degrees of freedom
    for each cell.

    On maps of 10,000 cells of normal errors, 100 of each of five variograms (independent cells to nearly smooth fields,
    ranges of 3 to 80 m), 12 of 500 held a group that counts as sure.

    Args:
        mean: change, metres.
        sampling: standard error of the mean by what differs from place to place, metres.
        shared: standard error that the whole map has in common (registration, plants), metres.
        samples: effective number of samples of the mean.
        cells: cells of the zone, a grown one counting once.
        compared: cells of the map.
    """
    more = max(samples - 1.0, 0.0)
    places = (
        math.log(max(compared / max(cells, 1.0), 1.0))
        + _LOG_SHAPES_PER_SAMPLE * more
        + min(_LOG_SHAPES_PER_NEAR_SAMPLE * more, _MAX_LOG_SHAPES_OF_NEAR_SAMPLES)
    )
    return _confidence_among(mean, sampling, shared, cells, places)


def _confidence_among(mean: float, sampling: float, shared: float, cells: float, log_places: float) -> float:
    """Probability that noise alone makes no such mean at any of the places, whose number's logarithm is given."""
    beyond = (abs(mean) - shared * np.abs(_NODES)) / max(sampling, 1e-12)
    tail = 2.0 * stdtr(_CELL_DEGREES_OF_FREEDOM * max(cells, 1.0), -beyond)
    with np.errstate(divide="ignore"):
        by_chance = np.exp(np.minimum(np.log(np.minimum(tail, 1.0)) + log_places, 0.0))
    return float(np.clip(1.0 - np.sum(_WEIGHTS * by_chance), 0.0, 1.0))


@dataclass(frozen=True)
class SureGroups:
    """Groups that are sure enough, numbered 1 to n in ``labels`` of the cells, and what was taken of them.

    Attributes:
        confidence: (n,) see ``confidence_after_selection``.
        footprints: of each.
        correlation: how the errors of cells are related, measured outside of the footprints.
    """

    labels: NDArray[np.int32]
    confidence: Float
    footprints: tuple[Footprint, ...]
    correlation: CorrelationModel


def sure_groups(
    labels: NDArray[np.int32],
    count: int,
    cells: Cells,
    found: Detected,
    parameters: ZoneParameters,
    *,
    registration_error: float,
) -> SureGroups:
    """The groups 1 to ``count`` of ``labels`` whose confidence is at least ``parameters.minimum_confidence``.

    What is left out is noise, and belongs to the ground on which the errors' correlation is measured: this is measured
    again without it, until all that remain are sure.

    Args:
        registration_error: metres, see ``footprints.outline_footprints``.
    """
    known = np.isfinite(cells.dz)
    gap, stable = parameters.bridged_gap, found.stable
    while True:
        footprints = outline_footprints(cells, labels, count, gap=gap, registration_error=registration_error)
        still = outside(footprints, known, cells.cell, cells.layout)
        correlation = fit_correlation(cells, still if stable is None else still & stable, registration_error)
        least = parameters.minimum_confidence
        told = confidence_of_groups(footprints, labels, cells, found.count_min, correlation, least=least)
        confidence = told[:, 2]
        kept = confidence >= least
        if kept.all():
            return SureGroups(labels, confidence, footprints, correlation)
        labels, count = without(labels, kept), int(kept.sum())


def confidence_of_groups(
    footprints: Sequence[Footprint],
    labels: NDArray[np.int32],
    cells: Cells,
    count_min: NDArray[np.integer],
    correlation: CorrelationModel,
    *,
    least: float,
) -> Float:
    """(n, 3) of the groups 1 to n of ``labels``: mean change and its standard error, metres, and confidence.

    Args:
        footprints: of each group; its ``own`` cells count.
        count_min: as in ``Detected``.
        least: confidence from which a group's shape decides; below it discs may make it surer.
    """
    groups = _Groups(cells, labels, count_min, correlation, cells.partition.parts_among(np.isfinite(cells.dz)))
    parts = cells.partition.parts_in_groups(labels, len(footprints))
    told = [groups.told(f, place, int(n), least) for place, (f, n) in enumerate(zip(footprints, parts, strict=True), 1)]
    return np.array(told, dtype=np.float64).reshape(-1, 3)


@dataclass(frozen=True)
class _Groups:
    """Groups of cells on a map of ``compared`` cells; the others as in ``sure_groups``."""

    cells: Cells
    labels: NDArray[np.int32]
    count_min: NDArray[np.integer]
    correlation: CorrelationModel
    compared: int

    def told(self, footprint: Footprint, number: int, parts: int, least: float) -> tuple[float, float, float]:
        """Of the group ``number`` of so many ``parts``: mean, its error, and confidence by its shape or by a disc.

        The number of shapes that noise may choose from grows with a group, and faint change over many cells never
        makes up for it. The discs are few. Their cells count whatever their own change is.
        """
        near = in_window(self.cells, footprint.window)
        points = self.cells.layout.window(self.count_min, footprint.window)
        own = footprint.own / footprint.own.sum()
        mean = mean_that_counts(near.dz, near.error, points, own)
        errors = self._errors(own, near)
        samples = self.correlation.samples(own, near)
        sure = confidence_after_selection(mean, *errors, samples=samples, cells=parts, compared=self.compared)
        if sure < least:
            sure = max(sure, self._by_discs(footprint, near, points, number))
        return mean, math.hypot(*errors), sure

    def _errors(self, weights: Float, near: Cells) -> tuple[float, float]:
        return self.correlation.own_error(weights, near), self.correlation.common_error(weights, near)

    def _by_discs(self, footprint: Footprint, near: Cells, points: NDArray[np.integer], number: int) -> float:
        labels = self.cells.layout.window(self.labels, footprint.window)
        own = labels == number
        sign = float(np.sign(np.sum(near.dz[own])))
        with np.errstate(invalid="ignore"):
            usable = np.isfinite(near.dz) & ((labels == 0) | own | (near.dz * sign < 0))
        moved = near.dz if near.plant_like is None else np.where(near.plant_like, 0.0, near.dz)
        surest = 0.0
        for disc in best_discs(sign * np.nan_to_num(moved), np.nan_to_num(near.error), usable, own):
            weights = disc / disc.sum()
            mean = mean_that_counts(moved, near.error, points, weights)
            if mean * sign > 0:
                parts = near.partition.parts_among(disc > 0)
                places = log_of_discs(self.compared)
                surest = max(surest, _confidence_among(mean, *self._errors(weights, near), parts, places))
        return surest
