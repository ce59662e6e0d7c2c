"""What a ground cloud tells of plants, from the file to the outputs."""

from __future__ import annotations

import json
from pathlib import Path

import geopandas
import laspy
import numpy as np
import pytest
import rasterio
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.epochs.epoch import Epoch, parse_date
from slopewatch.engine.pointcloud.plant_cover import PlantCover
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.engine.pointcloud.writing import copy_with, write_cloud
from slopewatch.interface.parameters import (
    ChangeParameters,
    GridChangeParameters,
    RegistrationParameters,
    SeriesParameters,
)
from slopewatch.tests.builders.plant_clouds import DIP, Grass, Ground, grassy_slope, write_ground
from slopewatch.workflows.change import change_step
from slopewatch.workflows.register import register_step
from slopewatch.workflows.series import monitor_series
from slopewatch.workflows.settings import SeriesSettings, Settings

TALL, MOWN = Grass(0.25, lifted=0.08, error=0.03), Grass(0.05, lifted=0.01, error=0.01)


@pytest.mark.parametrize("point_format", [3, 6, 7])
@pytest.mark.slow
def test_both_dimensions_are_read_whatever_stands_beside_them(tmp_path, las_file, point_format):
    def more(las: laspy.LasData) -> None:
        kinds = {"before": np.uint16, "plant_height": np.float32, "between": np.float64, "plant_error": np.float32}
        las.add_extra_dims([laspy.ExtraBytesParams(*named) for named in kinds.items()])
        las.plant_error, las.plant_height = np.linspace(0, 0.1, len(las.x)), np.linspace(0, 0.4, len(las.x))
        las.before, las.between = np.full(len(las.x), 7), np.full(len(las.x), 0.5)

    version = "1.2" if point_format == 3 else "1.4"
    for ending in ("las", "laz"):
        path = las_file(tmp_path / f"c.{ending}", point_format=point_format, version=version, change=more)
        cloud = read_cloud(path, colours=True)
        assert cloud.plant_error is not None
        assert cloud.plant_height is not None
        assert np.allclose(cloud.plant_error, np.linspace(0, 0.1, len(cloud)), atol=1e-7)
        assert np.allclose(cloud.plant_height, np.linspace(0, 0.4, len(cloud)), atol=1e-7)
        plain = read_cloud(path)
        assert plain.plants is not None
        assert np.array_equal(plain.plants.error, cloud.plant_error)


@pytest.mark.slow
def test_a_scaled_dimension_means_what_its_scale_says(tmp_path, las_file):
    def more(las: laspy.LasData) -> None:
        las.add_extra_dim(laspy.ExtraBytesParams("plant_error", np.uint16, scales=[0.001], offsets=[0.0]))
        las["plant_error"] = np.full(len(las.x), 0.042)

    cloud = read_cloud(las_file(tmp_path / "c.laz", change=more))
    assert cloud.plant_error is not None
    assert np.allclose(cloud.plant_error, 0.042, atol=1e-6)
    assert cloud.plants is not None
    assert cloud.plants.height is None


@pytest.mark.slow
def test_a_cloud_of_another_program_tells_nothing(tmp_path, las_file):
    cloud = read_cloud(las_file(tmp_path / "c.laz"))
    assert cloud.plant_error is cloud.plant_height is cloud.plants is None


@pytest.mark.slow
def test_copies_and_moved_clouds_keep_what_is_known_of_their_points(tmp_path):
    ground = grassy_slope(1, TALL, points=5_000)
    source = write_ground(tmp_path / "ground.laz", ground)
    keep = np.arange(5_000) % 3 == 0
    copy_with(source, tmp_path / "copy.laz", keep=keep, xyz=read_cloud(source).xyz[keep] + 1.0)
    copy = read_cloud(tmp_path / "copy.laz")
    assert copy.plants is not None
    assert np.allclose(copy.plants.error, ground.plants.error[keep], atol=1e-7)
    assert np.allclose(copy.plants.height, ground.plants.height[keep], atol=1e-7)
    dimensions = {"plant_error": ground.plants.error.astype("f4"), "plant_height": ground.plants.height.astype("f4")}
    write_cloud(tmp_path / "own.laz", read_cloud(source), dimensions=dimensions)
    own = read_cloud(tmp_path / "own.laz")
    assert np.array_equal(own.plant_error, read_cloud(source).plant_error)


@pytest.fixture(scope="module")
def mown(tmp_path_factory) -> tuple[Path, Path]:
    """Two surveys of grass and a road: 40 cm of slump under the grass, mown before the second, 5 cm off in height."""
    folder = tmp_path_factory.mktemp("mown")
    first = write_ground(folder / "2024-07-01.laz", grassy_slope(1, TALL, bare_share=0.3, points=60_000))
    second = grassy_slope(2, MOWN, bare_share=0.3, slump=0.4, points=60_000)
    off = Ground(second.xyz + [0.0, 0.0, 0.05], second.plants, second.bare)
    return first, write_ground(folder / "2024-11-01.laz", off)


@pytest.fixture(scope="module")
def run(mown, tmp_path_factory) -> tuple[Path, Path]:
    """The aligned cloud, and the output folder of its change."""
    folder = tmp_path_factory.mktemp("run")
    progress = Progress()
    register_step(
        *mown, folder / "aligned.laz", Settings(), transform_path=folder / "transform.json", given=None, invert=False,
        stable=None, progress=progress,
    )  # fmt: skip
    change_step(
        *mown, folder / "out", Settings(), dates=("2024-07-01", "2024-11-01"),
        transform_path=folder / "transform.json", progress=progress,
    )  # fmt: skip
    return folder / "aligned.laz", folder / "out"


@pytest.mark.slow
def test_the_aligned_cloud_keeps_them_and_lies_right(mown, run):
    aligned, before = read_cloud(run[0]), read_cloud(mown[1])
    assert np.array_equal(aligned.plant_error, before.plant_error)
    assert np.array_equal(aligned.plant_height, before.plant_height)
    moved = np.median(aligned.xyz - before.xyz, axis=0)
    assert np.allclose(moved, [0.0, 0.0, -0.05], atol=0.01)
    assert moved[2] - DIP * moved[1] == pytest.approx(-0.05, abs=0.003), "of the slope's height at a place"
    assert json.loads((run[0].parent / "aligned_run.json").read_text())["stages"][1]["registered_on_bare_ground"]


@pytest.mark.slow
def test_a_change_writes_the_term_and_finds_the_slump_alone(run):
    folder = run[1]
    record = json.loads((folder / "run.json").read_text())
    with rasterio.open(folder / "plant_error.tif") as raster, rasterio.open(folder / "elevation_change.tif") as change:
        error, dz = raster.read(1, masked=True), change.read(1, masked=True)
        assert raster.units == ("m",)
        assert (raster.transform, raster.shape) == (change.transform, change.shape)
    assert np.array_equal(error.mask, dz.mask)
    assert np.ma.median(error[error > 0.005]) == pytest.approx(np.hypot(0.03, 0.01), abs=0.001)
    assert record["metrics"]["plant_error_median_m"] == pytest.approx(float(np.ma.median(error)), abs=1e-6)
    terms = {term["term"]: term for term in record["level_of_detection"]["terms"]}
    assert set(terms) == {"points", "registration", "plants"}
    assert sum(term["largest_share"] for term in terms.values()) == pytest.approx(1.0)
    assert record["metrics"]["plant_error_largest_share"] == terms["plants"]["largest_share"] > 0.5
    assert record["season"]["verdict"] == "lower"
    heights = [record["season"][f"plant_height_{epoch}_m"] for epoch in ("from", "to")]
    assert heights == pytest.approx([0.25, 0.05])
    zones = geopandas.read_file(folder / "zones.gpkg", layer="zones")
    assert len(zones) == record["metrics"]["zone_count"] == 1
    assert zones["dz_mean_m"][0] == pytest.approx(-0.47, abs=0.03)
    assert zones["vol_area_m2"][0] == pytest.approx(np.pi * 9, rel=0.25), "and none of the grass around"
    assert zones["vol_err_m3"][0] > 0.8 * np.hypot(0.03, 0.01) * zones["vol_area_m2"][0], "a part of it is road"
    assert sum("The plants stood 0.25 m" in w for w in record["warnings"]) == 1


@pytest.mark.slow
def test_what_plants_explain_is_a_raster_of_its_own(run):
    record = json.loads((run[1] / "run.json").read_text())
    area = record["metrics"]["plant_change_area_m2"]
    with rasterio.open(run[1] / "plant_change.tif") as raster:
        values = raster.read(1, masked=True)
        assert values.count() * abs(raster.transform.a) ** 2 == pytest.approx(area, rel=1e-6)
    with rasterio.open(run[1] / "significant_change.tif") as raster:
        assert not (~raster.read(1, masked=True).mask & ~values.mask).any()
    assert area > 1


@pytest.mark.slow
def test_the_report_tells_the_term_and_the_season(run):
    page = (run[1] / "report.html").read_text()
    assert "What the cells’ errors are made of" in page
    assert "/level_of_detection/terms/2/largest_share" in page
    assert "The plants stood 0.25 m high in the first survey and 0.05 m in the second" in page
    assert "/metrics/plant_change_area_m2" in page


@pytest.mark.slow
def test_ground_that_tells_nothing_gives_the_outputs_of_before(mown, tmp_path):
    clouds = []
    for seed, path in zip((1, 2), mown, strict=True):
        ground = grassy_slope(seed, TALL, points=20_000)
        clouds.append(write_ground(tmp_path / path.name, ground, dimensions=False))
    settings = Settings(change=ChangeParameters(cell=0.5, adaptive=False))
    figures = change_step(
        *clouds, tmp_path / "out", settings, dates=(None, None), transform_path=None, progress=Progress()
    ).figures
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert not any("plant" in name for name in [*figures, *record["outputs"]])
    assert "season" not in record
    assert "terms" not in record["level_of_detection"]
    assert "Plants make the ground" not in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.slow
def test_a_series_keeps_the_term_from_run_to_run(tmp_path):
    """A slump that goes on under grass of one season; its error does not fall below the plants'."""
    days = ("2024-05-01", "2024-08-01", "2024-11-01")
    grass = Grass(0.2, error=0.03)
    epochs = [
        Epoch(
            write_ground(tmp_path / f"{day}.laz", grassy_slope(n, grass, slump=0.2 * n, points=30_000)), parse_date(day)
        )
        for n, day in enumerate(days)
    ]
    settings = SeriesSettings(
        change=GridChangeParameters(cell=0.5, calibrate=False),
        registration=RegistrationParameters(method="none"),
        series=SeriesParameters(ground_ready=True),
    )
    for _ in range(2):
        figures = monitor_series(epochs, tmp_path / "out", settings, progress=Progress()).figures
        record = json.loads((tmp_path / "out" / "run.json").read_text())
        assert figures["zone_count"] == 1
        course = record["course"]["S001"]
        assert [row["dz_mean_m"] for row in course] == pytest.approx([-0.2, -0.4], rel=0.1)
        for row in course:
            assert row["dz_err_m"] == pytest.approx(np.hypot(0.03, 0.03), rel=0.2)
    assert not record["stages"][0]["epochs"]["2024-08-01"]["made"], "the second run used what the first one kept"
    assert record["seasons"]["2024-08-01"]["verdict"] == "alike"


def test_a_cover_of_floats_is_not_copied():
    error = np.zeros(3, np.float32)
    assert PlantCover(error).error is error
