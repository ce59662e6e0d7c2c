"""The shipped model: the whole flow through the real qgis_process, against the truth of a simulated pair."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from qgis.core import QgsProcessingModelAlgorithm, QgsProcessingProvider, QgsVectorLayer
from slopewatch.plugin.shipped_model import FOLDER, TITLES
from slopewatch.tests.builders.qgis import QgisProcess


def test_every_model_is_in_the_toolbox_with_its_steps(provider: QgsProcessingProvider) -> None:
    models = [a for a in provider.algorithms() if isinstance(a, QgsProcessingModelAlgorithm)]
    assert {model.name() for model in models} == {path.stem for path in FOLDER.glob("*.model3")} == set(TITLES)
    for model in models:
        assert model.id() == f"slopewatch:{model.name()}"
        made = model.create()
        assert made.displayName() == TITLES[model.name()] == model.displayName()
        assert made.shortHelpString()
        assert made.shortDescription()
        assert not made.icon().isNull()
        assert made.tags()
        assert made.canExecute()[0]
        assert made.parameterDefinition("REFERENCE") is not None
        for child in made.childAlgorithms().values():
            known = {p.name() for p in child.algorithm().parameterDefinitions()}
            assert set(child.parameterSources()) <= known, "a parameter that the model sets is gone"
        assert len(made.childAlgorithms()) == 5


def test_the_whole_flow_runs(qgis_process: QgisProcess, survey: dict[str, Any], tmp_path: Path) -> None:
    done = qgis_process(
        "--json", "run", "slopewatch:slopeflow", f"--REFERENCE={survey['REFERENCE']}", f"--CLOUD={survey['CLOUD']}",
        f"--ROI={survey['ROI']}", "--REFERENCE_DATE=2024-05-01", "--CLOUD_DATE=2025-05-01",
        f"--output_folder={tmp_path / 'results'}",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    results = json.loads(done.stdout)["results"]
    assert Path(results["output_folder"]) == tmp_path / "results"
    record = json.loads((tmp_path / "results" / "run.json").read_text())
    assert record["command"] == "change"
    truth = json.loads(Path(survey["TRUTH"]).read_text())
    assert record["metrics"]["zone_count"] >= 1
    assert record["metrics"]["vol_loss_m3"] == pytest.approx(_lowered(truth, survey), rel=0.4)
    assert 0 < record["metrics"]["registration_error_m"] < 0.05, "it comes with the transform"
    zones = QgsVectorLayer(f"{tmp_path / 'results' / 'zones.gpkg'}|layername=zones")
    assert zones.featureCount() == record["metrics"]["zone_count"]
    assert {f["days"] for f in zones.getFeatures()} == {365}
    assert (tmp_path / "results" / "report.html").stat().st_size > 10_000


def _lowered(truth: dict[str, Any], survey: dict[str, Any]) -> float:
    record = json.loads(Path(survey["RUN_RECORD"]).read_text())
    return float(record["metrics"]["volume_lowered_m3"])
