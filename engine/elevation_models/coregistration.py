"""Where a later elevation model lies in relation to an earlier one: shift in plan and height, with its own error.

Nuth and Kääb (2011, doi:10.5194/tc-5-271-2011): a shift in plan shows in the difference as the rise of the ground in
its direction, dh = b - x e - y n. They divide by tan(slope) and fit a cosine over aspect; here the equation is kept
as it stands and fitted by robust least squares, so that flat ground, which says nothing of the shift, does no harm. On
a slope of one aspect the shift along its contours has no evidence, and none is taken off.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from ..core.arrays import Bool, Float, Index
from ..statistics.robust import nmad, robust_scale
from ..statistics.variogram import (
    MIN_CELLS,
    MIN_LAGS,
    VariogramModel,
    empirical_variogram,
    fit_variogram,
    sum_variance,
)
from .cell_errors import cell_errors
from .shift import shifted
from .terrain import gradients

MAX_SHIFT_ERROR_CELLS = 0.25
"""Standard error of a shift in plan, in cells, above which the relief does not show it."""
_TUKEY = 4.685  # standard deviations at which a residual counts nothing
_MIN_T_SQUARED = 9.21  # of both shifts together: 99 % of chi-square with two degrees of freedom
_MIN_PYRAMID_CELLS = 40  # along the shorter side of the coarsest level
_COARSEST = 8
_ROUNDS = 12
_CONVERGED_CELLS = 1e-3
MIN_EQUATIONS = 100
_NEAR_CELLS = 31  # along the side of the square around a cell
_MIN_RISE_RATIO = 0.5  # of the variance of the rises that both models show to that of their errors
_MAX_ROUNDS_OF_WEIGHTS, _CONVERGED_M = 20, 1e-6


class TooFewCells(ValueError):
    """The stable ground that both models show has fewer than ``MIN_EQUATIONS`` cells."""


@dataclass(frozen=True)
class Coregistration:
    """Of the later model in relation to the earlier; metres.

    Attributes:
        east, north: shift in plan of the later model that was found and taken off; 0 where none was.
        bias: height of the later model above the earlier on stable ground, which was taken off.
        covariance: (3, 3) of east, north and bias, m²; of the bias alone where no shift was taken off.
        found: the shift in plan that was measured, taken off or not, and its standard errors: east, north, error east,
            error north; None where it could not be determined.
        why: why no shift in plan was taken off; empty where one was.
        nmad_before, nmad_after: scatter of the difference on stable ground.
        cells: number of stable cells.
        correlation: how the errors of the difference on stable ground are related, in units of each cell's own; None
            with too little of it.
    """

    east: float
    north: float
    bias: float
    covariance: Float
    found: tuple[float, float, float, float] | None
    why: str
    nmad_before: float
    nmad_after: float
    cells: int
    correlation: VariogramModel | None = None

    @property
    def errors(self) -> tuple[float, float, float]:
        """Standard errors of east, north and bias."""
        east, north, bias = np.sqrt(np.diag(self.covariance)).tolist()
        return east, north, bias

    def height_error(self, east: Float, north: Float) -> Float:
        """Standard error of the difference by the coregistration, where the ground rises so, metres."""
        rows = np.stack([-np.nan_to_num(east), -np.nan_to_num(north), np.ones(east.shape)], axis=-1)
        return np.sqrt(np.einsum("...i,ij,...j->...", rows, self.covariance, rows))


@dataclass(frozen=True)
class _Fit:
    """Equations of the cells at ``place`` (n,) and the parameters that fit them; lengths in metres."""

    parameters: Float
    place: Index
    design: Float
    weight: Float
    residual: Float
    sigma: Float


def coregister(
    reference: Float, moving: Float, cell: float, stable: Bool | None = None, *, plan: bool = True
) -> Coregistration:
    """Find the shift of ``moving`` in relation to ``reference``.

    From coarse cells to fine, so that shifts of several cells are found. Cells that have changed lose their weight
    (Tukey's function, in units of the scatter on ground as steep). A shift in plan is taken off where its standard
    errors are below a quarter of a cell, it differs from none at 99 %, and the scatter becomes smaller; else the bias
    alone.

    Args:
        reference, moving: heights (rows, columns) on one grid, metres, NaN where unknown.
        cell: side of a cell, metres.
        stable: cells known, or found, to be stable; all without.
        plan: whether a shift in plan is asked for.

    Raises:
        TooFewCells: fewer than ``MIN_EQUATIONS`` common cells.
    """
    before = moving - reference
    used = np.isfinite(before) & (True if stable is None else stable)
    if int(used.sum()) < MIN_EQUATIONS:
        raise TooFewCells
    spread = nmad(before[used])
    alone = _with_bias(reference, moving, used, cell, spread)
    if not plan:
        return alone
    start, fit = np.zeros(2), None
    for factor in _levels(reference.shape):
        coarse = [_means(values, factor) for values in (reference, moving)]
        where = None if stable is None else _means(used.astype(np.float64), factor) > 0.5
        fit = _fitted(coarse[0], coarse[1], where, factor * cell, start)
        if fit is None:
            return replace(alone, why="the ground is too level for it")
        start = start + fit.parameters
    assert fit is not None
    covariance = _covariance(fit, reference.shape, cell)[0]
    error = np.sqrt(np.diag(covariance))
    known = replace(alone, found=(float(start[0]), float(start[1]), float(error[0]), float(error[1])))
    if error.max() > MAX_SHIFT_ERROR_CELLS * cell:
        return replace(known, why="the relief does not show it")
    if float(start @ np.linalg.solve(covariance, start)) < _MIN_T_SQUARED:
        return replace(known, why="it does not differ from none")
    after = moved(moving, np.array([*start, 0.0]), cell)
    level = _with_bias(reference, after, used & np.isfinite(after), cell, spread)
    if level.nmad_after >= spread:
        return replace(known, why="the models do not fit better with it")
    east, north = gradients(reference, cell)
    rise = np.array([-np.nanmean(np.where(used, part, np.nan)) for part in (east, north)])
    both = level.covariance.copy()
    # the bias is that of the ground in its middle: it takes up what an error of the shift lifts all of it by
    both[:2, :2], both[:2, 2], both[2, :2] = covariance, -covariance @ rise, -covariance @ rise
    both[2, 2] += rise @ covariance @ rise
    return replace(level, east=float(start[0]), north=float(start[1]), covariance=both, found=known.found, why="")


def _with_bias(reference: Float, moving: Float, used: Bool, cell: float, before: float) -> Coregistration:
    """The height of ``moving`` above ``reference`` alone; ``before`` is the scatter before any shift, metres."""
    dz = moving - reference
    place = np.flatnonzero(used)
    sigma = _scatter(dz, *gradients(reference, cell), used).ravel()[place]
    design = np.ones((place.size, 1))
    fit = _robust(place, design, dz.ravel()[place], sigma)
    own, correlation = _covariance(fit, reference.shape, cell)
    covariance = np.zeros((3, 3))
    covariance[2, 2] = own[0, 0]
    bias, after = float(fit.parameters[0]), nmad(dz[used])
    return Coregistration(
        0.0, 0.0, bias, covariance, None, "not asked for", before, after, int(place.size), correlation
    )


def moved(heights: Float, shift: Float, cell: float) -> Float:
    """A model with the shift (east, north, bias; metres) taken off, (rows, columns)."""
    if not shift[:2].any():
        return np.asarray(heights - shift[2])
    return shifted(heights, shift[0] / cell, -shift[1] / cell) - shift[2]


def _levels(shape: tuple[int, ...]) -> list[int]:
    factor = _COARSEST
    while factor > 1 and min(shape) // factor < _MIN_PYRAMID_CELLS:
        factor //= 2
    return [2**i for i in range(int(math.log2(factor)), -1, -1)]


def _means(values: Float, factor: int) -> Float:
    """Of blocks of ``factor`` by ``factor`` cells that are all known; incomplete ones at the edge are left out."""
    if factor == 1:
        return values
    rows, columns = (n // factor * factor for n in values.shape)
    blocks = values[:rows, :columns].reshape(rows // factor, factor, columns // factor, factor)
    return np.asarray(blocks.mean(axis=(1, 3)))


def _fitted(reference: Float, moving: Float, stable: Bool | None, cell: float, start: Float) -> _Fit | None:
    """Further shift (east, north) from ``start`` on, by Gauss and Newton; None where too few cells have a rise.

    Heights and rises are taken about their means around each cell: errors of a campaign are alike over hundreds of
    metres, and would pass for a shift where the ground as a whole leans to one side.
    """
    east, north = gradients(reference, cell)
    risen = np.isfinite(east) & np.isfinite(north) & (True if stable is None else stable)
    further, found = np.zeros(2), None
    for _ in range(_ROUNDS):
        dz = moved(moving, np.array([*(start + further), 0.0]), cell) - reference
        used = risen & np.isfinite(dz)
        place = np.flatnonzero(used)
        if place.size < MIN_EQUATIONS:
            return None
        sigma = _scatter(dz, east, north, used).ravel()[place]
        design = np.stack([-_about_near(part, used)[used] for part in (east, north)], axis=1)
        if _shared_rise(design, dz, used, cell) < _MIN_RISE_RATIO:
            return None
        limit = _TUKEY * nmad(dz[used])
        near = np.clip(dz, *(np.median(dz[used]) + limit * np.array([-1.0, 1.0])))
        values = (dz - near)[used] + _about_near(near, used)[used]
        found = _robust(place, design, values, sigma)
        further = further + found.parameters
        if float(np.hypot(*found.parameters)) < _CONVERGED_CELLS * cell:
            break
    return None if found is None else replace(found, parameters=further)


def _shared_rise(design: Float, dz: Float, used: Bool, cell: float) -> float:
    """Variance of the rise of the ground along the leveller direction over that of the error of a rise.

    Errors have rises of their own, which lie elsewhere in either model. The variance of the rises of one model holds
    the ground's and half of that of the rises of the difference.
    """
    noise = np.stack([part[used] for part in gradients(dz, cell)], axis=1)
    noise = noise[np.isfinite(noise).all(axis=1)]
    if len(noise) < MIN_EQUATIONS:
        return 0.0
    # robust: where the ground changed, the difference has large rises
    error = float(np.mean([nmad(part) ** 2 for part in noise.T])) / 2.0
    own = np.linalg.eigvalsh(design.T @ design / len(design))[0] - error
    return float(own / max(error, 1e-12))


def _about_near(values: Float, used: Bool) -> Float:
    """Less the mean of the used cells around each."""
    total = ndimage.uniform_filter(np.where(used, values, 0.0), _NEAR_CELLS, mode="constant")
    share = ndimage.uniform_filter(used.astype(np.float64), _NEAR_CELLS, mode="constant")
    return np.where(used, values - total / np.maximum(share, 1e-12), np.nan)


def _scatter(dz: Float, east: Float, north: Float, used: Bool) -> Float:
    """Of the difference on ground as steep, metres."""
    rise = np.hypot(east, north)
    errors = cell_errors(dz, {"rise": rise}, used)
    return np.maximum(errors.at([rise] if errors.names else [dz]), 1e-6)


def _robust(place: Index, design: Float, dz: Float, sigma: Float) -> _Fit:
    """Iterated weighted least squares."""
    root = 1.0 / sigma
    parameters: Float = np.asarray(np.linalg.lstsq(design * root[:, None], dz * root, rcond=None)[0], np.float64)
    if design.shape[1] == 1:
        parameters = np.array([np.median(dz)], dtype=np.float64)
    weight = root**2
    for _ in range(_MAX_ROUNDS_OF_WEIGHTS):
        residual = dz - design @ parameters
        scaled = residual * root
        limit = _TUKEY * max(robust_scale(scaled), 1e-9)
        weight = np.clip(1.0 - (scaled / limit) ** 2, 0.0, None) ** 2 * root**2
        weighted = design * weight[:, None]
        change = np.linalg.lstsq(weighted.T @ design, weighted.T @ residual, rcond=None)[0]
        parameters = parameters + change
        if np.abs(change).max() < _CONVERGED_M:
            break
    return _Fit(parameters, place, design, weight, dz - design @ parameters, sigma)


def _covariance(fit: _Fit, shape: tuple[int, ...], cell: float) -> tuple[Float, VariogramModel | None]:
    """Of the parameters, with errors that are alike in near cells; without a variogram with errors of one's own.

    The parameters are sums of weights times residuals, whose variances, and those of the sums of two of them, follow
    from the variogram of the residuals in units of each cell's scatter.
    """
    inverse = np.linalg.pinv((fit.design * fit.weight[:, None]).T @ fit.design)
    rows = inverse @ (fit.design * fit.weight[:, None]).T
    scaled = fit.residual / fit.sigma
    kept = fit.weight > 0
    correlation = None
    if int(kept.sum()) >= MIN_CELLS:
        values = np.full(shape, np.nan)
        values.ravel()[fit.place[kept]] = scaled[kept]
        empirical = empirical_variogram(values, cell)
        if len(empirical.lag) >= MIN_LAGS:
            correlation = fit_variogram(empirical)
    if correlation is None:
        spread = rows * (fit.residual * kept)
        return spread @ spread.T, None

    def variance(row: Float) -> float:
        weights = np.zeros(shape)
        weights.ravel()[fit.place] = row * fit.sigma
        return sum_variance(weights, cell, correlation)

    count = len(rows)
    covariance = np.zeros((count, count))
    for i in range(count):
        covariance[i, i] = variance(rows[i])
    for i in range(count):
        for j in range(i):
            both = variance(rows[i] + rows[j])
            covariance[i, j] = covariance[j, i] = (both - covariance[i, i] - covariance[j, j]) / 2.0
    return covariance, correlation
