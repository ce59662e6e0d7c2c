"""Registration of a later epoch to the first, and how far it can be trusted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from .alignment import Alignment, align
from .errors import InputError
from .icp import icp
from .observability import Information, height_sd, name_unobservable
from .parameters import RegistrationParameters
from .point_to_plane import Matcher
from .pose import Pose
from .progress import Progress
from .registration_quality import Agreement, agreement, explain
from .surface import Surface, nearest
from .transform import RigidTransform

Float = NDArray[np.float64]

_LEAST_POINTS = 30
_NEIGHBOUR_SAMPLE = 100_000


@dataclass(frozen=True)
class RegistrationResult:
    """A registration and its quality. Lengths are metres.

    Attributes:
        transform: moving to reference.
        method: robust, icp or none.
        iterations, converged: of the method; ``converged`` is True for none.
        inlier_rmse: RMSE of the nearest-neighbour distances within the largest correspondence (``inliers`` of them).
        nn_rmse_before, nn_rmse_after: RMSE of all nearest-neighbour distances, moving to reference.
        agreement: point-to-plane residuals on stable ground, before and after, and the share of stable ground.
        normal_translation: how far the moving surface was shifted along the mean normal (upwards is positive). A
            uniform deformation would look the same.
        vertical_translation: mean rise of the moving cloud.
        covariance: (6, 6) of rotation vector (rad) about the transform's centre and translation (m), robust only.
        condition: ratio of the largest to the smallest curvature of the cost, rotations scaled by the cloud's radius.
        unobservable: motions that the surfaces do not fix, in words.
        registration_error: standard error of a height after registration, for the level of detection.
        warnings: sentences for the user.
    """

    transform: RigidTransform
    method: str
    iterations: int
    converged: bool
    inlier_rmse: float
    inliers: int
    nn_rmse_before: float
    nn_rmse_after: float
    agreement: Agreement
    normal_translation: float
    vertical_translation: float
    covariance: Float | None
    condition: float | None
    unobservable: tuple[str, ...]
    registration_error: float
    warnings: tuple[str, ...]

    @property
    def improvement(self) -> float:
        """Share by which the nearest-neighbour RMSE fell."""
        return 1.0 - self.nn_rmse_after / self.nn_rmse_before if self.nn_rmse_before > 0 else 0.0

    def figures(self) -> dict[str, Any]:
        """The main figures by name, as JSON takes them."""
        shift = self.transform.translation
        return {
            "registration_method": self.method,
            "registration_dx_m": float(shift[0]),
            "registration_dy_m": float(shift[1]),
            "registration_dz_m": float(shift[2]),
            "registration_rotation_deg": float(np.degrees(self.transform.angle)),
            "registration_inlier_rmse_m": self.inlier_rmse,
            "registration_nn_rmse_before_m": self.nn_rmse_before,
            "registration_nn_rmse_after_m": self.nn_rmse_after,
            "registration_improvement": self.improvement,
            "registration_stable_share": self.agreement.stable_share,
            "registration_residual_before_m": self.agreement.nmad_before,
            "registration_residual_after_m": self.agreement.nmad_after,
            "registration_normal_translation_m": self.normal_translation,
            "registration_error_m": self.registration_error,
        }

    def summary(self) -> dict[str, Any]:
        """Everything for the run record."""
        return self.figures() | {
            "iterations": self.iterations,
            "converged": self.converged,
            "inliers": self.inliers,
            "vertical_translation_m": self.vertical_translation,
            "overlap_share": self.agreement.overlap_share,
            "residual_rms_before_m": self.agreement.rms_before,
            "residual_rms_after_m": self.agreement.rms_after,
            "local_misfit_m": self.agreement.misfit,
            "noise_m": self.agreement.scale,
            "covariance": None if self.covariance is None else self.covariance.tolist(),
            "condition": self.condition,
            "unobservable": list(self.unobservable),
        }


def register(
    reference: Float,
    moving: Float,
    parameters: RegistrationParameters,
    *,
    stable: BaseGeometry | None = None,
    progress: Progress | None = None,
) -> RegistrationResult:
    """Register ``moving`` (m, 3) to ``reference`` (n, 3), both in metres of one reference system.

    Args:
        stable: area known to be stable, in the same system; only the reference's points within it are used by the
            robust method and by the quality figures.

    Raises:
        InputError: no overlap, too few points, coordinates that are not finite, points on one line, or a stable area
            without points.
    """
    progress = progress or Progress()
    _check(reference, "earlier")
    _check(moving, "later")
    _check_overlap(reference, moving, parameters.maximum_offset)
    centre = (reference.min(axis=0) + reference.max(axis=0)) / 2
    a, b = reference - centre, moving - centre
    known = _inside(stable, reference)
    voxel = parameters.registration_voxel
    progress.update(0.0, "averaging points")
    surfaces = Surface(a, voxel), Surface(b, voxel)
    on_stable = None if stable is None else _inside(stable, surfaces[0].points + centre)
    matcher = Matcher(*surfaces, on_stable)
    _check_shape(surfaces[0].points, "earlier")
    _check_shape(surfaces[1].points, "later")
    tree = cKDTree(a, balanced_tree=False, compact_nodes=False)
    pose, found, iterations, converged = Pose.identity(), None, 0, True
    if parameters.method == "icp":
        with progress.stage(0.05, 0.8):
            plain = icp(
                a,
                b,
                distance=parameters.maximum_correspondence,
                iterations=parameters.registration_iterations,
                tree=tree,
                progress=progress,
            )
        pose, iterations, converged = plain.pose, plain.iterations, plain.converged
    elif parameters.method == "robust":
        with progress.stage(0.05, 0.85):
            found = align(
                a,
                b,
                matcher,
                voxel=voxel,
                offset=parameters.maximum_offset,
                iterations=parameters.registration_iterations,
                stable=known,
                progress=progress,
            )
        pose, iterations, converged = found.pose, found.iterations, found.converged
    progress.update(0.9, "measuring the agreement")
    quality = agreement(matcher, pose, parameters.maximum_offset)
    return _result(
        a, b, tree, centre, matcher, pose, found, quality, iterations, converged, parameters, stable is not None
    )


def _result(
    a: Float,
    b: Float,
    tree: cKDTree,
    centre: Float,
    matcher: Matcher,
    pose: Pose,
    found: Alignment | None,
    quality: Agreement,
    iterations: int,
    converged: bool,
    parameters: RegistrationParameters,
    on_stable: bool,
) -> RegistrationResult:
    transform = RigidTransform(pose.rotation, pose.translation, centre)
    some = b[:: max(1, len(b) // _NEIGHBOUR_SAMPLE)]
    before = nearest(tree, some)[0]
    after = before if parameters.method == "none" else nearest(tree, pose.apply(some))[0]
    close = after[after <= parameters.maximum_correspondence]
    normal = quality.mean_normal
    shift = pose.apply(quality.places).mean(axis=0) - quality.places.mean(axis=0)
    covariance, condition, error = None, None, 0.0
    names: tuple[str, ...] = ()
    if found is not None:
        information: Information = found.information
        scale = np.diag([1 / found.radius] * 3 + [1.0] * 3)
        covariance = scale @ information.covariance @ scale
        condition, names = information.condition, name_unobservable(information, normal)
        error = height_sd(information.observable_covariance, quality.places, quality.normals, found.radius)
    error = float(np.hypot(error, quality.misfit_height))
    widening = max(1.0, parameters.minimum_stable_share / max(quality.stable_share, 0.02))
    warnings = explain(
        quality,
        parameters,
        converged=converged,
        shift=shift,
        normal=normal,
        error=error,
        widening=widening,
        unobservable=names,
        stable_given=on_stable,
    )
    return RegistrationResult(
        transform=transform,
        method=parameters.method,
        iterations=iterations,
        converged=converged,
        inlier_rmse=float(np.sqrt(np.mean(close**2))) if len(close) else 0.0,
        inliers=round(len(close) * len(b) / len(some)),
        nn_rmse_before=float(np.sqrt(np.mean(before**2))),
        nn_rmse_after=float(np.sqrt(np.mean(after**2))),
        agreement=quality,
        normal_translation=float(shift @ normal),
        vertical_translation=float(shift[2]),
        covariance=covariance,
        condition=condition,
        unobservable=names,
        registration_error=error * widening,
        warnings=warnings,
    )


def _check(xyz: Float, name: str) -> None:
    if xyz.ndim != 2 or xyz.shape[1] != 3:
        raise InputError(f"The {name} epoch's points have the shape {xyz.shape}; give x, y and z of each.")
    if len(xyz) < _LEAST_POINTS:
        raise InputError(
            f"The {name} epoch has {len(xyz)} points and registration needs at least {_LEAST_POINTS}; "
            "check the region and the ground extraction."
        )
    # a sum is finite only if all its terms are, and needs no second copy of the cloud
    if not np.isfinite(xyz.sum()):
        bad = int(np.count_nonzero(~np.isfinite(xyz).all(axis=1)))
        raise InputError(f"The {name} epoch has {bad} points whose coordinates are not finite; remove them.")


def _check_overlap(reference: Float, moving: Float, offset: float) -> None:
    boxes = [(xyz.min(axis=0), xyz.max(axis=0)) for xyz in (reference, moving)]
    gap = np.maximum(boxes[0][0] - boxes[1][1], boxes[1][0] - boxes[0][1])
    if (gap > offset).any():
        first, second = (
            " to ".join("(" + ", ".join(f"{v:.1f}" for v in corner) + ")" for corner in box) for box in boxes
        )
        raise InputError(
            f"The epochs do not overlap: the earlier extends over {first}, the later over {second}; check the files, "
            f"their reference systems and units, or raise the largest expected offset ({offset:g} m)."
        )


def _check_shape(points: Float, name: str) -> None:
    if len(points) < _LEAST_POINTS:
        raise InputError(f"The {name} epoch has only {len(points)} occupied voxels; give a smaller registration voxel.")
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[1] < 1e-3 * spread[0]:
        raise InputError(
            f"The {name} epoch's points lie on one line, which fixes no registration; check the region of interest."
        )


def _inside(area: BaseGeometry | None, xyz: Float) -> NDArray[np.bool_] | None:
    if area is None:
        return None
    shapely.prepare(area)
    inside: NDArray[np.bool_] = shapely.contains_xy(area, xyz[:, 0], xyz[:, 1])
    if np.count_nonzero(inside) < _LEAST_POINTS:
        raise InputError(
            f"The stable area holds {np.count_nonzero(inside)} points of the earlier epoch and registration needs at "
            f"least {_LEAST_POINTS}; draw it on ground that was surveyed, or register without it."
        )
    return inside
