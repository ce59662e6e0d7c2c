"""Hazards of known place and height put into the ground points of a surveyed slope.

A real slope has relief, gaps and noise that no simulation has; what is put into it is known exactly. The bulges and
depressions are the smooth ones of ``geometry.hazard_shapes``, evaluated at the points themselves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from ...engine.core.arrays import Bool, Float
from ...engine.core.errors import InputError
from ...engine.geometry.dominant_plane import apply_matrix, fit_plane, flattening_matrix
from ...engine.geometry.hazard_shapes import Hazard, displacement_at, reach, smooth_hazard
from .scenes import BACKGROUND, HAZARD_FIELDS, SUBSIDENCE, UPLIFT
from .styles import THRESHOLD

KNOWN_FIELDS = np.dtype([*HAZARD_FIELDS.descr, ("z", np.float64), ("diameter", np.float64), ("points", np.int64)])
"""``HAZARD_FIELDS``, where ``amplitude`` is without sign, and height of the middle, nominal diameter (m), points."""
PLANE_DISTANCE, PLANE_ITERATIONS = 1.0, 64
NODE = 0.25
"""Spacing (m) of the places that are tried."""
MARGIN_M = 1.0
"""Untouched ground between two hazards, m."""
AREA_CELLS = 400


@dataclass(frozen=True)
class Site:
    """Where hazards may be put.

    ``minimum_density`` (points a m² of the slope's plane) must lie on the hazard and ``MARGIN_M`` m around it; ``gap``
    (m) is the farthest that any place there may be from a point, which keeps hazards off edges and holes.
    """

    minimum_density: float = 4.0
    gap: float = 0.75


@dataclass(frozen=True)
class KnownHazards:
    """A cloud with hazards in it, and the truth.

    ``xyz`` (n, 3) m, in the order of the input. Per point: ``label`` (0 background, 1 uplift, 2 subsidence), ``hazard``
    (id in ``hazards``, -1 where there is none) and ``displacement`` (m, along ``normal``). ``hazards`` (fields
    ``KNOWN_FIELDS``) has a row for each that found a place. ``matrix`` (4, 4) leads to the flat frame, in which
    ``shapes`` are given.
    """

    xyz: Float
    label: NDArray[np.uint8]
    hazard: NDArray[np.int32]
    displacement: Float
    hazards: NDArray[np.void]
    shapes: tuple[Hazard, ...]
    matrix: Float
    limit: float

    @property
    def normal(self) -> Float:
        """(3,) unit normal of the slope's plane, upwards."""
        return self.matrix[2, :3].copy()


def put_hazards(
    xyz: Float,
    wanted: Sequence[tuple[float, float]],
    seed: int,
    *,
    site: Site | None = None,
    limit: float = THRESHOLD,
) -> KnownHazards:
    """Move ground points along the slope's normal by hazards at random places.

    The middle of each is displaced by its full height, points outside its super-ellipse not at all. Hazards do not
    overlap. One for which there is no room is left out.

    Args:
        xyz: (n, 3) ground points, m.
        wanted: height (m, negative for a depression) and diameter (m) of each; the diameter is that of the circle
            with the same product of the axes.
        seed: of places and shapes; the same one gives the same cloud.
        limit: displacement (m) beyond which a point is labelled.

    Raises:
        InputError: a height or diameter is none, or the plane of the slope cannot be found.
    """
    for height, diameter in wanted:
        if not (math.isfinite(height) and height != 0 and math.isfinite(diameter) and diameter > 0):
            raise InputError(
                f"A hazard of {height} m height and {diameter} m diameter cannot be put in; give a height other than 0 "
                "and a diameter above 0."
            )
    site = site or Site()
    rng = np.random.default_rng(seed)
    matrix = flattening_matrix(fit_plane(xyz, PLANE_DISTANCE, PLANE_ITERATIONS, 0))
    flat = apply_matrix(matrix, xyz)
    ground = _Ground(flat[:, :2], site)
    drawn = [smooth_hazard(height, diameter, rng) for height, diameter in wanted]
    placed: list[tuple[int, Hazard]] = []
    # Large ones first: they find no room later.
    for number in sorted(range(len(drawn)), key=lambda i: -reach(drawn[i])):
        place = ground.free_place(reach(drawn[number]), rng)
        if place is not None:
            placed.append((number, replace(drawn[number], u=place[0], w=place[1])))
    shapes = tuple(hazard for _, hazard in sorted(placed, key=lambda pair: pair[0]))
    displacement, identity = np.zeros(len(xyz)), np.full(len(xyz), -1, dtype=np.int32)
    for number, hazard in enumerate(shapes):
        moved = displacement_at(hazard, flat[:, 0], flat[:, 1])
        identity[moved != 0] = number
        displacement += moved
    label = np.where(displacement > limit, UPLIFT, np.where(displacement < -limit, SUBSIDENCE, BACKGROUND))
    table = _table(shapes, flat, np.bincount(identity[(identity >= 0) & (label > 0)], minlength=len(shapes)), limit)
    back = np.column_stack([table["x"], table["y"], table["z"], np.ones(len(table))]) @ np.linalg.inv(matrix).T
    table["x"], table["y"], table["z"] = back[:, 0], back[:, 1], back[:, 2]
    moved_xyz = xyz + displacement[:, None] * matrix[2, :3]
    return KnownHazards(moved_xyz, label.astype(np.uint8), identity, displacement, table, shapes, matrix, limit)


def room_for(xyz: Float, diameter: float, site: Site | None = None) -> float:
    """Area (m²) of the slope's plane on which the middle of a round hazard of this diameter (m) may lie.

    Raises:
        InputError: the plane of the slope cannot be found.
    """
    matrix = flattening_matrix(fit_plane(xyz, PLANE_DISTANCE, PLANE_ITERATIONS, 0))
    ground = _Ground(apply_matrix(matrix, xyz)[:, :2], site or Site())
    return float(np.count_nonzero(ground.free(diameter / 2)) * NODE**2)


class _Ground:
    """Where points lie in the plane, and what is taken so far."""

    def __init__(self, xy: Float, site: Site) -> None:
        self.site, self.tree = site, cKDTree(xy)
        low, high = xy.min(axis=0), xy.max(axis=0)
        counts = np.ceil((high - low) / NODE).astype(int) + 1
        axes = [low[i] + NODE * np.arange(counts[i]) for i in (0, 1)]
        self.nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        near = self.tree.query(self.nodes, distance_upper_bound=site.gap)[0] <= site.gap
        # Beyond the raster there is no ground.
        padded = np.pad(near.reshape(counts), 1)
        self.room = (distance_transform_edt(padded)[1:-1, 1:-1] * NODE).ravel()

    def free(self, radius: float) -> Bool:
        """(nodes,) where a circle of ``radius`` m and its surroundings are free and dense enough."""
        wide = radius + MARGIN_M
        # Nodes up to a gap beyond an edge are near a point.
        free = self.room >= max(radius + self.site.gap, wide)
        where = np.flatnonzero(free)
        count = self.tree.query_ball_point(self.nodes[where], wide, return_length=True)
        free[where] = np.asarray(count) >= self.site.minimum_density * math.pi * wide**2
        return free

    def free_place(self, radius: float, rng: np.random.Generator) -> tuple[float, float] | None:
        """A random place for a hazard within ``radius`` m, which is then taken; None where there is none."""
        choices = np.flatnonzero(self.free(radius))
        if not len(choices):
            return None
        place = self.nodes[choices[rng.integers(len(choices))]]
        left = np.hypot(*(self.nodes - place).T) - radius
        np.minimum(self.room, left - max(0.0, self.site.gap - MARGIN_M), out=self.room)
        return float(place[0]), float(place[1])


def _table(shapes: Sequence[Hazard], flat: Float, points: NDArray[np.intp], limit: float) -> NDArray[np.void]:
    """Rows of ``KNOWN_FIELDS`` with places in the flat frame."""
    table = np.zeros(len(shapes), dtype=KNOWN_FIELDS)
    tree = cKDTree(flat[:, :2])
    for number, hazard in enumerate(shapes):
        far = reach(hazard)
        axis = np.linspace(-far, far, AREA_CELLS)
        u, w = np.meshgrid(hazard.u + axis, hazard.w + axis)
        labelled = np.abs(displacement_at(hazard, u.ravel(), w.ravel())) > limit
        area = float(np.count_nonzero(labelled)) * float(axis[1] - axis[0]) ** 2
        around = tree.query_ball_point((hazard.u, hazard.w), max(far, 1.0))
        row = table[number]
        row["id"] = row["hazard"] = number
        row["kind"] = hazard.kind
        row["label"] = UPLIFT if hazard.height > 0 else SUBSIDENCE
        row["amplitude"], row["area"], row["size"] = abs(hazard.height), area, 2 * math.sqrt(area / math.pi)
        row["x"], row["y"], row["z"] = hazard.u, hazard.w, float(np.median(flat[around, 2]))
        row["diameter"], row["points"] = 2 * math.sqrt(hazard.half_u * hazard.half_w), points[number]
    return table
