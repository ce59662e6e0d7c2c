"""The change between two elevation models on one grid, with its error in each cell."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..change.measured import Measured
from ..change.result import Change
from ..change.slope_calibration import ErrorModel, Samples, calibrate, patch_halves
from ..core.arrays import Bool, Float
from ..grid.grid import Grid
from ..grid.partition import Partition
from ..statistics.normal import quantile
from .cell_errors import CellErrors, attribute_table, cell_errors
from .coregistration import Coregistration, coregister, moved
from .stable import stable_ground_of
from .terrain import Terrain, terrain_of
from .trend import Trend, find_trend

_ROUNDS = 2  # of stable ground and what is measured on it
_HEIGHT_COUNT = 2
"""Points that a height stands for, where it is not known of how many it was made: more than one, which may be stray."""
_STEPS_ERROR = 1.0 / np.sqrt(12.0)  # of heights in steps, in units of the step


@dataclass(frozen=True)
class ModelChange:
    """Two elevation models compared.

    Attributes:
        change: with the bias and the shift in plan taken off, and the tilt or bend if that was asked for.
        coregistration: bias and shift in plan, which were taken off, with their errors.
        trend: the tilt or bend of the later model, and whether it was taken off.
        errors: standard error by the terrain, before it is calibrated by slope.
        attributes: how the scatter on stable ground follows each attribute.
        stable_given: stable ground was given, not found.
        notes: sentences for the user.
    """

    change: Change
    coregistration: Coregistration
    trend: Trend
    trend_taken_off: bool
    errors: CellErrors
    attributes: list[dict[str, Any]]
    stable_given: bool
    notes: tuple[str, ...]


@dataclass(frozen=True)
class TakenOff:
    """Whether a shift in plan, and a tilt or bend, are taken off where they differ from none."""

    plan: bool = True
    tilt: bool = False


@dataclass(frozen=True)
class _Matched:
    """The later model brought to the earlier, and what is measured on the difference; arrays (rows, columns)."""

    found: Coregistration
    later: Float
    dz: Float
    terrain: Terrain
    attributes: dict[str, Float]
    errors: CellErrors
    error: Float
    stable: Bool


def compare_models(
    reference: Float,
    moving: Float,
    grid: Grid,
    *,
    confidence: float = 0.95,
    stable: Bool | None = None,
    taken_off: TakenOff = TakenOff(),
    steps: tuple[float, float] = (0.0, 0.0),
) -> ModelChange:
    """Coregister ``moving`` to ``reference``, subtract, and state the error of each cell.

    Stable ground is what is given, or what is no part of a coherent change (``stable.stable_cells``). The
    coregistration, the scatter by terrain and the stable ground depend on each other and are found in turn. The
    scatter (``cell_errors``) is a median and says little of heavy tails; so its factor by slope is calibrated as that
    of a change between clouds, on the quantile that the level of detection is about (``slope_calibration.calibrate``).

    Args:
        reference, moving: heights (rows, columns) on ``grid``, metres, NaN where unknown.
        stable: cells known to be stable.
        taken_off: what is taken off beside the bias.
        steps: whole multiples of what the heights of either model are, metres; 0 for none.

    Raises:
        TooFewCells: too few common cells.
    """
    floor = float(np.hypot(*steps) * _STEPS_ERROR)
    matched = _matched(reference, moving, grid.cell, stable, taken_off.plan, floor)
    trend = find_trend(matched.dz, matched.error, matched.terrain.slope, stable)
    off = taken_off.tilt and trend.order > 0
    if off:
        before = matched.found.nmad_before
        matched = _matched(reference, moving - trend.surface, grid.cell, stable, taken_off.plan, floor)
        matched = replace(matched, found=replace(matched.found, nmad_before=before))
    dz = matched.dz
    measured = Measured(dz, matched.error, matched.terrain.slope, Partition(grid.shape, grid.cell))
    model = _calibrated(measured, matched.stable, confidence)
    heights = reference, matched.later
    change = _change(measured, heights, grid, model, matched, confidence, trend.error if off else None)
    table = attribute_table(matched.errors, dz, matched.attributes, matched.stable)
    return ModelChange(change, matched.found, trend, off, matched.errors, table, stable is not None, model.notes)


def _matched(reference: Float, moving: Float, cell: float, stable: Bool | None, plan: bool, floor: float) -> _Matched:
    """Bias and shift taken off, with the scatter by terrain, not below ``floor`` (m), and the stable ground."""
    known: Bool | None = stable
    for _ in range(_ROUNDS):
        found = coregister(reference, moving, cell, known, plan=plan)
        later = moved(moving, np.array([found.east, found.north, found.bias]), cell)
        dz = later - reference
        terrain = terrain_of((reference + later) / 2.0, cell)
        attributes = {"slope": terrain.slope, "curvature": terrain.curvature, "roughness": terrain.roughness}
        used = np.isfinite(dz) if known is None else known & np.isfinite(dz)
        errors = cell_errors(dz, attributes, used, floor)
        error = np.where(np.isfinite(dz), errors.at(list(attributes.values())), np.nan)
        known = stable_ground_of(dz, error, terrain.slope, stable)
    assert known is not None
    return _Matched(found, later, dz, terrain, attributes, errors, error, known)


def _common_error(found: Coregistration, terrain: Terrain, dz: Float) -> float:
    """Standard error by the coregistration, root mean square over the cells, metres: they share it."""
    known = np.isfinite(dz) & np.isfinite(terrain.east)
    if not known.any():
        return found.errors[2]
    return float(np.sqrt(np.mean(found.height_error(terrain.east[known], terrain.north[known]) ** 2)))


def _calibrated(measured: Measured, stable: Bool, confidence: float) -> ErrorModel:
    here = np.flatnonzero(np.isfinite(measured.dz))
    samples = Samples(
        measured.dz.ravel()[here],
        measured.sampling.ravel()[here],
        measured.slope.ravel()[here],
        stable.ravel()[here],
        half=patch_halves(measured.partition.layout, here),
    )
    # the bias was taken off on this very ground, so that its error does not show there
    return calibrate(samples, registration_error=0.0, confidence=confidence)


def _change(
    measured: Measured,
    heights: tuple[Float, Float],
    grid: Grid,
    model: ErrorModel,
    matched: _Matched,
    confidence: float,
    by_trend: Float | None,
) -> Change:
    common = _common_error(matched.found, matched.terrain, matched.dz)
    sampling = model.factor(measured.slope) * measured.sampling
    error = np.hypot(sampling, common)
    if by_trend is not None:
        error = np.hypot(error, by_trend)
    level = quantile(confidence) * error
    known = [np.isfinite(surface) for surface in heights]
    counts = [np.where(one, _HEIGHT_COUNT, 0) for one in known]
    with np.errstate(invalid="ignore"):
        significant = np.abs(measured.dz) > level
    return Change(
        grid=grid,
        partition=measured.partition,
        dz=measured.dz,
        error=error,
        level=level,
        significant=significant,
        count_from=counts[0],
        count_to=counts[1],
        height_from=heights[0],
        height_to=heights[1],
        confidence=confidence,
        registration_error=common,
        common_cell_rate=float((known[0] & known[1]).sum() / max((known[0] | known[1]).sum(), 1)),
        uniform_dz=None,
        stable=matched.stable,
        slope=measured.slope,
        model=model,
        sampling=sampling,
        by_trend=by_trend,
    )
