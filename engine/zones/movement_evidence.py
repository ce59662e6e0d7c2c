"""What was measured of the ground of each zone: along the normal, along the surface, and of its relief."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ..core.arrays import Float, Index
from ..core.progress import Progress
from ..displacement.facets import Facets
from ..displacement.frame import Frame
from ..displacement.ground_by_boxes import GroundByBoxes, by_boxes
from ..displacement.ground_fit import Gridded, GroundFit, PieceFits, fit_piece, grid_piece, with_errors
from ..displacement.registered import Registered
from ..displacement.stored_ground import Ground as Points
from ..displacement.windows import Search
from ..grid.grid import Grid
from ..m3c2.distances import Cylinder, m3c2_distances, squared_errors
from ..m3c2.lattice import Lattice
from ..m3c2.normals import fit_planes
from .movement import Evidence

_CORES = 300  # of a zone, at most
_NORMAL_RADIUS_M, _CYLINDER_RADIUS_M, _HALF_LENGTH_M = 1.0, 0.5, 1.5
_MIN_CORES = 5


@dataclass(frozen=True)
class Ground:
    """What the evidence is taken from.

    Attributes:
        clouds: ground points of both surveys in one frame.
        facets: of the first one; ``search`` as the vectors were sought.
        registered: error of the registration along the surface; ``height_error`` (m) that in height.
    """

    clouds: tuple[GroundByBoxes, GroundByBoxes]
    facets: Facets
    search: Search
    registered: Registered
    height_error: float

    @classmethod
    def of(
        cls, clouds: tuple[Points, Points], facets: Facets, search: Search, registered: Registered, height_error: float
    ) -> Ground:
        return cls((by_boxes(clouds[0]), by_boxes(clouds[1])), facets, search, registered, height_error)


@dataclass(frozen=True)
class Measured:
    """Evidence of a zone, and its motion in the map: (3,) east, north, up with covariance (3, 3), where it is known."""

    evidence: Evidence
    motion: Float | None
    covariance: Float | None


def measure_zones(
    numbers: Index, count: int, grid: Grid, ground: Ground, progress: Progress | None = None
) -> list[Measured | None]:
    """Evidence of each of ``count`` zones; None where there is too little ground.

    Args:
        numbers: (rows, columns) 1 to ``count`` on the zones' ground, -1 where something else changed, else 0.
    """
    progress = progress or Progress()
    fits: list[PieceFits | None] = []
    distances: list[tuple[float, float]] = []
    for number, box in enumerate(ndimage.find_objects(np.maximum(numbers, 0), max_label=count), start=1):
        progress.update((number - 1) / max(count, 1), "measuring what the zones did")
        bounds = None if box is None else _bounds(box, grid)
        frame = None if bounds is None else _frame_of(numbers, number, bounds, grid, ground)
        pieces: list[Gridded] = []
        if bounds is not None and frame is not None:
            pieces = grid_piece(ground.clouds, frame, bounds, _number_at(numbers, number, grid), ground.search)
        fits.append(fit_piece(pieces, ground.search) if pieces else None)
        distances.append((math.nan, math.nan) if bounds is None else _distance(numbers, number, bounds, grid, ground))
    known = iter(with_errors([fit for fit in fits if fit is not None]))
    progress.update(1.0)
    return [
        None if fit is None else _measured(next(known), distance, ground)
        for fit, distance in zip(fits, distances, strict=True)
    ]


def _bounds(box: tuple[slice, slice], grid: Grid) -> tuple[float, float, float, float]:
    rows, columns = box
    west, north = grid.west + columns.start * grid.cell, grid.north - rows.start * grid.cell
    return west, grid.north - rows.stop * grid.cell, grid.west + columns.stop * grid.cell, north


class _NumberAt:
    """1 in one zone, -1 where something else changed, else 0."""

    def __init__(self, numbers: Index, number: int, grid: Grid) -> None:
        self.numbers, self.number, self.grid = numbers, number, grid

    def __call__(self, xy: Float) -> Index:
        column = np.floor((xy[:, 0] - self.grid.west) / self.grid.cell).astype(np.int64)
        row = np.floor((self.grid.north - xy[:, 1]) / self.grid.cell).astype(np.int64)
        inside = (row >= 0) & (row < self.grid.rows) & (column >= 0) & (column < self.grid.columns)
        found = np.full(len(xy), 0, dtype=np.int64)
        found[inside] = self.numbers[row[inside], column[inside]]
        return np.where(found == self.number, 1, np.where(found == 0, 0, -1))


def _number_at(numbers: Index, number: int, grid: Grid) -> _NumberAt:
    return _NumberAt(numbers, number, grid)


def _own_points(numbers: Index, number: int, bounds: tuple[float, ...], grid: Grid, ground: Ground) -> Float:
    west, south, east, north = bounds
    near = ground.clouds[0].within((west, south, east, north))
    return np.asarray(near[_NumberAt(numbers, number, grid)(near[:, :2]) == 1])


def _frame_of(numbers: Index, number: int, bounds: tuple[float, ...], grid: Grid, ground: Ground) -> Frame | None:
    """The facet that holds most of a zone's points."""
    points = _own_points(numbers, number, bounds, grid, ground)
    facet = ground.facets.places(points[:, :2])[0] if len(points) else np.zeros(0, dtype=np.int64)
    facet = facet[facet >= 0]
    return ground.facets.frames[int(np.bincount(facet).argmax())] if len(facet) else None


def _distance(
    numbers: Index, number: int, bounds: tuple[float, ...], grid: Grid, ground: Ground
) -> tuple[float, float]:
    """Mean distance of a zone along the normals (M3C2) and its standard error, metres; NaN where it is not measured.

    Cylinders overlap: they count as many as fit into the zone without overlapping.
    """
    core = _own_points(numbers, number, bounds, grid, ground)
    core = core[:: max(len(core) // _CORES, 1)]
    reach = _HALF_LENGTH_M + _NORMAL_RADIUS_M
    west, south, east, north = bounds
    near = [cloud.within((west - reach, south - reach, east + reach, north + reach)) for cloud in ground.clouds]
    if len(core) < _MIN_CORES or min(len(part) for part in near) < _MIN_CORES:
        return math.nan, math.nan
    upwards = np.array([0.0, 0.0, 1.0])
    normal = fit_planes(Lattice(near[0], _NORMAL_RADIUS_M), core, 2 * _NORMAL_RADIUS_M, orientation=upwards).normal
    lattices = Lattice(near[0], _CYLINDER_RADIUS_M), Lattice(near[1], _CYLINDER_RADIUS_M)
    found = m3c2_distances(lattices, core, normal, Cylinder(_CYLINDER_RADIUS_M, _HALF_LENGTH_M))
    use = found.measured
    if np.count_nonzero(use) < _MIN_CORES:
        return math.nan, math.nan
    of_first, of_later = squared_errors(found.reference, found.moving)
    sampling = of_first + of_later
    area = float(np.count_nonzero(numbers == number)) * grid.cell**2
    apart = min(max(area / (math.pi * _CYLINDER_RADIUS_M**2), 1.0), float(np.count_nonzero(use)))
    error = math.sqrt(float(np.mean(sampling[use])) / apart + ground.height_error**2)
    return float(found.distance[use].mean()), error


def _measured(fit: GroundFit, distance: tuple[float, float], ground: Ground) -> Measured:
    normal, normal_error = distance
    slope = math.degrees(math.acos(min(fit.axes[2, 2], 1.0)))
    kept, kept_error = math.nan, math.nan
    if fit.own is not None and fit.around is not None and fit.around.value > 3 * fit.around.error:
        kept = fit.own.value / fit.around.value
        kept_error = math.hypot(fit.own.error, kept * fit.around.error) / fit.around.value
    motion = whole = along = covariance = None
    if fit.motion is not None and fit.covariance is not None:
        # what comes along a surface that rises over its plane lifts the place that it comes to
        normal += float(fit.rise @ fit.motion)
        along = fit.motion
        error = fit.axes @ ground.registered.at(fit.place[None])[0] @ fit.axes.T
        covariance = fit.covariance + error[:2, :2]
        inner = np.zeros((3, 3))
        inner[:2, :2], inner[2, 2] = covariance, normal_error**2
        motion, whole = fit.axes.T @ np.append(along, normal), fit.axes.T @ inner @ fit.axes
    return Measured(Evidence(normal, normal_error, along, covariance, kept, kept_error, slope), motion, whole)
