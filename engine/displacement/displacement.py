"""Motion of a surface along itself between two registered surveys: vectors over the map and zones that move as one.

Relief finds itself again: the surfaces of both surveys are laid on each other by least squares in windows, and the
shift that fits best is the motion (see ``least_squares``). It says nothing where there is no relief to hold on to.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...interface.parameters import DisplacementParameters
from ..core.arrays import Bool, Float, Index
from ..core.errors import InputError
from ..core.progress import Progress
from ..grid.grid import Grid, snapped_grid
from .components import Components, OneWay, held_one_way, on_the_map
from .facets import Facets, find_facets
from .gravity import is_uphill
from .least_squares import Fit
from .measure import Windows, judged
from .near_ground import near_points
from .neighbours import narrowest, with_neighbours
from .one_direction import Component
from .reference import Reference
from .registered import Registered
from .status import Status
from .stored_ground import Ground, bounds_of, parts_of
from .surface import kernel_of
from .vectors import CommonMotion, Vectors, common_motion, in_the_map, with_error
from .windows import Search, density, fitted_tiles, tiles
from .zone_growth import moving_zones
from .zones import Measured, MovingZone

_MAX_GAP_M = 1.0  # from a window's middle to the next ground point of either survey

StablePlaces = Callable[[Float], Bool]
"""Which of places (n, 2) are on ground that is known to be stable."""


MIN_POINTS_PER_M2 = 20.0
"""Ground points a m² of the map, of the sparser survey, below which no vector and no zone is claimed: of still windows
1 % would be where they are simulated and have 20 and 30 points, 6 % with 10 and 5, and of real airborne ones 6 to 25 %
with 5 to 14 (docs/displacement.md)."""


@dataclass(frozen=True)
class Displacement:
    """What was measured.

    Attributes:
        grid: of the windows' middles.
        cell: (n,) flat index in ``grid`` of each window.
        vectors: (n windows), of each window and its neighbours; ``by_width`` are the windows of each width alone.
        facet: (n,) facet of each window; ``facets`` are they.
        significant: (n,) whether a vector is significant; nowhere where the surveys are too sparse to say so.
        zones: what moves as one, largest first; ``doubtful`` what seems to move up the slope, and is no zone.
        common: the motion that most windows share, before it was taken off; None where too few were measured.
        stable: the motion of ground that is known to be stable; None where none is known or too little of it is seen.
        reference: what rests, whose motion was taken off all vectors, and its error, which they hold.
        kernel: standard deviation of the kernel (m), ``points_per_m2`` of the sparser cloud.
        independent: number of measured windows that do not overlap.
        components: of the motion in windows whose relief holds one direction only.
        confidence: with which vectors and components count as significant.
    """

    grid: Grid
    cell: Index
    vectors: Vectors
    by_width: tuple[Vectors, ...]
    facet: Index
    facets: Facets
    significant: Bool
    zones: tuple[MovingZone, ...]
    doubtful: tuple[MovingZone, ...]
    common: CommonMotion | None
    stable: CommonMotion | None
    reference: Reference
    kernel: float
    points_per_m2: float
    independent: float
    components: Components
    confidence: float

    @property
    def taken_off(self) -> Float:
        """(3,) east, north, up that was taken off all vectors, metres."""
        return self.reference.taken_off

    @property
    def significant_components(self) -> Bool:
        """(k,) as ``significant``, of ``components``."""
        return self.components.significant(self.confidence) & (self.points_per_m2 >= MIN_POINTS_PER_M2)

    @property
    def smallest(self) -> Float:
        """(n,) as ``Vectors.smallest``, of the window at the place alone: a small slide is shrunk, too."""
        return narrowest(self.by_width).smallest

    @property
    def uphill(self) -> Bool:
        """(n,) whether a vector points up the slope beyond its error, which makes it doubtful."""
        error = np.sqrt(self.vectors.in_plane_covariance[:, 0, 0])
        return is_uphill(self.vectors.axes[:, 0], self.vectors.in_plane[:, 0], error)


def measure_displacement(
    first: Ground,
    later: Ground,
    parameters: DisplacementParameters,
    registered: Registered,
    stable: StablePlaces | None = None,
    progress: Progress | None = None,
    *,
    threads: int | None = None,
) -> Displacement:
    """Vectors and zones of motion of ``later`` against ``first``, both ground points (n, 3) in one frame, metres.

    Args:
        registered: error of the registration.
        stable: which of places (n, 2) are on ground that is known to be stable; their motion is taken off.
        threads: tiles at a time; None: as ``windows.tile_threads``. The result does not depend on it.

    Raises:
        InputError: the surveys have no ground in common.
    """
    progress = progress or Progress()
    facets = find_facets(first)
    grid, cell, facet, places = windows_of(first, later, facets, parameters.spacing)
    points = density((first, later))
    radii = [parameters.window / 2]
    if parameters.wide_window > parameters.window:
        radii.append(parameters.wide_window / 2)
    search = Search(tuple(radii), parameters.largest_motion, kernel_of(points))
    with progress.stage(0.0, 0.95):
        sizes, one_way = measure_windows(first, later, facets, (places, facet), search, progress, threads)
    own = [in_the_map(windows, facets, places, facet) for windows in sizes]
    overlap = parameters.spacing**2 / (np.pi * np.array(radii) ** 2)
    common = common_motion(own[-1], float(overlap[-1]))
    still = None if stable is None else common_motion(own[-1], float(overlap[-1]), stable(places[:, :2]))
    reference = Reference.of(registered, still or (common if parameters.subtract else None))
    error, taken_off = reference.at(places), reference.taken_off
    by_width = tuple(with_error(v, error, taken_off) for v in own)
    vectors = with_error(with_neighbours(own, facet, facets.frames), error, taken_off)
    components = on_the_map(one_way, vectors, error, taken_off, parameters.vector_confidence)
    dense = points >= MIN_POINTS_PER_M2
    significant = vectors.significant(parameters.vector_confidence) & dense
    independent = float(np.count_nonzero(own[0].measured | own[-1].measured) * overlap[0])
    columns = np.column_stack(np.divmod(cell, grid.columns)[::-1])
    columns[:, 1] = grid.rows - 1 - columns[:, 1]
    held = Measured((first, later), facets, facet, search, columns, parameters.spacing, sizes[-1].common, taken_off)
    progress.update(0.95, "looking for zones that move as one")
    still_errors = [with_error(v, np.zeros((3, 3)), taken_off) for v in own]
    groups = moving_zones(still_errors, held, parameters.slide_area, reference.at) if dense else []
    rising = [_rises(zone, facets, facet) for zone in groups]
    zones, doubtful = (
        tuple(zone for zone, up in zip(groups, rising, strict=True) if up is wanted) for wanted in (False, True)
    )
    progress.update(1.0)
    return Displacement(
        grid, cell, vectors, by_width, facet, facets, significant, zones, doubtful, common, still, reference,
        search.kernel, points, independent, components, parameters.vector_confidence,
    )  # fmt: skip


def _rises(zone: MovingZone, facets: Facets, facet: Index) -> bool:
    dip = facets.frames[int(facet[zone.windows[0]])].axes[0]
    return bool(is_uphill(dip, zone.in_plane[0], np.sqrt(zone.in_plane_covariance[0, 0])))


def windows_of(first: Ground, later: Ground, facets: Facets, spacing: float) -> tuple[Grid, Index, Index, Float]:
    """The grid of windows, and of those over ground of both surveys: flat index, facet and place (n, 3)."""
    ends = bounds_of(first), bounds_of(later)
    low = np.maximum(ends[0][0][:2], ends[1][0][:2])
    high = np.minimum(ends[0][1][:2], ends[1][1][:2])
    if (low >= high).any():
        a, b = (f"x {one[0]:.1f} to {two[0]:.1f}, y {one[1]:.1f} to {two[1]:.1f}" for one, two in ends)
        raise InputError(
            f"The epochs do not overlap: the first spans {a}, the second {b}; "
            "check that both are of the same slope and in the same reference system."
        )
    grid = snapped_grid((low[0], low[1], high[0], high[1]), spacing)
    x = np.asarray(grid.west + (np.arange(grid.columns) + 0.5) * spacing, dtype=np.float64)
    y = np.asarray(grid.north - (np.arange(grid.rows) + 0.5) * spacing, dtype=np.float64)
    facet, places = facets.places(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
    near = facet >= 0
    for ground in (first, later):
        held = np.zeros(grid.shape, dtype=bool)
        for xyz in parts_of(ground):
            held |= near_points(xyz, x, y, _MAX_GAP_M)
        near &= held.ravel()
    if not near.any():
        raise InputError(
            f"Nowhere ground points of both surveys lie within {_MAX_GAP_M:g} m of each other; check the clouds, and "
            "give the transform of their registration."
        )
    cell = np.flatnonzero(near)
    return grid, cell, facet[cell], places[cell]


def measure_windows(
    first: Ground,
    later: Ground,
    facets: Facets,
    at: tuple[Float, Index],
    search: Search,
    progress: Progress,
    threads: int | None = None,
) -> tuple[list[Windows], list[OneWay]]:
    """The windows of each radius, and those in which relief holds one direction only."""
    places, facet = at
    regions = search.regions()
    fits: list[list[Fit | Status | Component]] = [[Status.NO_GROUND] * len(places) for _ in search.radii]
    for windows, fitted in fitted_tiles(
        tiles((first, later), facets, places, facet, search, progress), search, regions, threads
    ):
        for held, found in zip(fits, fitted, strict=True):
            for number, fit in zip(windows, found, strict=True):
                held[number] = fit
    sizes = [
        judged(held, radius, region.blocks, search.limit)
        for held, radius, region in zip(fits, search.radii, regions, strict=True)
    ]
    return sizes, [held_one_way(held, windows) for held, windows in zip(fits, sizes, strict=True)]
