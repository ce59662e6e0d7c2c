"""A bump on a quadratic background, fitted robustly about every cell: how high it is and how sure that is.

About each place the ground within one and a half diameters is described by a quadratic surface and a bump of known
form, as ``a * bump + b0 + b1 x + b2 y + b3 x² + b4 xy + b5 y²``, by least squares that are weighted anew in each round
with Tukey's biweight of the residuals (Beaton and Tukey 1974, doi:10.1080/00401706.1974.10489171). The bump's height
over its standard error is the statistic of a matched filter whose noise level is estimated about the place itself
(Kelly 1986, doi:10.1109/TAES.1986.310745): rough ground needs higher bumps.

All windows lie on one lattice, so that their design is the same: the normal equations of many windows are one matrix
product, and each window still has weights of its own.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Bool, Float, Float32, Index
from ...engine.core.blas_threads import one_blas_thread
from ...engine.core.processors import processors
from ...engine.geometry.plane_cells import Planes
from ...engine.statistics.robust import NORMALISED

BACKGROUND_DIAMETERS = 3.0
"""Width of the window in diameters of the bump."""
BASE_DIAMETERS = 1.4
"""Width of the cosine's base in diameters: at 0.35 diameters from its middle the bump is half as high, as the forms
that hazards have are on average, (1 - r^2)^1 to (1 - r^4)^1.5."""
TUKEY = 4.685
"""Residuals of so many scatters count nothing; 95 % efficient for normal ones."""
ROUNDS = 4
SCALE_ROUNDS = 2
"""Rounds at whose beginning the scatter is estimated again."""
_FULL_WEIGHT_POINTS = 4.0
"""A cell of so many points counts half of what endless points would give: the relief inside it stays."""
_MIN_CELLS = 14
"""Twice the unknowns."""
_MIN_BUMP_CELLS = 3
_MAX_INFLATION = 2.0
"""How many times as large as in a full window the background may make the variance of the height; beyond it the points
lie too one-sidedly."""
_MIN_SCATTER_M = 0.003
_CHUNK_VALUES = 200_000
"""Values of windows that are worked on at a time: what a processor's cache holds."""
_MAX_THREADS = 4  # beyond that they wait for memory
UNKNOWNS = 7


@dataclass(frozen=True)
class CellHeights:
    """Points averaged on a square lattice in the flat frame.

    ``height`` (m), ``count``, ``scatter`` (m, of the points about the cell's plane; NaN below 3 points), all (columns
    along x, rows along y); the height is that at the cell's middle and NaN in empty cells. ``origin`` (2,) is the
    lattice's corner, ``cell`` the side, m.
    """

    height: Float
    count: Float
    scatter: Float
    origin: Float
    cell: float

    @property
    def covered(self) -> Bool:
        """Cells with a point in them."""
        return self.count > 0


@dataclass(frozen=True)
class BumpFit:
    """Heights ``amplitude`` of a bump of ``diameter`` m and their standard errors ``error``, both (columns, rows) in m,
    NaN where there are too few points about the place.
    """

    diameter: float
    amplitude: Float32
    error: Float32

    @property
    def t(self) -> Float32:
        """Height over its standard error."""
        return self.amplitude / self.error


def cell_heights(
    flat: Float,
    cell: float,
    origin: Float,
    shape: tuple[int, int],
    number: NDArray[np.number] | None = None,
    spread: Float | None = None,
) -> CellHeights:
    """Average points (n, 3) of the flat frame on ``shape`` cells of ``cell`` m from ``origin`` (2,) on.

    Points that lie off the cell's middle are brought there along a plane through the cell and the eight around it.

    Args:
        number: (n,) how many points of the survey each is the average of; 1 by default.
        spread: (n, 6) sums of the products xx, xy, xz, yy, yz, zz of these points about their average, m²
            (``voxel_sums.SparseVoxels``). With them the cells are those of the survey's points; without them heights
            are so but for a millimetre's fraction, and the scatter is that of the averages.

    Raises:
        ValueError: a point lies outside of the lattice.
    """
    planes = Planes((flat[:, :2] - origin) / cell)
    if any(have > room for have, room in zip(planes.shape, shape)):
        raise ValueError(f"Points reach over {planes.shape} cells of the lattice's {shape}.")
    level = float(np.median(flat[:, 2]))
    z = flat[:, 2] - level
    weight = np.ones(len(z)) if number is None else np.asarray(number, dtype=np.float64)
    count = planes.sum(weight)
    within = None if spread is None else spread / np.array([cell**2, cell**2, cell, cell**2, cell, 1.0])
    _, along, across = planes.fit(z, weight, 0.0, 0.02, None if within is None else within[:, [0, 1, 3, 2, 4]])
    a, b = along.ravel()[planes.key], across.ravel()[planes.key]
    rest = z - a * planes.x - b * planes.y
    total, squares = planes.sum(weight * rest), planes.sum(weight * rest**2)
    if within is not None:
        xx, xy, xz, yy, yz, zz = within.T
        squares += planes.sum(zz - 2 * (a * xz + b * yz) + a * a * xx + 2 * a * b * xy + b * b * yy)
    with np.errstate(divide="ignore", invalid="ignore"):
        height = np.where(count > 0, total / count + level, np.nan)
        variance = np.maximum(squares - total**2 / count, 0.0) / (count - 1)
    scatter = np.where(count >= 3, np.sqrt(variance, where=count >= 3, out=np.zeros_like(variance)), np.nan)
    rim = [(0, room - have) for have, room in zip(planes.shape, shape)]
    padded = [np.pad(values, rim, constant_values=empty) for values, empty in ((height, np.nan), (scatter, np.nan))]
    return CellHeights(padded[0], np.pad(count, rim), padded[1], origin, cell)


def bump(distance: Float, diameter: float) -> Float:
    """Height (0 to 1) of a bump of unit height at ``distance`` m from its middle."""
    inside = np.minimum(distance / (BASE_DIAMETERS * diameter / 2), 1.0)
    return np.asarray(0.5 * (1.0 + np.cos(np.pi * inside)), dtype=np.float64)


def fit_bumps(cells: CellHeights, diameter: float, where: Bool) -> BumpFit:
    """Fit a bump of ``diameter`` m about each cell of ``where`` (columns, rows)."""
    design = BumpDesign.of(diameter, cells.cell)
    margin = design.margin
    known = np.pad(cells.covered, margin)
    height = np.where(known, np.pad(np.nan_to_num(cells.height), margin), 0.0).astype(np.float32)
    count = np.pad(cells.count, margin)
    weight = (count / (count + _FULL_WEIGHT_POINTS)).astype(np.float32)
    i, j = np.nonzero(where)
    middle = (i + margin) * height.shape[1] + j + margin
    offsets = design.di * height.shape[1] + design.dj
    amplitude, error = (np.full(where.shape, np.nan, dtype=np.float32) for _ in range(2))
    step = max(1, _CHUNK_VALUES // len(offsets))

    def fit(here: slice) -> tuple[Float, Float]:
        window = middle[here, None] + offsets
        return _fit_windows(height.ravel()[window], weight.ravel()[window], design)

    chunks = [slice(start, start + step) for start in range(0, len(middle), step)]
    # Chunks are worked on side by side: the threads of a BLAS only wait for each other on products as small as these.
    with one_blas_thread(), ThreadPoolExecutor(min(processors(), _MAX_THREADS)) as pool:
        for here, found in zip(chunks, pool.map(fit, chunks), strict=True):
            amplitude[i[here], j[here]], error[i[here], j[here]] = found
    return BumpFit(diameter, amplitude, error)


@dataclass(frozen=True)
class BumpDesign:
    """What all windows share: cells (k,) by their offsets, the columns (k, 7) of the model, the bump last, and the
    products (k, 28) of any two of them. ``bump_cells`` (k,) is 1 on the bump, 0 elsewhere; ``inflation`` is how many
    times the background makes the variance of the bump's height in a full window.
    """

    di: Index
    dj: Index
    columns: Float32
    products: Float32
    bump_cells: Float32
    inflation: float

    @property
    def margin(self) -> int:
        return int(np.abs(self.di).max())

    @classmethod
    def of(cls, diameter: float, cell: float) -> BumpDesign:
        radius = BACKGROUND_DIAMETERS * diameter / 2
        reach = math.floor(radius / cell)
        axis = np.arange(-reach, reach + 1)
        di, dj = (part.ravel() for part in np.meshgrid(axis, axis, indexing="ij"))
        inside = np.hypot(di, dj) * cell <= radius
        di, dj = di[inside], dj[inside]
        x, y = di * cell / radius, dj * cell / radius
        within = (np.arange(5) - 2) / 5
        a, b = (part.ravel() for part in np.meshgrid(within, within))
        mean = bump(np.hypot(di[:, None] + a, dj[:, None] + b) * cell, diameter).mean(axis=1)
        columns = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y, mean])
        first, second = np.triu_indices(UNKNOWNS)
        normal = columns.T @ columns
        return cls(
            di,
            dj,
            columns.astype(np.float32),
            (columns[:, first] * columns[:, second]).astype(np.float32),
            (mean >= 0.25).astype(np.float32),
            float(normal[-1, -1] * np.linalg.inv(normal)[-1, -1]),
        )


def _fit_windows(z: Float32, weight: Float32, design: BumpDesign) -> tuple[Float, Float]:
    """Heights and standard errors (n,) of the bumps in windows (n, k) of heights (m) and weights, 0 without points."""
    total = weight.sum(axis=1)
    # Heights about the window's mean keep the digits of single precision.
    z = z - ((z * weight).sum(axis=1) / np.maximum(total, 1e-9))[:, None]
    present = weight > 0
    count = present.sum(axis=1)
    root = np.sqrt(weight)
    now = weight
    scale = np.zeros(len(z), dtype=np.float32)
    for turn in range(ROUNDS):
        solution, information = _solve(now @ design.products, (now * z) @ design.columns)
        if turn == ROUNDS - 1:
            break
        residual = np.abs(z - solution.astype(np.float32) @ design.columns.T) * root
        if turn < SCALE_ROUNDS:
            scale = np.maximum(_median(residual, present, count) * NORMALISED, _MIN_SCATTER_M).astype(np.float32)
        part = residual / (TUKEY * scale)[:, None]
        now = weight * np.square(np.maximum(1.0 - part * part, 0.0))
    alone = now @ design.products[:, -1]
    sound = (
        (count >= _MIN_CELLS)
        & (present @ design.bump_cells >= _MIN_BUMP_CELLS)
        & (alone <= _MAX_INFLATION * design.inflation * information)
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        error = scale / np.sqrt(information)
    return np.where(sound, solution[:, -1], np.nan), np.where(sound, error, np.nan)


def _median(values: Float32, present: Bool, count: NDArray[np.intp]) -> Float32:
    """(n,) lower median of each row's values (n, k) where ``present``; 0 where none is."""
    ordered = np.sort(np.where(present, values, np.float32(np.inf)), axis=1)
    middle = ordered[np.arange(len(values)), np.maximum(count - 1, 0) // 2]
    return np.where(count > 0, middle, np.float32(0.0))


def _solve(products: NDArray[np.floating], right: NDArray[np.floating]) -> tuple[Float, Float]:
    """Solutions (n, 7) of normal equations, given as upper triangles (n, 28), and the information (n,) on the last
    unknown, 1 over its variance in units of the scatter's square. Cholesky's decomposition of all rows at once.
    """
    n = len(products)
    first, second = np.triu_indices(UNKNOWNS)
    matrix = np.empty((UNKNOWNS, UNKNOWNS, n))
    matrix[second, first] = products.T
    ridge = 1e-6 * matrix[0, 0] + 1e-12
    lower = np.zeros_like(matrix)
    half = np.empty((UNKNOWNS, n))
    for j in range(UNKNOWNS):
        pivot = matrix[j, j] + ridge - (lower[j, :j] ** 2).sum(axis=0)
        lower[j, j] = np.sqrt(np.maximum(pivot, ridge))
        for i in range(j + 1, UNKNOWNS):
            lower[i, j] = (matrix[i, j] - (lower[i, :j] * lower[j, :j]).sum(axis=0)) / lower[j, j]
        half[j] = (right[:, j] - (lower[j, :j] * half[:j]).sum(axis=0)) / lower[j, j]
    solution = np.empty((UNKNOWNS, n))
    for j in reversed(range(UNKNOWNS)):
        solution[j] = (half[j] - (lower[j + 1 :, j] * solution[j + 1 :]).sum(axis=0)) / lower[j, j]
    return solution.T, lower[-1, -1] ** 2
