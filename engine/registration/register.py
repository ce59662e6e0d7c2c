"""Registration of a later epoch to the first, and its error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from ...interface.parameters import RegistrationParameters
from ..core.arrays import Float
from ..core.errors import InputError
from ..core.progress import Progress
from ..geometry.pose import Pose
from ..pointcloud.plant_cover import PlantCover
from .alignment import Alignment, align, without_slides
from .bare_ground import MAX_SCALE_RATIO, Covered, align_bare, divide, offset_of_covered
from .checks import check_overlap, check_points, check_shape, inside
from .explanation import explain
from .icp import icp
from .measured import Measured, Solution, measured, of_alignment
from .moved_surface import on_what_stayed
from .observability import name_unobservable, weakest_direction
from .point_to_plane import Matcher
from .result import PlantsInRegistration, RegistrationResult
from .surface import Surface, nearest

_NEIGHBOUR_SAMPLE = 25_000
_MIN_PLANT_ERROR_M = 1e-3  # metres of a registration's error caused by plants: below, leaving them out gains nothing


def register(
    reference: Float,
    moving: Float,
    parameters: RegistrationParameters,
    *,
    stable: BaseGeometry | None = None,
    plants: tuple[PlantCover | None, PlantCover | None] = (None, None),
    progress: Progress | None = None,
) -> RegistrationResult:
    """Register ``moving`` (m, 3) to ``reference`` (n, 3), both in metres of one reference system.

    Where the clouds know their plants, the robust method takes bare ground alone if that states the smaller error (see
    ``bare_ground``).

    Args:
        stable: area known to be stable, in the same system; only the reference's points within it are used by the
            robust method and by the quality figures.
        plants: the plants over the points of each cloud, as far as the clouds record them.

    Raises:
        InputError: no overlap, too few points, coordinates that are not finite, points on one line, or a stable area
            without points.
    """
    progress = progress or Progress()
    check_points(reference, "earlier")
    check_points(moving, "later")
    check_overlap(reference, moving, parameters.maximum_offset)
    centre = np.median(reference, axis=0)  # in the middle of the points even where a stray one stretches the extent
    a, b = reference - centre, moving - centre
    progress.update(0.0, "averaging points")
    surfaces = _surface(a, plants[0], parameters), _surface(b, plants[1], parameters)
    check_shape(surfaces[0].points, "earlier")
    check_shape(surfaces[1].points, "later")
    matcher = Matcher(*surfaces, None if stable is None else inside(stable, surfaces[0].points + centre))
    tree = cKDTree(a, balanced_tree=False, compact_nodes=False)
    with progress.stage(0.05, 0.8):
        solution = _solve(a, b, tree, matcher, parameters, progress)
    progress.update(0.8, "measuring the agreement")
    found = measured(solution, matcher, parameters, stable is not None, progress)
    if solution.alignment is not None and matcher.knows_plants:
        with progress.stage(0.82, 0.88):
            found = _with_plants(found, solution.alignment, matcher, parameters, stable is not None, progress)
    if solution.alignment is not None and stable is None:
        with progress.stage(0.88, 0.95):
            found = on_what_stayed(found, solution.alignment, matcher, parameters, progress)
    solution = found.solution
    some = b[:: max(1, len(b) // _NEIGHBOUR_SAMPLE)]
    before = nearest(tree, some)[0]
    after = before if parameters.method == "none" else nearest(tree, solution.apply(some))[0]
    return _result(found, before, after, centre, len(b), parameters, stable is not None)


def _solve(
    a: Float,
    b: Float,
    tree: cKDTree,
    matcher: Matcher,
    parameters: RegistrationParameters,
    progress: Progress,
) -> Solution:
    """By the method asked for, in local coordinates."""
    if parameters.method == "icp":
        return icp(
            a,
            b,
            distance=parameters.maximum_correspondence,
            iterations=parameters.registration_iterations,
            tree=tree,
            progress=progress,
        )
    if parameters.method == "robust":
        found = align(matcher, parameters, progress)
        # what slid is looked for once, on the ground that is registered by in the end
        later = matcher.knows_plants
        return of_alignment(found if later else without_slides(matcher, found, parameters.maximum_offset, progress))
    return Solution(Pose.identity())


def _surface(xyz: Float, plants: PlantCover | None, parameters: RegistrationParameters) -> Surface:
    if plants is None:
        return Surface(xyz, parameters.registration_voxel)
    heights = None if plants.height is None else np.asarray(plants.height, dtype=np.float64)
    return Surface(xyz, parameters.registration_voxel, np.asarray(plants.error, dtype=np.float64), heights)


def _with_plants(
    found: Measured,
    alignment: Alignment,
    matcher: Matcher,
    parameters: RegistrationParameters,
    stable_given: bool,
    progress: Progress,
) -> Measured:
    """By all ground or by bare ground alone, without what slid."""
    ground = divide(matcher)
    if ground is not None:
        found = _surer(found, alignment, ground, parameters, stable_given, progress)
    if found.bare or found.solution.left:
        return found
    rests = without_slides(matcher, alignment, parameters.maximum_offset, progress)
    if rests is alignment:
        return found
    return replace(measured(of_alignment(rests), matcher, parameters, stable_given, progress), ground=found.ground)


def _surer(
    all_ground: Measured,
    alignment: Alignment,
    ground: Covered,
    parameters: RegistrationParameters,
    stable_given: bool,
    progress: Progress,
) -> Measured:
    """By all ground or by bare ground alone, whichever states the smaller error."""
    all_ground = replace(all_ground, ground=ground)
    if all_ground.by_plants < _MIN_PLANT_ERROR_M:
        return all_ground
    try:
        found = align_bare(ground, alignment, parameters, progress)
        if found is None:
            return all_ground
        bare = measured(of_alignment(found), ground.bare, parameters, stable_given, progress, ground)
    except InputError:  # the two surveys are not bare in the same places
        return all_ground
    if bare.solution.left or bare.error >= all_ground.error:
        return all_ground
    if bare.quality.scale > MAX_SCALE_RATIO * all_ground.quality.scale:  # bare ground that fits scatters less
        return all_ground
    offset = offset_of_covered(ground, bare.solution.pose, parameters.maximum_offset)
    return replace(bare, ground=ground, bare=True, offset=offset)


def _result(
    found: Measured,
    before: Float,
    after: Float,
    centre: Float,
    points: int,
    parameters: RegistrationParameters,
    stable_given: bool,
) -> RegistrationResult:
    """Args: before, after: nearest-neighbour distances of a sample of the moving cloud's ``points``, metres."""
    solution, quality = found.solution, found.quality
    pose, information = solution.pose, solution.information
    moved = quality.places if len(quality.places) else quality.sample  # nothing is stable
    shift = pose.apply(moved).mean(axis=0) - moved.mean(axis=0)
    names = () if information is None else name_unobservable(information, quality.mean_normal)
    close = after[after <= parameters.maximum_correspondence]
    plants = None
    if found.ground is not None:
        plants = PlantsInRegistration(found.ground.bare_share, found.bare, found.by_plants, found.offset)
    return RegistrationResult(
        transform=solution.transform(centre),
        method=parameters.method,
        iterations=solution.iterations,
        converged=solution.converged,
        inlier_rmse=float(np.sqrt(np.mean(close**2))) if len(close) else 0.0,
        inliers=round(len(close) * points / len(after)),
        nn_rmse_before=float(np.sqrt(np.mean(before**2))),
        nn_rmse_after=float(np.sqrt(np.mean(after**2))),
        agreement=quality,
        normal_translation=float(shift @ quality.mean_normal),
        vertical_translation=float(shift[2]),
        covariance=_covariance(solution) if parameters.method == "robust" else None,
        condition=None if information is None else information.condition,
        unobservable=names,
        weakest=None if information is None else weakest_direction(information, quality.mean_normal),
        bend=solution.bend,
        registration_error=found.error,
        warnings=explain(found, parameters, shift, names, stable_given=stable_given),
        plants=plants,
        slid=0.0 if solution.alignment is None else solution.alignment.slid,
    )


def _covariance(solution: Solution) -> Float | None:
    """(6, 6) of rotations (radians) and translation (m)."""
    if solution.information is None:
        return None
    scale = np.diag([1 / solution.radius] * 3 + [1.0] * 3)
    return scale @ solution.information.covariance @ scale
