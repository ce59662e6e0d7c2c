"""Register epochs: move a later ground cloud onto the reference."""

from __future__ import annotations

from typing import Any, ClassVar

from qgis.core import QgsProcessingContext, QgsProcessingFeedback, QgsProcessingParameterFileDestination

from ..interface.parameters import InputParameters, RegistrationParameters, SurfaceParameters
from ..plugin.bridge.engine_client import EngineResult
from . import declare
from .base import SlopeWatchAlgorithm

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
    TAGS = ("registration", "align", "icp", "co-registration", "transform")
    PARAMETER_GROUPS = (SurfaceParameters, RegistrationParameters, InputParameters)
    NUMBERS: ClassVar = {
        **REGISTRATION_NUMBERS,
        "RMSE_BEFORE": ("registration_nn_rmse_before_m", "Nearest-neighbour RMSE before (m)"),
        "RMSE_AFTER": ("registration_nn_rmse_after_m", "Nearest-neighbour RMSE after (m)"),
        "INLIER_RMSE": ("registration_inlier_rmse_m", "Inlier RMSE (m)"),
    }

    def initAlgorithm(self, configuration: Any = None) -> None:
        self.addParameter(
            declare.cloud_parameter("REFERENCE", "Reference", "Ground cloud of the first survey; it stays in place.")
        )
        self.addParameter(
            declare.cloud_parameter("CLOUD", "Later survey", "Ground cloud of the later survey; it is moved.")
        )
        self.addParameter(declare.polygon_parameter("STABLE", "Stable ground", STABLE_HELP))
        self.addParameter(declare.profile_parameter())
        self.declare_groups()
        self.addParameter(declare.cloud_destination("OUTPUT", "Registered", "LAZ file of the later survey, moved."))
        self.addParameter(
            declare.with_help(
                QgsProcessingParameterFileDestination(
                    "TRANSFORM", "Transform", "JSON files (*.json)", optional=True, createByDefault=True
                ),
                "JSON file with the 4 x 4 matrix from the later survey to the reference, in the clouds' own system.",
            )
        )
        self.declare_outputs()

    def arguments(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> list[str]:
        arguments = [
            "register",
            self.file(parameters, "REFERENCE", context),
            self.file(parameters, "CLOUD", context),
            "--output",
            self.output_file(parameters, "OUTPUT", context),
        ]
        transform = self.output_file(parameters, "TRANSFORM", context)
        if transform:
            arguments += ["--transform", transform]
        arguments += self.vector_options(parameters, context, feedback, "STABLE")
        arguments += declare.profile_options(self, parameters, context)
        return arguments + declare.options(self, self.PARAMETER_GROUPS, parameters, context)

    def results(
        self, result: EngineResult, parameters: dict[str, Any], context: QgsProcessingContext
    ) -> dict[str, Any]:
        results = {"OUTPUT": result.outputs["aligned"]}
        if "transform" in result.outputs:
            results["TRANSFORM"] = result.outputs["transform"]
        return results
