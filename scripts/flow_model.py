#!/usr/bin/env python3
"""Makes the Processing model that is shipped, plugin/models/slopeflow.model3: run it in QGIS's Python.

    QT_QPA_PLATFORM=offscreen PYTHONPATH=..:/usr/share/qgis/python/plugins .venv-qgis/bin/python scripts/flow_model.py

Run it again when a parameter that the model sets is renamed, which released names are not.
"""

from __future__ import annotations

import sys
from typing import Any

from qgis.core import (
    QgsProcessingModelAlgorithm,
    QgsProcessingModelChildAlgorithm,
    QgsProcessingModelChildParameterSource,
    QgsProcessingModelOutput,
    QgsProcessingModelParameter,
    QgsProcessingParameterDefinition,
)
from qgis.PyQt.QtCore import QPointF
from slopewatch.plugin.bridge.resources import help_text
from slopewatch.plugin.shipped_model import FIELD_HELP, FOLDER, STEPS, SUMMARIES
from slopewatch.processing_algorithms.declare import cloud_parameter, polygon_parameter, profiles_parameter, with_help
from slopewatch.processing_algorithms.declare import date_parameter as day

_HELP_OF_PARTS = {
    "ALG_DESC": help_text("slopeflow"),
    "ALG_CREATOR": "SlopeWatch",
    "SHORT_DESCRIPTION": SUMMARIES["slopeflow"],
}
# child: (algorithm, inputs)
_FROM_MODEL, _FROM_CHILD = "model", "child"
_CHILDREN: tuple[tuple[str, str, dict[str, tuple[str, ...]]], ...] = (
    ("ground_first", "extractground",
     {"INPUT": (_FROM_MODEL, "REFERENCE"), "ROI": (_FROM_MODEL, "ROI")}),
    ("ground_later", "extractground",
     {"INPUT": (_FROM_MODEL, "CLOUD"), "ROI": (_FROM_MODEL, "ROI")}),
    ("registration", "registerepochs",
     {"REFERENCE": (_FROM_CHILD, "ground_first", "OUTPUT"), "CLOUD": (_FROM_CHILD, "ground_later", "OUTPUT")}),
    ("change", "elevationchange",
     {"REFERENCE": (_FROM_CHILD, "ground_first", "OUTPUT"), "CLOUD": (_FROM_CHILD, "ground_later", "OUTPUT"),
      "TRANSFORM": (_FROM_CHILD, "registration", "TRANSFORM"), "REFERENCE_DATE": (_FROM_MODEL, "REFERENCE_DATE"),
      "CLOUD_DATE": (_FROM_MODEL, "CLOUD_DATE")}),
    ("report", "writereport",
     {"INPUT": (_FROM_CHILD, "change", "OUTPUT_FOLDER"), "PROFILES": (_FROM_MODEL, "PROFILES")}),
)  # fmt: skip
# child: outputs of the model
_OUTPUTS = {
    "change": {
        "OUTPUT_FOLDER": "Output folder",
        "ZONES": "Hazard zones",
        "SIGNIFICANT_CHANGE": "Significant change (m)",
        "ELEVATION_CHANGE": "Elevation change (m)",
    },
}


def inputs() -> list[QgsProcessingParameterDefinition]:
    found = [
        cloud_parameter("REFERENCE", "First survey", "Raw point cloud of the first survey, LAS or LAZ."),
        day("REFERENCE_DATE", "Day of the first survey"),
        cloud_parameter("CLOUD", "Later survey", "Raw point cloud of the later survey, LAS or LAZ."),
        day("CLOUD_DATE", "Day of the later survey"),
        polygon_parameter("ROI", "Region of interest", "Polygons of the slope. Not set: the whole clouds."),
        profiles_parameter(),
    ]
    for parameter in found:
        with_help(parameter, FIELD_HELP["slopeflow"].get(parameter.name(), parameter.help()))
    return found


def source(of: tuple[str, ...]) -> QgsProcessingModelChildParameterSource:
    kind = QgsProcessingModelChildParameterSource
    return kind.fromModelParameter(of[1]) if of[0] == _FROM_MODEL else kind.fromChildOutput(*of[1:])


def built() -> QgsProcessingModelAlgorithm:
    model = QgsProcessingModelAlgorithm("slopeflow", "Models")
    model.setName("slopeflow")
    for row, parameter in enumerate(inputs()):
        component = QgsProcessingModelParameter(parameter.name())
        component.setDescription(parameter.description())
        component.setPosition(QPointF(160.0 + 220 * row, 60.0))
        model.addModelParameter(parameter, component)
    for row, (name, algorithm, given) in enumerate(_CHILDREN):
        child = QgsProcessingModelChildAlgorithm(f"slopewatch:{algorithm}")
        child.setChildId(name)
        child.setDescription(STEPS["slopeflow"][name])
        child.setPosition(QPointF(300.0 + 260 * (row % 2), 180.0 + 110 * row))
        for parameter, of in given.items():
            child.addParameterSources(parameter, [source(of)])
        child.setModelOutputs(_outputs(name, child.position()))
        if child.algorithm() is None:
            sys.exit(f"slopewatch:{algorithm} is not there")
        model.addChildAlgorithm(child)
    model.setHelpContent(_HELP_OF_PARTS)
    model.setParameterOrder([parameter.name() for parameter in inputs()])
    model.setOutputOrder([f"{child}:{label}" for child, made in _OUTPUTS.items() for label in made.values()])
    model.updateDestinationParameters()
    return model


def _outputs(child: str, place: QPointF) -> dict[str, QgsProcessingModelOutput]:
    found: dict[str, Any] = {}
    for row, (output, label) in enumerate(_OUTPUTS.get(child, {}).items()):
        made = QgsProcessingModelOutput(label, label)
        made.setChildId(child)
        made.setChildOutputName(output)
        made.setPosition(QPointF(place.x() + 420, place.y() + 34 * row))
        # a folder to give; what lies in it may be left to it
        made.setMandatory(output == "OUTPUT_FOLDER")
        found[label] = made
    return found


def main() -> None:
    from qgis.testing import start_app

    application = start_app()
    import slopewatch

    plugin = slopewatch.classFactory(None)
    plugin.initProcessing()
    target = FOLDER / "slopeflow.model3"
    target.parent.mkdir(exist_ok=True)
    if not built().toFile(str(target)):
        sys.exit(f"{target} cannot be written")
    print(target)
    plugin.unload()
    del application


if __name__ == "__main__":
    main()
