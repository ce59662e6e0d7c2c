"""The command m3c2 from files to files: what it writes."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import ClassVar

import geopandas as gpd
import laspy
import numpy as np
import pytest
import rasterio
import shapely
from PIL import Image
from pyproj import CRS
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.report.compose import check_report
from slopewatch.tests.builders.steep_pair import BULGE, DIP, NORMAL, region, run, steep, write


@pytest.fixture(scope="module")
def outcome(pair, tmp_path_factory):
    progress = Progress()
    done = run(*pair, tmp_path_factory.mktemp("out") / "points.laz", progress=progress)
    outputs, metrics = done.outputs, done.figures
    return outputs, metrics, progress.warnings


def test_points_carry_what_was_measured_in_their_system(pair, outcome):
    outputs, metrics, _ = outcome
    las = laspy.read(outputs["points"])
    assert las.header.parse_crs().equals(CRS.from_epsg(32651))
    assert len(las.points) == metrics["core_points"] > 1000
    west = np.asarray(las.x) < 5e5 + 3
    east = np.asarray(las.x) > 5e5 + 5
    distance, level = np.asarray(las["m3c2_distance"]), np.asarray(las["m3c2_uncertainty"])
    assert np.nanmedian(distance[west]) == pytest.approx(BULGE, abs=0.003)
    assert np.nanmedian(distance[east]) == pytest.approx(0.0, abs=0.003)
    significant = np.asarray(las["m3c2_significant"]).astype(bool)
    with np.errstate(invalid="ignore"):
        assert np.array_equal(significant, np.abs(distance) > level)
    assert significant[west & (las["m3c2_status"] == 0)].all()
    assert significant[east].mean() < 0.1
    normals = np.column_stack([las[f"Normal{a}"] for a in "XYZ"])
    assert np.median(normals @ NORMAL) > 0.998
    # a selection of the reference's own points
    given = {tuple(p) for p in np.round(np.asarray(laspy.read(pair[0]).xyz), 3).tolist()}
    assert {tuple(p) for p in np.round(np.asarray(las.xyz), 3).tolist()} <= given
    assert (np.asarray(las.classification) == 2).all()


def test_the_raised_third_is_one_zone_with_its_volume(outcome):
    outputs, metrics, _ = outcome
    zones, footprints, volumes = (
        gpd.read_file(outputs["m3c2_zones"], layer=layer) for layer in ("zones", "footprints", "volumes")
    )
    assert len(zones) == len(footprints) == metrics["zone_count"] == 1
    zone = zones.iloc[0]
    assert zone["kind"] == "uplift"
    assert zone["slope_deg"] == pytest.approx(np.degrees(DIP), abs=1.0)
    assert zone["area_m2"] == pytest.approx(4.0 * 12.0, rel=0.1), "of the face, not of the map"
    assert zone.geometry.area == pytest.approx(4.0 * 12.0 * np.cos(DIP), rel=0.1)
    truth = 4.0 * 12.0 * BULGE
    assert zone["vol_net_m3"] == pytest.approx(truth, rel=0.01)
    assert zone["vol_low_m3"] < truth < zone["vol_high_m3"] < 1.12 * truth
    assert metrics["vol_gain_m3"] == pytest.approx(zone["vol_net_m3"])
    assert metrics["vol_loss_m3"] == 0.0
    assert len(volumes) > 10
    assert zones.crs.equals(CRS.from_epsg(32651))


def test_the_published_level_is_there_for_the_asking(pair, outcome, tmp_path):
    """1.96 (sqrt(s1^2 / n1 + s2^2 / n2) + registration error), from the file itself; the same distances."""
    outputs = run(*pair, tmp_path / "points.laz", calibrate=False, registration_error=0.01).outputs
    las = laspy.read(outputs["points"])
    one, two = (np.asarray(las[f"m3c2_std_dev{k}"]) ** 2 / las[f"m3c2_count{k}"] for k in (1, 2))
    measured = las["m3c2_status"] == 0
    level = np.asarray(las["m3c2_uncertainty"])
    np.testing.assert_allclose(level[measured], 1.959964 * (np.sqrt(one + two) + 0.01)[measured], rtol=1e-4)
    calibrated = laspy.read(outcome[0]["points"])
    np.testing.assert_array_equal(las["m3c2_distance"], calibrated["m3c2_distance"])
    level_record = json.loads(outputs["run"].read_text())["level_of_detection"]
    assert level_record["level"] == level_record["asked_for"] == "as published (Lague et al. 2013)"


class Heard(Progress):
    """Keeps every message."""

    def __init__(self) -> None:
        super().__init__()
        self.heard: list[str] = []

    def show(self, level: str, message: str) -> None:
        self.heard.append(message)


class TestCalibration:
    @pytest.fixture(scope="class")
    @classmethod
    def unchanged(cls, tmp_path_factory) -> tuple[Path, Path]:
        """Two surveys of one face whose eastern half lies 6 mm higher in every second metre of the later one."""
        folder, clouds = tmp_path_factory.mktemp("unchanged"), []
        for seed in (5, 6):
            xyz = steep(24_000, seed)
            wave = np.where((xyz[:, 0] - 5e5 > 6) & (np.floor(xyz[:, 1] * 1.5) % 2 == 0), 0.006, -0.006)
            clouds.append(xyz + (seed == 6) * wave[:, None] * NORMAL * (xyz[:, :1] - 5e5 > 6))
        names = ("slope_2024-05-01.laz", "slope_2025-05-01.laz")
        return tuple(write(folder / name, xyz) for name, xyz in zip(names, clouds, strict=True))

    def beyond(self, outputs: dict[str, Path]) -> tuple[float, float]:
        las = laspy.read(outputs["points"])
        measured, west = las["m3c2_status"] == 0, np.asarray(las.x) < 5e5 + 5.5
        significant = np.asarray(las["m3c2_significant"]).astype(bool)
        return float(significant[measured & west].mean()), float(significant[measured & ~west].mean())

    def test_stable_ground_tells_the_level_and_the_run_says_so(self, unchanged, tmp_path):
        """Of two surveys that differ by more than their points scatter."""
        progress = Heard()
        plain = run(*unchanged, tmp_path / "plain.laz", calibrate=False, registration_error=0.0).outputs
        assert self.beyond(plain)[1] > 0.2
        outputs = run(*unchanged, tmp_path / "out.laz", registration_error=0.0, progress=progress).outputs
        assert sum(self.beyond(outputs)) / 2 < 0.08
        level_record = json.loads(outputs["run"].read_text())["level_of_detection"]
        assert level_record["level"] == "calibrated"
        assert level_record["error_model"] == "calibrated"
        assert level_record["slope_classes"][0]["factor"] > 1.2
        assert any("calibrated on" in sentence for sentence in progress.heard)

    def test_polygons_known_to_be_stable_are_what_it_learns_from(self, unchanged, tmp_path):
        """The quiet western half: of the other half more is then beyond than of that."""
        area = tmp_path / "stable.gpkg"
        box = shapely.box(5e5 - 1, 3.5e6 - 1, 5e5 + 5.5, 3.5e6 + 20)
        gpd.GeoDataFrame(geometry=[box], crs="EPSG:32651").to_file(area)
        outputs = run(*unchanged, tmp_path / "out.laz", registration_error=0.0, stable=area).outputs
        west, east = self.beyond(outputs)
        assert west < 0.08
        assert east > 0.2
        record = json.loads(outputs["run"].read_text())
        assert [entry["role"] for entry in record["inputs"]][-1] == "stable"

    def test_stable_polygons_without_calibration_are_said_to_do_nothing(self, unchanged, tmp_path):
        area, progress = tmp_path / "stable.gpkg", Progress()
        gpd.GeoDataFrame(geometry=[shapely.box(5e5, 3.5e6, 5e5 + 5, 3.5e6 + 20)], crs="EPSG:32651").to_file(area)
        given = {"registration_error": 0.0, "calibrate": False}
        plain = run(*unchanged, tmp_path / "plain.laz", **given)
        done = run(*unchanged, tmp_path / "out.laz", stable=area, progress=progress, **given)
        assert done.figures == plain.figures
        assert [w for w in progress.warnings if "--stable has no effect with --no-calibrate" in w]
        assert not [w for w in plain.warnings if "--stable" in w]

    def test_plants_that_a_cloud_tells_of_widen_no_level_if_the_surveys_are_alike(self, unchanged, tmp_path):
        paths = [
            write(tmp_path / path.name, np.asarray(laspy.read(path).xyz), plant_error=np.full(24_000, 0.05))
            for path in unchanged
        ]
        shared = {"registration_error": 0.0, "projection_scale": 0.6, "normal_scale": 0.6, "half_length": 0.5}
        plain, stated = (run(*some, tmp_path / "out.laz", **shared).figures for some in (unchanged, paths))
        # stable ground shows none of the stated error
        assert stated["lod_median_m"] == pytest.approx(plain["lod_median_m"], rel=0.15)


def test_rasters_lie_on_a_snapped_grid_with_the_tags_of_all_rasters(outcome):
    outputs, metrics, _ = outcome
    layers = {}
    for name in ("m3c2_distance", "m3c2_level_of_detection", "m3c2_significant"):
        assert outputs[name].name == f"{name}.tif"
        assert outputs[name].with_suffix(".qml").is_file()
        with rasterio.open(outputs[name]) as source:
            assert source.crs.to_epsg() == 32651
            assert source.nodata == -9999
            assert source.units[0] == "m"
            cell = source.transform.a
            assert (source.transform.c / cell) % 1 == pytest.approx(0, abs=1e-6)
            assert (source.transform.f / cell) % 1 == pytest.approx(0, abs=1e-6)
            tags = source.tags()
            layers[name] = source.read(1, masked=True)
    assert (tags["EPOCH_FROM"], tags["EPOCH_TO"]) == ("2024-05-01", "2025-05-01")
    assert float(tags["LOD95_MEDIAN"]) == pytest.approx(metrics["lod_median_m"], abs=1e-6)
    assert len(tags["INPUT_SHA256"].split()) == 2
    assert tags["SOFTWARE"].startswith("SlopeWatch")
    distance, level, significant = layers.values()
    las = laspy.read(outputs["points"])
    measured = las["m3c2_status"] == 0
    column = np.floor((np.asarray(las.x) - source.transform.c) / cell + 1e-6).astype(int)
    row = np.ceil((source.transform.f - np.asarray(las.y)) / cell - 1e-6).astype(int) - 1
    at = (row[measured][7], column[measured][7])
    here = measured & (row == at[0]) & (column == at[1])
    assert distance[at] == pytest.approx(np.asarray(las["m3c2_distance"])[here].mean(), abs=1e-6)
    assert level[at] == pytest.approx(np.asarray(las["m3c2_uncertainty"])[here].mean(), abs=1e-6)
    assert (~distance.mask).sum() == len(set(zip(row[measured], column[measured], strict=True)))
    assert np.array_equal(~significant.mask, (np.abs(distance) > level).filled(False))


def test_the_run_record_states_scales_and_doubts(outcome):
    outputs, metrics, warnings = outcome
    record = json.loads(outputs["run"].read_text())
    assert outputs["run"].name == "points_run.json"
    assert record["command"] == "m3c2"
    assert record["metrics"] == json.loads(json.dumps(metrics))
    scales = record["scales"]
    assert scales["normal_scale"] == metrics["normal_scale_m"] >= 20 * scales["roughness"]
    assert scales["chosen"]["projection_scale"].startswith("25 points")
    assert metrics["cylinder_points_median"] >= 20
    assert metrics["half_length_m"] >= 2 * BULGE
    assert metrics["largest_raising_m"] == pytest.approx(BULGE, abs=0.05)
    assert any("registration's error is not known" in sentence for sentence in warnings)
    assert record["warnings"] == warnings
    assert {p.name for p in outputs["run"].parent.iterdir() if p.name.startswith(".")} == set()


def test_a_transform_is_applied_and_its_error_enters_the_level(pair, tmp_path):
    shift = np.array([0.4, -0.3, 0.2])
    moved = write(tmp_path / "moved_2025-05-01.laz", steep(14_000, 2, raised=BULGE, shift=shift))
    matrix = np.eye(4)
    matrix[:3, 3] = -shift
    transform = tmp_path / "transform.json"
    transform.write_text(json.dumps({"matrix": matrix.tolist(), "registration": {"registration_error_m": 0.02}}))
    progress = Progress()
    given = {"projection_scale": 0.7, "normal_scale": 0.6, "half_length": 0.8, "core_spacing": 0.5, "calibrate": False}
    plain = run(*pair, tmp_path / "plain.laz", **given).figures
    done = run(
        pair[0],
        moved,
        tmp_path / "out.laz",
        raster_dir=tmp_path / "maps",
        transform_path=transform,
        progress=progress,
        **given,
    )
    outputs, metrics = done.outputs, done.figures  # fmt: skip
    assert metrics["registration_error_m"] == 0.02
    assert not any("registration's error" in sentence for sentence in progress.warnings)
    assert metrics["lod_median_m"] == pytest.approx(plain["lod_median_m"] + 1.96 * 0.02, abs=5e-4)
    assert metrics["distance_median_m"] == pytest.approx(plain["distance_median_m"], abs=1e-3)
    assert outputs["m3c2_distance"] == tmp_path / "maps" / "m3c2_distance.tif"
    assert {p.name for p in (tmp_path / "maps").iterdir()} == {
        f"m3c2_{name}.{end}" for name in ("distance", "level_of_detection", "significant") for end in ("tif", "qml")
    } | {"m3c2_zones.gpkg", "m3c2_volumes.csv", "m3c2_face.png"}
    record = json.loads((tmp_path / "out_run.json").read_text())
    assert record["transform"] == matrix.tolist()
    with rasterio.open(outputs["m3c2_distance"]) as source:
        assert float(source.tags()["COREG_DX"]) == pytest.approx(-0.4)
    assert run(*pair, tmp_path / "e.laz", registration_error=0.05, **given).figures["registration_error_m"] == 0.05


def test_the_picture_of_the_face_shows_the_raised_third_from_the_side_of_the_normal(outcome):
    """The face dips to the south; seen from there, the raised west is on the left."""
    with Image.open(outcome[0]["m3c2_face"]) as picture:
        red, _, blue = np.asarray(picture.convert("RGB")).astype(int)[250:-250].transpose(2, 0, 1)
    bluish = (blue - red > 40).mean(axis=0)
    columns = np.flatnonzero(bluish > 0.3)
    assert len(columns) > 100
    assert columns.max() < 0.45 * bluish.size


def test_the_report_lies_next_to_the_record_and_states_its_figures(outcome):
    outputs, metrics, _ = outcome
    report = outputs["report"]
    assert report == outputs["run"].with_name("points_report.html")
    check_report(report)
    page = report.read_text(encoding="utf-8")
    assert page.count("data:image/") == 2
    found = dict(re.findall(r'<data value="([^"]+)" data-from="/metrics/(vol_gain_m3)"', page))
    assert [float(value) for value in found] == [metrics["vol_gain_m3"]]
    record = json.loads(outputs["run"].read_text())
    assert record["face"]["dip_deg"] == pytest.approx(np.degrees(DIP), abs=0.5)
    assert record["face"]["azimuth_deg"] == pytest.approx(180.0, abs=0.5)
    assert "Every figure stands in points_run.json" in page


class TestRegion:
    SCALES: ClassVar = {"projection_scale": 0.7, "normal_scale": 0.6, "half_length": 0.8, "core_spacing": 0.5}

    def test_core_points_inside_are_as_without_it_up_to_its_edge(self, pair, tmp_path):
        """A triangle through the raised part, in another reference system; so no cylinder is cut at its edge."""
        corners = [(5e5 + 1, 3.5e6 + 1), (5e5 + 8, 3.5e6 + 1), (5e5 + 1, 3.5e6 + 7)]
        area = shapely.Polygon(corners)
        whole = laspy.read(run(*pair, tmp_path / "whole.laz", calibrate=False, **self.SCALES).outputs["points"])
        given = region(tmp_path / "slope.gpkg", area, "EPSG:4326")
        done = run(*pair, tmp_path / "inside.laz", calibrate=False, roi=given, **self.SCALES)
        points = laspy.read(done.outputs["points"])
        within = shapely.contains_xy(area.buffer(1e-4), np.asarray(whole.x), np.asarray(whole.y))
        assert 50 < done.figures["core_points"] == within.sum() < 0.5 * len(within)
        for name in ("x", "y", "z", "m3c2_distance", "m3c2_count1", "m3c2_count2"):
            assert np.array_equal(np.asarray(points[name]), np.asarray(whole[name])[within], equal_nan=True), name
        zones = gpd.read_file(done.outputs["m3c2_zones"], layer="zones")
        assert len(zones) == 1
        raised = area.intersection(shapely.box(5e5, 3.5e6, 5e5 + 4, 3.5e6 + 99)).area / np.cos(DIP)
        # cells of 0.5 m on its edges count whole
        assert zones["area_m2"].sum() == pytest.approx(raised, rel=0.2)
        record = json.loads(done.outputs["run"].read_text())
        assert "roi" in [entry["role"] for entry in record["inputs"]]

    def test_scales_are_those_of_the_region(self, tmp_path):
        """East of the region the points are four times as dense and the surfaces three times as far apart."""
        clouds = []
        for seed, raised in ((1, 0.0), (2, 0.2)):
            sparse, dense = steep(4000, seed), steep(16_000, seed + 9)
            west, east = sparse[sparse[:, 0] < 5e5 + 6], dense[dense[:, 0] >= 5e5 + 6]
            west, east = west + raised * NORMAL, east + 3 * raised * NORMAL
            clouds.append((west, np.concatenate([west, east])))
        alone = [write(tmp_path / f"alone{k}.laz", cloud[0]) for k, cloud in enumerate(clouds)]
        both = [write(tmp_path / f"both{k}.laz", cloud[1]) for k, cloud in enumerate(clouds)]
        area = region(tmp_path / "slope.gpkg", shapely.box(5e5 - 1, 3.5e6 - 1, 5e5 + 5.9, 3.5e6 + 20))
        scales = ("half_length_m", "projection_scale_m", "normal_scale_m")
        found = run(*both, tmp_path / "b.laz", roi=area).figures
        expected = run(*alone, tmp_path / "a.laz").figures
        assert [found[s] for s in scales] == pytest.approx([expected[s] for s in scales], rel=0.15)
        assert run(*both, tmp_path / "c.laz").figures["half_length_m"] > 1.5 * found["half_length_m"]

    def test_given_core_points_outside_are_left_out(self, pair, tmp_path):
        places = steep(400, 8)
        east = places[:, 0] > 5e5 + 6
        normals = {f"Normal{a}": np.full(400, NORMAL[k]) for k, a in enumerate("XYZ")}
        core = write(tmp_path / "core.laz", places, **normals)
        area = region(tmp_path / "slope.gpkg", shapely.box(5e5 + 6, 3.5e6 - 1, 5e5 + 20, 3.5e6 + 20))
        given = {"core": core, "normals": "given", "projection_scale": 0.8, "half_length": 1.0, "distance_cell": 1.0}
        done = run(*pair, tmp_path / "p.laz", roi=area, **given)
        assert done.figures["core_points"] == pytest.approx(east.sum(), abs=1)
        assert done.figures["distance_median_m"] == pytest.approx(0.0, abs=0.01)


def test_vertical_distances_are_differences_of_height(pair, tmp_path):
    metrics = run(*pair, tmp_path / "v.laz", normals="vertical", half_length=2.0).figures
    las = laspy.read(tmp_path / "v.laz")
    west = (np.asarray(las.x) < 5e5 + 3) & (las["m3c2_status"] == 0)
    assert np.median(np.asarray(las["m3c2_distance"])[west]) == pytest.approx(BULGE / np.cos(DIP), rel=0.02)
    assert metrics["normal_scale_m"] is None


def test_the_same_input_gives_the_same_bytes(pair, tmp_path):
    given = {"projection_scale": 0.7, "normal_scale": 0.6, "half_length": 0.8, "core_spacing": 0.5}
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        run(*pair, tmp_path / name / "points.laz", **given)
    for name in ("points.laz", "m3c2_distance.tif", "m3c2_level_of_detection.tif", "m3c2_significant.tif"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name


def test_core_points_and_their_normals_may_be_given(pair, tmp_path):
    places = np.array([[2.0, 3, 0], [8, 3, 0], [8, 4, 0], [500, 500, 0]])
    places[:, 2] = places[:, 1] * np.tan(DIP)
    places += [5e5, 3.5e6, 50]
    length = np.array([2.0, -1.0, 0.0, 1.0])  # of any length, to either side, none
    normals = {f"Normal{a}": length * NORMAL[k] for k, a in enumerate("XYZ")}
    core = write(tmp_path / "core.laz", places, depth=np.arange(4.0), **normals)
    given = {"projection_scale": 0.8, "half_length": 1.0, "distance_cell": 1.0}
    done = run(*pair, tmp_path / "p.laz", core=core, normals="given", **given)
    outputs, metrics = done.outputs, done.figures
    las = laspy.read(outputs["points"])
    assert np.asarray(las["m3c2_status"]).tolist() == [0, 0, 3, 2]
    assert np.asarray(las["m3c2_distance"])[:2] == pytest.approx([BULGE, 0.0], abs=0.01)
    assert np.asarray(las["NormalZ"])[:2] == pytest.approx([np.cos(DIP), -np.cos(DIP)], abs=1e-6)
    assert np.asarray(las["depth"]).tolist() == [0, 1, 2, 3]
    assert (metrics["core_points"], metrics["measured_points"], metrics["no_normal"]) == (4, 2, 1)


def test_cloudcompares_distances_through_files(shared_data, tmp_path):
    folder = shared_data / "real" / "autzen_bmx"
    table = np.genfromtxt(folder / "autzen-bmx-cc.txt", delimiter=",", names=True)
    xyz, normals = (np.column_stack([table[f"{kind}{a}"] for a in "XYZ"]) for kind in ("", "Normal"))
    dimensions = {f"Normal{a}": normals[:, k] for k, a in enumerate("XYZ")}
    system = laspy.read(folder / "autzen-bmx-2010.las").header.parse_crs()
    core = write(tmp_path / "core.laz", xyz, crs=system, **dimensions)
    outputs = run(
        folder / "autzen-bmx-2010.las", folder / "autzen-bmx-2023.las", tmp_path / "p.laz", core=core, normals="given",
        height_unit="metre", projection_scale=2 * 2.890432, half_length=5.5,
    ).outputs  # fmt: skip
    las = laspy.read(outputs["points"])
    assert np.array_equal(las["m3c2_count1"], table["Npoints_cloud1"])
    assert np.array_equal(las["m3c2_count2"], table["Npoints_cloud2"])
    directed = np.asarray(las["m3c2_status"]) != 3
    apart = np.abs(np.asarray(las["m3c2_distance"]) - table["M3C2_distance"])[directed]
    assert np.nanmax(apart) < 0.003


def test_feet_become_metres_and_are_said(tmp_path):
    progress = Progress()
    feet = 0.3048
    first, second = (
        write(tmp_path / f"{name}.laz", cloud / feet, crs="EPSG:2994+6360")
        for name, cloud in (("a", steep(9000, 1)), ("b", steep(9000, 2, raised=BULGE)))
    )
    outputs = run(first, second, tmp_path / "out.laz", height_unit="foot", progress=progress).outputs
    assert any("feet" in sentence for sentence in progress.warnings)
    las = laspy.read(outputs["points"])
    west = np.asarray(las.x) < 5e5 + 3
    assert np.nanmedian(np.asarray(las["m3c2_distance"])[west]) == pytest.approx(BULGE, abs=0.005)
