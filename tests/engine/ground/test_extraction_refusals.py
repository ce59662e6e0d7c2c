"""Odd and unusable inputs of the ground extraction: said, or refused with nothing left; cancelling."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import geopandas
import laspy
import numpy as np
import pytest
import shapely
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.ground.extraction import extract_ground
from slopewatch.interface.parameters import GroundParameters, InputParameters
from slopewatch.simulation.surveys.survey import SimulatedPair
from slopewatch.tests.builders.extracted_ground import any_pdal, write
from slopewatch.tests.builders.limits import CANCELLED_S, PATIENCE_S


def test_strays_are_left_out_and_cost_no_ground(pair, inputs, result, tmp_path):
    def add_strays(las: laspy.LasData) -> None:
        inside = np.flatnonzero(las.user_data)[:: len(las.x) // 40][:6]
        las.z[inside] = las.z[inside] + np.array([-2e6, -5.0, -5.0, -60.0, 40.0, 900.0])

    cloud = write(pair, tmp_path / "strays.las", add_strays)
    found = extract_ground(cloud, tmp_path / "g.laz", roi=inputs[1], pdal=any_pdal())
    assert 1 <= found.outliers <= 6
    assert abs(found.ground_points - result.ground_points) < 0.002 * result.ground_points + 8
    low = laspy.read(found.clipped).header.mins[2]
    assert low > pair.first.xyz[:, 2].min() - 0.1


def test_without_a_region_a_stray_far_away_does_no_harm(pair, inputs, tmp_path):
    def move(las: laspy.LasData) -> None:
        las.x[:2] = las.x[:2] + np.array([9e5, -8e5])

    plain = extract_ground(inputs[0], tmp_path / "plain.laz", pdal=any_pdal())
    found = extract_ground(write(pair, tmp_path / "far.las", move), tmp_path / "far.laz", pdal=any_pdal())
    assert found.outliers - plain.outliers in (1, 2)
    # the slope's plane is another by a hair, and with it where windows begin
    assert abs(found.ground_points - plain.ground_points) < 0.015 * plain.ground_points
    assert found.roi_area == pytest.approx(plain.roi_area, rel=0.01)


def test_return_numbers_that_make_no_sense_are_said(pair, inputs, tmp_path):
    def clear(las: laspy.LasData) -> None:
        las.return_number, las.number_of_returns = (np.zeros(len(las.x), np.uint8) for _ in range(2))

    progress = Progress()
    cloud = write(pair, tmp_path / "zeros.las", clear)
    found = extract_ground(cloud, tmp_path / "g.laz", roi=inputs[1], pdal=any_pdal(), progress=progress)
    assert found.ground_ratio > 0.2
    assert any("return" in w for w in progress.warnings)
    assert progress.warnings == list(found.warnings)


def test_a_cloth_finer_than_the_points_is_said(pair, inputs, tmp_path):
    def thin(las: laspy.LasData) -> None:
        las.points = las.points[np.arange(0, len(las.x), 400)]

    cloud = write(pair, tmp_path / "thin.las", thin)
    found = extract_ground(cloud, tmp_path / "g.laz", pdal=any_pdal())
    assert any("cloth_resolution" in w for w in found.warnings)
    assert found.spacing > 0.5


def test_a_file_that_names_its_noise_and_uses_classes_above_31(pair, inputs, result, tmp_path):
    def label(las: laspy.LasData) -> None:
        labels = np.full(len(las.x), 65, np.uint8)
        labels[np.flatnonzero(las.user_data)[::100]] = 18
        labels[np.flatnonzero(las.user_data)[1::100]] = 2
        las.classification = labels

    found = extract_ground(write(pair, tmp_path / "c.las", label), tmp_path / "g.laz", roi=inputs[1], pdal=any_pdal())
    las = laspy.read(found.clipped)
    assert set(np.asarray(las.classification)) <= {2, 65}
    taken = set(laspy.read(result.clipped).gps_time) - set(las.gps_time)
    assert len(taken) == found.outliers - result.outliers > 50
    ground = set(laspy.read(found.ground).gps_time)
    assert len(ground ^ (set(laspy.read(result.ground).gps_time) - taken)) < 0.005 * len(ground)


def broken_inputs() -> dict[str, tuple[Callable[[Path, SimulatedPair, tuple[Path, Path]], dict[str, object]], str]]:
    def far(folder: Path, pair: SimulatedPair, inputs: tuple[Path, Path]) -> dict[str, object]:
        square = shapely.box(10_000, 10_000, 10_050, 10_050)
        geopandas.GeoSeries([square], crs=pair.crs).to_file(folder / "far.gpkg")
        return {"cloud": inputs[0], "roi": folder / "far.gpkg"}

    def tiny(folder: Path, pair: SimulatedPair, inputs: tuple[Path, Path]) -> dict[str, object]:
        centre = shapely.Polygon(pair.roi).centroid
        geopandas.GeoSeries([centre.buffer(0.05)], crs=pair.crs).to_file(folder / "tiny.gpkg")
        return {"cloud": inputs[0], "roi": folder / "tiny.gpkg"}

    def line(folder: Path, pair: SimulatedPair, inputs: tuple[Path, Path]) -> dict[str, object]:
        def squeeze(las: laspy.LasData) -> None:
            las.points = las.points[:1000]
            las.x = las.y - las.header.offsets[1] + las.header.offsets[0]
            las.z = np.full(1000, 5.0)

        return {"cloud": write(pair, folder / "line.las", squeeze)}

    def few(folder: Path, pair: SimulatedPair, inputs: tuple[Path, Path]) -> dict[str, object]:
        def cut(las: laspy.LasData) -> None:
            las.points = las.points[:5]

        return {"cloud": write(pair, folder / "few.las", cut)}

    def strict(folder: Path, pair: SimulatedPair, inputs: tuple[Path, Path]) -> dict[str, object]:
        return {"cloud": inputs[0], "parameters": GroundParameters(minimum_ground_ratio=0.99)}

    def huge(folder: Path, pair: SimulatedPair, inputs: tuple[Path, Path]) -> dict[str, object]:
        def move(las: laspy.LasData) -> None:
            las.x[:3] = las.x[:3] + 9e5

        cloud = write(pair, folder / "huge.las", move)
        return {"cloud": cloud, "parameters": GroundParameters(denoise=False, slope_aligned=False)}

    def degrees(folder: Path, pair: SimulatedPair, inputs: tuple[Path, Path]) -> dict[str, object]:
        return {"cloud": inputs[0], "inputs": InputParameters(crs="EPSG:4326")}

    return {
        "region outside": (far, "outside"),
        "region without points": (tiny, r"survey\.las.* within the region.*too few"),
        "on a line": (line, "line"),
        "few points": (few, "too few"),
        "implausible share": (strict, "too few to be true"),
        "cloth too large": (huge, "cloth_resolution"),
        "degrees": (degrees, "geographic"),
    }


@pytest.mark.parametrize("case", broken_inputs())
def test_what_cannot_work_is_one_sentence_and_leaves_nothing(pair, inputs, tmp_path, case):
    make, message = broken_inputs()[case]
    given = make(tmp_path, pair, inputs)
    cloud = given.pop("cloud")
    (tmp_path / "out").mkdir()
    with pytest.raises(InputError, match=message) as caught:
        extract_ground(cloud, tmp_path / "out" / "g.laz", pdal=any_pdal(), **given)
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")
    assert list((tmp_path / "out").iterdir()) == []


RUN = """
import sys
from pathlib import Path
sys.path.insert(0, {tests!r})
import conftest
from slopewatch.engine.core import cancellation
from slopewatch.engine.core.staged_outputs import staged_outputs
from slopewatch.engine.ground.extraction import extract_ground
from slopewatch.interface.parameters import GroundParameters
cancellation.install(lambda: None, watch_parent=False)
parameters = GroundParameters(cloth_resolution=0.02, iterations=10000)
with staged_outputs(Path({folder!r})) as stage:
    print("start", flush=True)
    extract_ground(Path({cloud!r}), stage.path("g.laz"), parameters=parameters)
"""


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_cancelling_leaves_nothing(inputs, tmp_path):
    any_pdal()
    tests = str(Path(__file__).resolve().parents[2])
    script = RUN.format(tests=tests, folder=str(tmp_path / "out"), cloud=str(inputs[0]))
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, env=environment)
    assert process.stdout is not None
    assert process.stdout.readline() == "start\n"
    deadline = time.monotonic() + PATIENCE_S
    while not list(tmp_path.rglob("*_clip.json")):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.05)
    time.sleep(3)  # by then it removes outliers or lays the cloth
    assert process.poll() is None
    started = time.monotonic()
    process.send_signal(signal.SIGINT)
    assert process.wait(PATIENCE_S) == 130
    assert time.monotonic() - started < CANCELLED_S
    process.communicate()
    assert list(tmp_path.iterdir()) == []
