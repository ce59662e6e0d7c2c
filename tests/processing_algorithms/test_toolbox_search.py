"""What analysts type into the toolbox's search field finds the tools; QGIS's own search is asked."""

from __future__ import annotations

import pytest
from qgis.core import QgsApplication, QgsProcessingProvider
from qgis.gui import QgsProcessingToolboxProxyModel

SEARCHES = {
    "change detection": {"inspectslope", "elevationchange", "m3c2distances", "demchange"},
    "DEM of difference": {"inspectslope", "elevationchange"},
    "difference of DEMs": {"elevationchange", "demchange"},
    "raster difference": {"demchange"},
    "DoD": {"elevationchange", "inspectslope"},
    "coregister": {"registerepochs"},
    "co-registration": {"registerepochs"},
    "align point clouds": {"registerepochs"},
    "settlement": {"inspectslope", "elevationchange", "inspectseries"},
    "subsidence": {"inspectslope", "elevationchange", "screenhazards"},
    "cut fill": {"inspectslope", "elevationchange"},
    "cut and fill volume": {"inspectslope", "elevationchange"},
    "landslide": {"inspectslope", "inspectseries"},
    "erosion": {"elevationchange"},
    "bare earth": {"extractground"},
    "ground classification": {"extractground"},
    "remove vegetation": {"extractground"},
    "outliers": {"extractground"},
    "C2C": {"m3c2distances"},
    "cloud to cloud distance": {"m3c2distances"},
    "rock face": {"m3c2distances"},
    "creep": {"displacementvectors"},
    "velocity": {"inspectseries"},
    "early warning": {"inspectseries"},
    "batch": {"corridorbatch"},
    "hazard": {"screenhazards", "inspectslope"},
    "cross-section": {"writereport"},
    "flight plan": {"planflight", "compareflight"},
    "trajectory": {"compareflight"},
    "waypoints": {"planflight"},
    "mission": {"planflight"},
    "chainage": {"locateonroad"},
    "linear referencing": {"locateonroad"},
    "pdf": {"writereport"},
    "print layout": {"createproject"},
    "dxf": {"exportgis"},
    "landxml": {"exportgis"},
    "iso 19115": {"exportgis"},
    "postgis": {"exportgis"},
    "sample data": {"simulatesurvey"},
    "machine learning": {"trainmodel"},
    "install": {"checkenvironment"},
    "slopewatch": {"inspectslope", "checkenvironment"},
}


@pytest.fixture
def found(provider: QgsProcessingProvider):
    """Asks the toolbox as its search field does; gives the names of SlopeWatch's tools that it then shows."""
    model = QgsProcessingToolboxProxyModel(None, QgsApplication.processingRegistry())

    def search(text: str) -> set[str]:
        model.setFilterString(text)
        names: set[str] = set()
        waiting = [model.index(row, 0) for row in range(model.rowCount())]
        while waiting:
            index = waiting.pop()
            waiting += [model.index(row, 0, index) for row in range(model.rowCount(index))]
            algorithm = model.toolboxModel().algorithmForIndex(model.mapToSource(index))
            if algorithm is not None and algorithm.provider().id() == "slopewatch":
                names.add(algorithm.name())
        return names

    return search


@pytest.mark.parametrize("text", SEARCHES)
def test_the_toolbox_finds(text: str, found) -> None:
    shown = found(text)
    assert shown >= SEARCHES[text]
    assert "trainmodel" not in shown or text in ("machine learning", "slopewatch"), "it shows only what fits"


def test_nonsense_finds_nothing(found) -> None:
    assert found("photosynthesis") == set()
