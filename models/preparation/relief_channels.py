"""What the network for rasters reads: relief at several scales in units of its own local roughness.

The ground is averaged on cells of 0.5 m (``bump_filter.cell_heights``). About each cell planes are fitted under
Gaussians of several reaches (normalised convolution, Knutsson and Westin 1993, doi:10.1109/CVPR.1993.341081): heights
between two of these surfaces are relief of one scale. Each is divided by its own scatter in the surroundings, so that a
hazard counts by how far it stands out of its place; the scatters themselves, density and the points' scatter within
cells are channels of their own. Trends that reach far along the slope and little up it, and the other way round, show
what is longer than a hazard. Everything is linear in the heights apart from these units: a slope upside down has
the same channels with the signs of ``SIGNED`` changed, and a tilt or a shift changes nothing.

Training and inference call the same function; wide surfaces are fitted on coarser lattices, so that a raster of 112
cells a side takes some 25 ms.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter

from ...engine.core.arrays import Bool, Float, Float32, Index
from .bump_filter import CellHeights
from .linear_bumps import linear_scores
from .relief_raster import MAX_GAP_M
from .trends import local_planes

SMOOTH_REACH_M = 0.6
"""Standard deviation of the Gaussian of the surface that fills small gaps."""
TREND_REACHES_M = (1.5, 3.0, 6.0, 12.0)
"""Of the surfaces that relief is measured over; each is fitted on cells of a third of its reach."""
SCATTER_REACHES_M = (4.0, 6.0, 8.0, 12.0, 20.0)
"""Reach within which the scatter of the points' own relief and of that over each of the trends is measured."""
BUMPS = {2.0: 1, 3.0: 1, 5.0: 2, 8.0: 3}
"""Diameters (m) of bumps that are fitted, and cells along a side of the squares on which they are."""
BANDS_M = ((10.0, 0.35), (0.35, 10.0))
"""Reaches along x and y of trends that follow what runs along the slope (benches, berms) and down it (drains,
gullies)."""
BAND_SCATTER_REACH_M = 8.0
"""Reach within which the scatter of relief over these is measured: benches would hide all else in that of others."""
OFF_BENCHES_M = (3.0, 5.0)
"""Diameters of the bumps that are also fitted to heights over the first of them."""
SIGNED = (
    "points",
    *(f"relief {reach:g} m" for reach in TREND_REACHES_M),
    *(f"bump {diameter:g} m" for diameter in BUMPS),
    *(f"relief {along:g} x {up:g} m" for along, up in BANDS_M),
    *(f"bump {diameter:g} m off benches" for diameter in OFF_BENCHES_M),
)
"""Channels that change their sign with the heights: over the smooth surface, of it over each trend, scores of bumps,
which grow as the logarithm beyond ``_LINEAR_SCORE``, of the smooth surface over trends along and down the slope, and
scores of bumps over the trend along it."""
CHANNELS = (
    *SIGNED,
    "log scatter 3 m",
    *(f"log scatter of {name} over it" for name in ("points", "1.5 m", "6 m", "12 m")),
    *(f"log scatter of {along:g} x {up:g} m over it" for along, up in BANDS_M),
    "log density",
    "log scatter in cells",
    "points in cell",
)
UNIT = 2
"""Number of the signed channel whose scatter the others are compared with."""
_MAX_DEVIATION = 8.0
_LINEAR_SCORE = 2.0
_MIN_SCATTER_M = 0.004
_USUAL_SCATTER_M = 0.08
_USUAL_DENSITY = 10.0
_MAX_DENSITY = 60.0
"""Ground denser than this is no surer: relief inside cells remains."""
_DENSITY_REACH_M = 1.0
_WINSOR = 2.5
"""Values beyond so many scatters are drawn in to them when scatter is measured."""
_FULL_WEIGHT_POINTS = 4.0


@dataclass(frozen=True)
class Relief:
    """``channels`` (len(CHANNELS), columns, rows), 0 where not ``covered`` (columns, rows); ``unit`` (columns, rows) is
    the local scatter of relief over the trend of 3 m, m.
    """

    channels: Float32
    covered: Bool
    unit: Float32


def relief_channels(cells: CellHeights) -> Relief:
    """Channels of a lattice of the slope's flat frame, whose cells are those of ``relief_raster``."""
    height, covered, smooth = _surface(cells)
    sigma = SMOOTH_REACH_M / cells.cell
    parts = [np.where(cells.covered, height - smooth, np.nan)]
    parts += [smooth - _trend(smooth, reach, cells.cell) for reach in TREND_REACHES_M]
    scatters = [
        np.maximum(_scatter(part, reach / cells.cell), _MIN_SCATTER_M)
        for part, reach in zip(parts, SCATTER_REACHES_M, strict=True)
    ]
    unit = scatters[UNIT]
    signed = [np.clip(part / scatter, -_MAX_DEVIATION, _MAX_DEVIATION) for part, scatter in zip(parts, scatters)]
    full = np.where(cells.covered, height, smooth)
    weight = covered.astype(np.float64)
    trends = [_planes(np.nan_to_num(smooth), weight, along / cells.cell, up / cells.cell) for along, up in BANDS_M]
    bands = [smooth - trend for trend in trends]
    of_bands = [np.maximum(_scatter(band, BAND_SCATTER_REACH_M / cells.cell), _MIN_SCATTER_M) for band in bands]
    signed += [np.arcsinh(score / _LINEAR_SCORE) for score in _bump_scores(full, cells.cell, BUMPS)]
    signed += [np.clip(band / scatter, -_MAX_DEVIATION, _MAX_DEVIATION) for band, scatter in zip(bands, of_bands)]
    signed += [np.arcsinh(score / _LINEAR_SCORE) for score in _bump_scores(full - trends[0], cells.cell, OFF_BENCHES_M)]
    density = gaussian_filter(cells.count / cells.cell**2, _DENSITY_REACH_M / cells.cell, mode="constant")
    others = [
        np.log(unit / _USUAL_SCATTER_M),
        *(np.log(scatter / unit) for number, scatter in enumerate(scatters) if number != UNIT),
        *(np.log(scatter / unit) for scatter in of_bands),
        np.log((np.minimum(density, _MAX_DENSITY) + 0.1) / _USUAL_DENSITY),
        np.log(_within(cells, sigma) / unit),
        np.minimum(np.log1p(cells.count), 3.0),
    ]
    channels = np.nan_to_num(np.stack([*signed, *others]).astype(np.float32)) * covered
    return Relief(channels, covered, unit.astype(np.float32))


def bump_scores(cells: CellHeights) -> Float:
    """Linear t scores (len(BUMPS), columns, rows) of bumps, of which their channels are made; NaN without data."""
    height, covered, smooth = _surface(cells)
    scores = _bump_scores(np.where(cells.covered, height, smooth), cells.cell, BUMPS)
    return np.where(covered, np.stack(scores), np.nan)


def hiding_scatter(cells: CellHeights) -> Float:
    """Scatter (columns, rows) of relief about which a hazard must stand out, m: ``Relief.unit``, or that over the trend
    along the slope where it is less, as on benches. Of no meaning far from points.
    """
    _, covered, smooth = _surface(cells)
    part = smooth - _trend(smooth, TREND_REACHES_M[UNIT - 1], cells.cell)
    along, up = (reach / cells.cell for reach in BANDS_M[0])
    band = smooth - _planes(np.nan_to_num(smooth), covered.astype(np.float64), along, up)
    scatters = [
        _scatter(part, SCATTER_REACHES_M[UNIT] / cells.cell),
        _scatter(band, BAND_SCATTER_REACH_M / cells.cell),
    ]
    return np.maximum(np.minimum(*scatters), _MIN_SCATTER_M)


def upside_down(channels: Float32) -> Float32:
    """The channels (k, columns, rows) of the same ground with its heights mirrored."""
    sign = np.ones(len(channels), dtype=np.float32)
    sign[: len(SIGNED)] = -1.0
    return channels * sign[:, None, None]


def _surface(cells: CellHeights) -> tuple[Float, Bool, Float]:
    """Heights over the slope's plane, where there is data, and the smooth surface, NaN elsewhere."""
    height = _over_plane(cells.height)
    weight = np.where(cells.covered, cells.count / (cells.count + _FULL_WEIGHT_POINTS), 0.0)
    covered = _near_points(cells)
    return height, covered, np.where(covered, _planes(height, weight, SMOOTH_REACH_M / cells.cell), np.nan)


def _bump_scores(height: Float, cell: float, diameters: Iterable[float]) -> list[Float]:
    """Scores everywhere of heights (columns, rows), NaN without data, of bumps of the ``diameters`` (m)."""
    near = distance_transform_edt(np.isnan(height), return_distances=False, return_indices=True)
    full = height[near[0], near[1]]
    return [
        _widened(linear_scores(_means(full, BUMPS[d]), d, BUMPS[d] * cell), full.shape, BUMPS[d]) for d in diameters
    ]


def _over_plane(height: Float) -> Float:
    """Heights over the plane through all of them: what is left is small where surfaces end."""
    i, j = np.nonzero(np.isfinite(height))
    design = np.column_stack([np.ones(len(i)), i, j])
    solution = np.linalg.lstsq(design.T @ design, design.T @ height[i, j], rcond=None)[0]
    columns, rows = np.ogrid[: height.shape[0], : height.shape[1]]
    return np.asarray(height - solution[0] - solution[1] * columns - solution[2] * rows)


def _near_points(cells: CellHeights) -> Bool:
    """Cells that hold data, as those of ``relief_raster``."""
    if cells.covered.all():
        return cells.covered
    return np.asarray(distance_transform_edt(~cells.covered) * cells.cell <= MAX_GAP_M)


def _planes(height: Float, weight: Float, sigma: float, up: float | None = None) -> Float:
    """Planes under a Gaussian of ``sigma`` cells, ``up`` cells along y if that is another."""
    return local_planes(np.where(weight > 0, height, 0.0), weight, (sigma, up or sigma))


def _trend(surface: Float, reach: float, cell: float) -> Float:
    """Planes under a Gaussian of ``reach`` m about the surface (columns, rows), NaN where it has no data, fitted on
    squares of about a third of it.
    """
    sigma = reach / cell
    step = max(1, math.floor(sigma / 3.0))
    known = np.isfinite(surface)
    filled = np.where(known, surface, 0.0)
    if step == 1:
        return _planes(filled, known.astype(np.float64), sigma)
    weight, total = _blocks(known.astype(np.float64), step), _blocks(filled, step)
    mean = total / np.maximum(weight, 1e-9)
    return _widened(_planes(mean, weight / step**2, sigma / step), surface.shape, step)


def _means(values: Float, step: int) -> Float:
    """Means of squares of ``step`` cells; at the rim the last cells count again."""
    padded = np.pad(values, [(0, -n % step) for n in values.shape], mode="edge")
    return _blocks(padded, step) / step**2


def _widened(coarse: Float, shape: tuple[int, ...], step: int, *, straight: bool = True) -> Float:
    """Values of squares of ``step`` cells at the cells (``shape``), linear in between. Beyond the last middle of a
    square they go on as they came where ``straight``, stay the same otherwise.
    """
    if step == 1:
        return coarse
    if straight and min(coarse.shape) > 1:
        padded = np.pad(coarse, 1, mode="reflect", reflect_type="odd")
    else:
        padded = np.pad(coarse, 1, mode="edge")
    return _between(_between(padded, shape[0], step).T, shape[1], step).T


def _blocks(values: Float, step: int) -> Float:
    """Sums over squares of ``step`` cells."""
    rim = [(0, -n % step) for n in values.shape]
    padded = np.pad(values, rim)
    shape = padded.shape[0] // step, step, padded.shape[1] // step, step
    return np.asarray(padded.reshape(shape).sum(axis=(1, 3)))


def _between(coarse: Float, size: int, step: int) -> Float:
    """Values (size, m) at cells, linear between the middles of squares (squares + 2, m), the first and last beyond the
    rim.
    """
    place = (np.arange(size) + 0.5) / step + 0.5
    before: Index = np.minimum(place.astype(np.int64), len(coarse) - 2)
    share = (place - before)[:, None]
    return np.asarray((1.0 - share) * coarse[before] + share * coarse[before + 1])


def _scatter(values: Float, sigma: float) -> Float:
    """Local standard deviation within ``sigma`` cells, on squares of about a third of it."""
    step = max(1, round(sigma / 3.0))
    known = np.isfinite(values)
    squares = np.where(known, values, 0.0) ** 2
    weight = np.maximum(_smoothed(known.astype(np.float64), sigma, step), 1e-9)
    scatter = np.sqrt(_smoothed(squares, sigma, step) / weight)
    for _ in range(2):
        limit = (_WINSOR * _widened(scatter, values.shape, step, straight=False)) ** 2
        scatter = np.sqrt(_smoothed(np.minimum(squares, limit), sigma, step) / weight)
    return _widened(scatter, values.shape, step, straight=False)


def _smoothed(values: Float, sigma: float, step: int) -> Float:
    return np.asarray(gaussian_filter(_blocks(values, step), sigma / step, mode="constant"))


def _within(cells: CellHeights, sigma: float) -> Float:
    """Scatter of the points within the cells about, m; ``_MIN_SCATTER_M`` where cells hold too few points."""
    known = np.isfinite(cells.scatter)
    weight = gaussian_filter(known.astype(np.float64), 2 * sigma, mode="constant")
    squares = gaussian_filter(np.where(known, cells.scatter, 0.0) ** 2, 2 * sigma, mode="constant")
    return np.sqrt(squares / np.maximum(weight, 1e-3) + _MIN_SCATTER_M**2)
