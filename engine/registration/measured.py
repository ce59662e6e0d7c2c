"""What a method of registration found: the motion, the agreement of the surfaces there, and its error."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...interface.parameters import RegistrationParameters
from ..core.arrays import Float
from ..core.progress import Progress
from ..geometry.height_correction import HeightCorrection
from ..geometry.pose import Pose
from ..geometry.rigid_transform import BentTransform, RigidTransform
from .alignment import Alignment, observe
from .bare_ground import Covered, compared_ground
from .bending import Bend, measure_bend
from .common_vegetation_error import common_vegetation_error
from .observability import Information, height_sd, relief_sd
from .patch_registration import OnPatches
from .point_to_plane import Matcher
from .quality import MIN_STABLE_SHARE, Agreement, agreement, widened
from .rival_parts import Standing
from .strain import Strain


@dataclass(frozen=True)
class Solution:
    """What a method found; ``radius`` (m) scales the rotations of ``information``.

    ``left``: left as surveyed because there is no stable ground. ``bent``: the correction of ``bend`` is part of it.
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


def of_alignment(found: Alignment) -> Solution:
    return Solution(found.pose, found.iterations, found.converged, found.information, found.radius, alignment=found)


@dataclass(frozen=True)
class Measured:
    """A solution, the agreement of the surfaces there, and the standard error of a height, ``error`` (m).

    ``by_plants`` (m) is the part of it that plants make. ``ground`` is known where the clouds record plants; ``bare``
    says that its bare part alone was registered, above which the later survey's covered ground lies by ``offset`` (m).
    ``strain`` is known if the surveys differ by more than one motion.
    """

    solution: Solution
    quality: Agreement
    error: float
    by_plants: float
    ground: Covered | None = None
    bare: bool = False
    offset: float | None = None
    judged: Standing | None = None
    strain: Strain | None = None


def measured(
    solution: Solution,
    matcher: Matcher,
    parameters: RegistrationParameters,
    stable_given: bool,
    progress: Progress,
    ground: Covered | None = None,
    patches: OnPatches | None = None,
) -> Measured:
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
        and quality.stable_share < MIN_STABLE_SHARE
    ):
        solution = Solution(Pose.identity(), solution.iterations, left=True)
        quality = agreement(matcher, solution.pose, parameters.maximum_offset)
    elif parameters.method == "robust":
        solution, quality = _bent(solution, quality, matcher if patches is None else patches.matcher, parameters)
    over = quality.places, quality.normals
    if ground is not None:
        over = compared_ground(ground, solution.pose, parameters.maximum_offset)
    by_plants = 0.0
    if parameters.method != "none" and not solution.left:  # a cloud left as it is takes nothing from plants
        by_plants = common_vegetation_error(matcher, solution.pose, quality.sample[quality.agrees])
    error = float(np.hypot(_error(solution, quality, over, parameters), by_plants))
    if patches is None:
        error = widened(error, quality, parameters.minimum_stable_share)
    return Measured(solution, quality, error, by_plants)


def covering(found: Measured, covariance: Float) -> Measured:
    """``found`` with another ``covariance`` (6, 6) of its motion added to its errors, square metres."""
    solution, quality = found.solution, found.quality
    assert solution.information is not None
    # of the stable ground; of the mean where there is none
    places = quality.places if len(quality.places) else quality.sample
    normals = quality.normals if len(quality.places) else np.broadcast_to(quality.mean_normal, places.shape)
    information = replace(solution.information, covariance=solution.information.covariance + covariance)
    error = float(np.hypot(found.error, height_sd(covariance, places, normals, solution.radius)))
    return replace(found, solution=replace(solution, information=information), error=error)


def _error(
    solution: Solution, quality: Agreement, over: tuple[Float, Float], parameters: RegistrationParameters
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
        error = float(
            np.linalg.norm(
                [
                    height_sd(seen, places, normals, solution.radius),
                    height_sd(information.covariance - seen, places, flat, solution.radius),
                    relief_sd(information) / max(float(mean[2]), 0.2),
                ]
            )
        )
    error = float(np.hypot(error, quality.misfit_height))
    if solution.correction is not None:
        error = float(np.hypot(error, np.sqrt(np.mean(solution.correction.sd**2))))
    return error


def _bent(
    solution: Solution, quality: Agreement, matcher: Matcher, parameters: RegistrationParameters
) -> tuple[Solution, Agreement]:
    """What bends in addition to the rigid motion: measured, and removed where that was asked for."""
    reach = max(0.3 * parameters.maximum_offset, 3 * matcher.spacing)
    bend = measure_bend(matcher, solution.pose, parameters.piece_size, reach, quality.scale)
    if bend is None:
        return solution, quality
    bent = parameters.piecewise == "always" or (parameters.piecewise == "auto" and bend.worth)
    solution = replace(solution, bend=bend, bent=bent)
    if bent:
        quality = agreement(matcher, solution.pose, parameters.maximum_offset, bend.correction)
    return solution, quality
