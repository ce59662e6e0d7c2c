"""Through the real qgis_process program: registration, messages and exit codes, cancelling, and whole runs."""

from __future__ import annotations

import json
import os
import signal
import struct
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from qgis.core import QgsRasterLayer, QgsVectorLayer
from slopewatch.plugin.shipped_model import TITLES as MODELS
from slopewatch.processing_algorithms import ALGORITHMS
from slopewatch.processing_algorithms.elevationchange import ElevationChange
from slopewatch.processing_algorithms.extractground import ExtractGround
from slopewatch.processing_algorithms.inspectslope import InspectSlope
from slopewatch.processing_algorithms.registerepochs import RegisterEpochs
from slopewatch.processing_algorithms.simulatescenes import SimulateScenes
from slopewatch.processing_algorithms.trainmodel import TrainModel
from slopewatch.tests.builders.limits import CANCELLED_S, PATIENCE_S
from slopewatch.tests.builders.qgis import QgisProcess, engine_python, processes_with, wait_until


def engine_says(*arguments: str) -> str:
    """The sentence of the engine on the command line, without QGIS."""
    done = subprocess.run(
        [engine_python(), "-m", "slopewatch.cli", *arguments], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2, done.stderr
    return done.stderr.strip().splitlines()[-1].removeprefix("Error: ")


class TestOffer:
    def test_every_algorithm_is_listed(self, qgis_process: QgisProcess) -> None:
        listed = json.loads(qgis_process("--json", "list").stdout)["providers"]["slopewatch"]["algorithms"]
        assert set(listed) == {f"slopewatch:{name}" for name in (*(a.NAME for a in ALGORITHMS), *MODELS)}

    def test_help_shows_units_and_what_values_do(self, qgis_process: QgisProcess) -> None:
        text = qgis_process("help", "slopewatch:inspectslope").stdout
        assert "Ground: cloth resolution (m)" in text
        assert "Larger is faster and smoother" in text
        assert "OUTPUT_FOLDER" in text


ON_REQUEST = {"CLASS_TABLE", "REPORT_PDF", "FASTEST_ZONE"}
"""Outputs of runs with classes, with a PDF, or with ground that moves along its surface."""
CLOUD_WITHOUT_SYSTEM = """
import sys
import laspy
import numpy as np
las = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
las.x = las.y = las.z = np.arange(200.0)
las.write(sys.argv[1])
"""


class TestErrors:
    def test_no_engine(self, qgis_process: QgisProcess) -> None:
        done = qgis_process("run", "slopewatch:checkenvironment", SLOPEWATCH_PYTHON="/nowhere/python")
        assert done.returncode == 1
        assert "/nowhere/python (environment variable SLOPEWATCH_PYTHON) does not exist" in done.stderr

    @pytest.mark.parametrize("content", [None, b"", b"not a cloud at all, but long enough to be read" * 20])
    def test_a_bad_cloud_gets_the_engines_sentence(
        self, qgis_process: QgisProcess, tmp_path: Path, content: bytes | None
    ) -> None:
        cloud, output = tmp_path / "no, 'such' cloud ä.las", tmp_path / "ground.laz"
        if content is not None:
            cloud.write_bytes(content)
        done = qgis_process.attempt("extractground", INPUT=cloud, OUTPUT=output)
        assert done.returncode == 1
        assert engine_says("ground", str(cloud), "--output", str(output)) in done.stderr
        assert done.stdout.strip() == ""
        assert {p.name for p in tmp_path.iterdir()} <= {cloud.name}

    def test_a_refusal_names_the_dialogs_parameter(self, qgis_process: QgisProcess, tmp_path: Path) -> None:
        cloud, output = tmp_path / "nowhere.las", tmp_path / "ground.laz"
        subprocess.run([engine_python(), "-c", CLOUD_WITHOUT_SYSTEM, str(cloud)], check=True)
        assert "with --crs EPSG:n." in engine_says("ground", str(cloud), "--output", str(output))
        done = qgis_process.attempt("extractground", INPUT=cloud, OUTPUT=output)
        assert done.returncode == 1
        assert "declares no coordinate reference system" in done.stderr
        assert "with EPSG:n in “Coordinate reference system”." in done.stderr
        assert not output.exists()

    def test_a_value_out_of_bounds(self, qgis_process: QgisProcess, tmp_path: Path) -> None:
        given = {"REFERENCE": "a_2024-05-01.laz", "CLOUD": "b_2025-05-01.laz", "OUTPUT_FOLDER": tmp_path / "out"}
        done = qgis_process.attempt("inspectslope", CELL=-1, **given)
        assert done.returncode == 1
        assert "give a number from 0.005 to 100 m, or leave it empty." in done.stderr
        assert list(tmp_path.iterdir()) == []

    def test_the_same_survey_twice_and_an_unwritable_folder(
        self, qgis_process: QgisProcess, survey: dict[str, Any], tmp_path: Path
    ) -> None:
        twice = {"REFERENCE": survey["REFERENCE"], "CLOUD": survey["REFERENCE"], "CLOUD_DATE": "2025-05-01"}
        done = qgis_process.attempt("inspectslope", **twice, OUTPUT_FOLDER=tmp_path / "out")
        assert done.returncode == 1
        assert "the same cloud" in done.stderr
        (tmp_path / "file").write_text("")
        pair = {"REFERENCE": survey["REFERENCE"], "CLOUD": survey["CLOUD"]}
        done = qgis_process.attempt("inspectslope", **pair, OUTPUT_FOLDER=tmp_path / "file" / "out")
        assert done.returncode == 1
        assert str(tmp_path / "file" / "out") in done.stderr
        assert {p.name for p in tmp_path.iterdir()} == {"file"}


STUBBORN = """
for name in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
    signal.signal(name, signal.SIG_IGN)
code = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(120)"
child = subprocess.Popen([sys.executable, "-c", code, value("--output")])
say(event="progress", percent=5, message="working")
time.sleep(120)
"""


class TestCancelling:
    def test_sigint_ends_a_stubborn_engine_and_its_children(
        self, qgis_process: QgisProcess, fake_engine: Callable[[str], Path], tmp_path: Path
    ) -> None:
        python = fake_engine(STUBBORN)
        qgis_process.environment["SLOPEWATCH_PYTHON"] = str(python)
        output = str(tmp_path / "ground.laz")
        try:
            process = qgis_process.start("extractground", INPUT="/data/a.laz", OUTPUT=output)
        finally:
            del qgis_process.environment["SLOPEWATCH_PYTHON"]
        # qgis_process, the engine and its child
        wait_until(lambda: len(processes_with(output)) >= 3)
        assert self._interrupt(process, output) < CANCELLED_S
        assert process.wait() == 1
        assert list(tmp_path.glob("*.laz")) == []

    def test_sigint_leaves_nothing_of_a_real_run(
        self, qgis_process: QgisProcess, survey: dict[str, Any], tmp_path: Path
    ) -> None:
        folder = tmp_path / "results"
        inputs = {"REFERENCE": survey["REFERENCE"], "CLOUD": survey["CLOUD"], "OUTPUT_FOLDER": folder}
        process = qgis_process.start("inspectslope", **inputs, CLOTH_RESOLUTION=0.02)
        wait_until(lambda: list(tmp_path.rglob("*_ground*")) or list(tmp_path.rglob(".slopewatch-part-*")))
        assert self._interrupt(process, str(folder)) < CANCELLED_S
        assert process.wait() == 1
        assert list(tmp_path.iterdir()) == []

    def test_a_killed_qgis_leaves_no_orphan(
        self, qgis_process: QgisProcess, survey: dict[str, Any], tmp_path: Path
    ) -> None:
        folder = tmp_path / "results"
        inputs = {"REFERENCE": survey["REFERENCE"], "CLOUD": survey["CLOUD"], "OUTPUT_FOLDER": folder}
        process = qgis_process.start("inspectslope", **inputs, CLOTH_RESOLUTION=0.02)
        wait_until(lambda: list(tmp_path.rglob(".slopewatch-part-*")))
        process.kill()
        process.wait()
        wait_until(lambda: not processes_with(str(folder)))
        wait_until(lambda: list(tmp_path.iterdir()) == [])
        process.communicate(timeout=PATIENCE_S)

    @staticmethod
    def _interrupt(process: subprocess.Popen[str], mark: str) -> float:
        """Send SIGINT; the seconds until no process with ``mark`` in its command line is left besides qgis_process."""
        started = time.monotonic()
        os.kill(process.pid, signal.SIGINT)
        wait_until(lambda: [p for p in processes_with(mark) if p != process.pid] == [])
        seconds = time.monotonic() - started
        process.communicate(timeout=PATIENCE_S)
        return seconds


class TestRuns:
    def test_the_environment_is_complete(self, qgis_process: QgisProcess) -> None:
        python = engine_python()
        results = qgis_process.run("checkenvironment")
        assert results["ENGINE"] == str(python)
        assert results["PDAL"]
        assert results["VERSION"]

    def test_a_cloud_is_described(self, qgis_process: QgisProcess, survey: dict[str, Any]) -> None:
        results = qgis_process.run("cloudinfo", INPUT=survey["CLOUD"])
        header = Path(survey["CLOUD"]).read_bytes()[:375]
        assert results["POINTS"] == struct.unpack_from("<Q", header, 247)[0]  # of LAS 1.4
        assert "UTM zone 51N" in results["REFERENCE_SYSTEM"]
        assert 10 < results["DENSITY"] < 1000
        assert results["AREA"] == pytest.approx(results["POINTS"] / results["DENSITY"], rel=1e-3)

    def test_the_whole_flow(self, qgis_process: QgisProcess, survey: dict[str, Any], tmp_path: Path) -> None:
        """Raw simulated surveys to zones; the figures against the truth that the simulation wrote."""
        copy = tmp_path / "copies" / "change.tif"
        results = qgis_process.run(
            "inspectslope",
            REFERENCE=survey["REFERENCE"],
            CLOUD=survey["CLOUD"],
            ROI=survey["ROI"],
            CELL=0.25,
            OUTPUT_FOLDER=tmp_path / "out",
            ELEVATION_CHANGE=copy,
            SCREENING_METHOD="residual",
            RESIDUAL_THRESHOLD=0.05,
        )
        assert set(InspectSlope.NUMBERS) | set(InspectSlope.FILES) <= set(results) | ON_REQUEST
        assert results["ELEVATION_CHANGE"] == str(copy)
        change = QgsRasterLayer(str(copy))
        assert change.isValid()
        assert change.renderer().type() == "singlebandpseudocolor"
        assert change.crs().isValid()
        assert change.rasterUnitsPerPixelX() == pytest.approx(0.25)
        for name in ("LEVEL_OF_DETECTION", "SIGNIFICANT_CHANGE", "HEATMAP", "TOP_VIEW"):
            assert QgsRasterLayer(results[name]).isValid()
        for name in ("REPORT", "HEATMAP_PICTURE", "TRANSFORM_FILE", "RUN_RECORD"):
            assert Path(results[name]).stat().st_size > 0
        zones = QgsVectorLayer(f"{results['ZONES']}|layername=zones", "zones", "ogr")
        assert zones.featureCount() == results["ZONE_COUNT"] > 0
        assert zones.renderer().type() == "categorizedSymbol"
        screened = QgsVectorLayer(f"{results['SCREENED_ZONES']}|layername=zones", "screened", "ogr")
        words = [feature["confirmed"] for feature in screened.getFeatures()]
        assert len(words) == results["SCREENED_ZONE_COUNT"] > 0
        assert words.count("confirmed") == results["CONFIRMED_ZONES"]
        assert screened.renderer().type() == "categorizedSymbol"
        assert screened.attributeDisplayName(screened.fields().indexOf("confirmed")) == "Confirmed by the change"
        assert QgsRasterLayer(results["SCREENED_PROBABILITY"]).bandCount() == 3
        # where the truth says that much has changed, the difference says so too
        truth = QgsRasterLayer(survey["TRUTH_DZ"])
        errors = []
        extent, cell = truth.extent(), truth.rasterUnitsPerPixelX()
        x = extent.xMinimum() + cell / 2
        while x < extent.xMaximum():
            y = extent.yMinimum() + cell / 2
            while y < extent.yMaximum():
                point = extent.center()
                point.set(x, y)
                expected, ok = truth.dataProvider().sample(point, 1)
                if ok and abs(expected) > 0.15:
                    measured, seen = change.dataProvider().sample(point, 1)
                    if seen:
                        errors.append(abs(measured - expected))
                y += cell
            x += cell
        errors.sort()
        assert len(errors) > 50
        assert errors[len(errors) // 2] < 0.06

    def test_one_survey_is_screened(self, qgis_process: QgisProcess, survey: dict[str, Any], tmp_path: Path) -> None:
        given = {"REFERENCE": survey["CLOUD"], "ROI": survey["ROI"], "OUTPUT_FOLDER": tmp_path / "out"}
        results = qgis_process.run("inspectslope", **given, SCREENING_METHOD="residual", RESIDUAL_THRESHOLD=0.05)
        screened = QgsVectorLayer(f"{results['SCREENED_ZONES']}|layername=zones", "screened", "ogr")
        assert screened.featureCount() == results["SCREENED_ZONE_COUNT"] > 0
        for name in ("SCREENED_CLOUD", "SCREENED_MAP", "RUN_RECORD"):
            assert Path(results[name]).stat().st_size > 0
        assert not {"ZONES", "ELEVATION_CHANGE", "HEATMAP_PICTURE", "CONFIRMED_ZONES"} & set(results)

    def test_the_single_steps_chain(self, qgis_process: QgisProcess, survey: dict[str, Any], tmp_path: Path) -> None:
        grounds = {}
        for name in ("REFERENCE", "CLOUD"):
            grounds[name] = tmp_path / f"ground_{Path(survey[name]).name}"
            results = qgis_process.run("extractground", INPUT=survey[name], ROI=survey["ROI"], OUTPUT=grounds[name])
            assert set(ExtractGround.NUMBERS) | set(ExtractGround.FILES) <= set(results)
            assert 0 < results["GROUND_POINTS"] < results["ROI_POINTS"] <= results["RAW_POINTS"]
        registered = qgis_process.run(
            "registerepochs", **grounds, OUTPUT=tmp_path / "moved.laz", TRANSFORM=tmp_path / "transform.json"
        )
        assert set(RegisterEpochs.NUMBERS) <= set(registered)
        assert Path(registered["OUTPUT"]).stat().st_size > 0
        matrix = json.loads((tmp_path / "transform.json").read_text())["matrix"]
        assert [len(row) for row in matrix] == [4, 4, 4, 4]
        first = qgis_process.run(
            "elevationchange",
            REFERENCE=grounds["REFERENCE"],
            CLOUD=registered["OUTPUT"],
            REFERENCE_DATE="2024-05-01",
            CLOUD_DATE="2025-05-01",
            OUTPUT_FOLDER=tmp_path / "moved",
            CELL=0.25,
            ADAPTIVE="false",
        )
        second = qgis_process.run(
            "elevationchange",
            **grounds,
            TRANSFORM=tmp_path / "transform.json",
            OUTPUT_FOLDER=tmp_path / "applied",
            CELL=0.25,
            ADAPTIVE="false",
        )
        assert set(ElevationChange.NUMBERS) | set(ElevationChange.FILES) <= set(first) | ON_REQUEST
        assert first["ZONE_COUNT"] > 0
        assert second["GAIN"] == pytest.approx(first["GAIN"], rel=0.02)
        assert "CELL_SIZE" not in first
        grown = qgis_process.run(
            "elevationchange",
            **grounds,
            TRANSFORM=tmp_path / "transform.json",
            OUTPUT_FOLDER=tmp_path / "grown",
            CELL_SIZE=tmp_path / "sizes.tif",
        )
        assert grown["CELL_SIZE"] == str(tmp_path / "sizes.tif")
        sizes = QgsRasterLayer(grown["CELL_SIZE"])
        assert sizes.rasterUnitsPerPixelX() == pytest.approx(0.1)
        assert len(sizes.renderer().shader().rasterShaderFunction().colorRampItemList()) >= 3
        # of the blocks of 1 m that the surveys reach, those at the edge are not wholly in them
        assert grown["COMPARED_SHARE"] > max(0.85, first["COMPARED_SHARE"], grown["COMMON_CELL_RATE"])

    def test_labelled_scenes(self, qgis_process: QgisProcess, tmp_path: Path) -> None:
        engine_python()
        folder = tmp_path / "scenes, 'two'"
        results = qgis_process.run(
            "simulatescenes", OUTPUT_FOLDER=folder, KIND="realistic", COUNT=2, AREA=200, DENSITY=30, PICTURE="false"
        )
        assert set(SimulateScenes.NUMBERS) | set(SimulateScenes.FILES) - {"PICTURE_FILE"} <= set(results)
        assert results["SCENE"] == str(folder / "realistic_0001000.laz")
        assert {p.name for p in folder.glob("*.laz")} == {"realistic_0001000.laz", "realistic_0001001.laz"}
        manifest = json.loads(Path(results["MANIFEST"]).read_text())
        assert [entry["seed"] for entry in manifest["scenes"]] == [1000, 1001]
        assert QgsVectorLayer(f"{results['HAZARDS']}|layername=hazards", "hazards", "ogr").isValid()
        assert results["SHARE_BACKGROUND"] + results["SHARE_UPLIFT"] + results["SHARE_SUBSIDENCE"] == pytest.approx(
            1, abs=0.001
        )

    def test_training(self, qgis_process: QgisProcess, tmp_path: Path) -> None:
        python = engine_python()
        if subprocess.run([python, "-c", "import torch, safetensors"], capture_output=True, check=False).returncode:
            pytest.skip("torch and safetensors are not installed; install slopewatch[screening]")
        scenes = tmp_path / "scenes"
        small = ["--count", "2", "--area", "200", "--density", "20", "--no-picture", "--output-dir", str(scenes)]
        subprocess.run([python, "-m", "slopewatch.cli", "simulate", "scenes", *small], check=True)
        clouds = sorted(map(str, scenes.glob("*.laz")))
        given = ["--DIMENSION=truth_class", "--START=none", "--NETWORK=smoke", "--STEPS=2", "--THREADS=1"]
        done = qgis_process(
            "--json", "run", "slopewatch:trainmodel", *(f"--CLOUDS={cloud}" for cloud in clouds), *given,
            f"--OUTPUT_FOLDER={tmp_path / 'out'}",
        )  # fmt: skip
        assert done.returncode == 0, done.stderr[-3000:]
        results = json.loads(done.stdout)["results"]
        of_relief = {
            name for name in TrainModel.NUMBERS if "HAZARD" in name or "ZONES" in name or "CALIBRATION" in name
        }
        assert set(TrainModel.NUMBERS) - of_relief - {"START_MEAN_IOU"} | set(TrainModel.FILES) <= set(results)
        description = json.loads(Path(results["DESCRIPTION"]).read_text())
        assert [file["name"] for file in description["training"]["files"]] == [Path(cloud).name for cloud in clouds]
        assert results["MEAN_IOU"] == pytest.approx(description["metrics"]["cross_validation"]["mean_iou"])
