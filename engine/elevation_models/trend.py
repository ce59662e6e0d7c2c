"""A tilt (plane) or bend (quadratic surface) between two elevation models, found on stable ground.

The differences are reduced to medians of square blocks. Errors of near blocks are alike, so a slow wave of errors may
look like a tilt. The order is therefore chosen by likelihood-ratio tests, in which the errors have a nugget and a
spherical covariance whose range and sill are fitted with each order (Mardia and Marshall 1984,
doi:10.1093/biomet/71.1.135). How large a ratio such errors reach without a trend is simulated (parametric bootstrap),
because the asymptotic distribution is too narrow if errors are alike over a large part of the map.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.spatial.distance import cdist

from ..core.arrays import Bool, Float
from ..statistics.robust import NORMALISED, nmad
from ..statistics.variogram import spherical
from .stable import stable_ground_of

TILT, BEND = 1, 2
"""Orders of a trend; 0 is none."""
_COLUMNS = (1, 3, 6)  # of the design, by order
_POWERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))  # of x and y, by column
_BLOCKS = 12  # along the longer side of the map
_MIN_BLOCK_CELLS = 25  # that are stable, of a block that counts
_MIN_BLOCKS = 4 * _COLUMNS[BEND]
_SUBSETS = 500  # of as many blocks as the design has columns; 58 of them hold no changed block if 30 % have changed
_KEPT_DEVIATIONS = 2.5  # from a robust fit, of blocks that count in it (Rousseeuw 1984)
_SIMULATED = 999
_LARGEST_P = 0.005  # of each of the two tests: both find what is not there in 1 of 100 pairs
_NUGGETS = (1.0, 0.8, 0.6, 0.4, 0.2, 0.1, 0.03)  # shares of the variance that are tried
_RANGES = 8


@dataclass(frozen=True)
class Trend:
    """What stable ground says of a tilt or bend of the later model against the earlier.

    Its mean over the stable blocks is 0, because a difference of height is the bias.

    Attributes:
        order: 0, ``TILT`` or ``BEND``: the lowest that the data support.
        p_values: of a tilt against none, and of a bend against a tilt; 1 where no test was possible.
        why: why none could be looked for; else empty.
        polynomial: (6,) metres, of the ``_POWERS`` of the coordinates; 0 beyond the order.
        covariance: (6, 6) of these, m².
        frame: column and row of the middle, and cells in a unit of the coordinates.
        area: (rows, columns), the cells that both models show.
    """

    order: int
    p_values: tuple[float, float]
    why: str
    polynomial: Float
    covariance: Float
    frame: tuple[float, float, float]
    area: Bool

    @cached_property
    def surface(self) -> Float:
        """Height of the later model above the earlier by the trend (rows, columns), metres."""
        return self._sum(_POWERS, self.polynomial)

    @cached_property
    def error(self) -> Float:
        """Standard error of ``surface`` (rows, columns), metres; it grows away from the stable ground."""
        powers = [(a[0] + b[0], a[1] + b[1]) for a, b in product(_POWERS, repeat=2)]
        return np.sqrt(np.maximum(self._sum(powers, self.covariance.ravel()), 0.0))

    @property
    def tilt(self) -> tuple[float, float]:
        """Largest difference over the map of the plane next to the trend, and its standard error, metres."""
        return self._largest(self._parts[1])

    @property
    def bend(self) -> tuple[float, float]:
        """Largest difference over the map of what the trend is beside that plane, and its standard error, metres."""
        raw, plane = self._parts
        return self._largest(raw - plane) if self.order == BEND else (0.0, 0.0)

    @property
    def _parts(self) -> tuple[Float, Float]:
        """What the polynomial is multiplied by to give the trend, and the plane next to it, in some 10,000 cells."""
        rows, columns = np.nonzero(self.area)
        every = slice(None, None, max(1, len(rows) // 10_000))
        raw = _design(columns[every].astype(np.float64), rows[every].astype(np.float64), self.frame)
        return raw, raw[:, :3] @ np.linalg.lstsq(raw[:, :3], raw, rcond=None)[0]

    def _largest(self, part: Float) -> tuple[float, float]:
        values = part @ self.polynomial
        row = part[int(np.argmax(values))] - part[int(np.argmin(values))]
        return float(row @ self.polynomial), float(np.sqrt(max(row @ self.covariance @ row, 0.0)))

    def _sum(self, powers: Sequence[tuple[int, int]], factors: Float) -> Float:
        column, row, unit = self.frame
        x, y = ((np.arange(n) - middle) / unit for n, middle in zip(self.area.shape[::-1], (column, row), strict=True))
        total = np.zeros(self.area.shape)
        for (a, b), factor in zip(powers, factors.tolist(), strict=True):
            if factor:
                total += factor * np.outer(y**b, x**a)
        return total


def find_trend(dz: Float, error: Float, slope: Float, given: Bool | None = None) -> Trend:
    """The tilt or bend in a difference whose bias and shift in plan are taken off.

    Each order is first fitted to the blocks so that changes on less than half of them do not pull it; ground that
    stands out from this surface is left out (``stable.stable_cells``). So a tilt hides no change, and a change makes no
    tilt unless it has its shape.

    Args:
        dz: (rows, columns) metres, NaN where unknown.
        error: standard error by the terrain, metres, up to a factor.
        slope: of the ground, degrees.
        given: cells known to be stable.
    """
    known = np.isfinite(dz) & np.isfinite(error) & (error > 0)
    frame = (dz.shape[1] / 2.0, dz.shape[0] / 2.0, max(dz.shape) / 2.0)
    found = Trend(0, (1.0, 1.0), "", np.zeros(len(_POWERS)), np.zeros((len(_POWERS),) * 2), frame, known)
    stable = known if given is None else known & given
    for order in (TILT, BEND):
        blocks = _blocks(dz, stable)
        if given is None and not _too_little(blocks):
            left = dz - replace(found, polynomial=_robust(blocks, frame, order)).surface
            stable = stable_ground_of(left, error * nmad((left / error)[stable]), slope, None)
            blocks = _blocks(dz, stable)
        if why := _too_little(blocks):
            return replace(found, why="" if found.order else why)
        fit = _Likelihood(blocks, frame)
        p_value = fit.p_value(order)
        p_values = (p_value, 1.0) if order == TILT else (found.p_values[0], p_value)
        found = replace(found, p_values=p_values)
        if p_value <= _LARGEST_P:
            polynomial, covariance = fit.estimated(order)
            found = replace(found, order=order, polynomial=polynomial, covariance=covariance)
    return found


@dataclass(frozen=True)
class _Blocks:
    """Of n blocks: column and row of the middle of their stable cells, the median difference, m, and their cells.

    ``side`` is that of a block, in cells.
    """

    column: Float
    row: Float
    median: Float
    cells: Float
    side: int


def _blocks(dz: Float, stable: Bool) -> _Blocks:
    side = max(-(-max(dz.shape) // _BLOCKS), 1)
    found = []
    for top, left in product(range(0, dz.shape[0], side), range(0, dz.shape[1], side)):
        rows, columns = np.nonzero(stable[top : top + side, left : left + side])
        if len(rows) >= _MIN_BLOCK_CELLS:
            median = np.median(dz[top + rows, left + columns])
            found.append((left + columns.mean(), top + rows.mean(), median, len(rows)))
    column, row, medians, cells = np.array(found, dtype=np.float64).reshape(-1, 4).T
    return _Blocks(column, row, medians, cells, side)


def _too_little(blocks: _Blocks) -> str:
    """Why these blocks show no trend; else empty."""
    if len(blocks.median) < _MIN_BLOCKS:
        return "too little stable ground"
    places = np.stack([blocks.column, blocks.row], axis=1)
    narrow = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)[-1] / np.sqrt(len(places))
    return "the stable ground lies in one line" if narrow < blocks.side else ""


def _design(column: Float, row: Float, frame: tuple[float, float, float]) -> Float:
    """(n, 6) powers of the coordinates."""
    x, y = (column - frame[0]) / frame[2], (row - frame[1]) / frame[2]
    return np.stack([x**a * y**b for a, b in _POWERS], axis=1)


def _robust(blocks: _Blocks, frame: tuple[float, float, float], order: int) -> Float:
    """(6,) polynomial that most of the blocks lie near, of those through some of them; then least squares of these.

    How near follows from the least median of absolute residuals (Yohai 1987, doi:10.1214/aos/1176350366).
    """
    count = _COLUMNS[order]
    design = _design(blocks.column, blocks.row, frame)[:, :count]
    rng = np.random.default_rng(0)
    chosen = np.argsort(rng.random((_SUBSETS, len(design))), axis=1)[:, :count]
    tried = np.einsum("sij,sj->si", np.linalg.pinv(design[chosen]), blocks.median[chosen])
    residual = np.abs(blocks.median - tried @ design.T)
    near = max(_KEPT_DEVIATIONS * NORMALISED * float(np.median(residual, axis=1).min()), 1e-9)
    kept = residual[int(np.argmin(np.sum(np.minimum(residual / near, 1.0) ** 2, axis=1)))] <= near
    found = np.zeros(len(_POWERS))
    found[:count] = np.linalg.lstsq(design[kept], blocks.median[kept], rcond=None)[0]
    return found


@dataclass(frozen=True)
class _Fit:
    """Log of the restricted likelihood, coefficients (p,) of the basis and their covariance (p, p)."""

    score: float
    coefficients: Float
    covariance: Float


class _Likelihood:
    """Of trends of each order, with errors of blocks that have a nugget and a spherical covariance."""

    def __init__(self, blocks: _Blocks, frame: tuple[float, float, float]) -> None:
        raw = _design(blocks.column, blocks.row, frame)
        # columns that are square to each other over the blocks: the first is their mean
        self._basis, self._to_raw = np.linalg.qr(raw)
        self._values = blocks.median
        places = np.stack([blocks.column, blocks.row], axis=1)
        distance = cdist(places, places)
        own = np.diag(blocks.cells.mean() / blocks.cells)
        ranges = np.geomspace(1.5 * blocks.side, 2.0 * distance.max(), _RANGES)
        self._roots, self._designs, self._determinants = [], [], []
        for share, reach in product(_NUGGETS, ranges):
            if share == 1.0 and reach > ranges[0]:
                continue  # the range means nothing
            root = cholesky(share * own + (1.0 - share) * spherical(distance, reach), lower=True)
            self._roots.append(root)
            self._designs.append(np.linalg.qr(solve_triangular(root, self._basis, lower=True)))
            self._determinants.append(2.0 * float(np.log(np.diag(root)).sum()))

    def p_value(self, order: int) -> float:
        """Share of simulations of the next lower order whose likelihood ratio is as large as that of the blocks.

        Each simulation has errors of one of the models, as often as its restricted likelihood says, with the trend that
        is asked about fitted: else a tilt passes for errors that are alike over more than the map.
        """
        rng = np.random.default_rng(order)
        scores = np.array([fit.score for fit in self._restricted(order)])
        weights = np.exp(scores - scores.max())
        simulated = rng.standard_normal((len(self._values), _SIMULATED))
        number = rng.choice(len(weights), _SIMULATED, p=weights / weights.sum())
        for one in np.unique(number):
            simulated[:, number == one] = self._roots[one] @ simulated[:, number == one]
        larger = int((self._ratios(simulated, order) >= self._ratios(self._values[:, None], order)).sum())
        return (1 + larger) / (1 + _SIMULATED)

    def _ratios(self, values: Float, order: int) -> Float:
        """Log likelihood gained by ``order`` against the next lower one, of each column of ``values`` (n, m)."""
        found = np.full((2, values.shape[1]), -np.inf)
        for root, (design, _), determinant in zip(self._roots, self._designs, self._determinants, strict=True):
            white = solve_triangular(root, values, lower=True)
            fitted = (design.T @ white) ** 2
            total = np.sum(white**2, axis=0)
            for part, count in zip(found, (_COLUMNS[order - 1], _COLUMNS[order]), strict=True):
                mean_square = np.maximum(total - fitted[:count].sum(axis=0), 1e-300) / len(values)
                np.maximum(part, -0.5 * (len(values) * np.log(mean_square) + determinant), out=part)
        return np.asarray(found[1] - found[0])

    def _restricted(self, order: int) -> list[_Fit]:
        """The fit with each model of the errors."""
        count = _COLUMNS[order]
        free = len(self._values) - count
        fits = []
        for root, (design, upper), determinant in zip(self._roots, self._designs, self._determinants, strict=True):
            white = solve_triangular(root, self._values, lower=True)
            fitted = design[:, :count].T @ white
            variance = max(float(white @ white - fitted @ fitted), 1e-300) / free
            inverse = np.linalg.inv(upper[:count, :count])
            score = 0.5 * (2.0 * np.log(np.abs(np.diag(inverse))).sum() - free * np.log(variance) - determinant)
            fits.append(_Fit(float(score), inverse @ fitted, variance * inverse @ inverse.T))
        return fits

    def estimated(self, order: int) -> tuple[Float, Float]:
        """Polynomial without its mean over the blocks, (6,), and its covariance, (6, 6).

        Both are means over the models of the errors, weighted by their restricted likelihood; so the covariance holds
        what is not known of the errors.
        """
        fits = self._restricted(order)
        scores = np.array([fit.score for fit in fits])
        weights = np.exp(scores - scores.max())
        weights /= weights.sum()
        each = np.array([fit.coefficients for fit in fits])
        mean = weights @ each
        within = np.einsum("k,kij->ij", weights, [fit.covariance for fit in fits])
        covariance = within + np.einsum("k,ki,kj->ij", weights, each - mean, each - mean)
        back = np.linalg.inv(self._to_raw)[:, 1 : len(mean)]
        return back @ mean[1:], back @ covariance[1:, 1:] @ back.T
