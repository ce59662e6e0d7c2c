"""The surveys of a series compared: each with the first one and with the one before."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from shapely.geometry.base import BaseGeometry

from ...interface.parameters import ChangeParameters, GridChangeParameters
from ..change.difference import (
    Areas,
    cells_to_compare,
    difference_of_blocks,
    difference_of_cells,
    either_area,
    stated_registration,
)
from ..change.doubts import warn_of_doubtful_change
from ..change.result import Change
from ..core.arrays import Float
from ..core.errors import InputError
from ..core.named_progress import NamedProgress
from ..core.progress import Progress
from ..displacement.registered import Registered
from ..epochs.epoch import Epoch
from ..geometry.rigid_transform import RigidTransform
from ..grid.cell_statistics import CellStatistics
from ..grid.grid import Grid
from ..grid.growing_cells import adaptive_cells_of_moments
from ..grid.kept_moments import KeptMoments
from ..pointcloud.in_parts import SpooledCloud
from .kept_changes import KeptChanges

Cells = CellStatistics | KeptMoments
"""What is kept of a survey: its cells of one size, or the sums from which cells grow."""


@dataclass(frozen=True)
class GriddedEpoch:
    """A survey in the frame and on the grid of the first one; ``load`` reads its cells, which no one else holds, and
    ``points`` its ``ground`` (n, 3) in that frame, metres, and ``stored`` the same in a folder on the disk; ``key``
    stands for all that they depend on.

    ``registration_error`` is the standard error of a height (m), 0 for the first; ``registered`` that of all six
    unknowns; ``area`` the part of the region of interest that both it and the first survey hold, ``excluded`` what is
    left out of it by hand. ``facts`` state what was done, and ``made`` which steps were not
    reused (ground, registration, cells).
    """

    epoch: Epoch
    transform: RigidTransform
    registration_error: float
    load: Callable[[], Cells]
    points: Callable[[], Float]
    stored: Callable[[Path], SpooledCloud]
    ground: Path
    key: str
    registered: Registered
    area: BaseGeometry | None
    excluded: BaseGeometry | None
    facts: dict[str, Any]
    made: tuple[str, ...]


def compared(
    gridded: Sequence[GriddedEpoch],
    grid: Grid,
    parameters: GridChangeParameters,
    folder: Path,
    stable: BaseGeometry | None,
    progress: Progress,
) -> tuple[KeptChanges, KeptChanges]:
    """Changes against the first survey and against the one before.

    Cells grow for each pair of surveys alone. A further survey therefore changes no comparison of the earlier ones.

    Args:
        folder: for the changes as long as they are in use.
    """
    names = [g.epoch.name for g in gridded]
    shares = [NamedProgress(s, n) for s, n in zip(progress.split(names), names, strict=True)]
    cumulative, incremental = KeptChanges(folder, "cumulative"), KeptChanges(folder, "incremental")
    first = before = gridded[0].load()
    for number, (last, this) in enumerate(pairwise(gridded), 1):
        progress.update(number / len(gridded), f"comparing {this.epoch.name}")
        later = this.load()
        try:
            change = _difference((gridded[0], first), (this, later), grid, parameters, stable)
            # all along the direction of the first comparison
            parameters = replace(parameters, direction=change.direction)
            cumulative.add(change)
            may_grow = isinstance(parameters, ChangeParameters) and not parameters.adaptive
            warn_of_doubtful_change(change, shares[number], may_grow=may_grow, of_pair=False)
            del change
            if number == 1:
                incremental.again(cumulative, 0)
            else:
                incremental.add(_difference((last, before), (this, later), grid, parameters, stable))
        except InputError as wrong:
            raise InputError(f"{this.epoch.name}: {wrong}") from wrong
        before = later
    return cumulative, incremental


def _difference(
    earlier: tuple[GriddedEpoch, Cells],
    later: tuple[GriddedEpoch, Cells],
    grid: Grid,
    parameters: GridChangeParameters,
    stable: BaseGeometry | None,
) -> Change:
    (a, before), (b, after) = earlier, later
    area = a.area if b.area is None else b.area if a.area is None else a.area.intersection(b.area)
    areas = Areas(area, stable, either_area(a.excluded, b.excluded))
    error = float(np.hypot(a.registration_error, b.registration_error))
    if isinstance(before, CellStatistics) and isinstance(after, CellStatistics):
        return difference_of_cells(before, after, grid, parameters, error, areas)
    assert isinstance(before, KeptMoments)
    assert isinstance(after, KeptMoments)
    assert isinstance(parameters, ChangeParameters)
    error = stated_registration(parameters, error)
    seen = cells_to_compare(areas, grid)
    cells = adaptive_cells_of_moments(before, after, grid, parameters, registration_error=error, inside=seen.allowed)
    return difference_of_blocks(cells, grid, parameters, registration_error=error, stable=stable, seen=seen).whole()
