"""The scales of M3C2 from the clouds themselves, and core points spread over the reference.

Rules: the normal is fitted over at least 20 to 25 times the roughness at that scale (Lague et al. 2013,
doi:10.1016/j.isprsjprs.2013.04.009, section 4.2), a cylinder holds some 20 to 30 points of the sparser cloud, and
it reaches twice as far as the surfaces are apart.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from shapely import contains_xy
from shapely.geometry.base import BaseGeometry

from ...interface.parameters import DistanceParameters, given
from ..core.arrays import Bool, Float, Index
from ..core.errors import InputError
from ..core.progress import Progress
from .distances import Cylinder, cylinder_statistics
from .nearest import nearest_distances
from .normals import Fits, fit_planes
from .surveys import Box, HeldSurvey, Survey, boxes, pieces

NORMAL_RATIO, MIN_NORMAL_RATIO = 25.0, 20.0  # normal scale over roughness
CYLINDER_POINTS = 25.0
_MAX_PLACES = 1000  # places at which scales are tried
_MAX_DISTANCE_POINTS = 200_000  # points whose distance to the other cloud is taken
_MIN_AGREEING_POINTS = 20  # so many of them must be so far apart, else they are outliers; fewer of a small cloud
_SMALLEST_BALL_POINTS = 10  # points in the smallest ball tried
_STEPS = 13  # of the square root of two: up to 64 times the first
_MAX_BALL_POINTS = 400  # about so many points of a ball are used; more do not make its plane surer


@dataclass(frozen=True)
class Scales:
    """Diameters of the normal's ball and of the cylinder, half length of the cylinder, spacing of core points; metres.

    ``roughness`` is the median standard deviation about the fitted planes and ``normal_ratio`` the median of the
    normal scale over it; ``density`` the points a square metre of the surface that three quarters of the places exceed
    in the sparser cloud; ``separation`` how far apart the surfaces are at most. ``warnings`` are sentences.
    """

    normal_scale: float
    projection_scale: float
    half_length: float
    core_spacing: float
    roughness: float
    normal_ratio: float
    density: float
    separation: float
    warnings: tuple[str, ...] = ()


Cloud = Survey | Float
"""A cloud as M3C2 looks at it, or points (n, 3) in memory, metres."""


def choose_scales(
    reference: Cloud,
    moving: Cloud,
    parameters: DistanceParameters,
    progress: Progress | None = None,
    area: BaseGeometry | None = None,
) -> Scales:
    """Scales for two clouds; what ``parameters`` gives (not 0) is taken as given.

    Args:
        area: polygons of the reference on which they are chosen; None: all of it.

    Raises:
        InputError: too few points to choose scales.
    """
    progress = progress or Progress()
    reference, moving = _survey(reference), _survey(moving)
    bounds = overlap_bounds(reference, moving, area)
    places = _sample(reference, bounds, area)
    if len(places) < 10 or len(moving) < 10:
        if area is not None:
            raise InputError(
                "Fewer than 10 points lie where the region and both clouds overlap, too few to choose scales; check "
                "the region of --roi."
            )
        raise InputError(
            "Fewer than 10 points lie where the two clouds overlap, too few to choose scales; check that both are of "
            "the same slope and in the same reference system."
        )
    progress.update(0.0, "choosing the normal scale")
    first = 2 * float(np.median(nearest_distances(reference, places, _SMALLEST_BALL_POINTS)))
    if not first > 0:
        raise InputError("The reference consists of duplicate points; remove them first.")
    normal_scale, fits, warnings = _normal_scale(reference, places, first, given(parameters.normal_scale))
    roughness = float(np.median(fits.roughness[fits.found])) if fits.found.any() else math.nan
    progress.update(0.4, "choosing the cylinder")
    separation = _separation(_overlapping(reference, bounds, area), moving)
    directed = fits.normal if fits.found.any() else np.tile([0.0, 0.0, 1.0], (len(places), 1))
    reach = max(2 * separation, 10 * (roughness if math.isfinite(roughness) else 0.0))
    density = _density(reference, moving, places, directed, normal_scale / 2, given(parameters.half_length) or reach)
    progress.update(0.9, "choosing the cylinder")
    projection = given(parameters.projection_scale) or _round_up(2 * math.sqrt(CYLINDER_POINTS / (math.pi * density)))
    half_length = given(parameters.half_length) or _round_up(max(reach, projection / 2))
    return Scales(
        normal_scale=normal_scale,
        projection_scale=projection,
        half_length=half_length,
        core_spacing=given(parameters.core_spacing) or _plain_below(projection / 2),
        roughness=roughness,
        normal_ratio=normal_scale / roughness if roughness > 0 else math.inf,
        density=density,
        separation=separation,
        warnings=warnings,
    )


def overlap_bounds(
    reference: Cloud, moving: Cloud, area: BaseGeometry | None = None
) -> tuple[float, float, float, float]:
    """West, south, east, north of the area that both clouds' extents share, as far as that of ``area`` goes.

    Raises:
        InputError: they share none; both extents are named.
    """
    ((w1, s1, _), (e1, n1, _)), ((w2, s2, _), (e2, n2, _)) = (_survey(c).bounds for c in (reference, moving))
    west, south, east, north = max(w1, w2), max(s1, s2), min(e1, e2), min(n1, n2)
    if west > east or south > north:
        raise InputError(
            f"The clouds do not overlap: the reference spans x {w1:.1f} to {e1:.1f}, y {s1:.1f} to {n1:.1f}, the later "
            f"survey x {w2:.1f} to {e2:.1f}, y {s2:.1f} to {n2:.1f}; check that both are of the same slope and in the "
            "same reference system."
        )
    if area is not None:
        w, s, e, n = area.bounds
        west, south, east, north = max(west, w), max(south, s), min(east, e), min(north, n)
    return float(west), float(south), float(east), float(north)


def spread_cores(reference: Float, spacing: float, bounds: tuple[float, float, float, float]) -> NDArray[np.bool_]:
    """Which points (n,) of the reference are core points: in each cube of ``spacing`` metres the one nearest to the
    mean of its points, within ``bounds`` (west, south, east, north).
    """
    west, south, east, north = bounds
    x, y = reference[:, 0], reference[:, 1]
    inside = np.flatnonzero((x >= west) & (x <= east) & (y >= south) & (y <= north))
    xyz = reference[inside]
    cube = _cubes(xyz, spacing)
    order = np.lexsort(cube.T)
    cube = cube[order]
    new = np.concatenate([[True], (cube[1:] != cube[:-1]).any(axis=1)]) if len(cube) else np.zeros(0, dtype=bool)
    starts = np.flatnonzero(new)
    members = np.diff(np.append(starts, len(cube)))
    chosen = np.zeros(len(reference), dtype=bool)
    if len(starts):
        sorted_xyz, corner = xyz[order], cube * spacing
        # from the cube's own corner, so that nothing outside of a cube counts in it
        mean = np.add.reduceat(sorted_xyz - corner, starts, axis=0) / members[:, None] + corner[starts]
        away = np.sum((sorted_xyz - np.repeat(mean, members, axis=0)) ** 2, axis=1)
        group = np.repeat(np.arange(len(starts)), members)
        nearest = np.lexsort((inside[order], away, group))
        chosen[inside[order][nearest[starts]]] = True
    return chosen


def _cubes(xyz: Float, spacing: float) -> Index:
    # the cells of the rasters are cut as gridding.cell_index cuts them
    return np.floor(xyz / spacing + 1e-6).astype(np.int64)


def survey_cores(
    reference: Survey, spacing: float, bounds: tuple[float, float, float, float], area: BaseGeometry | None = None
) -> tuple[Float, Index]:
    """The core points (m, 3) of ``spread_cores`` and their numbers (m,) in the cloud, in its order.

    Of those without an ``area`` it keeps the ones inside.
    """
    found = [(np.zeros((0, 3)), np.zeros(0, dtype=np.int64))]
    reach = 0.51 * spacing  # around the middle of a cube
    root = Box(*bounds[:2], *(float(np.nextafter(end, np.inf)) for end in bounds[2:])).grown(spacing)
    for box in boxes([reference], root, reach):
        near = reference.within(box.grown(reach))
        chosen = np.flatnonzero(spread_cores(near.xyz, spacing, bounds))
        # a cube is that box's in which its middle lies; all of its points are near then
        middles: Float = (_cubes(near.xyz[chosen], spacing).astype(np.float64) + 0.5) * spacing
        own = chosen[box.holds(middles)]
        found.append((near.xyz[own], near.number[own]))
    xyz, number = (np.concatenate(arrays) for arrays in zip(*found, strict=True))
    order = np.argsort(number)
    order = order[inside(area, xyz[order])]
    return xyz[order], number[order]


def inside(area: BaseGeometry | None, xyz: Float) -> Bool:
    """Which points (n, 3) lie in polygons, seen from above; None: all."""
    return np.ones(len(xyz), dtype=bool) if area is None else np.asarray(contains_xy(area, *xyz[:, :2].T))


def survey_planes(survey: Survey, places: Float, diameter: float, *, share: float = 1.0) -> Fits:
    """``fit_planes`` at places (m, 3), to about a ``share`` of a cloud's points."""
    fits = Fits(np.zeros_like(places), np.full(len(places), np.nan), np.zeros(len(places), dtype=np.int64))
    reach = diameter / 2 * (1 + 1e-6)
    for box in boxes([survey], Box.around(places), reach, share=share):
        here = np.flatnonzero(box.holds(places))
        if not len(here):
            continue
        lattice = survey.within(box.grown(reach)).some(share).lattice(diameter / 2, survey.frame)
        made = fit_planes(lattice, places[here], diameter)
        fits.normal[here], fits.roughness[here], fits.count[here] = made.normal, made.roughness, made.count
    return fits


def survey_counts(survey: Survey, places: Float, normal: Float, cylinder: Cylinder) -> Index:
    """Points of a cloud in the cylinders at places (m, 3) along ``normal`` (m, 3), of length 1: (m,)."""
    count = np.zeros(len(places), dtype=np.int64)
    reach = math.hypot(cylinder.radius, cylinder.half_length) * (1 + 1e-6)
    for box, near in pieces(survey):
        here = np.flatnonzero(box.distance(places) <= reach)
        if len(here):
            lattice = near.lattice(cylinder.radius, survey.frame)
            count[here] += cylinder_statistics(lattice, places[here], normal[here], cylinder).count
    return count


def _survey(cloud: Cloud) -> Survey:
    return HeldSurvey(cloud) if isinstance(cloud, np.ndarray) else cloud


def _sample(reference: Survey, bounds: tuple[float, float, float, float], area: BaseGeometry | None) -> Float:
    """Places spread evenly over the reference's surface in the overlap, always the same."""
    west, south, east, north = bounds
    side = math.sqrt(max((east - west) * (north - south), 1e-12) / (2 * _MAX_PLACES))
    places = survey_cores(reference, side, bounds, area)[0]
    if len(places) > _MAX_PLACES:
        places = places[np.sort(np.random.default_rng(0).choice(len(places), _MAX_PLACES, replace=False))]
    return places


def _normal_scale(
    reference: Survey, places: Float, first: float, stated: float | None
) -> tuple[float, Fits, tuple[str, ...]]:
    """The smallest scale, in steps of the square root of two, that is ``NORMAL_RATIO`` times its own roughness."""
    if stated is not None:
        return stated, survey_planes(reference, places, stated), ()
    low, high = reference.bounds
    largest = math.dist(low[:2], high[:2]) / 2
    best: tuple[float, float, Fits] | None = None
    for step in range(_STEPS):
        scale = _round_up(first * math.sqrt(2) ** step)
        if step and scale > largest:
            break
        share = min(1.0, _MAX_BALL_POINTS / (_SMALLEST_BALL_POINTS * 2.0**step))
        fits = survey_planes(reference, places, scale, share=share)
        if fits.found.mean() < 0.8:
            continue
        roughness = float(np.median(fits.roughness[fits.found]))
        ratio = scale / roughness if roughness > 0 else math.inf
        if best is None or ratio > best[0]:
            best = ratio, scale, fits
        if ratio >= NORMAL_RATIO:
            break
    if best is None:
        scale = _round_up(first * 2)
        warning = "The points fix no normals at any scale (they lie on lines, perhaps); give --normal-scale."
        return scale, survey_planes(reference, places, scale), (warning,)
    ratio, scale, fits = best
    if ratio >= MIN_NORMAL_RATIO:
        return scale, fits, ()
    warning = (
        f"At no scale is the surface plane enough for sure normals: {scale:g} m, the best, is only {ratio:.1f} times "
        f"the roughness ({MIN_NORMAL_RATIO:.0f} to {NORMAL_RATIO:.0f} are wanted); is vegetation left in the clouds?"
    )
    return scale, fits, (warning,)


def _separation(some: Float, moving: Survey) -> float:
    """How far points (n, 3) of the reference are from the moving cloud where that lies above or below them, metres."""
    horizontal = nearest_distances(moving, some[:, :2])
    covered = horizontal <= 3 * np.median(horizontal)
    apart = np.sort(nearest_distances(moving, some[covered]))
    return float(apart[-min(_MIN_AGREEING_POINTS, 1 + len(apart) // 1000)])


def _overlapping(reference: Survey, bounds: tuple[float, float, float, float], area: BaseGeometry | None) -> Float:
    """Every k-th of the points within bounds and area, (n, 3), of a large cloud."""
    west, south, east, north = bounds

    def within() -> Iterator[Float]:
        for xyz in reference.parts():
            x, y = xyz[:, 0], xyz[:, 1]
            xyz = xyz[(x >= west) & (x <= east) & (y >= south) & (y <= north)]
            yield xyz[inside(area, xyz)]

    step, done, found = max(1, sum(len(xyz) for xyz in within()) // _MAX_DISTANCE_POINTS), 0, []
    for xyz in within():
        found.append(xyz[-done % step :: step])
        done += len(xyz)
    return np.concatenate(found)


def _density(
    reference: Survey, moving: Survey, places: Float, normal: Float, radius: float, half_length: float
) -> float:
    """Points a square metre, across the normal, that three quarters of the places exceed in the sparser cloud."""
    per_cloud = []
    for cloud in (reference, moving):
        count = survey_counts(cloud, places, normal, Cylinder(radius, half_length))
        per_cloud.append(count / (math.pi * radius**2))
    sparser = np.minimum(*per_cloud)
    if not (sparser > 0).any():
        raise InputError(
            "No place of the reference has points of the later survey above or below it along the normal; give a "
            "larger --half-length, or check that the clouds are registered."
        )
    return float(np.percentile(sparser[sparser > 0], 25))


def _round_up(value: float) -> float:
    """The next number of two significant digits."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / unit - 1e-9) * unit:.6g}")


def _plain_below(value: float) -> float:
    """The largest of 1, 2, 2.5, 5 times a power of ten that is not above ``value``, for a raster's cells."""
    power = 10.0 ** math.floor(math.log10(value))
    return float(f"{max(s * power for s in (1.0, 2.0, 2.5, 5.0) if s * power <= value * (1 + 1e-9)):.6g}")
