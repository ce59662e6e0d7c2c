"""What the engine says, in the words of a dialog, its log and its outputs."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable
from pathlib import Path

import pytest
from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsProcessingContext,
    QgsProcessingException,
)
from slopewatch.processing_algorithms.checkenvironment import CheckEnvironment
from slopewatch.processing_algorithms.cloudinfo import CloudInfo
from slopewatch.processing_algorithms.extractground import ExtractGround
from slopewatch.tests.builders.qgis import Recorder

pytestmark = pytest.mark.usefixtures("qgis_app")
FIRST, LATER = "/data/slope 2024-05-01.laz", "/data/slope 2025-05-01.laz"


def test_the_engines_sentence_reaches_the_user(
    fake_engine: Callable[[str], Path], feedback: Recorder, tmp_path: Path
) -> None:
    sentence = f"{FIRST} does not exist; check the path."
    fake_engine(f"say(event='error', message={sentence!r}, code=2)\nsys.exit(2)")
    made = ExtractGround().create()
    parameters = {"INPUT": FIRST, "OUTPUT": str(tmp_path / "g.laz")}
    with pytest.raises(QgsProcessingException) as caught:
        made.run(parameters, QgsProcessingContext(), feedback, catchExceptions=False)
    assert str(caught.value) == sentence


def test_options_of_the_command_line_have_the_dialogs_names(
    fake_engine: Callable[[str], Path], feedback: Recorder, tmp_path: Path
) -> None:
    warning, refusal = "cloth_reach is small.", "g.laz declares no reference system; give one with --crs EPSG:n."
    fake_engine(
        f"say(event='log', level='warning', message={warning!r})\nsay(event='error', message={refusal!r}, code=2)\n"
        "sys.exit(2)"
    )
    made = ExtractGround().create()
    parameters = {"INPUT": FIRST, "OUTPUT": str(tmp_path / "g.laz")}
    with pytest.raises(QgsProcessingException) as caught:
        made.run(parameters, QgsProcessingContext(), feedback, catchExceptions=False)
    label = made.parameterDefinition("CRS").description()
    assert str(caught.value) == f"g.laz declares no reference system; give one with EPSG:n in “{label}”."
    assert feedback.said("warning") == [f"“{made.parameterDefinition('CLOTH_REACH').description()}” is small."]
    # what is run is shown as it is typed
    assert feedback.said("command")[0].startswith("slopewatch ground ")


def test_another_version_of_the_engine_is_said(
    fake_engine: Callable[[str], Path], feedback: Recorder, root: Path
) -> None:
    version = re.search(r"^version=(.+)$", (root / "metadata.txt").read_text(), re.MULTILINE)[1]
    for engine, warnings in ((version, []), ("0.0.9", [f"The engine is version 0.0.9, the plugin {version}"])):
        recorder = Recorder()
        fake_engine(f"say(event='result', outputs={{}}, metrics={{'slopewatch': {engine!r}, 'pdal': '2.9'}})")
        results, ok = CheckEnvironment().create().run({}, QgsProcessingContext(), recorder)
        assert ok
        assert (results["VERSION"], results["PDAL"]) == (engine, "2.9")
        assert [w.partition(";")[0] for w in recorder.said("warning")] == warnings
        assert "pdal: 2.9" in recorder.said("info")


def test_a_cloud_is_described_in_the_log_and_in_outputs(fake_engine: Callable[[str], Path], feedback: Recorder) -> None:
    facts = {
        "points": 120, "area": 4.0, "density": 30.0, "x": [1.5, 3.25], "points_by_class": {"2": 100, "5": 20},
        "reference_system": {"declared": "WGS 84 / UTM zone 51N"}, "warnings": ["No point has a GPS time."],
    }  # fmt: skip
    fake_engine(
        f"assert sys.argv[1:5] == ['info', {FIRST!r}, '--crs', 'EPSG:32651'], sys.argv\n"
        f"say(event='result', outputs={{}}, metrics={facts!r})"
    )
    parameters = {"INPUT": FIRST, "CRS": QgsCoordinateReferenceSystem("EPSG:32651")}
    results, ok = CloudInfo().create().run(parameters, QgsProcessingContext(), feedback)
    assert ok
    assert (results["POINTS"], results["AREA"], results["DENSITY"]) == (120, 4.0, 30.0)
    assert results["REFERENCE_SYSTEM"] == "WGS 84 / UTM zone 51N"
    assert results["UNUSUAL"] == "No point has a GPS time."
    assert feedback.said("warning") == ["No point has a GPS time."]
    assert {"x: 1.5 to 3.25", "points_by_class, 5: 20", "points: 120"} <= set(feedback.said("info"))


def test_the_log_shows_a_command_that_can_be_typed(
    fake_engine: Callable[[str], Path], feedback: Recorder, tmp_path: Path
) -> None:
    fake_engine("say(event='error', message='No.', code=2)\nsys.exit(2)")
    cloud = "/data/slope 'A' $HOME.laz"
    ExtractGround().create().run({"INPUT": cloud, "OUTPUT": str(tmp_path / "g.laz")}, QgsProcessingContext(), feedback)
    assert shlex.split(feedback.said("command")[0]) == ["slopewatch", "ground", cloud, "--output", f"{tmp_path}/g.laz"]


def test_figures_and_files_become_outputs(
    fake_engine: Callable[[str], Path], feedback: Recorder, tmp_path: Path
) -> None:
    output = tmp_path / "g.laz"
    record = tmp_path / "g_run.json"
    fake_engine(
        f"open({str(output)!r}, 'w').close()\nopen({str(record)!r}, 'w').write(json.dumps(sys.argv))\n"
        f"say(event='result', outputs={{'ground': {str(output)!r}, 'run': {str(record)!r}}}, "
        "metrics={'ground_points': 12, 'ground_ratio': None, 'new': 1})"
    )
    parameters = {"INPUT": FIRST, "OUTPUT": str(output)}
    results, ok = ExtractGround().create().run(parameters, QgsProcessingContext(), feedback)
    assert ok
    assert results == {"OUTPUT": str(output), "RUN_RECORD": str(record), "GROUND_POINTS": 12}
    assert json.loads(record.read_text())[1] == "ground"
