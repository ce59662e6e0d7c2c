"""What the zones of a change did, from its heights, distances along normals and vectors along the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ...interface.parameters import ZoneParameters
from ..change.result import Change
from ..core.arrays import Index
from ..core.progress import Progress
from ..displacement.displacement import Displacement
from ..displacement.registered import Registered
from ..displacement.stored_ground import Ground as Points
from ..displacement.windows import Search
from ..displacement.zones import MovingZone
from ..grid.grid import Grid
from .change_zones import cells_of, detected_of
from .extraction import Origin, Zones
from .footprints import footprint_labels
from .movement import sliding_probability
from .movement_evidence import Ground, measure_zones
from .slide_table import Slide, Surface
from .sliding import with_movements

_GATHERED_M = 0.5  # by which the cells of a zone are joined: under plants they are scattered


@dataclass(frozen=True)
class Motion:
    """What is known of motion along the surface of two surveys.

    Attributes:
        vectors: of them.
        clouds: ground points (n, 3) of both, in one frame, metres, in memory or on the disk.
        registered: error of the registration along the surface.
        largest: motion that was looked for, metres.
    """

    vectors: Displacement
    clouds: tuple[Points, Points]
    registered: Registered
    largest: float = 1.0


def moved_zones(
    found: Zones,
    change: Change,
    motion: Motion,
    parameters: ZoneParameters,
    *,
    confidence: float = 0.99,
    origin: Origin | None = None,
    progress: Progress | None = None,
) -> Zones:
    """The zones ``found`` in a ``change`` with what each did, and those that slid in place of their parts.

    Args:
        motion: of the same surveys.
        confidence: with which ground that did not slide is not said to have slid.
        origin: of the zones.
    """
    displacement = motion.vectors
    search = Search((), motion.largest, displacement.kernel)
    ground = Ground.of(motion.clouds, displacement.facets, search, motion.registered, change.registration_error)
    surface = Surface(cells_of(change), detected_of(change), change.grid, origin or Origin())
    numbers = own_ground(found, change.grid)
    measured = measure_zones(numbers, len(found.frame), change.grid, ground, progress)
    moving = [] if change.uniform_dz is not None else _slides(displacement, change.grid, 1.0 - confidence)
    return with_movements(found, measured, moving, surface, parameters, confidence)


def own_ground(found: Zones, grid: Grid) -> Index:
    """(rows, columns) 1 and on where each zone is, with the gaps between its cells; -1 in what is left of footprints.

    A footprint reaches out for as long as anything changed: too far for what the zone itself did.
    """
    numbers = np.where(footprint_labels(found.footprints, grid.shape) > 0, -1, 0).astype(np.int64)
    reach = _GATHERED_M / grid.cell
    margin = int(reach) + 2
    for number, box in enumerate(ndimage.find_objects(found.labels, max_label=len(found.frame)), start=1):
        if box is None:
            continue
        window = tuple(slice(max(0, part.start - margin), part.stop + margin) for part in box)
        own = np.pad(found.labels[window] == number, margin)
        near = ndimage.distance_transform_edt(~own) <= reach
        gathered = ndimage.binary_fill_holes(ndimage.distance_transform_edt(near) > reach) | own
        gathered = gathered[margin:-margin, margin:-margin]
        numbers[window][gathered & (found.labels[window] == 0)] = number
    numbers[found.labels > 0] = found.labels[found.labels > 0]
    return numbers


def _slides(displacement: Displacement, grid: Grid, by_chance: float) -> list[Slide]:
    """The moving zones of which sinking or bulging alone is no explanation."""
    slides = []
    for zone in displacement.zones:
        axes = displacement.facets.frames[int(displacement.facet[zone.windows[0]])].axes
        slope = float(np.degrees(np.arccos(min(axes[2, 2], 1.0))))
        without = sliding_probability(zone.in_plane[:2], float(zone.in_plane[2]), zone.in_plane_covariance, slope)
        cells = _cells_of(zone, displacement, grid)
        if without >= by_chance or not len(cells):
            continue
        slides.append(
            Slide(
                cells, zone.motion, zone.covariance, float(zone.in_plane[2]),
                float(np.sqrt(zone.in_plane_covariance[2, 2])), 1.0 - zone.probability, 1.0 - without,
            )
        )  # fmt: skip
    return slides


def _cells_of(zone: MovingZone, displacement: Displacement, grid: Grid) -> Index:
    """Flat indices of the cells of ``grid`` whose middle lies in the zone's windows' cells."""
    coarse = displacement.grid
    inside = np.zeros(coarse.shape, dtype=bool)
    inside.ravel()[displacement.cell[zone.windows]] = True
    x = grid.west + (np.arange(grid.columns) + 0.5) * grid.cell
    y = grid.north - (np.arange(grid.rows) + 0.5) * grid.cell
    column = np.floor((x - coarse.west) / coarse.cell).astype(np.int64)
    row = np.floor((coarse.north - y) / coarse.cell).astype(np.int64)
    known_rows, known_columns = (row >= 0) & (row < coarse.rows), (column >= 0) & (column < coarse.columns)
    whole = np.zeros(grid.shape, dtype=bool)
    whole[np.ix_(known_rows, known_columns)] = inside[np.ix_(row[known_rows], column[known_columns])]
    return np.flatnonzero(whole)
