"""Displacement vectors through the real qgis_process, against the motion of one half of the ground."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from qgis.core import QgsVectorLayer
from slopewatch.processing_algorithms.displacementvectors import DisplacementVectors
from slopewatch.tests.builders import known_truth
from slopewatch.tests.builders.algorithm_inputs import Inputs
from slopewatch.tests.builders.algorithm_runs import ON_BARE_GROUND, half_moved
from slopewatch.tests.builders.qgis import QgisProcess, engine_python


@pytest.fixture(scope="module")
def moved(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    engine_python()
    return Inputs(tmp_path_factory.mktemp("inputs")).moved


def test_the_half_that_moved_is_a_zone(qgis_process: QgisProcess, moved: dict[str, Path], tmp_path: Path) -> None:
    folder = tmp_path / "out, 'half'"
    results = qgis_process.run("displacementvectors", **moved, **ON_BARE_GROUND, OUTPUT_FOLDER=folder)
    assert set(DisplacementVectors.NUMBERS) | set(DisplacementVectors.FILES) <= set(results)
    half_moved(results, Inputs(tmp_path))
    vectors = list(QgsVectorLayer(f"{results['VECTORS']}|layername=vectors", "vectors", "ogr").getFeatures())
    assert len(vectors) > 5
    plunges = sorted(vector["plunge_deg"] for vector in vectors)
    assert plunges[len(plunges) // 2] == pytest.approx(known_truth.DIP_DEG, abs=5)
    record = json.loads(Path(results["RUN_RECORD"]).read_text(encoding="utf-8"))
    assert record["metrics"]["moving_zone_count"] == results["ZONE_COUNT"]
    by_chance = results["VECTOR_COUNT"] - len(vectors)  # outside of the zone and not written
    assert 0 <= by_chance <= record["metrics"]["chance_vectors_most"]


def test_the_engines_sentence_reaches_the_user(
    qgis_process: QgisProcess, moved: dict[str, Path], tmp_path: Path
) -> None:
    same = {"REFERENCE": moved["CLOUD"], "CLOUD": moved["CLOUD"]}
    done = qgis_process.attempt("displacementvectors", **same, **ON_BARE_GROUND, OUTPUT_FOLDER=tmp_path / "out")
    assert done.returncode == 1
    assert "the same" in done.stderr
    assert not (tmp_path / "out" / "run.json").exists()
