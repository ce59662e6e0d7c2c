"""Registration of a later epoch to the first, and its error."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from ...interface.parameters import RegistrationParameters
from ..core.arrays import Float
from ..core.errors import InputError
from ..core.progress import Progress
from ..geometry.height_correction import HeightCorrection
from ..geometry.pose import Pose
from ..geometry.rigid_transform import BentTransform, RigidTransform
from ..pointcloud.plant_cover import PlantCover
from .alignment import Alignment, align, observe
from .bare_ground import Covered, align_bare, compared_ground, divide, error_by_plants, offset_of_covered
from .bending import Bend, measure_bend
from .checks import check_overlap, check_points, check_shape, inside
from .icp import icp
from .observability import Information, height_sd, name_unobservable, relief_sd, weakest_direction
from .patch_registration import ENOUGH, OnPatches, align_on_patches, keeps
from .point_to_plane import Matcher
from .quality import NO_STABLE_GROUND, Agreement, agreement, explain, explain_plants, widened
from .result import PlantsInRegistration, RegistrationResult, StableGround
from .rival_parts import Standing, difference, refusal
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
    centre = np.median(reference, axis=0)  # amidst the points even where a stray one stretches the extent
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
    found = _measured(solution, matcher, parameters, stable is not None, progress)
    ground = divide(matcher) if parameters.method == "robust" else None
    if ground is not None and solution.alignment is not None:
        with progress.stage(0.82, 0.88):
            found = _surer(found, solution.alignment, ground, parameters, stable is not None, progress)
    if parameters.method == "robust" and stable is None:
        with progress.stage(0.88, 0.95):
            found = _on_what_stayed(found, solution.alignment, matcher, parameters, progress)
    solution = found.solution
    some = b[:: max(1, len(b) // _NEIGHBOUR_SAMPLE)]
    before = nearest(tree, some)[0]
    after = before if parameters.method == "none" else nearest(tree, solution.apply(some))[0]
    return _result(found, before, after, centre, len(b), parameters, stable is not None)


@dataclass(frozen=True)
class _Solution:
    """What a method found; ``radius`` (m) scales the rotations of ``information``.

    ``left``: left as surveyed because no stable ground was found. ``bent``: the correction of ``bend`` is part of it.
    ``alignment`` is what the robust method found.
    """

    pose: Pose
    iterations: int = 0
    converged: bool = True
    information: Information | None = None
    radius: float = 1.0
    left: bool = False
    bend: Bend | None = None
    bent: bool = False
    alignment: Alignment | None = None

    @property
    def correction(self) -> HeightCorrection | None:
        return self.bend.correction if self.bend is not None and self.bent else None

    def apply(self, xyz: Float) -> Float:
        moved = self.pose.apply(xyz)
        return moved if self.correction is None else self.correction.apply(moved)

    def transform(self, centre: Float) -> RigidTransform:
        """In the clouds' own system."""
        if self.correction is None:
            return RigidTransform(self.pose.rotation, self.pose.translation, centre)
        correction = replace(self.correction, nodes=self.correction.nodes.moved(centre[:2]))
        return BentTransform(self.pose.rotation, self.pose.translation, centre, correction)


def _solve(
    a: Float,
    b: Float,
    tree: cKDTree,
    matcher: Matcher,
    parameters: RegistrationParameters,
    progress: Progress,
) -> _Solution:
    """By the method asked for, in local coordinates."""
    if parameters.method == "icp":
        plain = icp(
            a,
            b,
            distance=parameters.maximum_correspondence,
            iterations=parameters.registration_iterations,
            tree=tree,
            progress=progress,
        )
        return _Solution(plain.pose, plain.iterations, plain.converged)
    if parameters.method == "robust":
        found = align(
            matcher,
            voxel=parameters.registration_voxel,
            offset=parameters.maximum_offset,
            iterations=parameters.registration_iterations,
            progress=progress,
        )
        return _of_alignment(found)
    return _Solution(Pose.identity())


def _of_alignment(found: Alignment) -> _Solution:
    return _Solution(found.pose, found.iterations, found.converged, found.information, found.radius, alignment=found)


def _surface(xyz: Float, plants: PlantCover | None, parameters: RegistrationParameters) -> Surface:
    error = None if plants is None else np.asarray(plants.error, dtype=np.float64)
    return Surface(xyz, parameters.registration_voxel, error)


@dataclass(frozen=True)
class _Measured:
    """A solution, the agreement of the surfaces there, and the standard error of a height, ``error`` (m).

    ``by_plants`` (m) is the part of it that plants cause. ``ground`` is known where the clouds record plants; ``bare``
    says that its bare part alone was registered, above which the later survey's covered ground lies by ``offset`` (m).
    """

    solution: _Solution
    quality: Agreement
    error: float
    by_plants: float
    ground: Covered | None = None
    bare: bool = False
    offset: float | None = None
    judged: Standing | None = None


def _on_what_stayed(
    found: _Measured,
    alignment: Alignment | None,
    matcher: Matcher,
    parameters: RegistrationParameters,
    progress: Progress,
) -> _Measured:
    """``found``, or where much has moved the registration on the part that has not.

    Raises:
        InputError: hardly anything agrees and no part is clearly the one that stayed, unless that was accepted.
    """
    if not found.solution.left and found.quality.stable_share >= ENOUGH:
        return found
    if found.bare and found.ground is not None:
        matcher = found.ground.bare
    patches = align_on_patches(matcher, alignment, parameters, progress)
    if patches is not None:
        judged = patches.standing
        if judged.contested and not parameters.accept_unstable:
            raise InputError(refusal(judged))
        narrow = _measured(_of_alignment(patches.alignment), matcher, parameters, False, progress, patches=patches)
        if judged.contested:
            narrow = _covering_both(narrow, judged)
        elif not found.solution.left and keeps(found.quality.stable_share, narrow.quality.stable_share, patches):
            return found
        return replace(narrow, ground=found.ground, bare=found.bare, offset=found.offset, judged=judged)
    little = found.solution.left or found.quality.stable_share < parameters.minimum_stable_share
    if little and not parameters.accept_unstable:
        raise InputError(
            f"Only {found.quality.stable_share:.0%} of the overlap agrees after registration and no part of the "
            "surface is clearly the one that did not move, so nothing tells how the epochs lie to one another; give "
            "an area known to be stable (--stable), or --accept-unstable to go on with a wide error."
        )
    return found


def _covering_both(found: _Measured, judged: Standing) -> _Measured:
    """``found`` with errors that cover the motion of the other part, which may be the one that stayed."""
    solution = found.solution
    assert solution.information is not None
    away = difference(judged, solution.radius)
    covariance = solution.information.covariance + np.outer(away, away)
    error = float(np.hypot(found.error, height_sd(np.outer(away, away), *_upward(found.quality), solution.radius)))
    return replace(
        found, solution=replace(solution, information=replace(solution.information, covariance=covariance)), error=error
    )


def _upward(quality: Agreement) -> tuple[Float, Float]:
    """Places and normals (n, 3) of the stable ground; of the mean where there is none."""
    if len(quality.places):
        return quality.places, quality.normals
    return quality.sample, np.broadcast_to(quality.mean_normal, quality.sample.shape)


def _measured(
    solution: _Solution,
    matcher: Matcher,
    parameters: RegistrationParameters,
    stable_given: bool,
    progress: Progress,
    ground: Covered | None = None,
    patches: OnPatches | None = None,
) -> _Measured:
    """Agreement of a solution by the ground of ``matcher``, and its error there, or over all of ``ground``.

    With ``patches`` only they can be stable ground.
    """
    among = None if patches is None else patches.among
    quality = agreement(matcher, solution.pose, parameters.maximum_offset, among=among)
    if parameters.method == "icp":
        seen = observe(matcher, solution.pose, quality.scale, parameters.maximum_offset, progress)
        solution = replace(solution, information=seen)
    elif (
        parameters.method == "robust"
        and patches is None
        and not stable_given
        and quality.stable_share < NO_STABLE_GROUND
    ):
        solution = _Solution(Pose.identity(), solution.iterations, left=True)
        quality = agreement(matcher, solution.pose, parameters.maximum_offset)
    elif parameters.method == "robust":
        solution, quality = _bent(solution, quality, matcher if patches is None else patches.matcher, parameters)
    over = quality.places, quality.normals
    if ground is not None:
        over = compared_ground(ground, solution.pose, parameters.maximum_offset)
    by_plants = 0.0
    if parameters.method != "none" and not solution.left:  # a cloud left as it is takes nothing from plants
        by_plants = error_by_plants(matcher, solution.pose, quality.sample[quality.agrees])
    error = float(np.hypot(_error(solution, quality, over, parameters), by_plants))
    if patches is None:
        error = widened(error, quality, parameters.minimum_stable_share)
    return _Measured(solution, quality, error, by_plants)


def _surer(
    all_ground: _Measured,
    alignment: Alignment,
    ground: Covered,
    parameters: RegistrationParameters,
    stable_given: bool,
    progress: Progress,
) -> _Measured:
    """By all ground or by bare ground alone, whichever states the smaller error."""
    all_ground = replace(all_ground, ground=ground)
    if all_ground.by_plants < _MIN_PLANT_ERROR_M:
        return all_ground
    try:
        found = align_bare(ground, alignment, parameters, progress)
        if found is None:
            return all_ground
        bare = _measured(_of_alignment(found), ground.bare, parameters, stable_given, progress, ground)
    except InputError:  # the two surveys are not bare in the same places
        return all_ground
    if bare.solution.left or bare.error >= all_ground.error:
        return all_ground
    offset = offset_of_covered(ground, bare.solution.pose, parameters.maximum_offset)
    return replace(bare, ground=ground, bare=True, offset=offset)


def _error(
    solution: _Solution, quality: Agreement, over: tuple[Float, Float], parameters: RegistrationParameters
) -> float:
    """Standard error of a height over places with their normals, (n, 3) each, in metres; plants aside."""
    information, error = solution.information, 0.0
    if information is not None and parameters.method == "robust":
        places, normals = over
        mean = normals.mean(axis=0) if len(normals) else quality.mean_normal
        mean = mean / np.linalg.norm(mean)
        seen = information.observable_covariance
        flat = np.broadcast_to(mean, normals.shape)
        # what is free moves the surface as a whole: sliding a slope along itself leaves its heights, tilting does not
        prior = parameters.maximum_offset / float(np.sqrt(3.0))
        error = float(
            np.linalg.norm(
                [
                    height_sd(seen, places, normals, solution.radius),
                    height_sd(information.covariance - seen, places, flat, solution.radius),
                    relief_sd(information, prior) / max(float(mean[2]), 0.2),
                ]
            )
        )
    error = float(np.hypot(error, quality.misfit_height))
    if solution.correction is not None:
        error = float(np.hypot(error, np.sqrt(np.mean(solution.correction.sd**2))))
    return error


def _bent(
    solution: _Solution, quality: Agreement, matcher: Matcher, parameters: RegistrationParameters
) -> tuple[_Solution, Agreement]:
    """Bending that the rigid motion leaves: measured, and removed if the parameters ask for it."""
    spacing = max(matcher.reference.spacing, matcher.moving.spacing)
    reach = max(0.3 * parameters.maximum_offset, 3 * spacing)
    bend = measure_bend(matcher, solution.pose, parameters.piece_size, reach, quality.scale)
    if bend is None:
        return solution, quality
    bent = parameters.piecewise == "always" or (parameters.piecewise == "auto" and bend.worth)
    solution = replace(solution, bend=bend, bent=bent)
    if bent:
        quality = agreement(matcher, solution.pose, parameters.maximum_offset, bend.correction)
    return solution, quality


def _result(
    found: _Measured,
    before: Float,
    after: Float,
    centre: Float,
    points: int,
    parameters: RegistrationParameters,
    stable_given: bool,
) -> RegistrationResult:
    """Args: before, after: nearest-neighbour distances of a sample of the moving cloud's ``points``, metres."""
    solution, quality, error = found.solution, found.quality, found.error
    pose, information = solution.pose, solution.information
    moved = quality.places if len(quality.places) else quality.sample  # nothing is stable
    shift = pose.apply(moved).mean(axis=0) - moved.mean(axis=0)
    covariance = None
    if information is not None and parameters.method == "robust":
        scale = np.diag([1 / solution.radius] * 3 + [1.0] * 3)
        covariance = scale @ information.covariance @ scale
    names = () if information is None else name_unobservable(information, quality.mean_normal)
    close = after[after <= parameters.maximum_correspondence]
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
        covariance=covariance,
        condition=None if information is None else information.condition,
        unobservable=names,
        weakest=None if information is None else weakest_direction(information, quality.mean_normal),
        bend=solution.bend,
        stable_ground=StableGround(quality.sample + centre, quality.agrees),
        registration_error=error,
        warnings=explain(
            quality,
            parameters,
            converged=solution.converged,
            shift=shift,
            error=error,
            unobservable=names,
            stable_given=stable_given,
            left=solution.left,
            judged=found.judged,
            bend=solution.bend,
            bent=solution.bent,
        )
        + explain_plants(
            error_by_plants=found.by_plants,
            error=error,
            bare=found.bare,
            bare_share=None if found.ground is None else found.ground.bare_share,
            offset=found.offset,
        ),
        plants=None
        if found.ground is None
        else PlantsInRegistration(found.ground.bare_share, found.bare, found.by_plants, found.offset),
    )
