"""Screening from file to labelled file: labels, what stays untouched, what is refused, memory."""

from __future__ import annotations

import json
import tracemalloc
from pathlib import Path

import geopandas
import laspy
import numpy as np
import pytest
import shapely
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.messages import shown as named
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.grid.geotiff import read_raster
from slopewatch.engine.ground.extraction import extract_ground
from slopewatch.engine.pointcloud import records
from slopewatch.engine.pointcloud.cloud import PointCloud
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.interface.parameters import GroundParameters, InputParameters, ScreeningParameters
from slopewatch.models.screening import cloud_file, network
from slopewatch.models.screening.cloud_file import ScreenedFile
from slopewatch.models.screening.screen import screen_points
from slopewatch.tests.builders.screening_clouds import (
    BULGE,
    DIP,
    HOLLOW,
    SOUTH,
    WEST,
    leftovers,
    near,
    screen,
    screen_cloud,
    slope,
    small_weights,
    write,
)
from slopewatch.workflows.products.screening import default_targets
from slopewatch.workflows.screen import screen_step
from slopewatch.workflows.settings import ScreeningSettings


@pytest.fixture(scope="module")
def cloud(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("slope") / "2024-05-01.laz", slope())


@pytest.fixture
def weights(tmp_path) -> Path:
    """Of a model that decides by the most probable class, voxel by voxel."""
    return small_weights(tmp_path / "model.safetensors", "most_probable")


def test_a_bulge_and_a_hollow_are_labelled_where_they_are(cloud, tmp_path):
    done = screen(cloud, tmp_path / "out.laz")
    outputs, figures = done.outputs, done.figures
    las = laspy.read(tmp_path / "out.laz")
    xyz = np.asarray(las.xyz)
    labels, probability = np.asarray(las.slopewatch_class), np.asarray(las.slopewatch_prob)
    assert (labels.dtype, probability.dtype) == (np.uint8, np.float32)
    assert (labels[near(xyz, BULGE, 1.0)] == 1).mean() > 0.98
    assert (labels[near(xyz, HOLLOW, 1.0)] == 2).mean() > 0.98
    quiet = ~near(xyz, BULGE, 5.0) & ~near(xyz, HOLLOW, 5.0)
    assert (labels[quiet] == 0).mean() > 0.99
    assert ((probability > 1 / 3 - 1e-6) & (probability <= 1)).all()
    assert figures["uplift_points"] == (labels == 1).sum()
    # the zones: an ellipse on the map, its full area on the slope
    zones = geopandas.read_file(outputs["zones"], layer="zones").set_index("kind")
    assert sorted(zones.index) == ["subsidence", "uplift"]
    for kind, place, sign in (("uplift", BULGE, 1), ("subsidence", HOLLOW, -1)):
        zone = zones.loc[kind]
        centre = zone.geometry.centroid
        assert np.hypot(centre.x - WEST - place[0], centre.y - SOUTH - place[1]) < 0.5
        assert zone["area_m2"] * np.cos(np.radians(DIP)) == pytest.approx(zone["plan_m2"], rel=0.12)
        assert 8.0 < zone["area_m2"] < 14.0
        assert 0.15 < sign * zone["height_med_m"] < sign * zone["height_p95_m"] < 0.42
    hazard, up, down = (read_raster(outputs["probability"], band) for band in (1, 2, 3))
    np.testing.assert_allclose(hazard.array, up.array + down.array, atol=1e-6)
    assert (hazard.unit, up.description) == ("1", "Probability of uplift")
    column, row = int((WEST + BULGE[0] - up.grid.west) / 0.25), int((up.grid.north - SOUTH - BULGE[1]) / 0.25)
    assert up.array[row, column] > 0.9
    assert down.array[row, column] < 0.05
    record = json.loads(outputs["run"].read_text())
    assert record["metrics"]["zone_count"] == 2
    assert record["parameters"]["screening"]["residual_threshold"] == 0.08
    assert leftovers(tmp_path) == [
        "out.laz", "out_map.png", "out_probability.tif", "out_smallest_hazard.tif", "out_zones.gpkg",
    ]  # fmt: skip


@pytest.mark.parametrize(("point_format", "crs", "unit"), [(7, 6557, 0.3048), (3, 32651, 1.0), (6, 32651, 1.0)])
def test_coordinates_order_and_every_other_dimension_stay_as_they_are(tmp_path, point_format, crs, unit):
    xyz = slope(12_000)
    own = {"amplitude": np.arange(12_000, dtype=np.float32), "classification": np.full(12_000, 2, np.uint8)}
    source = write(tmp_path / "in.las", xyz, point_format=point_format, crs=crs, unit=unit, **own)
    done = screen(source, tmp_path / "out.laz")
    outputs, figures = done.outputs, done.figures
    before, after = laspy.read(source), laspy.read(outputs["labelled"])
    assert (before.header.scales == after.header.scales).all()
    assert (before.header.offsets == after.header.offsets).all()
    assert after.header.point_format.id == point_format
    assert after.header.parse_crs().axis_info[0].unit_name == CRS.from_epsg(crs).axis_info[0].unit_name
    for name in before.point_format.dimension_names:
        np.testing.assert_array_equal(before[name], after[name], err_msg=name)
    # what is a length is in metres, whatever the file's unit
    assert figures["dip"] == pytest.approx(DIP, abs=1)
    assert figures["screened_area_m2"] == pytest.approx(22 * 22, rel=0.3)
    assert geopandas.read_file(outputs["zones"], layer="zones").crs.axis_info[0].unit_name == "metre"
    assert figures["zone_count"] == 2


def test_labels_of_an_earlier_run_are_replaced_with_a_warning(cloud, tmp_path):
    screen(cloud, tmp_path / "one.laz", residual_threshold=0.3)
    progress = Progress()
    screen(tmp_path / "one.laz", tmp_path / "two.laz", progress=progress)
    assert any("earlier screening" in w for w in progress.warnings)
    screen(cloud, tmp_path / "fresh.laz")
    one, two, fresh = (laspy.read(tmp_path / f"{name}.laz") for name in ("one", "two", "fresh"))
    np.testing.assert_array_equal(two.slopewatch_class, fresh.slopewatch_class)
    assert (one.slopewatch_class > 0).sum() < (two.slopewatch_class > 0).sum()
    assert list(two.point_format.extra_dimension_names) == ["slopewatch_class", "slopewatch_prob"]


def test_points_that_are_not_screened_are_background_of_probability_0(tmp_path):
    rng = np.random.default_rng(4)
    xyz = slope()
    plants = rng.random(len(xyz)) < 0.3
    xyz[plants, 2] += rng.uniform(0.3, 2.0, int(plants.sum()))
    source = write(tmp_path / "in.laz", xyz, classification=np.where(plants, 4, 2).astype(np.uint8))
    roi = tmp_path / "roi.geojson"
    corners = [(WEST, SOUTH), (WEST, SOUTH + 22), (WEST + 11.0005, SOUTH + 22), (WEST + 11.0005, SOUTH)]
    box = geopandas.GeoSeries([shapely.Polygon(corners)], crs=32651)
    box.to_file(roi)
    figures = screen(source, tmp_path / "out.laz", ground="class_2", roi=roi).figures
    las = laspy.read(tmp_path / "out.laz")
    inside = ~plants & (np.asarray(las.x) < WEST + 11.0005)
    np.testing.assert_array_equal(las.slopewatch_prob > 0, inside)
    assert (las.slopewatch_class[~inside] == 0).all()
    assert figures["ground_points"] == inside.sum()
    assert figures["subsidence_zones"] == 0
    assert figures["uplift_zones"] == 1
    with pytest.raises(InputError, match="no points of class 2"):
        screen(write(tmp_path / "b.laz", xyz), tmp_path / "no.laz", ground="class_2")


def test_known_noise_is_no_ground(tmp_path):
    xyz = slope(10_000)
    classes = np.where(np.arange(len(xyz)) % 10 == 0, 7, np.where(np.arange(len(xyz)) % 10 == 1, 18, 1))
    xyz[classes != 1, 2] += 5.0
    source = write(tmp_path / "in.laz", xyz, classification=classes.astype(np.uint8))
    screen(source, tmp_path / "out.laz")
    las = laspy.read(tmp_path / "out.laz")
    np.testing.assert_array_equal(las.slopewatch_prob > 0, classes == 1)
    screening, _ = screen_cloud(read_cloud(source), ScreeningParameters(screening_method="residual"))
    assert screening.ground_points == (classes == 1).sum()


def test_ground_is_extracted_first_where_asked(tmp_path, monkeypatch):
    def extract(copy, *given, progress, **more):
        progress.warning(f"{named(copy)} has plants.")
        return extract_ground(copy, *given, progress=progress, **more)

    monkeypatch.setattr("slopewatch.workflows.screen.extract_ground", extract)
    rng = np.random.default_rng(5)
    xyz = slope(50_000)
    plants = rng.random(len(xyz)) < 0.3
    xyz[plants, 2] += rng.uniform(0.5, 2.0, int(plants.sum()))
    source = write(tmp_path / "raw.laz", xyz)
    with pytest.raises(InputError, match="--ground extract"):
        screen(source, tmp_path / "out.laz")
    done = screen(source, tmp_path / "out.laz", ground="extract")
    outputs, figures = done.outputs, done.figures
    las = laspy.read(outputs["labelled"])
    screened = np.asarray(las.slopewatch_prob) > 0
    np.testing.assert_allclose(np.asarray(las.xyz), xyz, atol=0.0006)
    assert screened[~plants].mean() > 0.9
    assert screened[plants].mean() < 0.02
    assert figures["zone_count"] == 2
    stage = json.loads(outputs["run"].read_text())["stages"][0]
    assert stage["extraction"]["ground_points"] == screened.sum()
    assert stage["pipelines"]
    said = json.loads(outputs["run"].read_text())["warnings"]
    assert [one for one in said if "plants" in one] == [f"{named(source)} has plants."], "the file that was given"
    assert leftovers(tmp_path) == [
        "out.laz", "out_map.png", "out_probability.tif", "out_smallest_hazard.tif", "out_zones.gpkg", "raw.laz",
    ]  # fmt: skip


def test_the_classification_is_written_only_when_asked(cloud, tmp_path):
    screen(cloud, tmp_path / "out.laz", write_classification=True)
    before, las = laspy.read(cloud), laspy.read(tmp_path / "out.laz")
    codes = np.array([0, 64, 65])[las.slopewatch_class]
    np.testing.assert_array_equal(las.classification, np.where(codes, codes, before.classification))
    old = write(tmp_path / "old.las", slope(5000), point_format=1)
    with pytest.raises(InputError, match="point format 1, whose classes end at 31"):
        screen(old, tmp_path / "no.laz", write_classification=True)
    assert "no.laz" not in leftovers(tmp_path)


def test_the_same_input_gives_the_same_bytes(cloud, tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        screen(cloud, tmp_path / name / "out.laz")
    assert leftovers(tmp_path / "a") == [
        "out.laz",
        "out_map.png",
        "out_probability.tif",
        "out_smallest_hazard.tif",
        "out_zones.gpkg",
    ]
    for name in leftovers(tmp_path / "a"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name


def test_a_file_in_parts_gets_the_labels_of_the_cloud_in_memory(cloud, weights, tmp_path, monkeypatch):
    from slopewatch.models.inference.prediction import predict
    from slopewatch.models.network.randlanet import fold_normalisation
    from slopewatch.models.network.weights import load_model

    monkeypatch.setattr(records, "_GROUP_BYTES", 100_000)
    figures = screen(cloud, tmp_path / "out.laz", method="network", weights=str(weights), rotations=2).figures
    las = laspy.read(tmp_path / "out.laz")
    points = read_cloud(cloud)
    prediction = predict(fold_normalisation(load_model(weights).network), points.xyz, rotations=2)
    np.testing.assert_array_equal(las.slopewatch_class, prediction.labels)
    np.testing.assert_array_equal(las.slopewatch_prob, prediction.probabilities.max(axis=1))
    assert len(np.unique(las.slopewatch_prob)) > 1000
    screening, hazards = screen_cloud(
        points, ScreeningParameters(weights=str(weights), rotations=2, threads=1), run_id="x"
    )
    np.testing.assert_array_equal(screening.at(points.xyz)[0], prediction.labels)
    assert len(hazards.frame) == figures["zone_count"]


def test_probabilities_are_calibrated_with_the_models_temperature(cloud, weights, tmp_path):
    description = json.loads(weights.with_suffix(".json").read_text())
    points = read_cloud(cloud)

    def screened(**metrics):
        weights.with_suffix(".json").write_text(json.dumps({**description, "metrics": metrics}))
        screening, _ = screen_cloud(points, ScreeningParameters(weights=str(weights), threads=1))
        return screening.at(points.xyz), screening

    (labels, plain), _ = screened()
    (same, softer), screening = screened(calibration={"temperature": 2.0})
    np.testing.assert_array_equal(labels, same)
    assert (softer < plain).mean() > 0.99
    power = np.sqrt(screening.raw.astype(float))
    np.testing.assert_allclose(screening.probabilities, power / power.sum(axis=1, keepdims=True), rtol=1e-5)
    with pytest.raises(InputError, match="temperature"):
        screened(calibration={"temperature": -1})


def test_many_processor_cores_do_not_take_all_memory(weights, monkeypatch):
    for cores, expected in ((2, 2), (64, 8)):
        monkeypatch.setattr(network, "processors", lambda n=cores: n)
        assert network.ScreeningModel(ScreeningParameters(weights=str(weights))).threads == expected
    assert network.ScreeningModel(ScreeningParameters(weights=str(weights), threads=20)).threads == 20


def test_labels_do_not_depend_on_the_threads(cloud, weights, monkeypatch):
    import torch
    from slopewatch.models.network.randlanet import RandLANet

    forward, seen = RandLANet.forward, set()

    def watched(*given):
        seen.add(torch.get_num_threads())
        return forward(*given)

    monkeypatch.setattr(RandLANet, "forward", watched)
    torch.set_num_threads(2)
    points = read_cloud(cloud)
    found = [
        screen_cloud(points, ScreeningParameters(weights=str(weights), threads=n))[0].probabilities for n in (1, 3)
    ]
    assert (seen, torch.get_num_threads()) == ({1}, 2)
    torch.set_num_threads(1)
    np.testing.assert_array_equal(*found)


def test_a_screened_point_never_has_probability_0():
    points = PointCloud(slope(20_000), CRS.from_epsg(32651), Path("a.laz"))
    parameters = ScreeningParameters(screening_method="residual", minimum_probability=0.999, residual_threshold=0.01)
    screening, _ = screen_cloud(points, parameters)
    screening.raw[:, 0], screening.raw[:, 1:] = 0.0, 0.5
    labels, probability = screening.at(points.xyz)
    assert not labels.any()
    assert (probability == np.float32(1e-6)).all()
    labels, probability = screening.at(points.xyz + 1000.0)
    assert not labels.any()
    assert not probability.any()


def test_memory_follows_the_area_and_not_the_number_of_points(tmp_path, monkeypatch):
    """Three times the points at the same places: the same voxels, and hardly more memory."""
    from slopewatch.models.preparation import streaming, voxel_sums

    monkeypatch.setattr(records, "_GROUP_BYTES", 500_000)
    monkeypatch.setattr(voxel_sums, "_WAITING", 20_000)
    monkeypatch.setattr(streaming, "SAMPLE", 20_000)
    monkeypatch.setattr(cloud_file, "_PICTURE_POINTS", 20_000)
    xyz = slope(40_000)
    parameters = ScreeningParameters(screening_method="residual")
    peaks, voxels = [], []
    for times in (12, 4, 12):  # the first time counts what is imported and compiled
        # uncompressed: the compressor's own buffers are not the question
        path = write(tmp_path / f"{times}.las", np.tile(xyz, (times, 1)), point_format=6)
        source = ScreenedFile(path, InputParameters(), ground="auto", picture=True)
        tracemalloc.start()
        screening = screen_points(source, parameters)
        source.write_labelled(tmp_path / "out.laz", screening)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        voxels.append(len(screening.count))
    assert voxels[1] == pytest.approx(voxels[2], rel=0.02)  # another sample, another plane
    assert peaks[2] < peaks[1] + 0.1 * 8 * xyz.nbytes, "more than a tenth of what the further coordinates take"


def test_outputs_may_lie_in_several_folders(cloud, tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
    settings = ScreeningSettings(
        InputParameters(), GroundParameters(), ScreeningParameters(screening_method="residual")
    )
    targets = default_targets(tmp_path / "a" / "o.laz", tmp_path / "b" / "z.gpkg", picture=tmp_path / "m.png")
    outputs = screen_step(cloud, targets, settings).outputs
    assert outputs["zones"] == tmp_path / "b" / "z.gpkg"
    assert all(path.is_file() for path in outputs.values())
    assert {p.name for p in tmp_path.rglob("*") if p.is_file()} == {
        "o.laz", "o.qml", "o_run.json", "o_probability.tif", "o_probability.qml", "z.gpkg", "m.png",
        "o_smallest_hazard.tif", "o_smallest_hazard.qml",
    }  # fmt: skip


def test_shipped_weights_label_the_bulge_and_the_hollow(cloud, tmp_path):
    pytest.importorskip("torch", reason="torch is not installed; install slopewatch[screening]")
    from slopewatch.engine.core.checksums import sha256
    from slopewatch.models.network.shipped import SHIPPED_SHA256, SHIPPED_WEIGHTS

    assert sha256(SHIPPED_WEIGHTS) == SHIPPED_SHA256
    figures = screen(cloud, tmp_path / "out.laz", method="network").figures
    las = laspy.read(tmp_path / "out.laz")
    xyz = np.asarray(las.xyz)
    assert (las.slopewatch_class[near(xyz, BULGE, 1.0)] == 1).mean() > 0.8
    assert (las.slopewatch_class[near(xyz, HOLLOW, 1.0)] == 2).mean() > 0.8
    assert figures["zone_count"] >= 2
