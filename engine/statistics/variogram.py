"""Spatial correlation of errors: empirical variogram, fitted model, variance of a sum over any set of cells.

Errors of neighbouring cells are alike, so the error of a mean or a volume falls more slowly than with the root of the
number of cells (Rolstad et al. 2009, doi:10.3189/002214309789470950; Hugonnet et al. 2022,
doi:10.1109/JSTARS.2022.3188922). The values are changes over their own standard errors, so that the model's variance is
about 1 and has no unit; distances are metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.optimize import nnls

from ..core.arrays import Float
from .robust import nmad

MIN_CELLS = 500
"""With fewer values no variogram is estimated."""
MIN_LAGS = 3
"""With fewer classes of distance that hold pairs no model is fitted: a nugget and a structure have three numbers."""
_MAX_LATTICE_CELLS = 1 << 20  # cells; larger grids are thinned for the longer lags
_MAX_NEAR_LAG_CELLS = 6  # cells: lags below are measured on the grid as it is
_MAX_SIDE_CELLS = 128  # cells a side, beyond which sums are taken over blocks of cells
_MAX_DEVIATIONS = 5.0  # robust standard deviations


@dataclass(frozen=True)
class EmpiricalVariogram:
    """Semivariance in classes of distance.

    Only classes that hold pairs are in it: values that lie far apart, as those of grown cells do, leave short lags
    empty. There may be none.

    Attributes:
        lag: (n,) mean distance of the pairs of a class, m.
        semivariance: (n,) half the mean squared difference.
        pairs: (n,) pairs of cells in a class.
        variance: of the values themselves.
        cells: number of values.
    """

    lag: Float
    semivariance: Float
    pairs: Float
    variance: float
    cells: int


@dataclass(frozen=True)
class VariogramModel:
    """A nugget and nested spherical structures.

    ``nugget`` is what a cell has for itself, ``sills`` the variances of the structures and ``ranges`` the distances, m,
    at which their correlation ends.
    """

    nugget: float
    sills: tuple[float, ...] = ()
    ranges: tuple[float, ...] = ()

    @property
    def variance(self) -> float:
        return self.nugget + sum(self.sills)

    def structured(self, distance: Float) -> Float:
        """Covariance of two different cells at ``distance`` (any shape), m."""
        total = np.zeros(np.shape(distance))
        for sill, reach in zip(self.sills, self.ranges, strict=True):
            total += sill * spherical(distance, reach)
        return total

    def semivariance(self, distance: Float) -> Float:
        """Variogram at ``distance`` > 0."""
        return self.variance - self.structured(distance)

    def figures(self) -> dict[str, object]:
        return {"nugget": self.nugget, "sills": list(self.sills), "ranges_m": list(self.ranges)}


def spherical(distance: Float, reach: float) -> Float:
    """Correlation of the spherical model: 1 at distance 0, 0 from ``reach`` on."""
    share = np.minimum(np.asarray(distance) / reach, 1.0)
    return 1.0 - 1.5 * share + 0.5 * share**3


def empirical_variogram(values: Float, cell: float) -> EmpiricalVariogram:
    """Matheron's estimator over all pairs of cells, up to half of the grid's shorter side.

    All pairs at once by Fourier transform (Marcotte 1996, doi:10.1016/S0098-3004(96)00026-X). Long lags leave out the
    grid's middle, and where the values by chance scatter more at the edge, that would pass for correlation. So each
    class is stated relative to the mean square of its own pairs, as in the non-ergodic correlogram (Srivastava and
    Parker 1989). Values beyond five robust standard deviations are drawn in to these. From grids of more than a million
    cells every k-th row and column serve for the lags from six cells on.

    Args:
        values: (rows, columns), NaN where there is none (or where the surface is not stable).

    Raises:
        ValueError: fewer than ``MIN_CELLS`` values.
    """
    known = np.isfinite(values)
    cells = int(known.sum())
    if cells < MIN_CELLS:
        raise ValueError(f"{cells} values are too few for a variogram")
    values, known = _bounding_box(values, known)
    drawn_in = values[known]
    middle = float(np.median(drawn_in))
    spread = nmad(drawn_in, middle)
    limit = _MAX_DEVIATIONS * spread if spread > 0 else np.inf
    drawn_in = np.clip(drawn_in - middle, -limit, limit)
    z = np.zeros(known.shape)
    z[known] = drawn_in - drawn_in.mean()
    step = max(1, int(np.ceil(np.sqrt(z.size / _MAX_LATTICE_CELLS))))
    largest = max(min(z.shape) / 2.0, 2.0)
    thinned = _thinned(known, step)
    parts = [_pairs_by_fourier(z[thinned], known[thinned], largest / step, step)]
    if step > 1:
        parts = [parts[0][:, parts[0][0] > _MAX_NEAR_LAG_CELLS], _near_pairs(z, known)]
    distance, squares, products, pairs = np.concatenate(parts, axis=1)
    which = np.digitize(distance, _class_edges(float(distance.max(initial=0.0))))
    # where cells grew, near ones have no pairs
    filled = np.flatnonzero(np.bincount(which, pairs) > 0)
    count, apart, square, product = (
        np.bincount(which, part)[filled].astype(np.float64) for part in (pairs, distance * pairs, squares, products)
    )
    variance = float(z[known].var())
    return EmpiricalVariogram(
        lag=apart / count * cell,
        semivariance=variance * (1.0 - product / np.where(square > 0, square, 1.0)),
        pairs=count,
        variance=variance,
        cells=cells,
    )


def fit_variogram(empirical: EmpiricalVariogram) -> VariogramModel:
    """The nugget and at most two spherical structures that fit best.

    Least squares with the weights of Cressie (1985, doi:10.1007/BF01032109): pairs over the squared semivariance. The
    parts are not negative; ranges are tried in steps of a quarter octave, every pair of them, so that there is no local
    minimum to be caught in.

    Raises:
        ValueError: fewer than ``MIN_LAGS`` classes of distance.
    """
    if len(empirical.lag) < MIN_LAGS:
        raise ValueError(f"{len(empirical.lag)} classes of distance are too few for a model of the variogram")
    weight = np.sqrt(empirical.pairs) / np.maximum(empirical.semivariance, 1e-12 + 1e-3 * empirical.variance)
    target = empirical.semivariance * weight
    first, last = float(empirical.lag[0]), float(empirical.lag[-1])
    ranges = np.geomspace(1.5 * first, max(last, 3.0 * first), max(2, 1 + round(4 * np.log2(max(last / first, 2.0)))))
    shapes = [(1.0 - spherical(empirical.lag, reach)) * weight for reach in ranges]
    best: tuple[float, Float, tuple[float, ...]] | None = None
    for a, b in combinations(range(len(ranges)), 2):
        parts, residual = nnls(np.stack([weight, shapes[a], shapes[b]], axis=1), target)
        if best is None or residual < best[0] * (1 - 1e-9):
            best = float(residual), parts, (float(ranges[a]), float(ranges[b]))
    assert best is not None
    _, parts, chosen = best
    kept = [(float(s), r) for s, r in zip(parts[1:], chosen, strict=True) if s > 0]
    return VariogramModel(float(parts[0]), tuple(s for s, _ in kept), tuple(r for _, r in kept))


def sum_variance(weights: Float, cell: float, model: VariogramModel) -> float:
    """Variance of the sum of ``weights`` times values that follow ``model``: the double sum over all pairs of cells.

    Exact up to 128 by 128 cells. Larger grids are summed over square blocks of cells, between which the mean
    covariance counts; the nugget stays with the cells.

    Args:
        weights: (rows, columns), 0 outside; with standard errors in metres the result is in m².
    """
    variance = model.nugget * float(np.sum(weights * weights))
    if not model.sills or not weights.any():
        return variance
    weights, _ = _bounding_box(weights, weights != 0)
    block = -(-max(weights.shape) // _MAX_SIDE_CELLS)
    if block > 1:
        squares = float(np.sum(weights * weights))
        rows, columns = (np.arange(0, n, block) for n in weights.shape)
        weights = np.add.reduceat(np.add.reduceat(weights, rows, axis=0), columns, axis=1)
        # with uneven weights a cell counts more with itself than the mean over its block states
        own, others = model.variance - model.nugget, _mean_in_block(block, cell, model)
        variance += (squares - float(np.sum(weights * weights)) / block**2) * (own - others)
    shape = tuple(fft.next_fast_len(2 * n - 1, real=True) for n in weights.shape)
    power = np.abs(fft.rfft2(weights, shape)) ** 2
    spectrum = _covariance_spectrum(shape, cell, block, model)
    # Parseval: the columns between the first and the middle one stand for their mirror images too
    twice = np.full(power.shape[1], 2.0)
    twice[0] = 1.0
    if shape[1] % 2 == 0:
        twice[-1] = 1.0
    return variance + float(np.sum(power * spectrum * twice)) / (shape[0] * shape[1])


def effective_samples(weights: Float, cell: float, model: VariogramModel) -> float:
    """How many independent cells have a sum as uncertain as these (``weights`` as in ``sum_variance``).

    That is (sum w)² variance / variance of the sum: n for independent cells, 1 for fully correlated ones (Hugonnet et
    al. 2022, eq. 18, with errors that differ from cell to cell).
    """
    variance = sum_variance(weights, cell, model)
    return float(np.sum(weights)) ** 2 * model.variance / variance if variance > 0 else float(np.count_nonzero(weights))


def _bounding_box(values: Float, inside: NDArray[np.bool_]) -> tuple[Float, NDArray[np.bool_]]:
    rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    return values[box], inside[box]


def _thinned(known: NDArray[np.bool_], step: int) -> tuple[slice, slice]:
    """Every ``step``-th row and column from the first, or from where more than twice as many values lie.

    The values of grown cells lie at multiples of their size; a thinning out of step with these would miss them all.
    """
    offsets = [(slice(i, None, step), slice(j, None, step)) for i in range(step) for j in range(step)]
    counts = [int(np.count_nonzero(known[offset])) for offset in offsets]
    best = int(np.argmax(counts))
    return offsets[best] if counts[best] > 2 * counts[0] else offsets[0]


def _pairs_by_fourier(z: Float, known: NDArray[np.bool_], largest: float, step: int) -> Float:
    """Of each lag of half of the plane: distance in cells, and over its pairs the sums of (a² + b²) / 2, a b and 1."""
    shape = tuple(fft.next_fast_len(2 * n - 1, real=True) for n in z.shape)
    ones, first, second = (fft.rfft2(part, shape) for part in (known.astype(np.float64), z, z * z))
    squares = fft.irfft2((np.conj(ones) * second).real, shape)
    products = fft.irfft2(np.abs(first) ** 2, shape)
    pairs = np.rint(fft.irfft2(np.abs(ones) ** 2, shape))
    reach = int(largest)
    rows = np.fft.fftfreq(shape[0], 1.0 / shape[0])
    near = np.flatnonzero(np.abs(rows) <= reach)
    columns = np.arange(min(reach, shape[1] // 2) + 1, dtype=float)
    distance = np.hypot(rows[near][:, None], columns)
    found = [part[near][:, : len(columns)] for part in (squares, products, pairs)]
    # each pair once: the right half of the plane
    half = (distance > 0) & (distance <= largest) & ((columns > 0) | (rows[near][:, None] > 0)) & (found[2] > 0.5)
    return np.stack([distance[half] * step, *(part[half] for part in found)])


def _near_pairs(z: Float, known: NDArray[np.bool_]) -> Float:
    """As ``_pairs_by_fourier`` for the lags up to ``_MAX_NEAR_LAG_CELLS`` cells, by shifting the grid."""
    found = []
    for row in range(-_MAX_NEAR_LAG_CELLS, _MAX_NEAR_LAG_CELLS + 1):
        for column in range(_MAX_NEAR_LAG_CELLS + 1):
            distance = float(np.hypot(row, column))
            if distance > _MAX_NEAR_LAG_CELLS or (column == 0 and row <= 0):
                continue
            a = slice(max(row, 0), z.shape[0] + min(row, 0)), slice(column, None)
            b = slice(max(-row, 0), z.shape[0] + min(-row, 0)), slice(None, z.shape[1] - column)
            both = known[a] & known[b]
            if not both.any():
                continue
            one, other = z[a][both], z[b][both]
            squares = float(one @ one + other @ other) / 2.0
            found.append((distance, squares, float(one @ other), float(both.sum())))
    return np.array(found).reshape(-1, 4).T


def _class_edges(largest: float) -> Float:
    """Edges of the classes in cells: the first lags alone, then in steps of about half an octave."""
    edges = [1.2, 1.7, 2.5]
    while edges[-1] < largest:
        edges.append(edges[-1] * 1.4)
    return np.array(edges)


def _mean_in_block(block: int, cell: float, model: VariogramModel) -> float:
    """Mean structured covariance of two different cells of one block."""
    offsets = np.arange(1 - block, block)
    pairs = (block - np.abs(offsets))[:, None] * (block - np.abs(offsets))
    covariance = model.structured(np.hypot(offsets[:, None], offsets) * cell)
    alone = float(block**2)
    return (float(np.sum(pairs * covariance)) - alone * (model.variance - model.nugget)) / (alone * (alone - 1.0))


@lru_cache(maxsize=64)
def _covariance_spectrum(shape: tuple[int, int], cell: float, block: int, model: VariogramModel) -> Float:
    """Transform of the structured covariance between blocks of ``block`` by ``block`` cells, as of all lags."""
    lags = [np.abs(np.fft.fftfreq(n, 1.0 / n)) for n in shape]
    covariance = model.structured(np.hypot(lags[0][:, None], lags[1]) * (block * cell))
    if block > 1:
        # blocks near each other: the mean over their cells, not the covariance of their middles
        offsets = np.arange(1 - block, block)
        triangle = (block - np.abs(offsets)) / block**2
        near = [np.flatnonzero(lag <= 3) for lag in lags]
        for i in near[0]:
            for j in near[1]:
                di, dj = lags[0][i] * block + offsets[:, None], lags[1][j] * block + offsets
                mean = model.structured(np.hypot(di, dj) * cell) * triangle[:, None] * triangle
                covariance[i, j] = float(mean.sum())
    spectrum: Float = fft.rfft2(covariance).real
    return spectrum
