"""A Processing model that comes with the plugin: shown under SlopeWatch, with its own title, words and picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from qgis.core import QgsProcessingModelAlgorithm
from qgis.PyQt.QtGui import QIcon

from .bridge import resources
from .bridge.words import tr

FOLDER = Path(__file__).resolve().parent / "models"
"""The models' files; ``scripts/flow_model.py`` makes them."""
GROUP = "Models"
TITLES = {"slopeflow": "Whole flow, step by step"}
SUMMARIES = {"slopeflow": "Ground of two surveys, registration, elevation change and report, step by step."}
STEPS = {
    "slopeflow": {
        "ground_first": "Ground of the first survey",
        "ground_later": "Ground of the later survey",
        "registration": "Register the later ground",
        "change": "Change between the two",
        "report": "Report with profiles",
    },
}
"""What the log calls the steps of a model."""
_NO_DAY = "Day of the survey. Not set: the report and the zones' table have no rates."
FIELD_HELP = {"slopeflow": {"REFERENCE_DATE": _NO_DAY, "CLOUD_DATE": _NO_DAY}}
"""What fields of a model do that do something else than the field of their step."""
TAGS = {
    "slopeflow": [
        "model", "workflow", "change detection", "DEM of difference", "ground", "coregister", "settlement", "cut fill",
        "volume", "report",
    ],
}  # fmt: skip


class ShippedModel(QgsProcessingModelAlgorithm):
    """A model of a file. QGIS's own class shows no title but the name, no picture, and one language."""

    @classmethod
    def of(cls, path: Path) -> ShippedModel | None:
        """The model; None where this QGIS cannot read it."""
        model = cls()
        if not model.fromFile(str(path)):
            return None
        model._dress()
        return model

    def createInstance(self) -> ShippedModel:
        made = type(self)()
        made.loadVariant(self.toVariant())
        made._dress()
        return made

    def displayName(self) -> str:
        return tr(TITLES.get(self.name(), str(self.name())))

    def group(self) -> str:
        return tr(GROUP)

    def groupId(self) -> str:
        return "models"

    def shortDescription(self) -> str:
        return tr(SUMMARIES.get(self.name(), ""))

    def shortHelpString(self) -> str:
        return resources.help_text(self.name())

    def tags(self) -> list[str]:
        # the title as well: who reads another language may know the English one
        return [*TAGS.get(self.name(), []), "lidar", "slope", "point clouds", TITLES.get(self.name(), "")]

    def helpUrl(self) -> str:
        return resources.help_url("index") + f"#{self.name()}"

    def icon(self) -> QIcon:
        return resources.icon(self.name())

    def svgIconPath(self) -> str:
        return resources.icon_path(self.name())

    def _dress(self) -> None:
        """Give the fields their words, and what a model's file does not keep: the help and the widget of the step's
        field that takes the value. The output folder is the first of the results.
        """
        for definition in self.parameterDefinitions():
            definition.setDescription(tr(definition.description()))
        for child in self.childAlgorithms().values():
            for name, sources in child.parameterSources().items():
                self._dress_fields([one.parameterName() for one in sources], child.algorithm(), name)
        for field, text in FIELD_HELP.get(self.name(), {}).items():
            self.parameterDefinition(field).setHelp(tr(text))
        destinations = [one.clone() for one in self.parameterDefinitions() if one.isDestination()]
        for definition in sorted(destinations, key=lambda one: bool(one.flags() & one.Flag.FlagOptional)):
            self.removeParameter(definition.name())
            self.addParameter(definition)
        for name, title in STEPS.get(self.name(), {}).items():
            self.childAlgorithm(name).setDescription(tr(title))

    def _dress_fields(self, names: Sequence[str], step: Any, of_step: str) -> None:
        """Fields of the model that the parameter ``of_step`` of the algorithm ``step`` takes its value from."""
        taker = None if step is None else step.parameterDefinition(of_step)
        for name in names:
            definition = self.parameterDefinition(name) if name else None
            if taker is not None and definition is not None:
                definition.setHelp(taker.help())
                definition.setMetadata({**definition.metadata(), **taker.metadata()})


def shipped_models() -> list[Any]:
    """All models of the folder, once their steps are known to QGIS."""
    found = (ShippedModel.of(path) for path in sorted(FOLDER.glob("*.model3")))
    return [model for model in found if model is not None]
