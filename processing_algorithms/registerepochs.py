"""Register epochs: move a later ground cloud onto the reference."""

from __future__ import annotations

from typing import Any, ClassVar

from ..interface.parameters import command_sets
from ..plugin.bridge.engine_client import EngineResult
from . import declare
from .base import SlopeWatchAlgorithm
from .values import Values

STABLE_HELP = (
    "Polygons of ground that has surely not moved, such as the road or a concrete lattice. Only points in them decide "
    "the registration. Not set: the whole surface, robustly weighted."
)
REGISTRATION_NUMBERS = {
    "SHIFT_X": ("registration_dx_m", "Shift to the east (m)"),
    "SHIFT_Y": ("registration_dy_m", "Shift to the north (m)"),
    "SHIFT_Z": ("registration_dz_m", "Shift upwards (m)"),
    "STABLE_SHARE": ("registration_stable_share", "Share of stable ground (0 to 1)"),
    "REGISTRATION_STANDARD_ERROR": ("registration_error_m", "Standard error of the registration in height (m)"),
}


class RegisterEpochs(SlopeWatchAlgorithm):
    NAME = "registerepochs"
    TITLE = "Register epochs"
    GROUP = "steps"
    SUMMARY = "Moves a later ground cloud rigidly onto the reference without following real change."
    TAGS = (
        "registration", "coregister", "co-register", "coregistration", "co-registration", "align", "alignment", "icp",
        "transform", "match surveys", "shift",
    )  # fmt: skip
    PARAMETER_GROUPS = command_sets.REGISTER
    NUMBERS: ClassVar = {
        **REGISTRATION_NUMBERS,
        "RMSE_BEFORE": ("registration_nn_rmse_before_m", "Nearest-neighbour RMSE before (m)"),
        "RMSE_AFTER": ("registration_nn_rmse_after_m", "Nearest-neighbour RMSE after (m)"),
        "INLIER_RMSE": ("registration_inlier_rmse_m", "Inlier RMSE (m)"),
    }

    def inputs(self) -> None:
        self.add(
            declare.cloud_parameter("REFERENCE", "Reference", "Ground cloud of the first survey; it stays in place."),
            declare.cloud_parameter("CLOUD", "Later survey", "Ground cloud of the later survey; it is moved."),
            declare.polygon_parameter("STABLE", "Stable ground", STABLE_HELP),
            declare.profile_parameter(self.PARAMETER_GROUPS),
        )
        self.declare_groups()
        self.add(
            declare.cloud_destination("OUTPUT", "Registered", "LAZ file of the later survey, moved."),
            declare.file_destination(
                "TRANSFORM",
                "Transform",
                "JSON file with the 4 x 4 matrix from the later survey to the reference, in the clouds' own system.",
                "JSON files (*.json)",
            ),
        )

    def arguments(self, values: Values) -> list[str]:
        clouds = [values.file("REFERENCE"), values.file("CLOUD")]
        return ["register", *clouds, *values.options("OUTPUT", "TRANSFORM", "STABLE")]

    def results(self, result: EngineResult, values: Values) -> dict[str, Any]:
        keys = {"OUTPUT": "aligned", "TRANSFORM": "transform"}
        return {name: result.outputs[key] for name, key in keys.items() if key in result.outputs}
