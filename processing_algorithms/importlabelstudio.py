"""Import from Label Studio: what was drawn there as a georeferenced layer."""

from __future__ import annotations

import os
from typing import Any, ClassVar

from ..interface.parameters import command_sets
from ..plugin.bridge.engine_client import EngineResult
from ..plugin.bridge.styling import Appearance
from . import declare, products
from .base import SlopeWatchAlgorithm
from .values import Values

_PRODUCTS = (
    products.Product(
        "OUTPUT",
        "labels",
        "Labels",
        "Polygons with their class, annotator, task and attributes; Train a model takes them.",
        Appearance(60),
        layer="labels",
    ),
)


class ImportLabelStudio(SlopeWatchAlgorithm):
    NAME = "importlabelstudio"
    TITLE = "Import from Label Studio"
    GROUP = "tools"
    SUMMARY = "Brings polygons, rectangles and brush masks of a Label Studio export onto the map, with their labels."
    TAGS = ("label studio", "annotation", "labelling", "labeling", "training data", "brush", "mask", "rle", "polygons")
    PARAMETER_GROUPS = command_sets.IMPORTLABELSTUDIO
    NUMBERS: ClassVar = {
        "REGIONS": ("regions", "Regions that were drawn"),
        "POLYGONS": ("polygons", "Polygons written"),
        "AREA": ("area_m2", "Area of the polygons (m²)"),
    }
    FILES: ClassVar = {"RUN_RECORD": ("run", "Run record")}

    def inputs(self) -> None:
        self.add(
            declare.file_parameter(
                "EXPORT",
                "Export of Label Studio",
                "The project's annotations, exported there as JSON (not JSON-MIN).",
                declare.JSON_FILTER,
                optional=False,
            ),
            declare.file_parameter(
                "TASKS",
                "Tasks",
                "The tasks.json that Export to Label Studio wrote, with its pictures next to it.",
                declare.JSON_FILTER,
                optional=False,
            ),
        )
        self.declare_groups()
        self.add(products.vector_destination("OUTPUT", "Labels", _PRODUCTS[0].help))

    def arguments(self, values: Values) -> list[str]:
        return ["importlabelstudio", values.file("EXPORT"), *values.options("TASKS", "OUTPUT")]

    def results(self, result: EngineResult, values: Values) -> dict[str, Any]:
        name = os.path.splitext(os.path.basename(values.file("EXPORT")))[0]
        return products.deliver(_PRODUCTS, result, values, f"SlopeWatch {name}")
