"""The Processing provider ``slopewatch``: registers every algorithm, whether or not the engine is there."""

from __future__ import annotations

from qgis.core import QgsApplication, QgsProcessingProvider
from qgis.PyQt.QtGui import QIcon

from ..processing_algorithms import ALGORITHMS
from .bridge.resources import icon, icon_path
from .shipped_model import shipped_models


class SlopeWatchProvider(QgsProcessingProvider):
    """See the module."""

    def id(self) -> str:
        return "slopewatch"

    def name(self) -> str:
        return "SlopeWatch"

    def longName(self) -> str:
        return "SlopeWatch: road slopes from UAV LiDAR"

    def icon(self) -> QIcon:
        return icon()

    def svgIconPath(self) -> str:
        return icon_path()

    def loadAlgorithms(self) -> None:
        for algorithm in ALGORITHMS:
            self.addAlgorithm(algorithm())
        # A model finds its steps by the registry, which has this provider only after it was loaded once.
        if QgsApplication.processingRegistry().providerById(self.id()) is not None:
            for model in shipped_models():
                self.addAlgorithm(model)

    def supportsNonFileBasedOutput(self) -> bool:
        return False

    def supportedOutputRasterLayerExtensions(self) -> list[str]:
        return ["tif"]

    def supportedOutputVectorLayerExtensions(self) -> list[str]:
        return ["gpkg", "geojson", "shp"]

    def defaultVectorFileExtension(self, hasGeometry: bool = True) -> str:
        return "gpkg"

    def defaultRasterFileExtension(self) -> str:
        return "tif"
