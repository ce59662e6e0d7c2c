"""A raw cloud as rasters to draw on, of any number of points: it is decompressed once, and gone through three times."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from shapely.geometry.base import BaseGeometry

from ...interface.parameters import AUTO, TopViewParameters
from ..core.arrays import Bool, Float32
from ..core.errors import InputError
from ..core.messages import shown
from ..core.progress import Progress
from ..grid.chosen_cell import CELL_SIDES_M, CellChoice
from ..grid.cloud_look import CloudLook, looked_through
from ..grid.grid import Grid, snapped_grid
from ..grid.returns import GROUND, CellReturns, HeightsOverGround
from ..ground.quick_surface import GROUND_WITHIN_M, LowestReturns, QuickSurface, quick_surface
from ..pointcloud.in_parts import CloudFile
from ..pointcloud.reading import eight_bits
from .relief import hillshade
from .top_view import FILL_DISTANCE, TopView, painted, stretch_levels, stretched

SIDES_M = (0.05, *CELL_SIDES_M)
"""Sides of a cell that are chosen from, metres."""
SPACINGS_A_CELL = 2.0
"""Mean distances of the points that a cell is wide: four points, so that hardly a cell within the cloud is empty."""
BYTES_A_CELL = 48
"""Memory that the rasters take for a cell, measured."""
BYTES_BASE = 350_000_000
"""Memory of the program and of the points that are in work, measured."""


@dataclass(frozen=True)
class DrawingRasters:
    """Rasters of one cloud on one grid; NaN where nothing was measured.

    Attributes:
        view: picture in the colours or the intensity of the highest returns, else their relief.
        hillshade: brightness, 0 to 255, of the highest returns, or of the lowest in a cell and the eight around it;
            ``hillshade_of`` says of which.
        density: returns a m².
        ground_density: ground returns a m²; ``ground`` says of which, ``class_2`` or ``estimate``.
        canopy_height: height (m) of the highest return over the ground, not below 0.
        choice: the cell, and why.
    """

    view: TopView
    hillshade: Float32
    hillshade_of: str
    density: Float32
    ground_density: Float32
    ground: str
    canopy_height: Float32
    choice: CellChoice
    look: CloudLook

    @property
    def grid(self) -> Grid:
        return self.view.grid


def drawing_rasters(
    cloud: CloudFile, area: BaseGeometry | None, parameters: TopViewParameters, folder: Path, progress: Progress
) -> DrawingRasters:
    """The rasters of a cloud that is read with its classes and colours.

    Args:
        area: polygons in metres of the cloud's frame, outside of which points are left out.
        folder: for the points as long as they are in use.

    Raises:
        InputError: as ``look_at``; the cloud has no points of class 2 where these are asked for; the rasters need more
            memory than is allowed.
    """
    with progress.stage(0.0, 0.25, "looking at the cloud"):
        look, again = looked_through(cloud, area, folder, progress)
    ground = _ground(look, parameters, cloud)
    choice = choose_side(look, parameters, cloud, progress)
    grid = snapped_grid(look.bounds, choice.cell)
    base = math.floor(look.low[2])
    with progress.stage(0.25, 0.55, "gridding the returns"):
        cells = CellReturns(grid, base, classified=ground == "class_2", colours=look.colours)
        lows = LowestReturns(grid, base, look.spacing)
        for part in again(progress):
            rgb = None if part.rgb is None else eight_bits(np.asarray(part.rgb, dtype=np.uint16), look.largest_colour)
            cells.add(part, rgb)
            lows.add(part.xyz if ground == "estimate" else part.xyz[part.classification == GROUND])
    surface = quick_surface(lows, plants=ground == "estimate")
    with progress.stage(0.55, 1.0, "taking heights over the ground"):
        heights = HeightsOverGround(grid, base, GROUND_WITHIN_M)
        for part in again(progress):
            heights.add(part.xyz, surface.at(part.xyz))
    return _rasters(cells, heights, surface, parameters, (ground, choice, look))


def choose_side(look: CloudLook, parameters: TopViewParameters, cloud: CloudFile, progress: Progress) -> CellChoice:
    """The cell as given, or that of ``SIDES_M`` nearest to ``SPACINGS_A_CELL`` spacings whose rasters fit the memory.

    Raises:
        InputError: the rasters of a cell that was given do not fit.
    """
    allowed = parameters.view_memory * 1e9

    def needed(side: float) -> float:
        return BYTES_BASE + BYTES_A_CELL * math.prod(snapped_grid(look.bounds, side).shape)

    if parameters.cell != AUTO:
        side = float(parameters.cell)
        if needed(side) > allowed:
            rows, columns = snapped_grid(look.bounds, side).shape
            raise InputError(
                f"Rasters of {rows} by {columns} cells over {shown(cloud.path)} need {needed(side) / 1e9:.3g} GB, more "
                f"than the {allowed / 1e9:.3g} GB allowed; give a larger --cell, a region by --roi, or raise "
                "--view-memory."
            )
        return CellChoice(side, False, f"Cells of {side:g} m, as given.")
    wanted = min(SIDES_M, key=lambda side: abs(math.log(side / (SPACINGS_A_CELL * look.spacing))))
    side = wanted
    while needed(side) > allowed:
        side = next((s for s in SIDES_M if s > side), 2.0 * side)
    sentence = (
        f"Cells of {side:g} m, chosen because the points are {look.spacing:.2g} m apart; --cell fixes another size."
    )
    if side > wanted:
        sentence = (
            f"Cells of {side:g} m, because cells of {wanted:g} m, which would suit the points, need "
            f"{needed(wanted) / 1e9:.3g} GB of the {allowed / 1e9:.3g} GB allowed; give a region by --roi, or raise "
            "--view-memory, for smaller ones."
        )
        progress.warning(sentence)
    return CellChoice(side, True, sentence)


def _ground(look: CloudLook, parameters: TopViewParameters, cloud: CloudFile) -> str:
    """Which returns are taken for ground."""
    if parameters.ground_returns == "class_2" and not look.ground:
        raise InputError(
            f"{shown(cloud.path)} has no points of class 2 here; leave --ground-returns to auto, or extract its ground "
            "first."
        )
    if parameters.ground_returns == "auto":
        return "class_2" if look.classified else "estimate"
    return parameters.ground_returns


def _rasters(
    cells: CellReturns,
    heights: HeightsOverGround,
    surface: QuickSurface,
    parameters: TopViewParameters,
    chosen: tuple[str, CellChoice, CloudLook],
) -> DrawingRasters:
    """What was gathered as rasters; overwrites ``cells`` and ``heights`` on the way, to hold less."""
    ground, choice, look = chosen
    view = _view(cells, look)
    measured = view.rgba[..., 3] > 0
    if parameters.hillshade == "highest":
        shade = _shade(heights.highest, surface, cells.grid)
    else:
        # the lowest of a cell is often a plant; of nine it is so less often
        shade = _shade(ndimage.minimum_filter(heights.lowest, 3, mode="nearest"), surface, cells.grid)
    shade[~measured] = np.nan
    found = heights.close if cells.ground_count is None else cells.ground_count
    canopy = heights.highest
    np.maximum(canopy, 0.0, out=canopy)
    canopy[cells.count == 0] = np.nan
    return DrawingRasters(
        view=view,
        hillshade=shade,
        hillshade_of=parameters.hillshade,
        density=_density(cells.count, measured, cells.grid.cell),
        ground_density=_density(found, measured, cells.grid.cell),
        ground=ground,
        canopy_height=canopy,
        choice=choice,
        look=look,
    )


def _shade(over: Float32, surface: QuickSurface, grid: Grid) -> Float32:
    """Hillshade of returns so high ``over`` the surface, infinite where there is none.

    They are put into the middle of their cell along the surface: a return may lie anywhere in its cell, and on a slope
    that alone would make it look rough.
    """
    heights = np.empty(grid.shape, dtype=np.float32)
    x = grid.west + (np.arange(grid.columns) + 0.5) * grid.cell
    for row in range(grid.rows):
        y = np.full(grid.columns, grid.north - (row + 0.5) * grid.cell)
        heights[row] = surface.at(np.column_stack([x, y])) + over[row]
    heights[np.isinf(heights)] = np.nan
    return hillshade(heights, grid.cell)


def _density(count: NDArray[np.uint32], measured: Bool, cell: float) -> Float32:
    """Returns a m²; NaN outside of the cloud, 0 in the cells within it that have none."""
    density = count.astype(np.float32)
    density /= np.float32(cell**2)
    density[~measured] = np.nan
    return density


def _view(cells: CellReturns, look: CloudLook) -> TopView:
    """The picture of the highest returns."""
    source = look.colours or "height"
    levels = 0.0, 1.0
    if cells.intensity is not None:
        levels = stretch_levels(cells.intensity[cells.filled])

    def lines(first: int, last: int) -> tuple[Float32, Bool]:
        rows = slice(first, last)
        filled = cells.count[rows] > 0
        if cells.rgb is not None:
            return cells.rgb[rows].astype(np.float32), filled
        if cells.intensity is not None:
            return stretched(cells.intensity[rows].astype(np.float32), *levels)[..., np.newaxis], filled
        return np.where(filled, cells.highest[rows], 0.0)[..., np.newaxis].astype(np.float32), filled

    return painted(lines, cells.grid, source, FILL_DISTANCE)
