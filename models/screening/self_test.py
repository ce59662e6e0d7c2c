"""A test of screening on the user's own ground: hazards of known size are put in, and screened as the run screens.

What is found of them is what this screening finds on this slope. Zones of the untouched ground count as false, though
hazards of the slope's own are among them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import geopandas as gpd
import numpy as np
import shapely
from scipy.spatial import cKDTree

from ...engine.core.arrays import Bool, Float
from ...engine.core.progress import Progress
from ...engine.geometry.dominant_plane import apply_matrix
from ...engine.geometry.hazard_shapes import Hazard, displacement_at, smooth_hazard
from ...interface.parameters import ScreeningParameters
from ..preparation.inserted_hazards import Placed, footprint, insert_hazards
from ..preparation.raster_zones import MIN_AREA_M2, PER_M2
from ..preparation.relief_raster import CELL_M, DIAMETERS_M
from .cloud_file import ScreenedFile
from .result import GroundPoints, Screening
from .screen import screen_points
from .zones import KINDS, Hazards, outline_hazards

HEIGHTS_M = (0.15, 0.3, 0.5, 0.8)
LOOKS = 2
"""Screenings of changed ground, each of which takes as long as the run's own."""
_FILLED = 0.12
"""Share of the ground that is displaced at a time: more would be the ground rather than lie on it."""


@dataclass(frozen=True)
class SelfTest:
    """Heights (m, signed) and nominal diameters (m) of the hazards put in, and whether each was ``found``, all (n,).

    ``zones`` were found on ``area`` m² of untouched ground.
    """

    heights: Float
    diameters: Float
    found: Bool
    zones: int
    area: float

    @property
    def false_zones(self) -> float:
        """Zones of the untouched ground per 1,000 m²."""
        return PER_M2 * self.zones / max(self.area, 1e-9)

    def figures(self) -> dict[str, Any]:
        """For the record: by height and by width how many were found of how many, and the false zones."""
        return {
            "found_by_height": {f"{h:g}": self._of(np.isclose(np.abs(self.heights), h)) for h in HEIGHTS_M},
            "found_by_width": {f"{d:g}": self._of(np.isclose(self.diameters, d)) for d in DIAMETERS_M},
            "false_zones_per_1000_m2": self.false_zones,
        }

    def sentence(self) -> str:
        """What was found, in one sentence."""
        by_height = self.figures()["found_by_height"].items()
        shown = ", ".join(f"{height} m: {n['found']} of {n['of']}" for height, n in by_height if n["of"])
        if not shown:
            return "Self-test: no hazard could be put in, because the ground has no room for any."
        return (
            f"Self-test: of {len(self.found)} hazards {DIAMETERS_M[0]:g} to {DIAMETERS_M[-1]:g} m wide that were put "
            f"into this ground, screening found by height {shown}; on the untouched ground it shows "
            f"{self.false_zones:.1f} zones per 1,000 m², false but for hazards that are there."
        )

    def _of(self, which: Bool) -> dict[str, int]:
        return {"found": int(self.found[which].sum()), "of": int(which.sum())}


def self_test(
    source: ScreenedFile, screening: Screening, hazards: Hazards, parameters: ScreeningParameters, progress: Progress
) -> SelfTest:
    """Put hazards into a file's ground ``LOOKS`` times and screen it.

    Args:
        screening, hazards: of the untouched ground.

    Raises:
        InputError: see ``screen_points``.
    """
    matrix = screening.voxels.matrix
    flat = apply_matrix(matrix, screening.points)
    cosine = float(np.cos(np.radians(screening.plane.dip)))
    area = float(np.isfinite(hazards.heights).sum()) * hazards.grid.cell**2 / cosine
    surface = cKDTree(flat[:, :2])
    rng = np.random.default_rng(len(flat))
    drawn = _drawn(rng)
    rows: list[tuple[float, float, bool]] = []
    for look in range(LOOKS):
        wanted = _that_fit(drawn, _FILLED * area)
        placed = insert_hazards(flat, wanted, rng).hazards
        with progress.stage(look / LOOKS, (look + 1) / LOOKS, "self-test"):
            source.progress = quiet = _Quiet(progress)
            try:
                changed = screen_points(_Changed(source, matrix, [one.shape for one in placed]), parameters, quiet)
            finally:
                source.progress = progress
            zones = outline_hazards(changed, source.frame.crs, parameters).frame
        for one in placed:
            places = _places(one, flat, surface, matrix)
            rows.append((one.shape.height, _nominal(one.diameter), _found(zones, KINDS[one.label], places)))
        taken = {one.number for one in placed}
        drawn = [h for n, h in enumerate(drawn) if n not in taken] or _drawn(rng)
    heights, diameters, found = np.array(rows, dtype=np.float64).reshape(-1, 3).T
    return SelfTest(heights, diameters, found > 0, len(hazards.frame), area)


class _Quiet(Progress):
    """Passes on how much is done; messages have been shown by the run."""

    def __init__(self, parent: Progress) -> None:
        super().__init__()
        self._parent = parent

    def emit(self, percent: float, message: str) -> None:
        self._parent.update(percent / 100.0, f"self-test: {message}" if message else "self-test")


class _Changed:
    """Ground points with hazards in them, otherwise as they are."""

    def __init__(self, ground: GroundPoints, matrix: Float, hazards: Sequence[Hazard]) -> None:
        self._ground, self._matrix, self._hazards = ground, matrix, hazards

    @property
    def name(self) -> str:
        return self._ground.name

    @property
    def classified(self) -> bool:
        return self._ground.classified

    @property
    def bare(self) -> bool:
        return self._ground.bare

    def parts(self) -> Iterator[Float]:
        # where the flat frame's axis square to the slope points on the map
        normal = np.linalg.inv(self._matrix)[:3, 2]
        for xyz in self._ground.parts():
            yield xyz + self._displacement(apply_matrix(self._matrix, xyz))[:, None] * normal

    def _displacement(self, flat: Float) -> Float:
        moved = np.zeros(len(flat))
        for hazard in self._hazards:
            u0, w0, u1, w1 = hazard.bounds
            u, w = flat[:, 0], flat[:, 1]
            near = np.flatnonzero((u > u0) & (u < u1) & (w > w0) & (w < w1))
            moved[near] += displacement_at(hazard, u[near], w[near])
        return moved


def _drawn(rng: np.random.Generator) -> list[Hazard]:
    """One of each height and width, in random order, up or down at random."""
    signs = rng.choice((-1.0, 1.0), (len(HEIGHTS_M), len(DIAMETERS_M)))
    every = [
        smooth_hazard(float(signs[i, j]) * height, diameter, rng)
        for i, height in enumerate(HEIGHTS_M)
        for j, diameter in enumerate(DIAMETERS_M)
    ]
    return [every[k] for k in rng.permutation(len(every))]


def _that_fit(hazards: list[Hazard], area: float) -> list[Hazard]:
    """The first hazards that together are not larger than ``area`` (m²), at least one."""
    sizes = np.cumsum([np.pi * hazard.half_u * hazard.half_w for hazard in hazards])
    return hazards[: max(1, int(np.searchsorted(sizes, area, side="right")))]


def _nominal(diameter: float) -> float:
    return min(DIAMETERS_M, key=lambda one: abs(one - diameter))


def _places(one: Placed, flat: Float, surface: cKDTree, matrix: Float) -> Float:
    """Map coordinates (n, 2) of the cells that a hazard displaces."""
    u0, w0, u1, w1 = one.shape.bounds
    origin = np.floor(np.array([u0, w0]) / CELL_M) * CELL_M
    shape = (int((u1 - origin[0]) / CELL_M) + 1, int((w1 - origin[1]) / CELL_M) + 1)
    i, j = np.nonzero(np.logical_or(*footprint(one.shape, origin, CELL_M, shape)))
    uw = origin + (np.column_stack([i, j]) + 0.5) * CELL_M
    height = flat[surface.query(uw)[1], 2] + displacement_at(one.shape, uw[:, 0], uw[:, 1])
    back = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
    return apply_matrix(back, np.column_stack([uw, height]))[:, :2]


def _found(zones: gpd.GeoDataFrame, kind: str, places: Float) -> bool:
    """Whether a zone of the kind covers a quarter of the places or 1 m² of the slope."""
    need = min(MIN_AREA_M2, 0.25 * len(places) * CELL_M**2) - 1e-9
    same = zones.geometry[zones["kind"] == kind]
    covered = [np.count_nonzero(shapely.contains_xy(zone, *places.T)) * CELL_M**2 for zone in same]
    return max(covered, default=0.0) >= need
