"""Change of elevation models through the real qgis_process, against the bias and the pit of the later model."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from slopewatch.processing_algorithms.demchange import DemChange
from slopewatch.tests.builders import known_truth
from slopewatch.tests.builders.algorithm_inputs import Inputs
from slopewatch.tests.builders.algorithm_runs import bias_and_pit
from slopewatch.tests.builders.qgis import QgisProcess, engine_python


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    engine_python()
    return Inputs(tmp_path_factory.mktemp("inputs")).models


def test_a_pit_is_measured_and_a_bias_is_none(qgis_process: QgisProcess, models: list[Path], tmp_path: Path) -> None:
    """The models are given with their days, in the wrong order: the days put them right."""
    given = {"MODELS": models[::-1], "MODEL_DATES": ",".join(reversed(known_truth.DAYS))}
    copy = tmp_path / "copies" / "change.tif"
    results = qgis_process.run("demchange", **given, OUTPUT_FOLDER=tmp_path / "out, 'pit'", ELEVATION_CHANGE=copy)
    on_request = {"ZONE_SERIES", "PAIRS", "CLASS_TABLE", "REPORT_PDF"}
    assert {*DemChange.NUMBERS, *DemChange.FILES, *DemChange.PAGES} - on_request <= set(results)
    assert results["ELEVATION_CHANGE"] == str(copy)
    bias_and_pit(results, Inputs(tmp_path))
    with Path(results["PAIRS"]).open(encoding="utf-8") as file:
        (pair,) = csv.DictReader(file)
    assert (pair["from"], pair["to"]) == known_truth.DAYS


def test_days_that_are_too_few_are_refused(qgis_process: QgisProcess, models: list[Path], tmp_path: Path) -> None:
    given = {"MODELS": models, "MODEL_DATES": known_truth.DAYS[0]}
    done = qgis_process.attempt("demchange", **given, OUTPUT_FOLDER=tmp_path / "out")
    assert done.returncode == 1
    assert "“Days of the models” holds 1 days for 2 elevation models" in done.stderr
    assert not (tmp_path / "out" / "run.json").exists()
