"""Screen for hazards through the real qgis_process and the real engine."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

from qgis.core import QgsRasterLayer, QgsVectorLayer
from slopewatch.processing_algorithms.screenhazards import ScreenHazards
from slopewatch.tests.builders.qgis import QgisProcess


def test_a_raw_survey_is_refused_with_the_remedy_and_screened_with_it(
    qgis_process: QgisProcess, survey: dict[str, Any], tmp_path: Path
) -> None:
    given = {
        "INPUT": survey["REFERENCE"],
        "ROI": survey["ROI"],
        "SCREENING_METHOD": "residual",
        "OUTPUT": tmp_path / "labelled.laz",
        "ZONES": tmp_path / "hazards.gpkg",
    }
    done = qgis_process.attempt("screenhazards", **given)
    assert done.returncode == 1
    assert "give extract in “Ground points”" in done.stderr
    assert list(tmp_path.iterdir()) == []
    results = qgis_process.run("screenhazards", **given, GROUND="extract", RESIDUAL_THRESHOLD=0.05)
    assert set(ScreenHazards.NUMBERS) | set(ScreenHazards.FILES) <= set(results)
    for name in ("OUTPUT", "MAP", "RUN_RECORD"):
        assert Path(results[name]).stat().st_size > 0
    record = json.loads(Path(results["RUN_RECORD"]).read_text())
    assert record["parameters"]["screening"]["residual_threshold"] == 0.05
    assert results["GROUND_POINTS"] == record["metrics"]["ground_points"] > 5000
    raster = QgsRasterLayer(results["PROBABILITY"])
    assert raster.bandCount() == 3
    assert raster.renderer().type() == "singlebandpseudocolor"
    zones = QgsVectorLayer(f"{results['ZONES']}|layername=zones", "zones", "ogr")
    assert zones.featureCount() == results["ZONE_COUNT"] > 0
    assert zones.renderer().type() == "categorizedSymbol"
    # every zone meets a category of the style that the file holds
    known = {c.value() for c in zones.renderer().categories()}
    assert {f"{f['kind']}, {f['confidence']}" for f in zones.getFeatures()} <= known
    with closing(sqlite3.connect(results["ZONES"])) as database:
        assert database.execute("SELECT count(*) FROM layer_styles").fetchone() == (1,)
