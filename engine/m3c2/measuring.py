"""M3C2 over two surveys, box by box where they are on the disk: normals, distances, and what lies beyond these."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...interface.parameters import DistanceParameters
from ..core.arrays import Float, Index
from ..core.progress import Progress
from ..pointcloud.point_squares import Box
from .distances import Cylinder, Distances, LevelTerms, Status, joined, m3c2_distances
from .level import slope_of
from .normals import fit_planes
from .scales import Scales, survey_counts
from .surveys import Near, Survey, boxes

_LONGER_CYLINDER_RATIO = 4.0  # cylinders so many times as long show whether points lie just beyond


@dataclass(frozen=True)
class Measuring:
    """How to measure: ``toward`` (3,), the side to which normals point, ``normals`` (m, 3) where they are given, and
    the registration's standard error, m.
    """

    parameters: DistanceParameters
    scales: Scales
    toward: Float
    registration_error: float
    normals: Float | None = None

    @property
    def fits(self) -> bool:
        """Whether planes are fitted, for the normals or for the slope."""
        upright = self.parameters.normals == "vertical" and not self.parameters.calibrate
        return self.normals is None and not upright

    @property
    def cylinder(self) -> Cylinder:
        return Cylinder(self.scales.projection_scale / 2, self.scales.half_length)

    @property
    def reach(self) -> float:
        """How far (m) around a core point its points lie."""
        far = math.hypot(self.cylinder.radius, self.cylinder.half_length)
        return max(far, self.scales.normal_scale / 2 if self.fits else 0.0) * (1 + 1e-6)


def measure(
    clouds: tuple[Survey, Survey], core: Float, how: Measuring, progress: Progress
) -> tuple[Distances, Float | None]:
    """Distances with their published level at core points (m, 3), and the surface's slope (m,) in degrees where the
    normals do not give it.

    Raises:
        InputError: the points around a core point are more than may be held.
    """
    found: list[tuple[Index, Distances]] = []
    slope: Float | None = None
    done = 0
    for box in boxes(clouds, Box.around(core), how.reach):
        here = np.flatnonzero(box.holds(core))
        if not len(here):
            continue
        with progress.stage(done / len(core), (done + len(here)) / len(core)):
            near = [cloud.within(box.grown(how.reach)) for cloud in clouds]
            distances, steep = _measured(clouds, (near[0], near[1]), core[here], how, here, progress)
        del near
        found.append((here, distances))
        if steep is not None:
            slope = np.full(len(core), np.nan) if slope is None else slope
            slope[here] = steep
        done += len(here)
    return joined(found), slope


def _measured(
    clouds: tuple[Survey, Survey], near: tuple[Near, Near], core: Float, how: Measuring, here: Index, progress: Progress
) -> tuple[Distances, Float | None]:
    """At the core points (k, 3), whose numbers are ``here`` (k,)."""
    parameters, slope = how.parameters, None
    upright = np.tile([0.0, 0.0, 1.0], (len(core), 1))
    normal = upright if how.normals is None else how.normals[here]
    if how.fits:
        scale = how.scales.normal_scale
        with progress.stage(0.0, 0.4, "fitting normals"):
            lattice = near[0].lattice(scale / 2, clouds[0].frame)
            fitted = fit_planes(lattice, core, scale, orientation=how.toward, progress=progress).normal
            del lattice
        normal, slope = (upright, slope_of(fitted)) if parameters.normals == "vertical" else (fitted, None)
    first, later = (n.lattice(how.cylinder.radius, cloud.frame) for n, cloud in zip(near, clouds, strict=True))
    terms = LevelTerms(parameters.minimum_cylinder_points, parameters.confidence, how.registration_error)
    with progress.stage(0.4, 1.0):
        found = m3c2_distances(
            (first, later), core, normal, how.cylinder, terms, spread=parameters.calibrate, progress=progress
        )
    return found, slope


def beyond_cylinder(later: Survey, found: Distances, cylinder: Cylinder) -> int:
    """Core points that have points of the later survey not in their cylinder, but in one of four times the length."""
    empty = (found.status == Status.NO_POINTS) & (found.moving.count == 0) & (found.reference.count > 0)
    if not empty.any():
        return 0
    longer = Cylinder(cylinder.radius, _LONGER_CYLINDER_RATIO * cylinder.half_length)
    return int(np.count_nonzero(survey_counts(later, found.core[empty], found.normal[empty], longer)))
