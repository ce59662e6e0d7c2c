"""What one epoch's points leave in the cells of a grid, from which a difference is taken."""

from __future__ import annotations

from dataclasses import replace

from ...interface.parameters import GridChangeParameters
from ..grid.cell_statistics import CellStatistics, cell_statistics, median_level, sloping_statistics
from ..grid.grid import Grid
from ..grid.kept_moments import KeptMoments
from ..grid.plant_cells import cell_means
from ..grid.stored_cells import stored_moments, stored_statistics
from ..pointcloud.in_parts import Points, SpooledCloud
from ..pointcloud.plant_cover import PlantCover


def epoch_moments(xyz: Points, grid: Grid, plants: PlantCover | None = None) -> KeptMoments:
    """The sums of one epoch's points (n, 3) from which cells grow, with the ``plants`` over these.

    Points on the disk have their own plants.
    """
    if isinstance(xyz, SpooledCloud):
        return stored_moments(xyz, grid)
    known = [] if plants is None else [values for values in (plants.error, plants.height) if values is not None]
    return KeptMoments.of_parts([(xyz, known)], grid, median_level(lambda: [xyz], grid))


def epoch_cells(
    xyz: Points, grid: Grid, parameters: GridChangeParameters, plants: PlantCover | None = None
) -> CellStatistics:
    """The cells of one epoch's points (n, 3) as ``difference_of_cells`` takes them, with the ``plants`` over these.

    Points on the disk have their own plants.
    """
    if isinstance(xyz, SpooledCloud):
        return stored_statistics(xyz, grid, sloping=parameters.cell_value == "plane")
    cells = sloping_statistics(xyz, grid) if parameters.cell_value == "plane" else cell_statistics(xyz, grid)
    if plants is None:
        return cells
    means = [None if v is None else cell_means(xyz, v, grid).ravel()[cells.cell] for v in (plants.error, plants.height)]
    return replace(cells, plant_error=means[0], plant_height=means[1])
