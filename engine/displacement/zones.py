"""Ground that moves as one: adjoining significant windows of like direction; one least-squares motion over windows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..core.arrays import Bool, Float, Index
from .errors import covariances
from .facets import Facets
from .frame import Frame
from .least_squares import BLOCK_SHARE, Fit, Region, fit_motion
from .stored_ground import Ground, StoredGround, in_frame
from .surface import NODE_M, gridded
from .vectors import Vectors
from .windows import Search

MAX_PROBABILITY = 0.05
"""That still ground shows a zone anywhere on the map; zones with a larger one are not reported."""
MAX_TURN_DEG = 60.0
"""Neighbouring vectors that turn farther belong to different zones."""
_MIN_FIT_AREA_M2 = 8.0  # that a zone keeps when its margin is taken off
_MAX_FIT_WIDTH_M = 50.0  # of the part of a zone that is fitted, so that memory stays bounded
_MARGIN_SHARE = 0.5  # of half a window's width

Shape = tuple[int, int]


@dataclass(frozen=True)
class FitPlan:
    """How to fit a zone: from motion ``start`` (2,) along its axes (m), without a ``margin`` (m), with the blocks of
    windows of ``width`` (m).
    """

    start: Float
    margin: float
    width: float


@dataclass(frozen=True)
class MovingZone:
    """Ground that moves as one.

    Attributes:
        windows: (k,) numbers of its windows.
        area: of the windows' cells on the map, m².
        motion: (3,) east, north, up of one fit over the zone without its margin, metres.
        covariance: (3, 3) of it, with the registration's error, m².
        in_plane, in_plane_covariance: the same along the dip, across it and along the normal.
        probability: that still ground shows such a zone anywhere on the map.
        fitted_area: along the surface, m².
    """

    windows: Index
    area: float
    motion: Float
    covariance: Float
    in_plane: Float
    in_plane_covariance: Float
    probability: float
    fitted_area: float

    @property
    def off_dip(self) -> float:
        """Angle of the motion along the surface to the direction of dip, degrees from -180 to 180, left positive."""
        return float(np.degrees(np.arctan2(self.in_plane[1], self.in_plane[0])))


@dataclass(frozen=True)
class Measured:
    """What zones are made of: clouds in one frame, the search, windows and their facets, and what all have in common.

    ``common`` (5, 5) is of ``errors.common_ratio``, ``cells`` (n, 2) the windows' columns and rows on the map,
    ``spacing`` their distance (m), and ``taken_off`` (3,) what was taken off all vectors.
    """

    clouds: tuple[Ground, Ground]
    facets: Facets
    facet: Index
    search: Search
    cells: Index
    spacing: float
    common: Float
    taken_off: Float


def groups(vectors: Vectors, significant: Bool, cells: Index, facet: Index) -> list[Index]:
    """Numbers of the windows of each group of significant ones that adjoin, corners too, and point alike."""
    chosen = np.flatnonzero(significant)
    if not len(chosen):
        return []
    place = cells[chosen] - cells[chosen].min(axis=0) + 1
    number = np.full(place.max(axis=0) + 2, -1)
    number[tuple(place.T)] = np.arange(len(chosen))
    direction = vectors.in_plane[chosen][:, :2]
    direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    pairs = []
    for step in ((0, 1), (1, 0), (1, 1), (1, -1)):
        other = number[tuple((place + step).T)]
        here = np.flatnonzero(other >= 0)
        there = other[here]
        like = (direction[here] * direction[there]).sum(axis=1) > np.cos(np.radians(MAX_TURN_DEG))
        like &= facet[chosen[here]] == facet[chosen[there]]
        pairs.append(np.stack([here[like], there[like]]))
    i, j = np.concatenate(pairs, axis=1)
    count, label = connected_components(coo_matrix((np.ones(len(i)), (i, j)), shape=(len(chosen),) * 2), directed=False)
    return [chosen[label == k] for k in range(count)]


def fit_group(
    group: Index, vectors: Vectors, measured: Measured, error_at: Callable[[Float], Float]
) -> tuple[Float, Float, float] | None:
    """As ``fit_zone``, from the median of the windows' vectors, without a margin of a quarter of their width."""
    frame = measured.facets.frames[int(measured.facet[group[0]])]
    start = np.median(vectors.in_plane[group][:, :2] + (frame.axes @ measured.taken_off)[:2], axis=0)
    narrow, wide = (float(pick(vectors.width[group])) for pick in (np.min, np.max))
    return fit_zone(group, vectors.places, measured, error_at, FitPlan(start, _MARGIN_SHARE * narrow / 2, wide))


def fit_zone(
    group: Index, places: Float, measured: Measured, error_at: Callable[[Float], Float], plan: FitPlan
) -> tuple[Float, Float, float] | None:
    """One fit over a group's cells without their margin: motion and covariance in the map, and its area.

    Args:
        places: (n, 3) of all windows.
    """
    frame = measured.facets.frames[int(measured.facet[group[0]])]
    flat = frame.to_plane(places[group])[:, :2]
    reach = measured.spacing + measured.search.limit / 2 + 1.0
    middle = np.median(flat, axis=0)
    low = np.maximum(flat.min(axis=0), middle - _MAX_FIT_WIDTH_M / 2) - reach
    high = np.minimum(flat.max(axis=0), middle + _MAX_FIT_WIDTH_M / 2) + reach
    corner = low
    rows, columns = (int(n) for n in np.ceil((high - low) / NODE_M) + 1)
    inside = _inside(group, places, measured, frame, corner, (rows, columns))
    node = _without_margin(inside, plan.margin)
    stride = measured.search.stride
    at = np.argwhere(node)
    at = at[((at % stride) == 0).all(axis=1)]
    if not len(at):
        return None
    centre = np.rint(at.mean(axis=0)).astype(np.int64)
    region = Region.of_nodes(at[:, 0] - centre[0], at[:, 1] - centre[1], BLOCK_SHARE * plan.width / 2)
    first, later = (
        gridded(in_frame(frame, _cut(xyz, frame, low, high)), corner, (rows, columns), measured.search.kernel).values
        for xyz in measured.clouds
    )
    fit = fit_motion(first, later, region, (int(centre[0]), int(centre[1])), plan.start, measured.search.limit)
    if not isinstance(fit, Fit) or not fit.converged:
        return None
    own = covariances([fit], [region.blocks * fit.seen], measured.common)[0]
    place = places[group].mean(axis=0)
    motion = frame.axes.T @ fit.motion - measured.taken_off
    covariance = frame.axes.T @ own @ frame.axes + error_at(place[None])[0]
    return motion, covariance, len(at) * (stride * NODE_M) ** 2


def _cut(xyz: Ground, frame: Frame, low: Float, high: Float) -> Float:
    if isinstance(xyz, StoredGround):
        return xyz.in_plane(frame, low, high)
    flat = frame.to_plane(xyz)[:, :2]
    return np.asarray(xyz[((flat >= low) & (flat <= high)).all(axis=1)])


def _inside(group: Index, places: Float, measured: Measured, frame: Frame, corner: Float, shape: Shape) -> Bool:
    """Which nodes of the plane's grid lie in the group's cells on the map."""
    flat = frame.to_plane(places[group])
    design = np.column_stack([np.ones(len(flat)), flat[:, :2]])
    height = np.linalg.lstsq(design, flat[:, 2], rcond=None)[0]
    u, v = (corner[k] + np.arange(shape[k]) * NODE_M for k in (0, 1))
    above = height[0] + height[1] * u[:, None] + height[2] * v[None, :]
    xy = [
        frame.origin[k] + frame.axes[0, k] * u[:, None] + frame.axes[1, k] * v[None, :] + frame.axes[2, k] * above
        for k in (0, 1)
    ]
    cells = measured.cells[group]
    origin = places[group[0], :2] - (cells[0] + 0.5) * measured.spacing
    low = cells.min(axis=0) - 1
    taken = np.zeros(cells.max(axis=0) - low + 2, dtype=bool)
    taken[tuple((cells - low).T)] = True
    index = [np.floor((xy[k] - origin[k]) / measured.spacing).astype(np.int64) - low[k] for k in (0, 1)]
    return np.asarray(taken[tuple(np.clip(index[k], 0, taken.shape[k] - 1) for k in (0, 1))])


def _without_margin(inside: Bool, margin: float) -> Bool:
    """Without what lies nearer to the edge than ``margin``, or than leaves enough to fit."""
    depth = ndimage.distance_transform_edt(inside) * NODE_M
    for share in (1.0, 0.75, 0.5, 0.25):
        left = depth > share * margin
        if np.count_nonzero(left) * NODE_M**2 >= _MIN_FIT_AREA_M2:
            return np.asarray(left)
    return inside
