"""Train a model: a screening model on one's own labelled clouds."""

from __future__ import annotations

import os
from typing import Any, ClassVar

from qgis.core import (
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingFeedback,
    QgsProcessingParameterFile,
    QgsProcessingParameterMultipleLayers,
)

from ..interface.parameters import FineTuneParameters, InputParameters, OutputParameters
from ..plugin.bridge.compat import FILE, FILES
from ..plugin.bridge.engine_client import EngineResult
from . import declare, products
from .base import SlopeWatchAlgorithm


class TrainModel(SlopeWatchAlgorithm):
    NAME = "trainmodel"
    TITLE = "Train a model"
    GROUP = "tools"
    SUMMARY = "Trains a screening model on your own labelled clouds and scores it on slopes it never saw."
    TAGS = ("training", "fine-tuning", "labels", "network", "RandLA-Net", "calibration", "cross-validation")
    PARAMETER_GROUPS = (FineTuneParameters, InputParameters, OutputParameters)
    FILES: ClassVar = {
        "WEIGHTS": ("weights", "Weights"),
        "DESCRIPTION": ("description", "Description of the weights"),
        "LOG": ("log", "Log"),
        "REPORT": ("report", "Report"),
        "RUN_RECORD": ("run", "Run record"),
    }
    NUMBERS: ClassVar = {
        "LABELLED_POINTS": ("labelled_points", "Labelled points"),
        "FOLD_COUNT": ("folds", "Folds"),
        "STEPS_DONE": ("steps", "Steps of each training"),
        "OVERALL_ACCURACY": ("overall_accuracy", "Accuracy on held-out points (0 to 1)"),
        "MEAN_IOU": ("mean_iou", "Mean IoU on held-out points (0 to 1)"),
        "MAJORITY_ACCURACY": ("majority_accuracy", "Accuracy of the most frequent class everywhere (0 to 1)"),
        "START_MEAN_IOU": ("start_mean_iou", "Mean IoU of the weights it started from (0 to 1)"),
        "TEMPERATURE": ("temperature", "Temperature of the calibration"),
    }

    def initAlgorithm(self, configuration: Any = None) -> None:
        self.addParameter(
            declare.with_help(
                QgsProcessingParameterMultipleLayers("CLOUDS", "Labelled clouds", FILES),
                "LAS or LAZ files of ground points, each of one slope. Two or more, or the model cannot be scored.",
            )
        )
        self.addParameter(
            declare.polygon_parameter(
                "POLYGONS",
                "Polygons with classes",
                "The points inside have the polygon's class, instead of the one that a dimension says.",
            )
        )
        self.declare_groups()
        self.addParameter(
            declare.with_help(
                QgsProcessingParameterFile(
                    "START_WEIGHTS",
                    "Other weights to start from",
                    behavior=FILE,
                    fileFilter="Weights (*.safetensors)",
                    optional=True,
                ),
                "A .safetensors file with its .json beside it. Set, it is used instead of what Start from says.",
                advanced=True,
            )
        )
        products.declare_folder(
            self, "Receives weights, report and log, and checkpoints that a stopped training goes on from."
        )
        self.declare_outputs()

    def arguments(
        self, parameters: dict[str, Any], context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> list[str]:
        clouds = [path for path in self.parameterAsFileList(parameters, "CLOUDS", context) if path]
        if not clouds:
            raise QgsProcessingException("CLOUDS is empty; give one or more labelled LAS or LAZ files.")
        self._folder = products.output_folder(self, parameters, context)
        arguments = ["train", *(os.path.abspath(cloud) for cloud in clouds), "--output-dir", self._folder]
        arguments += self.vector_options(parameters, context, feedback, "POLYGONS")
        arguments += declare.options(self, self.PARAMETER_GROUPS, parameters, context)
        weights = self.file(parameters, "START_WEIGHTS", context)
        return [*arguments, "--start", weights] if weights else arguments

    def results(
        self, result: EngineResult, parameters: dict[str, Any], context: QgsProcessingContext
    ) -> dict[str, Any]:
        return {"OUTPUT_FOLDER": self._folder}
