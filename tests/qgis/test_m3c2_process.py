"""M3C2 through the real qgis_process, against the change that the simulation put in."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from qgis.core import QgsPointXY, QgsRasterLayer
from slopewatch.processing_algorithms.m3c2distances import M3C2Distances
from slopewatch.tests.builders.qgis import QgisProcess, engine_python

ANGLE = 45


@pytest.fixture(scope="module")
def survey(qgis_process: QgisProcess, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """A bare slope without an offset, so that the raw surveys are its ground."""
    engine_python()
    folder = tmp_path_factory.mktemp("bare slope")
    return qgis_process.run(
        "simulatesurvey", OUTPUT_FOLDER=folder, POINTS=60000, LENGTH=24, HEIGHT=10, VEGETATION=0, OFFSET=0, ANGLE=ANGLE
    )


def test_points_and_rasters(qgis_process: QgisProcess, survey: dict[str, Any], tmp_path: Path) -> None:
    copy = tmp_path / "copies" / "distance.tif"
    results = qgis_process.run(
        "m3c2distances",
        REFERENCE=survey["REFERENCE"],
        CLOUD=survey["CLOUD"],
        OUTPUT=tmp_path / "core, 'points'.laz",
        DISTANCE=copy,
        REGISTRATION_ERROR=0.005,
    )
    assert {*M3C2Distances.NUMBERS, *M3C2Distances.FILES} - {"REPORT_PDF"} <= set(results)
    assert Path(results["OUTPUT"]).stat().st_size > 0
    assert 0 < results["MEASURED_POINTS"] <= results["CORE_POINTS"]
    record = json.loads(Path(results["RUN_RECORD"]).read_text())
    assert record["metrics"]["registration_error_m"] == 0.005
    assert results["LEVEL_MEDIAN"] > 1.96 * 0.005
    assert results["PROJECTION_SCALE_USED"] == record["scales"]["projection_scale"]
    assert results["DISTANCE"] == str(copy)
    distance, truth = QgsRasterLayer(str(copy)), QgsRasterLayer(survey["TRUTH_DZ"])
    assert distance.isValid()
    assert distance.crs().isValid()
    assert distance.renderer().type() == "singlebandpseudocolor"
    for name in ("LEVEL_OF_DETECTION", "SIGNIFICANT"):
        assert QgsRasterLayer(results[name]).isValid()
    # a vertical change is seen across the slope
    ratios, extent, cell = [], truth.extent(), 0.5
    for column in range(int(extent.width() / cell)):
        for row in range(int(extent.height() / cell)):
            place = QgsPointXY(extent.xMinimum() + column * cell, extent.yMinimum() + row * cell)
            expected, known = truth.dataProvider().sample(place, 1)
            measured, seen = distance.dataProvider().sample(place, 1)
            if known and seen and abs(expected) > 0.15:
                ratios.append(measured / expected)
    ratios.sort()
    assert len(ratios) > 20
    assert ratios[len(ratios) // 2] == pytest.approx(math.cos(math.radians(ANGLE)), abs=0.1)


def test_the_engines_sentence_reaches_the_user(
    qgis_process: QgisProcess, survey: dict[str, Any], tmp_path: Path
) -> None:
    done = qgis_process.attempt(
        "m3c2distances", REFERENCE=survey["REFERENCE"], CLOUD=survey["REFERENCE"], OUTPUT=tmp_path / "out.laz"
    )
    assert done.returncode == 1
    assert "the same" in done.stderr
    assert list(tmp_path.iterdir()) == []
