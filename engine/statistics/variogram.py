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

from ..core.arrays import Float, Index
from .layout import Layout, layout_of
from .robust import nmad

MIN_CELLS = 500
"""With fewer values no variogram is estimated."""
MIN_LAGS = 3
"""With fewer classes of distance that hold pairs no model is fitted: a nugget and a structure have three numbers."""
_MAX_LATTICE_CELLS = 1 << 20  # cells; larger grids are thinned for the longer lags
_MAX_NEAR_LAG_CELLS = 6  # cells: lags below are measured on the grid as it is
_MAX_SIDE_CELLS = 128  # cells a side, beyond which sums are taken over blocks of cells
_BAND_ROWS = 128  # rows of a grid in which near pairs are looked for at a time
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


def empirical_variogram(values: Float, cell: float, layout: Layout | None = None) -> EmpiricalVariogram:
    """Matheron's estimator over all pairs of cells, up to half of the grid's shorter side.

    All pairs at once by Fourier transform (Marcotte 1996, doi:10.1016/S0098-3004(96)00026-X). Long lags leave out the
    grid's middle, and where the values by chance scatter more at the edge, that would pass for correlation. So each
    class is stated relative to the mean square of its own pairs, as in the non-ergodic correlogram (Srivastava and
    Parker 1989). Values beyond five robust standard deviations are drawn in to these. From grids of more than a million
    cells every k-th row and column serve for the lags from six cells on.

    Args:
        values: NaN where there is none (or where the surface is not stable).
        layout: of the values; all cells (rows, columns) by default.

    Raises:
        ValueError: fewer than ``MIN_CELLS`` values.
    """
    known = np.isfinite(values)
    cells = int(known.sum())
    if cells < MIN_CELLS:
        raise ValueError(f"{cells} values are too few for a variogram")
    drawn_in = values[known]
    middle = float(np.median(drawn_in))
    spread = nmad(drawn_in, middle)
    limit = _MAX_DEVIATIONS * spread if spread > 0 else np.inf
    drawn_in = np.clip(drawn_in - middle, -limit, limit)
    z = drawn_in - drawn_in.mean()
    row, column, shape = _boxed(np.flatnonzero(known), layout or layout_of(values))
    step = max(1, int(np.ceil(np.sqrt(shape[0] * shape[1] / _MAX_LATTICE_CELLS))))
    largest = max(min(shape) / 2.0, 2.0)
    parts = [_pairs_by_fourier(*_thinned(z, row, column, shape, step), largest / step, step)]
    if step > 1:
        parts = [parts[0][:, parts[0][0] > _MAX_NEAR_LAG_CELLS], _near_pairs(z, row, column)]
    distance, squares, products, pairs = np.concatenate(parts, axis=1)
    which = np.digitize(distance, _class_edges(float(distance.max(initial=0.0))))
    # where cells grew, near ones have no pairs
    filled = np.flatnonzero(np.bincount(which, pairs) > 0)
    count, apart, square, product = (
        np.bincount(which, part)[filled].astype(np.float64) for part in (pairs, distance * pairs, squares, products)
    )
    variance = float(z.var())
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


def sum_variance(weights: Float, cell: float, model: VariogramModel, layout: Layout | None = None) -> float:
    """Variance of the sum of ``weights`` times values that follow ``model``: the double sum over all pairs of cells.

    Exact up to 128 by 128 cells. Larger grids are summed over square blocks of cells, between which the mean
    covariance counts; the nugget stays with the cells.

    Args:
        weights: 0 outside; with standard errors in metres the result is in m².
        layout: of the weights; all cells (rows, columns) by default.
    """
    variance = model.nugget * float(np.sum(weights * weights))
    if not model.sills or not weights.any():
        return variance
    squares = float(np.sum(weights * weights))
    weights, block = _in_blocks(weights, layout or layout_of(weights))
    if block > 1:
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


def effective_samples(weights: Float, cell: float, model: VariogramModel, layout: Layout | None = None) -> float:
    """How many independent cells have a sum as uncertain as these (``weights`` as in ``sum_variance``).

    That is (sum w)² variance / variance of the sum: n for independent cells, 1 for fully correlated ones (Hugonnet et
    al. 2022, eq. 18, with errors that differ from cell to cell).
    """
    variance = sum_variance(weights, cell, model, layout)
    return float(np.sum(weights)) ** 2 * model.variance / variance if variance > 0 else float(np.count_nonzero(weights))


def _boxed(place: Index, layout: Layout) -> tuple[Index, Index, tuple[int, int]]:
    """Row and column (n,) of the values at ``place`` (n,) within their bounding box, and its shape."""
    row, column = layout.row_and_column(place)
    row, column = row - row.min(), column - column.min()
    return row, column, (int(row.max()) + 1, int(column.max()) + 1)


def _in_blocks(weights: Float, layout: Layout) -> tuple[Float, int]:
    """The weights in their bounding box, summed over square blocks where that is larger, and the blocks' side.

    Block by block, so that no array of the whole box is made.
    """
    place = np.flatnonzero(weights)
    values = weights.ravel()[place]
    row, column, shape = _boxed(place, layout)
    block = -(-max(shape) // _MAX_SIDE_CELLS)
    lines = []
    for top in range(0, shape[0], block):
        here = slice(*np.searchsorted(row, (top, top + block)).tolist())
        part = np.zeros((min(block, shape[0] - top), shape[1]))
        part[row[here] - top, column[here]] = values[here]
        lines.append(np.add.reduceat(part.sum(axis=0), np.arange(0, shape[1], block)))
    return np.stack(lines), block


def _thinned(z: Float, row: Index, column: Index, shape: tuple[int, int], step: int) -> tuple[Float, NDArray[np.bool_]]:
    """Every ``step``-th row and column from the first, or from where more than twice as many values lie: the values, 0
    where there is none, and where there is one.

    The values of grown cells lie at multiples of their size; a thinning out of step with these would miss them all.
    """
    offset = row % step * step + column % step
    counts = np.bincount(offset, minlength=step**2)
    best = int(np.argmax(counts))
    best = best if counts[best] > 2 * counts[0] else 0
    here = np.flatnonzero(offset == best)
    i, j = divmod(best, step)
    lattice = -(-(shape[0] - i) // step), -(-(shape[1] - j) // step)
    thinned, known = np.zeros(lattice), np.zeros(lattice, dtype=bool)
    place = row[here] // step, column[here] // step
    thinned[place], known[place] = z[here], True
    return thinned, known


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


def _near_pairs(z: Float, row: Index, column: Index) -> Float:
    """As ``_pairs_by_fourier`` for the lags up to ``_MAX_NEAR_LAG_CELLS`` cells, by shifting bands of the grid.

    Args:
        z: (n,) values, in the order of the grid; ``row`` and ``column`` are where they lie.
    """
    reach = _MAX_NEAR_LAG_CELLS
    steps = [(i, j) for i in range(-reach, reach + 1) for j in range(reach + 1) if np.hypot(i, j) <= reach]
    steps = [(i, j) for i, j in steps if j > 0 or i > 0]
    sums = np.zeros((len(steps), 3))
    for top in range(0, int(row[-1]) + 1, _BAND_ROWS):
        # with so many rows more as a lag reaches down; the upper cell of a pair is in the band
        here = slice(*np.searchsorted(row, (top, top + _BAND_ROWS + reach)).tolist())
        if here.start == here.stop:
            continue
        i, j = row[here] - top, column[here] - int(column[here].min())
        values, known = np.zeros((2, _BAND_ROWS + reach, int(j.max()) + 1))
        values[i, j], known[i, j] = z[here], 1.0
        square = values * values
        for number, (down, right) in enumerate(steps):
            width = values.shape[1] - right
            if width <= 0:
                continue
            upper, lower = slice(0, _BAND_ROWS), slice(abs(down), abs(down) + _BAND_ROWS)
            a = lower if down >= 0 else upper, slice(right, None)
            b = upper if down >= 0 else lower, slice(0, width)
            sums[number] += (
                (np.sum(square[a] * known[b]) + np.sum(square[b] * known[a])) / 2.0,
                np.sum(values[a] * values[b]),
                np.sum(known[a] * known[b]),
            )
    found = [(float(np.hypot(*step)), *of) for step, of in zip(steps, sums.tolist(), strict=True) if of[2] > 0]
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
