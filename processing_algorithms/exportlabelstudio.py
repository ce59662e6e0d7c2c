"""Export to Label Studio: a top view as pictures and tasks to label there."""

from __future__ import annotations

import os
from typing import Any, ClassVar

from qgis.core import QgsProcessingException, QgsProcessingParameterRasterLayer

from ..interface.parameters import command_sets
from ..plugin.bridge.engine_client import EngineResult
from . import declare, products
from .base import SlopeWatchAlgorithm
from .values import Values


class ExportLabelStudio(SlopeWatchAlgorithm):
    NAME = "exportlabelstudio"
    TITLE = "Export to Label Studio"
    GROUP = "tools"
    SUMMARY = "Writes a top view as pictures and tasks for Label Studio, with zones or segments shown on them."
    TAGS = ("label studio", "annotation", "labelling", "labeling", "training data", "segments", "png", "tasks")
    PARAMETER_GROUPS = command_sets.EXPORTLABELSTUDIO
    NUMBERS: ClassVar = {
        "PICTURES": ("pictures", "Pictures"),
        "REGIONS": ("regions", "Regions shown on them"),
    }
    FILES: ClassVar = {
        "TASKS": ("tasks", "Tasks"),
        "LABELS_FILE": ("labels", "Labelling configuration"),
        "RUN_RECORD": ("run", "Run record"),
    }

    def inputs(self) -> None:
        self.add(
            declare.with_help(
                QgsProcessingParameterRasterLayer("PICTURE", "Top view"),
                "GeoTIFF of colours, such as the picture of Top view, or of one band, such as its hillshade.",
            ),
            declare.polygon_parameter(
                "SEGMENTS",
                "Zones or segments",
                "Polygons that are shown on the pictures as predictions, with their attributes, to be corrected there.",
            ),
        )
        self.declare_groups()
        products.declare_folder(self, "Receives pictures with world files, tasks.json, labels.xml and the run record.")

    def arguments(self, values: Values) -> list[str]:
        layer = self.parameterAsRasterLayer(values.parameters, "PICTURE", values.context)
        if layer is None:
            raise QgsProcessingException("PICTURE cannot be read as a raster; give a GeoTIFF such as top_view.tif.")
        picture = os.path.abspath(layer.source())
        folder = ["--output-dir", values.output_folder()]
        return ["exportlabelstudio", picture, *folder, *values.options("SEGMENTS")]

    def results(self, result: EngineResult, values: Values) -> dict[str, Any]:
        return {"OUTPUT_FOLDER": values.output_folder()}
