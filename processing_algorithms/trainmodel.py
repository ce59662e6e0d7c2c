"""Train a model: a screening model on one's own labelled clouds."""

from __future__ import annotations

import os
from typing import Any, ClassVar

from qgis.core import (
    QgsProcessingException,
    QgsProcessingParameterMultipleLayers,
)

from ..interface.command_list import BASIC
from ..interface.parameters import command_sets
from ..plugin.bridge.compat import FILES
from ..plugin.bridge.engine_client import EngineResult
from . import declare, products
from .base import SlopeWatchAlgorithm
from .values import Values


class TrainModel(SlopeWatchAlgorithm):
    NAME = "trainmodel"
    TITLE = "Train a model"
    GROUP = "tools"
    SUMMARY = "Trains a screening model on your own labelled clouds and scores it on slopes it was not trained on."
    TAGS = (
        "training", "fine-tuning", "labels", "machine learning", "deep learning", "network", "relief", "U-Net",
        "RandLA-Net", "calibration", "cross-validation",
    )  # fmt: skip
    PARAMETER_GROUPS = command_sets.TRAIN
    BASIC = BASIC["train"]
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
        "HAZARD_RECALL": ("hazard_recall", "Held-out hazards that were found (0 to 1)"),
        "START_HAZARD_RECALL": ("start_hazard_recall", "Those that the weights it started from find (0 to 1)"),
        "FALSE_ZONES_RATE": ("false_zones_per_1000_m2", "False zones on 1,000 m² of held-out ground"),
        "START_FALSE_ZONES_RATE": ("start_false_zones_per_1000_m2", "Those of the weights it started from"),
        "CALIBRATION_SCALE": ("calibration_scale", "Scale of the calibration"),
        "CALIBRATION_SHIFT": ("calibration_shift", "Shift of the calibration"),
        "TEMPERATURE": ("temperature", "Temperature of the calibration of a network on points"),
    }

    def inputs(self) -> None:
        self.add(
            declare.with_help(
                QgsProcessingParameterMultipleLayers("CLOUDS", "Labelled clouds", FILES),
                "LAS or LAZ files of ground points, each of one slope. With fewer than two the model cannot be scored.",
            ),
            declare.polygon_parameter(
                "POLYGONS",
                "Polygons with classes",
                "The points inside get the polygon's class instead of the one in a dimension.",
            ),
        )
        self.declare_groups()
        self.add(
            declare.file_parameter(
                "START_WEIGHTS",
                "Other weights to start from",
                "A .safetensors file with its .json next to it. If set, it is used instead of the value of Start from.",
                "Weights (*.safetensors)",
                advanced=True,
            )
        )
        products.declare_folder(
            self, "Receives weights, report and log, and checkpoints from which a stopped training continues."
        )

    def arguments(self, values: Values) -> list[str]:
        clouds = [path for path in self.parameterAsFileList(values.parameters, "CLOUDS", values.context) if path]
        if not clouds:
            raise QgsProcessingException("CLOUDS is empty; give one or more labelled LAS or LAZ files.")
        paths = [os.path.abspath(cloud) for cloud in clouds]
        return ["train", *paths, "--output-dir", values.output_folder(), *values.options("POLYGONS")]

    def command(self, values: Values) -> list[str]:
        weights = values.file("START_WEIGHTS")
        return [*super().command(values), *(["--start", weights] if weights else [])]

    def results(self, result: EngineResult, values: Values) -> dict[str, Any]:
        return {"OUTPUT_FOLDER": values.output_folder()}
