"""Motion along the surface as a step of an inspection: it finds a slide, and never changes the other results."""

from __future__ import annotations

import json
import re
from datetime import date
from pathlib import Path
from types import SimpleNamespace

import geopandas
import numpy as np
import pytest
import rasterio
from pyproj import CRS
from shapely.affinity import translate
from shapely.geometry import LineString
from slopewatch.engine.core.errors import Cancelled, EngineError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.epochs.epoch import Epoch
from slopewatch.engine.geometry.rigid_transform import RigidTransform
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.pointcloud.cloud import PointCloud
from slopewatch.engine.report.compose import write_report
from slopewatch.engine.report.motion import cells_with_ground
from slopewatch.interface.parameters import (
    ChangeParameters,
    DisplacementParameters,
    LastEpochParameters,
    SurveyParameters,
)
from slopewatch.simulation.surveys.survey import simulate_pair
from slopewatch.simulation.surveys.write import write_pair
from slopewatch.tests.builders.rough_ground import relief, sampled
from slopewatch.workflows import inspect_motion, motion_memory
from slopewatch.workflows.inspect import inspect_slope
from slopewatch.workflows.products.displacement import DISPLACEMENT_OUTPUTS
from slopewatch.workflows.run import Run
from slopewatch.workflows.settings import Settings

SETTINGS = Settings(change=ChangeParameters(cell=0.2), screening=LastEpochParameters(screen_last_epoch=False))
OWN = {*DISPLACEMENT_OUTPUTS, "run.json", "report.html"}
WAY = 0.25
MEMORY = motion_memory.MotionMemory(4e9)


@pytest.fixture(scope="module")
def slide(tmp_path_factory) -> dict[str, Path]:
    """Two surveys of a bare slope, of which a patch in the middle slides down by ``WAY``, and a line through it."""
    parameters = SurveyParameters(
        points=140_000, length=22.0, height=12.0, vegetation=0.0, motion="translation", motion_amount=WAY, seed=5
    )
    paths = write_pair(simulate_pair(parameters), tmp_path_factory.mktemp("slide"))
    roi = geopandas.read_file(paths["roi"])
    west, south, east, north = roi.to_crs(32651).total_bounds
    middle, half = np.array([(west + east) / 2, (south + north) / 2]), 0.3 * (north - south)
    line = LineString([middle + (0, half), middle - (0, half)])
    lines = geopandas.GeoDataFrame({"name": ["down", "far off"]}, geometry=[line, translate(line, 8)], crs=32651)
    lines.to_file(paths["roi"].with_name("lines.gpkg"))
    return paths | {"lines": paths["roi"].with_name("lines.gpkg")}


def inspected(slide: dict[str, Path], out: Path, settings: Settings = SETTINGS, progress: Progress | None = None):
    epochs = Epoch(slide["first"], date(2024, 5, 1)), Epoch(slide["second"], date(2025, 5, 1))
    return inspect_slope(epochs, out, settings, roi=slide["roi"], profiles=slide["lines"], progress=progress)


@pytest.fixture(scope="module")
def run(slide, tmp_path_factory):
    return inspected(slide, tmp_path_factory.mktemp("with") / "out")


@pytest.fixture(scope="module")
def left_out(slide, tmp_path_factory):
    """The same settings on a machine with too little memory for the step."""
    progress = Progress()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(motion_memory, "machine_memory", lambda: 1_000_000)
        return inspected(slide, tmp_path_factory.mktemp("without") / "out", progress=progress), progress


def registered(*, stated: bool = True) -> SimpleNamespace:
    """What the step takes of a registration."""
    covariance = np.diag([0, 0, 0, 1e-6, 1e-6, 1e-6]) if stated else None
    return SimpleNamespace(covariance=covariance, registration_error=0.004, transform=RigidTransform.identity())


def _measured(
    run: Run, parameters: DisplacementParameters | None = None, density: float = 60.0, roughness: float = 0.15
):
    """The step on a small rough slope with so many points a m², of which one survey is moved."""
    heights = relief(10.0, roughness, seed=2) if roughness else np.zeros((200, 200))
    clouds = [PointCloud(sampled(heights, density, 0.02, seed), CRS.from_epsg(32651), Path("a.laz")) for seed in (1, 2)]
    parameters = parameters or DisplacementParameters(wide_window=5.0)
    return inspect_motion.measured_motion(run, (clouds[0], clouds[1]), parameters, registered(), None, MEMORY)


def record_of(done) -> dict:
    return json.loads(done.outputs["run"].read_text())


def words(done) -> str:
    """The report's text, each figure as it is shown."""
    text = re.sub(r"<style>.*?</style>", "", done.outputs["report"].read_text(encoding="utf-8"), flags=re.DOTALL)
    return re.sub(r"\s+", " ", re.sub("<[^>]+>", "", text).replace("&nbsp;", " "))


def test_the_slide_is_found_with_its_way_and_direction(run):
    zones = geopandas.read_file(run.outputs["displacement_vectors"], layer="zones")
    record = record_of(run)
    assert len(zones) == run.figures["moving_zone_count"] == len(record["displacement"]["zones"]) >= 1
    (zone,) = zones[zones["area_m2"] == zones["area_m2"].max()].to_dict("records")
    assert zone["length_m"] == pytest.approx(WAY, abs=4 * zone["length_err_m"])
    assert record["displacement"]["zones"][0]["direction"] == "down the slope"
    assert {row["stage"] for row in record["stages"]} >= {"registration", "displacement", "change"}
    assert record["parameters"]["displacement_step"] == {"displacement": True}


def test_the_registrations_error_is_in_the_vectors(run):
    record = record_of(run)
    covariance = np.array(record["registration"]["covariance"])
    centre = RigidTransform.load(run.outputs["transform"]).centre
    with rasterio.open(run.outputs["displacement"]) as raster:
        error = raster.read(raster.descriptions.index("standard error east") + 1, masked=True)
        rows, columns = np.nonzero(~error.mask)
        x, y = rasterio.transform.xy(raster.transform, rows, columns)
    arm = np.column_stack([x, y]) - centre[:2]
    # the rotation about the vertical axis and the shift alone make at least so much of it
    least = covariance[3, 3] + arm[:, 1] ** 2 * covariance[2, 2] - 2 * arm[:, 1] * covariance[2, 3]
    assert (error.compressed() ** 2 > 0.5 * least).all()
    assert record["displacement"]["registration_known"] is True
    assert record["displacement"]["registration_error_m"] > 0


def test_the_report_and_its_sections_show_it(run):
    text = words(run)
    count = run.figures["moving_zone_count"]
    assert f"{count} zone{'s' if count > 1 else ''} slide{'' if count > 1 else 's'} along the surface, together" in text
    assert "down the slope" in text
    assert "M001, from the top down" in text
    page = run.outputs["report"].read_text(encoding="utf-8")
    assert re.search(r"Section of [\d.]+ m down the zone with \d+ displacement vectors near it", page)
    # the profile through the slide shows its vectors, the one next to it none that moved
    (near,) = re.findall(r"; (\d+) displacement vectors near the line, by ([+−-][\d.]+) m along it", page)
    assert int(near[0]) > 3
    assert 0.05 < float(near[1].replace("−", "-")) < WAY * np.cos(np.radians(39))
    figures = re.findall(r'data-from="(/displacement/[^"]+)"', page)
    assert len(figures) > 15
    # only from the folder, and the same again
    assert write_report(run.outputs["run"].parent).read_text(encoding="utf-8") == page


def test_ground_without_a_window_is_not_known_either(run):
    folder = run.outputs["run"].parent
    with rasterio.open(folder / "displacement.tif") as raster:
        grid = Grid(raster.transform.c, raster.transform.f, raster.transform.a, raster.height, raster.width)
    with rasterio.open(folder / "surface_heights.tif") as raster:
        rows, columns = np.nonzero(~raster.read(2, masked=True).mask)
        x, y = (np.array(part) for part in rasterio.transform.xy(raster.transform, rows, columns))
    expected = np.zeros(grid.shape, dtype=bool)
    for east, north in zip(x, y, strict=True):
        row, column = int((grid.north - north) // grid.cell), int((east - grid.west) // grid.cell)
        if 0 <= row < grid.rows and 0 <= column < grid.columns:
            expected[row, column] = True
    np.testing.assert_array_equal(cells_with_ground(folder / "surface_heights.tif", grid), expected)


def test_too_little_memory_leaves_it_out_and_says_so(left_out):
    done, progress = left_out
    record = record_of(done)
    assert "ground points of both surveys, which are held in memory, need about" in record["displacement_left_out"]
    assert "displacement" not in record
    assert not set(done.outputs) & {"displacement", "displacement_vectors", "smallest_motion"}
    assert not [w for w in progress.warnings if "surface was not measured" in w]
    assert "which are held in memory, need about" in words(done)
    assert "No motion along the surface" not in words(done)


def test_all_other_results_are_the_same_bytes_with_and_without(run, left_out):
    here, there = (done.outputs["run"].parent for done in (run, left_out[0]))
    names = {str(path.relative_to(here)) for path in here.rglob("*") if path.is_file()} - OWN
    assert names == {str(path.relative_to(there)) for path in there.rglob("*") if path.is_file()} - OWN
    assert {"zones.gpkg", "elevation_change.tif", "profiles.csv", "profiles.gpkg", "transform.json"} <= names
    for name in sorted(names):
        # pipelines name the folder
        mine, other = ((folder / name).read_bytes().replace(bytes(folder), b"") for folder in (here, there))
        assert mine == other, name
    own = {"displacement", "displacement_left_out", "stages", "outputs", "started", "metrics", "seconds"}
    records = [record_of(done) for done in (run, left_out[0])]
    for key in set(records[0]) & set(records[1]) - own:
        assert records[0][key] == records[1][key], key
    assert records[1]["metrics"].items() <= records[0]["metrics"].items()


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        (MemoryError(), "Memory ran out"),
        (ValueError("array of no use"), r"It failed on this ground \(ValueError: array of no use\); please report it"),
        (np.linalg.LinAlgError("Singular matrix"), "LinAlgError: Singular matrix"),
        (EngineError("A part of it broke."), "A part of it broke"),
    ],
)
def test_whatever_fails_in_it_is_a_reason_and_no_end(fault, sentence, monkeypatch):
    progress = Progress()
    task = Run("inspect", {}, progress=progress)

    def fails(*_, **__):
        raise fault

    monkeypatch.setattr(inspect_motion, "measure_displacement", fails)
    assert _measured(task) is None
    assert re.search(sentence, task.facts["displacement_left_out"])


def test_cancelling_ends_the_run(monkeypatch):
    def cancelled(*_, **__):
        raise Cancelled("Cancelled.")

    monkeypatch.setattr(inspect_motion, "measure_displacement", cancelled)
    with pytest.raises(Cancelled):
        _measured(Run("inspect", {}, progress=Progress()))


def test_sparse_and_smooth_ground_are_left_out_with_the_figure():
    task = Run("inspect", {}, progress=Progress())
    assert _measured(task, density=2.0) is None
    assert re.search(r"has \d\.\d ground points a m², and with less than", task.facts["displacement_left_out"])
    task = Run("inspect", {}, progress=Progress())
    assert _measured(task, roughness=0.0) is None
    assert task.facts["displacement_left_out"].startswith(
        "Nowhere on the map a motion along the surface, or its absence"
    )


def test_an_own_error_of_the_registration_counts():
    own = inspect_motion.registered_by(registered(), DisplacementParameters(surface_error=0.05))
    assert np.sqrt(np.diag(own.covariance)).tolist() == pytest.approx([0, 0, 0, 0.05, 0.05, 0.004])
    assert inspect_motion.registered_by(registered(), DisplacementParameters()).covariance[3, 3] == 1e-6
    assert inspect_motion.registered_by(registered(stated=False), DisplacementParameters()).known is False
