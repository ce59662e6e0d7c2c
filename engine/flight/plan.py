"""A plan: lines over a region, and place by place what a survey along them is expected to show."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from ...interface.parameters import FlightParameters, given
from ..change.direction import STEEP_DEG
from ..core.arrays import Float, Index
from ..grid.grid import Grid, cell_index, snapped_grid
from .density import Places, expected_pulses
from .effort import Effort, effort_of
from .expected import expected_level, smallest_motion
from .last_survey import Scatter, Seen
from .lines import Line
from .terrain import Terrain

MAX_PLACES = 4_000_000
_PLANTS_FACTOR = 0.7  # of the errors by plants, which two surveys have partly in common: the change learns 0.4 to 1


@dataclass(frozen=True)
class Expected:
    """What is expected of each place of ``grid``; arrays (rows, columns), NaN outside of the region.

    Densities are a m² of map: ``returns`` of all kinds, ``ground`` those of the ground; ``pulses_surface`` and
    ``ground_surface`` a m² of the inclined ground. ``share`` of the pulses reaches the ground. ``slope`` and
    ``incidence`` (beam to the ground's normal) in degrees, ``level`` of detection and smallest ``motion`` in metres,
    the level along ``direction``: vertical, or normal to the slope, as the change chooses it. ``lines`` is how many
    lines see the place.
    """

    grid: Grid
    returns: Float
    ground: Float
    pulses_surface: Float
    ground_surface: Float
    share: Float
    slope: Float
    incidence: Float
    lines: Float
    level: Float
    motion: Float
    direction: str

    @property
    def inside(self) -> np.ndarray:
        return np.isfinite(self.slope)


@dataclass(frozen=True)
class Plan:
    """``lines`` over ``region`` with what is expected of them."""

    region: Polygon | MultiPolygon
    terrain: Terrain
    lines: list[Line]
    expected: Expected
    effort: Effort


def place_grid(region: Polygon | MultiPolygon, parameters: FlightParameters) -> Grid:
    """The grid of the places of a region."""
    west, south, east, north = region.bounds
    return snapped_grid((west, south, east, north), parameters.place_size)


def expected_of(
    region: Polygon | MultiPolygon,
    terrain: Terrain,
    lines: list[Line],
    seen: Seen | None,
    scatter: Scatter,
    parameters: FlightParameters,
) -> Plan:
    """What a survey along ``lines`` is expected to show of each place of ``region``.

    Args:
        seen: the last survey on ``place_grid``; None: the share of pulses that reach the ground is given, or all do.
    """
    grid = place_grid(region, parameters)
    place, ground, slope = _ground_in(region, terrain, grid)
    pulses = expected_pulses(lines, ground, terrain, parameters)

    def mean(values: Float) -> Float:
        known = np.isfinite(values)
        count = np.bincount(place[known], minlength=grid.rows * grid.columns)
        total = np.bincount(place[known], values[known], grid.rows * grid.columns)
        with np.errstate(invalid="ignore"):
            return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan).reshape(grid.shape))

    inclination = mean(slope)
    pulses_map = mean(pulses.surface / ground.normal[:, 2])
    share = _share(seen, grid, given(parameters.ground_share))
    on_ground = pulses_map * share
    chosen = np.isfinite(on_ground)
    level, motion = np.full(grid.shape, np.nan), np.full(grid.shape, np.nan)
    clumping = np.zeros(grid.shape) if seen is None else seen.clumping
    plants = np.zeros(grid.shape) if seen is None else seen.plant_error
    level[chosen] = expected_level(
        on_ground[chosen],
        clumping[chosen],
        scatter,
        parameters.expected_registration_error,
        parameters.expected_confidence,
        _PLANTS_FACTOR * math.sqrt(2.0) * plants[chosen],
    )
    normal = float(np.nanmedian(inclination)) > STEEP_DEG
    if normal:
        level *= np.cos(np.radians(inclination))
    motion[chosen] = smallest_motion(on_ground[chosen], parameters.motion_window)
    surface = mean(pulses.surface)
    expected = Expected(
        grid=grid,
        returns=pulses_map * (1.0 if seen is None else seen.returns_a_pulse),
        ground=on_ground,
        pulses_surface=surface,
        ground_surface=surface * share,
        share=np.where(np.isfinite(inclination), share, np.nan),
        slope=inclination,
        incidence=mean(pulses.incidence),
        lines=mean(pulses.lines.astype(float)),
        level=level,
        motion=motion,
        direction="normal" if normal else "vertical",
    )
    return Plan(region, terrain, lines, expected, effort_of(lines, parameters))


def _ground_in(region: Polygon | MultiPolygon, terrain: Terrain, grid: Grid) -> tuple[Index, Places, Float]:
    """The terrain's cells in the region: the place of each (n,), its ground and inclination (degrees)."""
    east, north = terrain.gradient()
    rows, columns = np.nonzero(np.isfinite(terrain.heights) & np.isfinite(east) & np.isfinite(north))
    x = terrain.grid.west + (columns + 0.5) * terrain.grid.cell
    y = terrain.grid.north - (rows + 0.5) * terrain.grid.cell
    inside = shapely.contains_xy(region, x, y)
    rows, columns, x, y = rows[inside], columns[inside], x[inside], y[inside]
    xyz = np.column_stack([x, y, terrain.heights[rows, columns]])
    normal = np.column_stack([-east[rows, columns], -north[rows, columns], np.ones(len(x))])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    place = cell_index(xyz, grid)
    within = place >= 0
    return place[within], Places(xyz[within], normal[within]), np.degrees(np.arccos(normal[within, 2]))


def _share(seen: Seen | None, grid: Grid, wanted: float | None) -> Float:
    """Share of the pulses that reach the ground (rows, columns); where the last survey saw too little, its median."""
    if wanted is not None or seen is None:
        return np.full(grid.shape, 1.0 if wanted is None else wanted)
    known = np.isfinite(seen.ground_share)
    middle = float(np.median(seen.ground_share[known])) if known.any() else 1.0
    return np.where(known, seen.ground_share, middle)
