"""From a dialog's values to the engine's command line."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Any

import pytest
from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsProcessingContext,
    QgsProcessingException,
)
from qgis.PyQt.QtCore import QDate
from slopewatch.interface.parameters import GroundParameters
from slopewatch.processing_algorithms.compareflight import CompareFlight
from slopewatch.processing_algorithms.corridorbatch import CorridorBatch
from slopewatch.processing_algorithms.demchange import DemChange
from slopewatch.processing_algorithms.elevationchange import ElevationChange
from slopewatch.processing_algorithms.exportlabelstudio import ExportLabelStudio
from slopewatch.processing_algorithms.extractground import ExtractGround
from slopewatch.processing_algorithms.importlabelstudio import ImportLabelStudio
from slopewatch.processing_algorithms.inspectseries import InspectSeries
from slopewatch.processing_algorithms.inspectslope import InspectSlope
from slopewatch.processing_algorithms.locateonroad import LocateOnRoad
from slopewatch.processing_algorithms.m3c2distances import M3C2Distances
from slopewatch.processing_algorithms.planflight import PlanFlight
from slopewatch.processing_algorithms.simulatesurvey import SimulateSurvey
from slopewatch.processing_algorithms.suggestroi import SuggestRoi
from slopewatch.processing_algorithms.topview import TopView
from slopewatch.processing_algorithms.trainmodel import TrainModel
from slopewatch.tests.builders.command_lines import command, line, square, written

pytestmark = pytest.mark.usefixtures("qgis_app")
FIRST, LATER = "/data/slope 2024-05-01.laz", "/data/slope 2025-05-01.laz"


def test_defaults_pass_nothing(tmp_path: Path) -> None:
    assert command(InspectSlope, REFERENCE=FIRST, CLOUD=LATER, OUTPUT_FOLDER=str(tmp_path / "out")) == [
        "inspect",
        "--epoch",
        f"2024-05-01={FIRST}",
        "--epoch",
        f"2025-05-01={LATER}",
        "--output-dir",
        str(tmp_path / "out"),
    ]


def test_elevation_models_are_put_in_order_by_their_days(tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("dem 2020-01-01.asc", "dem 2015-06-01.asc")]
    for file in files:
        file.write_text("ncols 1\nnrows 1\nxllcorner 0\nyllcorner 0\ncellsize 1\n5\n", encoding="utf-8")
    given = {"MODELS": [str(file) for file in files], "OUTPUT_FOLDER": "/out"}
    later, first = map(str, files)
    assert command(DemChange, **given, PLAN_SHIFT=False) == [
        "demchange", f"2015-06-01={first}", f"2020-01-01={later}", "--output-dir", "/out", "--no-plan-shift",
    ]  # fmt: skip
    dated = command(DemChange, **given, MODEL_DATES="2010-01-01, 2011-01-01")
    assert dated[1:3] == [f"2010-01-01={later}", f"2011-01-01={first}"]
    with pytest.raises(QgsProcessingException, match="MODEL_DATES holds 1 days for 2 elevation models"):
        command(DemChange, **given, MODEL_DATES="2010-01-01")


def test_a_survey_alone_is_one_epoch() -> None:
    arguments = command(InspectSlope, REFERENCE=LATER, OUTPUT_FOLDER="/out", SCREENING_METHOD="residual")
    assert arguments == [
        "inspect", "--epoch", f"2025-05-01={LATER}", "--output-dir", "/out", "--screening-method", "residual",
    ]  # fmt: skip
    arguments = command(InspectSlope, REFERENCE=FIRST, CLOUD=LATER, OUTPUT_FOLDER="/out", SCREEN_LAST_EPOCH=False)
    assert arguments[-1] == "--no-screen-last-epoch"


@pytest.mark.parametrize("algorithm", [InspectSlope, ElevationChange])
def test_earlier_results_are_replaced_where_that_is_asked_for(algorithm: Any) -> None:
    given = {"REFERENCE": FIRST, "CLOUD": LATER, "OUTPUT_FOLDER": "/out"}
    assert command(algorithm, **given, OVERWRITE=True)[-1] == "--overwrite"
    assert "--overwrite" not in command(algorithm, **given)


def test_a_dialog_that_gives_every_default_passes_nothing_either() -> None:
    made = SimulateSurvey().create()
    values = {p.name(): p.defaultValue() for p in made.parameterDefinitions() if not p.isDestination()}
    assert command(SimulateSurvey, **values, OUTPUT_FOLDER="/out") == ["simulate", "survey", "--output-dir", "/out"]


def test_values_that_differ_are_passed() -> None:
    arguments = command(
        ExtractGround,
        INPUT=FIRST,
        OUTPUT="/out/ground.laz",
        PROFILE="paper",
        SLOPE_ALIGNED=False,
        CLOTH_RESOLUTION=0.35,
        RIGIDNESS=2,
        SLOPE_SMOOTHING=True,
        CLASS_THRESHOLD=GroundParameters().class_threshold,
        HEIGHT_UNIT="us-survey-foot",
        CRS=QgsCoordinateReferenceSystem("EPSG:6557"),
    )
    assert arguments == [
        "ground", FIRST, "--output", "/out/ground.laz", "--profile", "paper",
        "--crs", "EPSG:6557", "--height-unit", "us-survey-foot",
        "--cloth-resolution", "0.35", "--rigidness", "2", "--class-threshold", "0.06", "--slope-smoothing",
    ]  # fmt: skip


def test_settings_of_a_former_run_are_passed_with_what_differs_from_them(tmp_path: Path) -> None:
    path = tmp_path / "run.json"
    path.write_text(json.dumps({"command": "ground", "parameters": {"ground": {"rigidness": 2, "refine": False}}}))
    given = {"INPUT": FIRST, "OUTPUT": "/out/g.laz", "SETTINGS": str(path)}
    head = ["ground", FIRST, "--output", "/out/g.laz", "--settings", str(path)]
    assert command(ExtractGround, **given) == head
    assert command(ExtractGround, **given, RIGIDNESS=2) == head, "as in a dialog that was filled in"
    assert command(ExtractGround, **given, RIGIDNESS=1, REFINE=True) == [*head, "--rigidness", "1", "--refine"]
    assert command(ExtractGround, **given, PROFILE="paper", RIGIDNESS=1) == [
        *head, "--profile", "paper", "--rigidness", "1",
    ]  # fmt: skip
    path.write_text('{"profile": "paper", "iterations": 20}')
    assert command(ExtractGround, **given) == head
    assert command(ExtractGround, **given, PROFILE="default") == [*head, "--profile", "default"]


def test_settings_that_cannot_be_used_are_refused_before_the_engine_starts(tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    path.write_text('{"rigidness": 7}')
    made = ExtractGround().create()
    given = {"INPUT": FIRST, "OUTPUT": "/out/g.laz", "SETTINGS": str(path)}
    accepted, sentence = made.checkParameterValues(given, QgsProcessingContext())
    assert not accepted
    assert sentence == f"In {path} “Cloth rigidness” is 7; give a whole number from 1 to 3."
    with pytest.raises(QgsProcessingException, match="rigidness is 7"):
        command(ExtractGround, **given)


def test_a_value_overrides_the_profile_also_where_it_equals_the_default() -> None:
    given = {"INPUT": FIRST, "OUTPUT": "/out/g.laz", "PROFILE": "paper"}
    assert command(ExtractGround, **given)[4:] == ["--profile", "paper"]
    default, published = GroundParameters(), GroundParameters.build(profile="paper")
    assert default.cloth_resolution != published.cloth_resolution
    assert command(ExtractGround, **given, CLOTH_RESOLUTION=published.cloth_resolution)[4:] == ["--profile", "paper"]
    overridden = command(ExtractGround, **given, CLOTH_RESOLUTION=default.cloth_resolution, REFINE=True)
    assert overridden[4:] == ["--profile", "paper", "--cloth-resolution", str(default.cloth_resolution), "--refine"]
    change = {"REFERENCE": FIRST, "CLOUD": LATER, "OUTPUT_FOLDER": "/out", "PROFILE": "paper"}
    assert command(ElevationChange, **change, CELL=None)[-4:] == ["--profile", "paper", "--cell", "auto"], "emptied"


def test_numbers_that_stand_for_auto_pass_nothing() -> None:
    """Those of models and batches that were saved with 0 and -1, and what an emptied field gives."""
    given = {"REFERENCE": "/a.laz", "CLOUD": "/b.laz", "OUTPUT": "/o/a.laz", "OUTPUT_FOLDER": "/o"}
    left = {"CELL": 0, "LARGEST_CELL": "0", "REGISTRATION_ERROR": -1, "COLOUR_RANGE": 0.0, "NORMAL_SCALE": None}
    words = {"CELL": "", "REGISTRATION_ERROR": "auto"}
    assert command(ElevationChange, **given, **words)[3:] == ["--output-dir", "/o"]
    assert command(ElevationChange, **given, **left)[3:] == ["--output-dir", "/o"]
    assert command(M3C2Distances, **given, REGISTRATION_ERROR="-1", NORMAL_SCALE=0)[3:] == ["--output", "/o/a.laz"]
    stated = command(ElevationChange, **given, CELL=0.2, REGISTRATION_ERROR=0)
    assert stated[5:] == ["--cell", "0.2", "--registration-error", "0.0"]
    made, context = ElevationChange().create(), QgsProcessingContext()
    assert made.checkParameterValues({**given, **left}, context)[0]
    assert not made.checkParameterValues({**given, "REGISTRATION_ERROR": -0.5}, context)[0]


def test_values_as_qgis_process_gives_them() -> None:
    arguments = command(
        InspectSlope, REFERENCE=FIRST, CLOUD=LATER, OUTPUT_FOLDER="/out", PROFILE="1", CELL="0.25",
        SLOPE_ALIGNED="true", METHOD="icp", MINIMUM_POINTS="3",
    )  # fmt: skip
    assert arguments[arguments.index("/out") + 1 :] == [
        "--profile", "paper", "--slope-aligned", "--cell", "0.25", "--minimum-points", "3",
    ]  # fmt: skip


def test_a_reference_system_without_a_code_is_passed_as_text() -> None:
    crs = QgsCoordinateReferenceSystem.fromProj("+proj=tmerc +lat_0=31.5 +lon_0=121.4 +x_0=1234 +units=m +ellps=GRS80")
    arguments = command(ExtractGround, INPUT=FIRST, OUTPUT="/out/g.laz", CRS=crs)
    assert "1234" in arguments[arguments.index("--crs") + 1]


def test_days_come_from_the_parameter_before_the_name() -> None:
    for day in (QDate(2023, 1, 31), "2023-01-31", "2023-01-31T00:00:00"):
        arguments = command(InspectSlope, REFERENCE=FIRST, REFERENCE_DATE=day, CLOUD=LATER, OUTPUT_FOLDER="/out")
        assert arguments[2] == f"2023-01-31={FIRST}"
    arguments = command(ElevationChange, REFERENCE="/a.laz", CLOUD=LATER, CLOUD_DATE="2025-06-01", OUTPUT_FOLDER="/o")
    assert arguments == ["change", "/a.laz", LATER, "--output-dir", "/o", "--epoch-to", "2025-06-01"]


def test_a_survey_without_a_day_is_refused() -> None:
    with pytest.raises(QgsProcessingException, match=r"CLOUD_DATE is not set.*/data/b\.laz.*give the day"):
        command(InspectSlope, REFERENCE=FIRST, CLOUD="/data/b.laz", OUTPUT_FOLDER="/out")
    with pytest.raises(QgsProcessingException, match=r"REFERENCE_DATE is 'yesterday'; give a day"):
        command(InspectSlope, REFERENCE=FIRST, REFERENCE_DATE="yesterday", CLOUD=LATER, OUTPUT_FOLDER="/out")


def test_level_options_and_stable_ground_reach_the_engine(tmp_path: Path) -> None:
    stable = written(square("stable", 0), tmp_path / "stable.gpkg", "stable")
    arguments = command(
        ElevationChange, REFERENCE="/a.laz", CLOUD="/b.laz", OUTPUT_FOLDER="/o", STABLE=str(stable),
        THRESHOLD=1, DIRECTION=1, CALIBRATE=False,
    )  # fmt: skip
    assert arguments[arguments.index("--stable") + 1] == str(stable)
    assert arguments[arguments.index("--threshold") + 1] == "coherent"
    assert arguments[arguments.index("--direction") + 1] == "normal"
    assert "--no-calibrate" in arguments


def test_stable_ground_and_the_published_level_of_m3c2_are_passed(tmp_path: Path) -> None:
    stable = written(square("stable", 0), tmp_path / "stable.gpkg", "stable")
    arguments = command(
        M3C2Distances, REFERENCE="/a.laz", CLOUD="/b.laz", OUTPUT="/o/a.laz", STABLE=str(stable), CALIBRATE=False
    )
    assert arguments[arguments.index("--stable") + 1] == str(stable)
    assert "--no-calibrate" in arguments
    assert "--stable" not in command(M3C2Distances, REFERENCE="/a.laz", CLOUD="/b.laz", OUTPUT="/o/a.laz")


@pytest.mark.parametrize("algorithm", [ElevationChange, M3C2Distances])
def test_which_points_are_taken_and_trusted_days_reach_the_engine(algorithm: Any) -> None:
    values = {"OUTPUT_FOLDER": "/o", "OUTPUT": "/o/a.laz", "GROUND": "as_is", "TRUST_DATES": True}
    arguments = command(algorithm, REFERENCE="/a.laz", CLOUD="/b.laz", **values)
    assert arguments[arguments.index("--ground") + 1] == "as_is"
    assert "--trust-dates" in arguments


def test_values_out_of_bounds_are_refused_with_the_dialogs_name_and_the_engines_bounds() -> None:
    made = InspectSlope().create()
    given = {"REFERENCE": FIRST, "CLOUD": LATER, "OUTPUT_FOLDER": "/out"}
    context = QgsProcessingContext()
    assert made.checkParameterValues(given, context) == (True, "")
    assert made.checkParameterValues({**given, "CELL": 0}, context) == (True, ""), "0 leaves it to the clouds"
    for value in (0.001, -1.5, "0.004"):
        ok, sentence = made.checkParameterValues({**given, "CELL": value}, context)
        assert not ok
        assert sentence.startswith("“Cell size (m)” is ")
        assert sentence.endswith("give a number from 0.005 to 100 m, or leave it empty.")
    assert made.checkParameterValues({**given, "PROFILE": "1", "METHOD": "icp"}, context)[0]
    assert not made.checkParameterValues({**given, "PROFILE": "2"}, context)[0]
    assert not made.checkParameterValues({**given, "CELL": "wide"}, context)[0]
    assert not made.checkParameterValues({**given, "METHOD": "magic"}, context)[0]


def test_training_takes_several_clouds_and_other_weights(tmp_path: Path) -> None:
    areas = written(square("areas", 0), tmp_path / "areas.gpkg", "areas")
    arguments = command(
        TrainModel, CLOUDS=[FIRST, LATER], POLYGONS=str(areas), START="none", OUTSIDE="unknown", MINUTES=30,
        START_WEIGHTS="/data/own.safetensors", OUTPUT_FOLDER="/out",
    )  # fmt: skip
    assert arguments == [
        "train", FIRST, LATER, "--output-dir", "/out", "--polygons", str(areas), "--start", "none", "--outside",
        "unknown", "--minutes", "30.0", "--start", "/data/own.safetensors",
    ]  # fmt: skip
    with pytest.raises(QgsProcessingException, match="CLOUDS is empty; give one or more labelled"):
        command(TrainModel, CLOUDS=[], OUTPUT_FOLDER="/out")


def test_a_corridor(tmp_path: Path) -> None:
    out = str(tmp_path / "out")
    assert command(CorridorBatch, MANIFEST="/data/corridor.csv", OUTPUT_FOLDER=out) == [
        "batch", "/data/corridor.csv", "--output-dir", out,
    ]  # fmt: skip
    given: dict[str, Any] = {"CENTRELINE": "/data/road.gpkg", "ALERT_TABLE": "/data/a.csv", "WORKERS": 4, "CELL": 0.5}
    more = command(CorridorBatch, INPUT=str(tmp_path), OUTPUT_FOLDER=out, MEMORY_BUDGET=8, SCHEDULER="local", **given)
    assert more[:2] == ["batch", str(tmp_path)]
    assert shlex.join(more[2:]) == (
        f"--centreline /data/road.gpkg --alerts /data/a.csv --output-dir {out} --workers 4 --memory-budget 8.0 "
        "--scheduler local --cell 0.5"
    )
    for wrong in ({}, {"MANIFEST": "/data/corridor.csv", "INPUT": str(tmp_path)}):
        with pytest.raises(QgsProcessingException, match="not both"):
            command(CorridorBatch, OUTPUT_FOLDER=out, **wrong)


def test_what_is_drawn_on(tmp_path: Path) -> None:
    out = str(tmp_path / "out")
    found = command(TopView, INPUT=FIRST, OUTPUT_FOLDER=out, CELL=0.2, HILLSHADE="highest")
    assert found == ["topview", FIRST, "--output-dir", out, "--cell", "0.2", "--hillshade", "highest"]
    roi = str(tmp_path / "roi.gpkg")
    found = command(SuggestRoi, INPUT=FIRST, OUTPUT=roi, LEAST_DENSITY=0.3, OVERWRITE=True)
    assert found == ["suggestroi", FIRST, "--output", roi, "--least-density", "0.3", "--overwrite"]


def test_a_flight_is_planned(tmp_path: Path) -> None:
    out, roi = str(tmp_path / "out"), str(written(square("roi", 0), tmp_path / "roi.gpkg", "roi"))
    given: dict[str, Any] = {"TERRAIN": FIRST, "ROI": roi, "SURVEY": LATER, "PLAN": "/data/plan.gpkg", "ALTITUDE": 60.0}
    found = command(PlanFlight, OUTPUT_FOLDER=out, **given, AZIMUTH=30.0)
    assert found == [
        "planflight", FIRST, "--output-dir", out, "--roi", roi, "--survey", LATER, "--plan", "/data/plan.gpkg",
        "--altitude", "60.0", "--azimuth", "30.0",
    ]  # fmt: skip


def test_a_flight_is_planned_with_its_season_and_a_mission(tmp_path: Path) -> None:
    out, roi = str(tmp_path / "out"), str(written(square("roi", 0), tmp_path / "roi.gpkg", "roi"))
    given: dict[str, Any] = {"TERRAIN": FIRST, "ROI": roi, "SEASON": [FIRST, LATER], "WPML_DRONE": 89}
    found = command(
        PlanFlight, OUTPUT_FOLDER=out, **given, WPML_PAYLOAD=65534, TAKEOFF_HEIGHT="12.5",
        TAKEOFF_ELLIPSOID_HEIGHT="-20",
    )  # fmt: skip
    assert found == [
        "planflight", FIRST, "--output-dir", out, "--roi", roi, "--season", FIRST, "--season", LATER, "--wpml-drone",
        "89", "--wpml-payload", "65534", "--takeoff-height", "12.5", "--takeoff-ellipsoid-height", "-20",
    ]  # fmt: skip


def test_a_flight_is_compared_with_its_plan(tmp_path: Path) -> None:
    out, given = str(tmp_path / "out"), {"PLAN": "/data/plan.gpkg", "INPUT": FIRST}
    assert command(CompareFlight, OUTPUT_FOLDER=out, **given, GROUND=LATER, TRAJECTORY="/data/flown.csv") == [
        "compareflight", "/data/plan.gpkg", FIRST, "--output-dir", out, "--ground", LATER, "--trajectory",
        "/data/flown.csv",
    ]  # fmt: skip


def test_places_on_a_road_and_classes_of_asset(tmp_path: Path) -> None:
    road = str(written(line("road"), tmp_path / "road.gpkg", "road"))
    zones = str(written(square("zones", 0), tmp_path / "zones.gpkg", "zones"))
    given: dict[str, Any] = {"CENTRELINE": road, "FIELD_NAMES": "/data/names.csv", "CHAINAGE_START": 12300}
    out = str(tmp_path / "out.gpkg")
    found = command(LocateOnRoad, INPUT=zones, OUTPUT=out, **given)
    assert found[:2] == ["locate", zones]
    expected = [
        "--centreline",
        road,
        "--field-names",
        "/data/names.csv",
        "--output",
        out,
        "--chainage-start",
        "12300.0",
    ]
    assert found[-8:] == expected
    done = command(ElevationChange, REFERENCE=FIRST, CLOUD=LATER, OUTPUT_FOLDER="/out", CLASSES=zones, **given)
    words = f"--centreline {road} --field-names /data/names.csv --classes {zones} --chainage-start 12300.0"
    assert words in shlex.join(done)


def test_corrections_by_hand(tmp_path: Path) -> None:
    drawn = str(written(square("corrections", 0), tmp_path / "corrections.gpkg", "corrections"))
    surveys = {"REFERENCE": FIRST, "CLOUD": LATER}
    for algorithm, given in (
        (InspectSlope, surveys),
        (InspectSeries, {"MANIFEST": "/data/series.csv"}),
        (CorridorBatch, {"MANIFEST": "/data/slopes.csv"}),
    ):
        found = command(algorithm, OUTPUT_FOLDER="/out", CORRECTIONS=drawn, **given)
        assert f"--corrections {drawn}" in shlex.join(found)


def test_what_goes_to_label_studio_and_back(tmp_path: Path) -> None:
    out, labels = str(tmp_path / "out"), str(tmp_path / "labels.gpkg")
    with pytest.raises(QgsProcessingException, match="PICTURE cannot be read as a raster"):
        command(ExportLabelStudio, PICTURE=str(tmp_path / "gone.tif"), OUTPUT_FOLDER=out)
    found = command(ImportLabelStudio, EXPORT="/data/e.json", TASKS="/data/t.json", OUTPUT=labels)
    assert found == ["importlabelstudio", "/data/e.json", "--tasks", "/data/t.json", "--output", labels]
