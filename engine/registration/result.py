"""The result of a registration and its quality."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.arrays import Float
from ..geometry.rigid_transform import BentTransform, RigidTransform
from .bending import Bend
from .quality import Agreement


@dataclass(frozen=True)
class PlantsInRegistration:
    """Effect of plants on a registration, where the clouds record them.

    Attributes:
        bare_share: share of the ground without plants, in the survey that has less of it.
        bare_only: bare ground alone was registered.
        error: part of the registration error that plants cause, metres.
        offset: median height of the later survey's ground under plants over the earlier one's, metres; None where
            all ground was registered together.
    """

    bare_share: float
    bare_only: bool
    error: float
    offset: float | None

    def facts(self) -> dict[str, Any]:
        return {
            "bare_share": self.bare_share,
            "registered_on_bare_ground": self.bare_only,
            "registration_error_by_plants_m": self.error,
            "ground_under_plants_offset_m": self.offset,
        }


@dataclass(frozen=True)
class RegistrationResult:
    """A registration and its quality. Lengths are metres.

    Attributes:
        transform: moving to reference; a ``BentTransform`` where heights were corrected beyond the rigid motion.
        method: robust, icp or none.
        iterations, converged: of the method; ``converged`` is True for none.
        inlier_rmse: RMSE of the nearest-neighbour distances within the largest correspondence (``inliers`` of them).
        nn_rmse_before, nn_rmse_after: RMSE of all nearest-neighbour distances, moving to reference.
        agreement: point-to-plane residuals on stable ground, before and after, and the share of stable ground.
        normal_translation: how far the moving surface was shifted along the mean normal (upwards is positive). A
            uniform deformation would look the same.
        vertical_translation: mean rise of the moving cloud; by so much it lay too low.
        covariance: (6, 6) of rotation vector (rad) about the transform's centre and translation (m), robust only.
        condition: ratio of the largest to the smallest curvature of the cost, rotations scaled by the cloud's radius.
        unobservable: motions that the surfaces do not fix, in words.
        weakest: the motion that is fixed least of the others, in words, and its standard error.
        bend: how far stable ground is bent after the rigid motion; None where that was not or cannot be measured.
        registration_error: standard error of a height after registration, for the level of detection.
        warnings: sentences for the user.
        plants: None where the clouds record no plants.
        registered_points: of either survey, where not all were taken.
        slid: share of the surface that was left out because it moved along itself against the rest.
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
    weakest: tuple[str, float] | None
    bend: Bend | None
    registration_error: float
    warnings: tuple[str, ...]
    plants: PlantsInRegistration | None = None
    registered_points: tuple[int, int] | None = None
    slid: float = 0.0

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
            "registration_vertical_bias_m": -self.vertical_translation,
        }

    def stated(self) -> dict[str, Any]:
        """What the transform's file states: the main figures, and the error of all six motions."""
        covariance = None if self.covariance is None else self.covariance.tolist()
        return self.figures() | {"covariance": covariance, "unobservable": list(self.unobservable)}

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
            "weakest_direction": None if self.weakest is None else self.weakest[0],
            "weakest_direction_error_m": None if self.weakest is None else self.weakest[1],
            "height_differences_spread_m": self.agreement.spread,
            "bend_before_m": None if self.bend is None else self.bend.before,
            "bend_after_m": None if self.bend is None else self.bend.after,
            **({} if self.plants is None else self.plants.facts()),
            **({"slid_share": self.slid} if self.slid else {}),
            **({} if self.registered_points is None else {"registered_points": list(self.registered_points)}),
            "pieces": self.transform.correction.facts() if isinstance(self.transform, BentTransform) else None,
        }
