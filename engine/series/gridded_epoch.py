"""One survey of a series on the common grid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from shapely.geometry.base import BaseGeometry

from ..epochs.epoch import Epoch
from ..geometry.rigid_transform import RigidTransform
from ..grid.cell_statistics import CellStatistics


@dataclass(frozen=True)
class GriddedEpoch:
    """A survey in the frame and on the grid of the first one.

    ``registration_error`` is the standard error of a height (m), 0 for the first; ``area`` the part of the region of
    interest that both it and the first survey hold. ``facts`` state what was done, and ``made`` which steps were not
    reused (ground, registration, cells).
    """

    epoch: Epoch
    transform: RigidTransform
    registration_error: float
    cells: CellStatistics
    area: BaseGeometry | None
    facts: dict[str, Any]
    made: tuple[str, ...]
