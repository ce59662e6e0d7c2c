"""Places on a road through the real qgis_process: squares next to a straight road, whose chainages are plain."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from qgis.core import (
    QgsCoordinateTransformContext,
    QgsFeature,
    QgsGeometry,
    QgsVectorFileWriter,
    QgsVectorLayer,
)
from slopewatch.tests.builders.qgis import QgisProcess, engine_python

CRS = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32651"}}


@pytest.fixture(scope="module", autouse=True)
def _engine() -> None:
    engine_python()


def written(path: Path, *features: tuple[dict[str, object], dict[str, object]]) -> str:
    """A GeoJSON of properties and geometries."""
    found = [{"type": "Feature", "properties": p, "geometry": g} for p, g in features]
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": CRS, "features": found}), encoding="utf-8")
    return str(path)


def square(west: float, south: float) -> dict[str, object]:
    ring = [[west, south], [west + 10, south], [west + 10, south + 10], [west, south + 10], [west, south]]
    return {"type": "Polygon", "coordinates": [ring]}


def test_squares_on_both_sides_have_their_chainages(qgis_process: QgisProcess, tmp_path: Path) -> None:
    road = {"type": "LineString", "coordinates": [[500_000, 3_500_000], [501_000, 3_500_000]]}
    line = written(tmp_path / "road.geojson", ({"route": "S320"}, road))
    squares = written(
        tmp_path / "zones.geojson",
        ({"name": "left"}, square(500_100, 3_500_005)),
        ({"name": "right"}, square(500_400, 3_499_970)),
    )
    output = tmp_path / "located.gpkg"
    results = qgis_process.run(
        "locateonroad", INPUT=squares, CENTRELINE=line, CHAINAGE_START=12_000, CHAINAGE_STYLE="K12+345", OUTPUT=output
    )
    assert (results["FEATURES"], results["LOCATED"], results["NOT_LOCATED"]) == (2, 2, 0)
    found = {one["name"]: one for one in QgsVectorLayer(str(output), "located", "ogr").getFeatures()}
    for name, start, side, offset in (("left", 12_100, "left", 5), ("right", 12_400, "right", 20)):
        row = found[name]
        assert row["route"] == "S320"
        assert row["side"] == side
        assert row["chain_from"] == pytest.approx(start, abs=0.01)
        assert row["chain_to"] == pytest.approx(start + 10, abs=0.01)
        assert row["offset_m"] == pytest.approx(offset, abs=0.01)
        assert f"K{start // 1000}+{start % 1000:03d}" in row["location"]


def test_m_values_that_qgis_wrote_are_the_chainages(qgis_process: QgisProcess, tmp_path: Path) -> None:
    """1,100 m of chainage on a line of 1,000 m, falling to the east, so that the north lies to the right."""
    layer = QgsVectorLayer("LineStringM?crs=EPSG:32651&field=route:string", "road", "memory")
    axis = QgsFeature(layer.fields())
    axis.setAttributes(["S320"])
    axis.setGeometry(QgsGeometry.fromWkt("LineStringM (500000 3500000 3100, 501000 3500000 2000)"))
    layer.dataProvider().addFeatures([axis])
    line = tmp_path / "road.gpkg"
    options = QgsVectorFileWriter.SaveVectorOptions()
    error = QgsVectorFileWriter.writeAsVectorFormatV3(layer, str(line), QgsCoordinateTransformContext(), options)
    assert error[0] == QgsVectorFileWriter.NoError, error
    squares = written(tmp_path / "zones.geojson", ({"name": "north"}, square(500_100, 3_500_005)))
    output = tmp_path / "located.gpkg"
    results = qgis_process.run("locateonroad", INPUT=squares, CENTRELINE=line, OUTPUT=output)
    assert (results["LOCATED"], results["NOT_LOCATED"]) == (1, 0)
    (row,) = QgsVectorLayer(str(output), "located", "ogr").getFeatures()
    assert (row["route"], row["side"]) == ("S320", "right")
    assert row["chain_from"] == pytest.approx(3100 - 1.1 * 110, abs=0.01)
    assert row["chain_to"] == pytest.approx(3100 - 1.1 * 100, abs=0.01)
