"""Difference of two epochs on a common grid, with its error and level of detection."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from affine import Affine
from numpy.typing import NDArray
from rasterio.features import geometry_mask
from shapely.geometry.base import BaseGeometry

from ...interface.parameters import ChangeParameters, GridChangeParameters, given
from ..core.arrays import Float
from ..core.errors import InputError
from ..core.progress import Progress
from ..core.side_by_side import side_by_side
from ..grid.cell_slope import gradient_at, slope_degrees
from ..grid.cell_statistics import CellStatistics, compiled_pays
from ..grid.chosen_cell import CellChoice, choose_cell, with_cell
from ..grid.common_grid import affordable, common_grid, union
from ..grid.grid import Grid, on_grid
from ..grid.growing_cells import AdaptiveCells, adaptive_cells
from ..grid.partition import Partition
from ..grid.plant_cells import together
from ..grid.pooled_variance import pooled_variance
from ..grid.seen_cells import Cells, SeenCells
from ..pointcloud.in_parts import Points, SpooledCloud
from ..pointcloud.plant_cover import PlantCover
from ..statistics.normal import quantile
from ..statistics.quantiles import sample_quantile
from ..statistics.robust import NORMALISED
from .direction import SENTENCE, with_direction
from .epoch_cells import epoch_cells
from .judgement import judge
from .measured import Measured
from .result import Change
from .season import judge_season
from .thresholds import stated_error

_MIN_CELLS = 30  # with fewer in common, the whole overlap is not judged


@dataclass(frozen=True)
class Areas:
    """Polygons that restrict a comparison; all without them.

    Attributes:
        compared: those to which both clouds were clipped. Cells that are not wholly inside hold a part of their surface
            only, not the same in both epochs, and are left out.
        stable: those known to be stable, on which the errors are calibrated; found in the data without.
        excluded: those that are not compared, though they are a part of the slope.
    """

    compared: BaseGeometry | None = None
    stable: BaseGeometry | None = None
    excluded: BaseGeometry | None = None


def either_area(first: BaseGeometry | None, second: BaseGeometry | None) -> BaseGeometry | None:
    """What either of two areas holds; None for nothing."""
    return first if second is None else second if first is None else first.union(second)


def difference(
    reference: Float,
    moving: Float,
    parameters: GridChangeParameters,
    *,
    registration_error: float = 0.0,
    areas: Areas | None = None,
    plants: tuple[PlantCover | None, PlantCover | None] = (None, None),
    progress: Progress | None = None,
) -> Change:
    """As ``listed_difference``, with arrays (rows, columns) of the whole grid."""
    return listed_difference(
        reference,
        moving,
        parameters,
        registration_error=registration_error,
        areas=areas,
        plants=plants,
        progress=progress,
    ).whole()


def listed_difference(
    reference: Points,
    moving: Points,
    parameters: GridChangeParameters,
    *,
    registration_error: float = 0.0,
    areas: Areas | None = None,
    plants: tuple[PlantCover | None, PlantCover | None] = (None, None),
    progress: Progress | None = None,
) -> Change:
    """Grid both clouds and subtract: change, standard error and level of detection of each cell.

    The error of a cell's height is its points' variance times the leverage (1/n for a mean); the difference adds
    both epochs', scaled by slope as calibrated on stable ground (``slope_calibration.calibrate``), and in quadrature
    the registration error and, where it is known, the error that plants cause in either epoch (Lague et al. 2013,
    doi:10.1016/j.isprsjprs.2013.04.009, eq. 1, with the registration error as a standard error). The level is the
    two-sided normal quantile times that, unless another threshold is asked for.

    Where cells grow, the change lists the cells of the slope; else its arrays are of the whole grid.

    Args:
        reference: (n, 3) points of the first epoch, metres; on the disk where cells grow.
        moving: (m, 3) points of the second epoch, registered to the first.
        registration_error: standard error of the registration in height, metres; ``parameters.registration_error``
            overrides it unless negative.
        plants: the plants over the points of each epoch; None for a cloud that does not record them.

    Raises:
        InputError: no overlap, no common cell, a grid too large, or no cell with two points; of the last the thresholds
            constant and propagated have no need, and the errors are those that they state.
    """
    progress, areas = progress or Progress(), areas or Areas()
    stored = [points for points in (reference, moving) if isinstance(points, SpooledCloud)]
    with_plants = any(cover is not None for cover in plants) or any(points.values for points in stored)
    clouds, bounds = (reference, moving), union(reference, moving)
    choice = affordable(choose_cell(clouds, parameters), clouds, parameters, plants=with_plants, bounds=bounds)
    if choice.automatic:
        progress.info(choice.sentence)
    parameters = with_cell(parameters, choice)
    grid = common_grid(reference, moving, parameters, plants=with_plants, bounds=bounds)
    if isinstance(parameters, ChangeParameters) and parameters.grows:
        registration_error, seen = stated_registration(parameters, registration_error), cells_to_compare(areas, grid)
        cells = adaptive_cells(
            reference,
            moving,
            grid,
            parameters,
            registration_error=registration_error,
            inside=seen.allowed,
            plants=plants,
            progress=progress,
        )
        change = difference_of_blocks(
            cells, grid, parameters, registration_error=registration_error, stable=areas.stable, seen=seen
        )
        return _with_choice(change, parameters, choice, progress)
    if isinstance(parameters, ChangeParameters) and parameters.adaptive:
        progress.info(parameters.why_one_size)
    assert not isinstance(reference, SpooledCloud)
    assert not isinstance(moving, SpooledCloud)
    progress.update(0.05, "gridding the first epoch")
    if parameters.cell_value == "plane" and compiled_pays(min(len(reference), len(moving)), grid):
        epochs = (reference, plants[0]), (moving, plants[1])
        first, second = side_by_side(*(partial(epoch_cells, xyz, grid, parameters, cover) for xyz, cover in epochs))
    else:
        first = epoch_cells(reference, grid, parameters, plants[0])
        progress.update(0.35, "gridding the second epoch")
        second = epoch_cells(moving, grid, parameters, plants[1])
    progress.update(0.65, "differencing")
    change = difference_of_cells(first, second, grid, parameters, registration_error, areas)
    progress.update(1.0, "differencing")
    return _with_choice(change, parameters, choice, progress)


def _with_choice(change: Change, parameters: GridChangeParameters, choice: CellChoice, progress: Progress) -> Change:
    """The change with the choice of its cell; reports which direction was chosen."""
    if parameters.direction == "auto" and change.direction == "normal":
        progress.info(SENTENCE)
    return replace(change, choice=choice)


def difference_of_cells(
    first: CellStatistics,
    second: CellStatistics,
    grid: Grid,
    parameters: GridChangeParameters,
    registration_error: float,
    areas: Areas,
) -> Change:
    """As ``difference``, from the statistics of both epochs' cells on ``grid`` (a series keeps them)."""
    # all that has points; the rest of the rectangle around a slope would only take time
    listed = np.flatnonzero((first.count > 0) | (second.count > 0))
    counts = first.count.ravel()[listed], second.count.ravel()[listed]
    valid_first, valid_second = (count >= parameters.minimum_points for count in counts)
    seen = cells_to_compare(areas, grid)
    if (allowed := seen.allowed) is not None:
        inside = allowed.ravel()[listed]
        valid_first, valid_second = valid_first & inside, valid_second & inside
    both = valid_first & valid_second
    if not both.any():
        raise InputError(
            f"No cell of {grid.cell:g} m has {parameters.minimum_points} or more points in both epochs; "
            "use a larger cell or fewer points a cell."
        )
    here, places = np.flatnonzero(both), [count > 0 for count in counts]
    surfaces = [(cells.cell, cells.height) for cells in (first, second)]
    work: list[Callable[[], Float]] = [lambda: slope_degrees(gradient_at(listed[here], surfaces, grid))]
    if max(first.degrees.max(), second.degrees.max()) > 0:
        work += [partial(_squared_error, cells, both[own]) for cells, own in zip((first, second), places, strict=True)]
        slope, *errors = side_by_side(*work) if compiled_pays(here.size, grid) else [one() for one in work]
        squares = errors[0] + errors[1]
    elif (stated := stated_error(parameters)) is not None:
        # without two points in any cell there is no scatter, and nothing to calibrate it on
        slope, squares, parameters = work[0](), np.full(here.size, stated**2), replace(parameters, calibrate=False)
    else:
        raise InputError(
            f"No cell of {grid.cell:g} m holds two points of an epoch, so that their scatter and the level of "
            "detection cannot be determined; use a larger cell."
        )
    heights = [on_grid(np.flatnonzero(own), of.height, own.shape) for of, own in zip((first, second), places)]
    plants = together(first.plants, second.plants)
    return _judged(
        _Compared(
            Measured(
                dz=np.where(both, heights[1] - heights[0], np.nan),
                sampling=on_grid(here, np.sqrt(squares), both.shape),
                slope=on_grid(here, slope, both.shape),
                partition=Partition(grid.shape, grid.cell, listed=listed),
                plants=None if plants is None else plants.laid_out(lambda values: values.ravel()[listed]),
            ),
            counts=counts,
            heights=(heights[0], heights[1]),
            common=_common(valid_first, valid_second),
            seen=seen,
        ),
        grid,
        parameters,
        stated_registration(parameters, registration_error),
        areas.stable,
    ).whole()


def _squared_error(cells: CellStatistics, where: NDArray[np.bool_]) -> Float:
    """Of the height of each of the cells ``where`` (cells,); m², (n,)."""
    return (cells.leverage * pooled_variance(cells))[where]


def difference_of_blocks(
    cells: AdaptiveCells,
    grid: Grid,
    parameters: ChangeParameters,
    *,
    registration_error: float,
    stable: BaseGeometry | None,
    seen: SeenCells,
) -> Change:
    """As ``difference``, from cells that grew among those ``seen`` allows (see ``growing_cells.adaptive_cells``)."""
    if not cells.partition.count:
        raise InputError(
            f"No cell that grew from {grid.cell:g} m has enough points in both epochs for its surface to be "
            "compared; check that both cover the same slope, or use a larger cell or largest_cell."
        )
    common = _common(*(own >= parameters.minimum_points for own in cells.points))
    return _judged(
        _Compared(
            Measured(cells.dz, cells.sampling, cells.slope, cells.partition, cells.plants),
            counts=(cells.count_from, cells.count_to),
            heights=(cells.height_from, cells.height_to),
            common=common,
            seen=replace(seen, near=cells.near),
            own_points=cells.points,
        ),
        grid,
        parameters,
        registration_error,
        stable,
    )


@dataclass(frozen=True)
class _Compared:
    """What was measured in each cell; counts and heights of both epochs; the share of common cells; the cells that may
    be compared; where cells grew, each cell's own points.
    """

    measured: Measured
    counts: tuple[NDArray[np.signedinteger[Any]], NDArray[np.signedinteger[Any]]]
    heights: tuple[Float, Float]
    common: float
    seen: SeenCells
    own_points: tuple[NDArray[np.signedinteger[Any]], NDArray[np.signedinteger[Any]]] | None = None


def _judged(
    cells: _Compared,
    grid: Grid,
    parameters: GridChangeParameters,
    registration_error: float,
    stable: BaseGeometry | None,
) -> Change:
    """The change with its calibrated errors, levels and what they decide."""
    measured, layout = cells.measured, cells.measured.partition.layout
    parameters = with_direction(parameters, measured.slope)
    valid = np.isfinite(measured.dz)
    here = np.flatnonzero(valid)
    stated = np.hypot(measured.sampling.ravel()[here], registration_error)
    if measured.plants is not None:
        stated = np.hypot(stated, measured.plants.error.ravel()[here])
    uniform = uniform_shift(
        measured.dz.ravel()[here],
        quantile(parameters.confidence) * stated,
        independent=measured.partition.parts_among(valid),
    )
    found = judge(
        measured,
        parameters,
        registration_error=registration_error,
        uniform=uniform is not None,
        given=None if stable is None else layout.of(cells_inside(stable, grid)),
    )
    season, plant_like = judge_season(measured.plants, found.dz, found.decision.level, grid.cell, layout)
    explained = None if plant_like is None else plant_like & found.decision.significant
    significant = found.decision.significant if explained is None else found.decision.significant & ~explained
    return Change(
        grid=grid,
        partition=measured.partition,
        dz=found.dz,
        error=found.error,
        level=found.decision.level,
        significant=significant,
        count_from=cells.counts[0],
        count_to=cells.counts[1],
        height_from=cells.heights[0],
        height_to=cells.heights[1],
        confidence=parameters.confidence,
        registration_error=found.registration_error,
        common_cell_rate=cells.common,
        uniform_dz=uniform,
        stable=found.stable,
        slope=measured.slope,
        minimum_points=parameters.minimum_points,
        own_points=cells.own_points,
        model=found.model,
        threshold=parameters.threshold,
        direction=parameters.direction,
        probability=found.decision.probability,
        sampling=found.sampling,
        plants=found.plants,
        plant_like=plant_like,
        explained=explained,
        season=season,
        plants_factor=found.plants_factor,
        seen=cells.seen,
    )


def _common(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> float:
    """Share of cells that both epochs have among those that either has."""
    return float((first & second).sum() / max((first | second).sum(), 1))


def stated_registration(parameters: GridChangeParameters, measured: float) -> float:
    """The registration error (m) that was given as a parameter, or else what the registration measured."""
    stated = given(parameters.registration_error)
    return measured if stated is None else stated


def cells_to_compare(areas: Areas, grid: Grid) -> SeenCells:
    """Cells of the slope, and those of them that are excluded: whatever an excluded polygon touches."""
    excluded = None
    if areas.excluded is not None:
        excluded = geometry_mask([areas.excluded], grid.shape, Affine(*grid.affine), all_touched=True, invert=True)
    return SeenCells(
        inside=None if areas.compared is None else Cells.of(cells_inside(areas.compared, grid)),
        excluded=None if excluded is None else Cells.of(excluded),
    )


def cells_inside(area: BaseGeometry, grid: Grid) -> NDArray[np.bool_]:
    """Cells (rows, columns) that lie wholly inside the polygons."""
    # a cell is inside if its centre is, and no edge of the polygons comes nearer than half the cell's diagonal
    core = area.buffer(-grid.cell * math.sqrt(0.5))
    if core.is_empty:
        return np.zeros(grid.shape, dtype=bool)
    affine = Affine(*grid.affine)
    inside: NDArray[np.bool_] = geometry_mask([core], grid.shape, affine, invert=True)
    return inside


def uniform_shift(dz: Float, level: Float, *, independent: int | None = None) -> float | None:
    """Median dz where the whole overlap has moved alike, else None; ``independent``: how many of the cells are.

    A whole surface that rises or sinks by one amount is a datum or a bias, not a deformation: nine tenths of the cells
    lie beyond their level on one side, and their spread is small compared with the shift.
    """
    shift = sample_quantile(dz, 0.5)
    spread = NORMALISED * sample_quantile(np.abs(dz - shift), 0.5)
    beyond = float(np.mean(dz * math.copysign(1.0, shift) > level))
    cells = dz.size if independent is None else independent
    return shift if cells >= _MIN_CELLS and beyond >= 0.9 and spread < abs(shift) / 3 else None
