"""A Processing model that comes with the plugin: shown under SlopeWatch, with its own title, words and picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from qgis.core import QgsProcessingModelAlgorithm
from qgis.PyQt.QtGui import QIcon

from .bridge import resources

FOLDER = Path(__file__).resolve().parent / "models"
"""The models' files; ``scripts/flow_model.py`` makes them."""
TITLES = {"slopeflow": "Whole flow, step by step"}
TAGS = {
    "slopeflow": [
        "model", "workflow", "change detection", "DEM of difference", "ground", "coregister", "settlement", "cut fill",
        "volume", "report",
    ],
}  # fmt: skip


class ShippedModel(QgsProcessingModelAlgorithm):
    """A model of a file. QGIS's own class shows no title but the name, and no picture of the plugin."""

    @classmethod
    def of(cls, path: Path) -> ShippedModel | None:
        """The model; None where this QGIS cannot read it."""
        model = cls()
        return model if model.fromFile(str(path)) else None

    def createInstance(self) -> ShippedModel:
        made = type(self)()
        made.loadVariant(self.toVariant())
        return made

    def displayName(self) -> str:
        return TITLES.get(self.name(), str(self.name()))

    def groupId(self) -> str:
        return "models"

    def tags(self) -> list[str]:
        return [*TAGS.get(self.name(), []), "lidar", "slope", "point clouds"]

    def helpUrl(self) -> str:
        return resources.help_url("index") + f"#{self.name()}"

    def icon(self) -> QIcon:
        return resources.icon()

    def svgIconPath(self) -> str:
        return resources.icon_path()


def shipped_models() -> list[Any]:
    """All models of the folder, once their steps are known to QGIS."""
    found = (ShippedModel.of(path) for path in sorted(FOLDER.glob("*.model3")))
    return [model for model in found if model is not None]
