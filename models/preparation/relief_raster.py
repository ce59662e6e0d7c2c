"""The slope as a raster of its flat frame: what a network for images and the screening without learning read.

Channels are heights over a robust local background, heights and t scores of bumps of several widths, ground density
and local scatter. All arrays are (columns, rows): the first axis runs along x of the flat frame, the second along y.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, distance_transform_edt, gaussian_filter, gaussian_laplace, map_coordinates

from ...engine.core.arrays import Bool, Float, Float32, Index
from ...engine.core.errors import InputError
from .bump_filter import BumpFit, CellHeights, cell_heights, fit_bumps
from .trends import robust_trend

CELL_M = 0.5
DIAMETERS_M = (2.0, 3.0, 5.0, 8.0)
BACKGROUND_REACH_M = 4.0
"""Standard deviation of the Gaussian in which the local background is a plane."""
DENSITY_REACH_M = 1.0
MAX_GAP_M = 1.0
"""Cells farther than this from any point hold no data."""
_COARSENING = {2.0: 1, 3.0: 1, 5.0: 2, 8.0: 3}
"""Cells of the raster along a cell of the lattice on which bumps of this diameter (m) are fitted, about
six of which make a diameter."""
_MAX_CELLS = 8_000_000


@dataclass(frozen=True)
class ReliefRaster:
    """Channels (columns, rows) of a slope, NaN where there is no data.

    ``origin`` (2,) is the corner of the first cell in the flat frame, ``cell`` the side, m. ``height`` (m) lies over
    the local background, ``density`` in points/m², ``scatter`` (m) is that of heights about the background within
    ``BACKGROUND_REACH_M``. ``bumps`` has a fit for each diameter. ``covered`` are the cells with ground.
    """

    origin: Float
    cell: float
    height: Float32
    density: Float32
    scatter: Float32
    covered: Bool
    bumps: tuple[BumpFit, ...]

    @property
    def shape(self) -> tuple[int, int]:
        return self.height.shape[0], self.height.shape[1]

    @property
    def area(self) -> float:
        """Covered area of the slope's plane, m²."""
        return float(np.count_nonzero(self.covered)) * self.cell**2

    def channels(self) -> Float32:
        """(3 + diameters, columns, rows): height, density, scatter, then the t scores."""
        return np.stack([self.height, self.density, self.scatter, *(fit.t for fit in self.bumps)])

    def index(self, flat: Float) -> tuple[Index, Index]:
        """Column and row (n,) of points (n, 2 or 3) in the flat frame; at the rim for points beyond it."""
        place = np.floor((flat[:, :2] - self.origin) / self.cell).astype(np.int64)
        return np.clip(place[:, 0], 0, self.shape[0] - 1), np.clip(place[:, 1], 0, self.shape[1] - 1)


def relief_raster(
    flat: Float,
    diameters: Sequence[float] = DIAMETERS_M,
    cell: float = CELL_M,
    number: NDArray[np.number] | None = None,
) -> ReliefRaster:
    """Lay ground points out as a raster.

    Args:
        flat: (n, 3) points in the slope's flat frame, m (``prepare.flat_frame``).
        number: (n,) how many points of the survey each is the average of; 1 by default. Averages must lie in parts of
            the cells, as those in voxels of half of their side do.
        diameters: of the bumps, m.
        cell: side of the raster's cells, m.

    Raises:
        InputError: there is no point, or the points reach too far for a raster of such cells.
    """
    if not len(flat):
        raise InputError("There is no ground point to lay out; check the cloud.")
    low, high = flat[:, :2].min(axis=0), flat[:, :2].max(axis=0)
    origin = np.floor(low / cell) * cell
    columns, rows = (int(n) + 1 for n in np.floor((high - origin) / cell))
    if columns * rows > _MAX_CELLS:
        raise InputError(
            f"The ground reaches over {high[0] - low[0]:.0f} x {high[1] - low[1]:.0f} m of its slope's plane, which "
            f"takes too much memory in cells of {cell:g} m; cut out a part of the slope."
        )
    shape = columns, rows
    fine = cell_heights(flat, cell, origin, shape, number)
    covered = distance_transform_edt(~fine.covered) * cell <= MAX_GAP_M if columns * rows > 1 else fine.covered
    lattices = {1: fine}
    fits = []
    for diameter in diameters:
        step = _COARSENING.get(diameter, max(1, round(diameter / 6 / cell)))
        if step not in lattices:
            coarse = -(-columns // step), -(-rows // step)
            lattices[step] = cell_heights(flat, step * cell, origin, coarse, number)
        fits.append(_on_raster(lattices[step], step, diameter, covered))
    sigma = BACKGROUND_REACH_M / cell
    height = fine.height - robust_trend(fine.height, (sigma, sigma))
    density = gaussian_filter(fine.count / cell**2, DENSITY_REACH_M / cell, mode="constant")
    return ReliefRaster(
        origin,
        cell,
        _filled(height, covered),
        np.where(covered, density, np.nan).astype(np.float32),
        np.where(covered, local_scatter(height, sigma), np.nan).astype(np.float32),
        covered,
        tuple(fits),
    )


def laplacian_score(raster: ReliefRaster, diameter: float, roughness_reach: float = 6.0) -> Float32:
    """Laplacian of Gaussian (Marr and Hildreth 1980, doi:10.1098/rspb.1980.0020) over its own local scatter.

    Positive on bulges. The Gaussian's standard deviation is ``diameter`` / (2 sqrt 2), at which a disc of this
    diameter (m) gives the strongest response; the scatter is taken within ``roughness_reach`` m. NaN without data.
    """
    sigma = diameter / (2 * math.sqrt(2)) / raster.cell
    known = np.isfinite(raster.height).astype(np.float64)
    response = -(sigma**2) * gaussian_laplace(np.where(known > 0, raster.height, 0.0).astype(np.float64), sigma)
    response = np.where(known > 0, response, np.nan)
    score = response / np.maximum(local_scatter(response, roughness_reach / raster.cell), 0.003)
    return np.where(raster.covered, score, np.nan).astype(np.float32)


def _on_raster(lattice: CellHeights, step: int, diameter: float, covered: Bool) -> BumpFit:
    """The fits of a lattice whose cells are ``step`` of the raster's wide, at the raster's ``covered`` cells."""
    if step == 1:
        return fit_bumps(lattice, diameter, covered)
    coarse = np.zeros(lattice.count.shape, dtype=bool)
    i, j = np.nonzero(covered)
    coarse[i // step, j // step] = True
    fit = fit_bumps(lattice, diameter, binary_dilation(coarse, np.ones((3, 3))))
    place = np.array([(i + 0.5) / step - 0.5, (j + 0.5) / step - 0.5])
    known = np.isfinite(fit.amplitude)
    result = []
    for values in (fit.amplitude, fit.error):
        raster = np.full(covered.shape, np.nan, dtype=np.float32)
        if known.any():
            near = distance_transform_edt(~known, return_distances=False, return_indices=True)
            filled = values[near[0], near[1]]
            raster[i, j] = map_coordinates(filled, place, order=1, mode="nearest")
            raster[i, j] = np.where(known[i // step, j // step], raster[i, j], np.nan)
        result.append(raster)
    return BumpFit(diameter, result[0], result[1])


def _filled(values: Float, covered: Bool) -> Float32:
    """Small gaps take the nearest cell's value; NaN beyond ``covered``."""
    near = distance_transform_edt(np.isnan(values), return_distances=False, return_indices=True)
    return np.where(covered, values[near[0], near[1]], np.nan).astype(np.float32)


def local_scatter(values: Float, sigma: float) -> Float:
    """Standard deviation of ``values`` about each cell, weighted by a Gaussian of ``sigma`` cells. Values beyond
    twice the scatter are drawn in to it, so that a hazard hardly raises the scatter of its surroundings.
    """
    known = np.isfinite(values)
    weight = np.maximum(gaussian_filter(known.astype(np.float64), sigma, mode="constant"), 1e-9)
    squares = np.where(known, values, 0.0) ** 2
    limit = np.full(values.shape, np.inf)
    scatter = np.zeros(values.shape)
    for _ in range(3):
        scatter = np.sqrt(gaussian_filter(np.minimum(squares, limit), sigma, mode="constant") / weight)
        limit = (2.0 * scatter) ** 2
    return scatter
