"""How far the errors of a difference hold, by slope: the model that stable ground calibrates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float, Index
from ..grid.cell_slope import class_of_slope
from ..statistics.layout import Layout
from ..statistics.normal import quantile
from ..statistics.quantiles import sample_quantile
from ..statistics.robust import NORMALISED

_SLOPE_CLASS_DEG = 5.0  # degrees; classes with too few cells are joined with the next
_MIN_CLASS_CELLS = 200  # with 5 % beyond, their share is known to 1.5 %
_MIN_INDEPENDENT_CLASS_CELLS = 100  # ... that share no points with others
_MIN_CELLS_TO_NARROW = 400  # for factors below 1
_MIN_CELLS = 50
_MIN_STABLE_SHARE = 0.1  # share of a class's cells that must be stable for the class to be calibrated
_SQUARES_ALONG_LONGER_SIDE = 12
_MIN_HALF_CELLS = 100  # with fewer cells a half is not used
_MIN_FACTOR, _MAX_FACTOR = 0.4, 5.0
_MAX_CREDIBLE_FACTOR = 2.0  # above, a note for the user
_FACTOR_WITHOUT_STABLE_GROUND = 1.5  # beyond every factor seen on unchanged surveys (docs/figures.md)
_ROUNDS = 3
_MAX_PLANT_RATIO = 0.5  # of the sampling error: plants that add an eighth to it at most


@dataclass(frozen=True)
class SlopeClass:
    """One class of the model, ``slope_from`` to ``slope_to`` degrees.

    ``factor`` multiplies the sampling error at the class's median slope, ``at``. The exceedances are the shares of its
    stable ``cells`` beyond the level of detection with the uncalibrated errors and with the calibrated.
    """

    slope_from: float
    slope_to: float
    at: float
    cells: int
    factor: float
    exceedance_uncalibrated: float
    exceedance: float


@dataclass(frozen=True)
class ErrorModel:
    """Factor of the sampling error by slope.

    Attributes:
        kind: calibrated (on stable ground), widened (there was none to calibrate on) or uncalibrated.
        classes: the classes from flat to steep; empty unless calibrated.
        typical: the factor where the slope is unknown, and everywhere unless calibrated.
        stable_cells: number of cells that it was calibrated on.
        stable_share: their share of the compared cells.
        notes: sentences for the user.
        why: why there was nothing to calibrate on, where it is widened.
        changed_share: share of the compared cells around which the ground has changed as a whole, where that was asked.
    """

    kind: str
    classes: tuple[SlopeClass, ...] = ()
    typical: float = 1.0
    stable_cells: int = 0
    stable_share: float = 0.0
    notes: tuple[str, ...] = ()
    changed_share: float | None = None
    why: str = ""

    def factor(self, slope: Float) -> Float:
        """The factor at each cell's slope (degrees), linear between the classes' medians, constant beyond."""
        if not self.classes:
            return np.full(slope.shape, self.typical)
        at, factor = [c.at for c in self.classes], [c.factor for c in self.classes]
        return np.where(np.isnan(slope), self.typical, np.interp(slope, at, factor))

    def summary(self) -> dict[str, Any]:
        """For the run record."""
        return {
            "error_model": self.kind,
            "factor_typical": self.typical,
            "stable_cells": self.stable_cells,
            "stable_share": self.stable_share,
            "changed_share": self.changed_share,
            "slope_classes": [vars(c) for c in self.classes],
        }


def uncalibrated() -> ErrorModel:
    """Errors as estimated from the points' scatter."""
    return ErrorModel("uncalibrated")


def without_stable_ground(changed_share: float, stable_share: float) -> ErrorModel:
    """Errors as estimated from the points' scatter, because too much has changed to calibrate them on the rest."""
    note = (
        f"More than a third of the compared ground has changed (only {100 * stable_share:.0f} % looks stable, and "
        f"{100 * changed_share:.0f} % changed as a whole), so the change itself does not show what is stable: the "
        "errors are not calibrated, and the level of detection is that of the points and the registration; give an "
        "area known to be stable, and check the registration."
    )
    return ErrorModel("uncalibrated", stable_share=stable_share, notes=(note,), changed_share=changed_share)


@dataclass(frozen=True)
class Samples:
    """Changes of which some are on stable ground; arrays of one shape.

    Attributes:
        dz: change, metres, NaN where not compared.
        sampling: standard error from the points' scatter alone, metres.
        slope: degrees, NaN where unknown.
        stable: what to calibrate on.
        plants: error of the change by plants, metres; none without.
        half: True in one half of the patches of ground, False in the other (``patch_halves``).
    """

    dz: Float
    sampling: Float
    slope: Float
    stable: NDArray[np.bool_]
    plants: Float | None = None
    half: NDArray[np.bool_] | None = None


@dataclass(frozen=True)
class _CellsToUse:
    """Flat numbers of cells: ``compared`` ones, by which classes of slope are judged, and the ``stable`` ones of these.

    ``bare``: only cells with little error by plants are among them. ``known`` is how many were compared at all.
    """

    compared: Index
    stable: Index
    bare: bool
    known: int


def _cells_to_use(samples: Samples, independent: float) -> _CellsToUse:
    """The cells that show their sampling error, if there are enough; else all."""
    dz, sampling = samples.dz.ravel(), samples.sampling.ravel()
    known = np.flatnonzero(np.isfinite(dz) & np.isfinite(sampling) & (sampling > 0))
    little = known
    if samples.plants is not None:
        little = known[samples.plants.ravel()[known] <= _MAX_PLANT_RATIO * sampling[known]]
    stable = samples.stable.ravel()
    bare = len(little) == len(known) or int(np.count_nonzero(stable[little])) * independent >= _MIN_CLASS_CELLS
    compared = little if bare else known
    return _CellsToUse(compared, compared[stable[compared]], bare, len(known))


def calibrate(
    samples: Samples, *, registration_error: float, confidence: float, independent: float = 1.0
) -> ErrorModel:
    """Factor f of the sampling error s with which 1 - confidence of the stable cells are beyond the level, by slope.

    After Hugonnet et al. (2022, doi:10.1109/JSTARS.2022.3188922), who bin the scatter of standardised stable
    differences by slope and interpolate. In place of the median scatter (NMAD) f is taken from the quantile that
    the level is about, because differences of real ground have heavy tails: on a dense real cloud the NMAD of dz / s is
    0.2 to 0.7 where the 95 % quantile asks for 0.6 to 1. With the registration error r and the normal quantile q a
    stable cell lies beyond its level where (dz² / q² - r²) / s² exceeds f²; f² is the ``confidence`` quantile of that.

    Classes of 5 degrees are joined until each has 200 stable cells. With fewer than 400 a factor below 1 is taken from
    a quantile one standard error higher, because too narrow a level does more harm than too wide a one. Nor is it
    smaller than what either ``half`` of the ground alone requires: errors below those of the points need
    evidence that holds on ground from which it was not taken.

    The error by plants p is no sampling error, and no factor multiplies it. Where it is the larger part, a cell hardly
    shows its sampling error: the cells whose p is below s / 2 serve if there are enough, else all with r² + p²
    in place of r², and then f does not fall below 1, as plant errors stated too large would make it.

    Args:
        registration_error: metres.
        independent: share of the cells that are independent, above 0: below 1 where neighbours share
            points. What is asked of numbers of cells is asked of so many of them.
    """
    cells_used = _cells_to_use(samples, independent)
    stable, bare = cells_used.stable, cells_used.bare
    dz, sampling, at = (values.ravel()[stable] for values in (samples.dz, samples.sampling, samples.slope))
    all_at = samples.slope.ravel()[cells_used.compared]
    of_half = None if samples.half is None else samples.half.ravel()[stable]
    plant = 0.0 if samples.plants is None else samples.plants.ravel()[stable]
    others = np.full(dz.size, registration_error**2) + plant**2
    cells, share = dz.size, dz.size / max(cells_used.known, 1)
    shift = sample_quantile(dz, 0.5) if cells else 0.0
    spread = NORMALISED * sample_quantile(np.abs(dz - shift), 0.5) if cells else 0.0
    usual = float(np.sqrt(np.median(others))) if cells else registration_error
    if cells * independent < _MIN_CELLS or abs(shift) > 2.0 * spread + 2.0 * usual:
        why = (
            f"only {cells} cells of stable ground were found"
            if cells * independent < _MIN_CELLS
            else f"what looks stable has moved by {shift:+.3f} m"
        )
        return _widened(why, cells, share)
    z = quantile(confidence)
    needed = ((dz / z) ** 2 - others) / sampling**2
    least = _MIN_FACTOR if bare else 1.0
    typical = _factor(needed, confidence, least=least, half=of_half, independent=independent)
    bounds = _joined(at, all_at, independent)
    inside = [(at >= low) & (at < high) for low, high in bounds]
    members = [(needed[m], at[m]) for m in inside]
    halves = [None if of_half is None else of_half[m] for m in inside]
    centres = [sample_quantile(slopes, 0.5) for _, slopes in members]
    factor = partial(_factor, confidence=confidence, least=least, independent=independent)
    factors = _class_factors(members, halves, centres, typical, factor)
    classes = tuple(
        SlopeClass(
            slope_from=low,
            slope_to=high,
            at=centre,
            cells=squares.size,
            factor=factor,
            exceedance_uncalibrated=float(np.mean(squares > 1.0)),
            exceedance=float(np.mean(squares > np.interp(slopes, centres, factors) ** 2)),
        )
        for (low, high), (squares, slopes), centre, factor in zip(bounds, members, centres, factors, strict=True)
    )
    return ErrorModel("calibrated", classes, typical, cells, share, _notes(classes, typical))


def _class_factors(
    members: Sequence[tuple[Float, Float]],
    halves: Sequence[NDArray[np.bool_] | None],
    centres: Sequence[float],
    typical: float,
    factor: Callable[..., float],
) -> list[float]:
    """The factor of each class of slope; ``members`` are the squares and slopes of its cells, ``centres`` its median.

    Between the medians the factor is interpolated: the classes are made to hold as they are used.
    """
    factors = [typical] * len(members)
    for _ in range(_ROUNDS):
        scaled = [squares / np.interp(slopes, centres, factors) ** 2 for squares, slopes in members]
        factors = [factor(rest, scale=f, half=of) for rest, f, of in zip(scaled, factors, halves, strict=True)]
    return factors


def _widened(why: str, cells: int, share: float) -> ErrorModel:
    """The errors where stable ground does not show them: ``cells`` of it, ``share`` of those compared."""
    note = (
        f"The errors could not be calibrated, because {why}; the level of detection is widened "
        f"{_FACTOR_WITHOUT_STABLE_GROUND:g} times; give an area known to be stable."
    )
    return ErrorModel(
        "widened", typical=_FACTOR_WITHOUT_STABLE_GROUND, stable_cells=cells, stable_share=share, notes=(note,), why=why
    )


def patch_halves(layout: Layout, here: Index) -> NDArray[np.bool_]:
    """Which of the cells at the places ``here`` (n,) are in the squares of one colour of a chessboard over the grid.

    See ``_SQUARES_ALONG_LONGER_SIDE``.
    """
    side = max(-(-max(layout.shape) // _SQUARES_ALONG_LONGER_SIDE), 1)
    row, column = layout.row_and_column(here)
    return np.asarray((row // side + column // side) % 2 == 0)


def _factor(
    needed: Float,
    confidence: float,
    scale: float = 1.0,
    *,
    least: float = _MIN_FACTOR,
    half: NDArray[np.bool_] | None = None,
    independent: float = 1.0,
) -> float:
    """``scale`` times the square root of the quantile, within credible limits, not below 1 by chance of a few cells."""

    def asked(of: Float, share: float) -> float:
        return scale * float(np.sqrt(max(sample_quantile(of, share), 0.0)))

    factor = asked(needed, confidence)
    if factor < 1.0 and needed.size * independent < _MIN_CELLS_TO_NARROW:
        surer = min(confidence + float(np.sqrt(confidence * (1 - confidence) / (needed.size * independent))), 1.0)
        factor = min(asked(needed, surer), 1.0)
    elif factor < 1.0 and half is not None:
        least_in_half = _MIN_HALF_CELLS / independent
        parts = [part for part in (needed[half], needed[~half]) if part.size >= least_in_half]
        # by chance a half asks for more or less; one standard error is allowed for
        chance = float(np.sqrt(confidence * (1 - confidence)))
        both = [asked(part, confidence - chance / np.sqrt(part.size * independent)) for part in parts]
        factor = min(max(factor, *both), 1.0) if len(both) == 2 else 1.0
    return float(np.clip(factor, least, _MAX_FACTOR))


def _joined(at: Float, all_at: Float, independent: float) -> list[tuple[float, float]]:
    """Classes of slope with enough stable cells (``at``, degrees) among all compared ones; narrow ones are joined."""
    bounds: list[tuple[float, float]] = []
    low, cells, of = 0.0, 0, 0
    numbers = (class_of_slope(slopes, _SLOPE_CLASS_DEG) for slopes in (at, all_at))
    classes = round(90.0 / _SLOPE_CLASS_DEG)
    counts = (np.bincount(number[number >= 0], minlength=classes)[:classes].tolist() for number in numbers)
    for number, (stable, compared) in enumerate(zip(*counts, strict=True), 1):
        cells, of = cells + stable, of + compared
        if cells >= max(_MIN_CLASS_CELLS, _MIN_INDEPENDENT_CLASS_CELLS / independent, _MIN_STABLE_SHARE * of):
            bounds.append((low, number * _SLOPE_CLASS_DEG))
            low, cells, of = number * _SLOPE_CLASS_DEG, 0, 0
    if bounds and np.any(at >= low):
        bounds[-1] = (bounds[-1][0], 90.0)
    return bounds


def _notes(classes: tuple[SlopeClass, ...], typical: float) -> tuple[str, ...]:
    largest = max((c.factor for c in classes), default=typical)
    if largest <= _MAX_CREDIBLE_FACTOR:
        return ()
    sentence = (
        f"Even on ground taken as stable the epochs differ up to {largest:.1f} times as much as their points' scatter "
        "explains: the surveys do not fit, or much of the slope has moved; the level of detection is widened by as "
        "much; check the registration, or give an area known to be stable."
    )
    return (sentence,)
