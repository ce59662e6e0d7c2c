"""The result of a comparison on a grid."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float
from ..grid.chosen_cell import CellChoice
from ..grid.grid import Grid
from ..grid.partition import Partition
from ..grid.plant_cells import PlantCells
from ..grid.seen_cells import SeenCells
from ..statistics.layout import Layout
from .season import Season
from .slope_calibration import ErrorModel, uncalibrated


@dataclass(frozen=True)
class Change:
    """Elevation change B minus A; NaN where a cell is not valid in both epochs.

    Arrays are (rows, columns) of ``grid``, or (n,) of the cells that ``partition`` lists (see ``Layout``); ``whole``
    gives the former.

    ``error`` is the standard error of ``dz``; ``level`` the level of detection at ``confidence``, both in metres.
    ``common_cell_rate`` is the share of cells with enough points of both epochs among those with enough of either, also
    where cells grew: it shows how dense the surveys are compared with ``grid.cell``. ``stable`` marks the cells that
    were taken as stable ground; ``slope`` is the surface's inclination, degrees, NaN where it is unknown or nothing was
    compared.

    ``partition`` states which cells are one, where cells grew: they share dz, error, level and counts, and their errors
    are the same error. ``count_from`` and ``count_to`` are the points behind a cell's change, those of its part;
    ``points`` are those of the cell itself.

    ``model`` states how the errors were calibrated; ``threshold`` and ``direction`` are the parameters of that name:
    with the direction ``normal``, ``dz`` and all errors are distances square to the slope. ``probability`` is the
    posterior probability that a cell's change is real, of the threshold ``coherent`` only.

    ``sampling`` is the part of the error that the points' scatter causes, after calibration; ``plants`` the part
    that plants cause, and their height, None where neither epoch knows them. ``plant_like`` marks cells whose change a
    change of the plants' height explains, ``explained`` those of them that would else be significant; ``season`` states
    how the plants differ between the epochs. All are None where the plants' heights are not known. The errors of
    ``plants`` are the stated ones times ``plants_factor``, which was measured on stable ground (``plant_calibration``).

    ``by_trend`` is the part of the error by a tilt or bend that was taken off, metres; None where none was.

    ``seen`` states which cells have ground of the surveys nearby, and which may be compared (see ``coverage.seen``).

    ``choice`` states how the side of a cell was chosen, where this is known.
    """

    grid: Grid
    partition: Partition
    dz: Float
    error: Float
    level: Float
    significant: NDArray[np.bool_]
    count_from: NDArray[np.signedinteger[Any]]
    count_to: NDArray[np.signedinteger[Any]]
    height_from: Float
    height_to: Float
    confidence: float
    registration_error: float
    common_cell_rate: float
    uniform_dz: float | None
    stable: NDArray[np.bool_]
    slope: Float
    minimum_points: int = 1
    own_points: tuple[NDArray[np.signedinteger[Any]], NDArray[np.signedinteger[Any]]] | None = None
    model: ErrorModel = field(default_factory=uncalibrated)
    threshold: str = "probabilistic"
    direction: str = "vertical"
    probability: Float | None = None
    sampling: Float | None = None
    plants: PlantCells | None = None
    plant_like: NDArray[np.bool_] | None = None
    explained: NDArray[np.bool_] | None = None
    season: Season | None = None
    plants_factor: float = 1.0
    by_trend: Float | None = None
    seen: SeenCells = field(default_factory=SeenCells)
    choice: CellChoice | None = None

    @property
    def layout(self) -> Layout:
        """How the arrays hold the cells."""
        return self.partition.layout

    def whole(self) -> Change:
        """The change with arrays (rows, columns)."""
        layout = self.layout
        if layout.listed is None:
            return self
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        arrays: dict[str, Any] = {n: layout.on_grid(v) for n, v in values.items() if isinstance(v, np.ndarray)}
        own, plants = self.own_points, self.plants
        return replace(
            self,
            **arrays,
            partition=self.partition.whole(),
            own_points=None if own is None else (layout.on_grid(own[0]), layout.on_grid(own[1])),
            plants=None if plants is None else plants.laid_out(layout.on_grid),
        )

    @property
    def points(self) -> tuple[NDArray[np.signedinteger[Any]], NDArray[np.signedinteger[Any]]]:
        """Points of each cell itself in either epoch."""
        return self.own_points or (self.count_from, self.count_to)

    @property
    def cell_area(self) -> Float:
        """Area that each cell's ``dz`` acts on, m²: on the map, or on the slope where ``dz`` is square to it."""
        flat = self.grid.cell**2
        if self.direction == "normal":
            return flat / np.cos(np.radians(self.slope))
        return np.broadcast_to(np.float64(flat), self.dz.shape)  # one number, read only

    @property
    def measure(self) -> str:
        """What ``dz`` is, in words."""
        return "Slope-normal change" if self.direction == "normal" else "Elevation change"

    @property
    def valid(self) -> NDArray[np.bool_]:
        return np.isfinite(self.dz)

    @property
    def beyond(self) -> NDArray[np.bool_]:
        """Cells beyond their level, those included that the plants explain."""
        return self.significant if self.explained is None else self.significant | self.explained

    @property
    def median_level(self) -> float:
        return float(np.nanmedian(self.level))

    def level_facts(self) -> dict[str, Any]:
        """How the level of detection was derived, for the run record; metres."""
        return {
            "threshold": self.threshold,
            "direction": self.direction,
            "confidence": self.confidence,
            "level_median_m": self.median_level,
            "error_median_m": float(np.nanmedian(self.error)),
            "registration_error_m": self.registration_error,
            "plants_factor": self.plants_factor,
            **self.model.summary(),
        }
