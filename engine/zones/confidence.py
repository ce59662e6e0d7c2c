"""Confidence of a zone: it was selected from a whole map, where noise alone makes groups of cells that stand out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr

from ...interface.parameters import ZoneParameters
from ..core.arrays import Float
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
    beyond = (abs(mean) - shared * np.abs(_NODES)) / max(sampling, 1e-12)
    tail = 2.0 * stdtr(_CELL_DEGREES_OF_FREEDOM * max(cells, 1.0), -beyond)
    with np.errstate(divide="ignore"):
        by_chance = np.exp(np.minimum(np.log(np.minimum(tail, 1.0)) + places, 0.0))
    return float(np.clip(1.0 - np.sum(_WEIGHTS * by_chance), 0.0, 1.0))


@dataclass(frozen=True)
class SureGroups:
    """Groups that are sure enough, numbered 1 to n in ``labels`` of the cells, and what was taken of them.

    Attributes:
        confidence: (n,) see ``confidence_after_selection``.
        footprints: of each.
        correlation: how the errors of cells are related, measured outside of the footprints.
        dropped: how many groups were not sure enough.
    """

    labels: NDArray[np.int32]
    confidence: Float
    footprints: tuple[Footprint, ...]
    correlation: CorrelationModel
    dropped: int


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
    compared = cells.partition.parts_among(known)
    gap, stable = parameters.bridged_gap, found.stable
    dropped = 0
    while True:
        footprints = outline_footprints(cells, labels, count, gap=gap, registration_error=registration_error)
        still = outside(footprints, known, cells.cell, cells.layout)
        correlation = fit_correlation(cells, still if stable is None else still & stable, registration_error)
        number = cells.partition.parts_in_groups(labels, count)
        confidence = np.array(
            [
                _confidence(
                    footprint,
                    cells,
                    found.count_min,
                    correlation,
                    int(n),
                    compared,
                )
                for footprint, n in zip(footprints, number, strict=True)
            ],
            dtype=np.float64,
        )
        kept = confidence >= parameters.minimum_confidence
        if kept.all():
            return SureGroups(labels, confidence, footprints, correlation, dropped)
        dropped += int((~kept).sum())
        labels, count = without(labels, kept), int(kept.sum())


def _confidence(
    footprint: Footprint,
    cells: Cells,
    count_min: NDArray[np.integer],
    correlation: CorrelationModel,
    number: int,
    compared: int,
) -> float:
    near = in_window(cells, footprint.window)
    own = footprint.own / footprint.own.sum()
    return confidence_after_selection(
        mean_that_counts(near.dz, near.error, cells.layout.window(count_min, footprint.window), own),
        correlation.own_error(own, near),
        correlation.common_error(own, near),
        samples=correlation.samples(own, near),
        cells=number,
        compared=compared,
    )
