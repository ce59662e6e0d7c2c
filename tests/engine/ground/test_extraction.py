"""The ground extracted from files by the real PDAL, against the truth of the simulation and the vendors' classes."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import geopandas
import laspy
import lazrs
import numpy as np
import pytest
import shapely
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.ground.cloth import cloth_ground
from slopewatch.engine.ground.extraction import extract_ground
from slopewatch.engine.ground.filtering import ground_mask
from slopewatch.engine.pointcloud.header import preflight
from slopewatch.engine.pointcloud.pdal_program import NO_PDAL, Pdal
from slopewatch.interface.parameters import GroundParameters
from slopewatch.tests.builders.extracted_ground import any_pdal, old_pdal, rows, write


def test_the_ground_is_that_of_the_truth_and_its_points_are_untouched(inputs, result):
    raw, found = laspy.read(inputs[0]), laspy.read(result.ground)
    assert rows(result.ground) <= rows(result.clipped) <= rows(inputs[0])
    assert (np.asarray(found.classification) == 2).all()
    region = geopandas.read_file(inputs[1]).geometry[0]
    inside = shapely.contains_xy(region, np.array(raw.x), np.array(raw.y))
    truth = inside & (np.asarray(raw.user_data) == 1)
    right = np.count_nonzero(found.user_data)
    assert right / truth.sum() >= 0.97
    assert right / len(found.x) >= 0.96
    labels = laspy.read(result.classified)
    assert len(labels.x) == result.roi_points - result.outliers
    assert np.array_equal(np.sort(labels.gps_time[np.asarray(labels.classification) == 2]), np.sort(found.gps_time))


def test_the_files_say_how_high_points_stand_and_what_plants_cost(pair, result):
    las, ground = laspy.read(result.classified), laspy.read(result.ground)
    height, labels = np.asarray(las.height_over_ground), np.asarray(las.classification)
    truth = np.asarray(las.z) - pair.scene.with_changes(()).height_at(np.array(las.xyz))
    known = np.isfinite(height)
    assert known[labels == 2].all()
    assert np.abs(height - truth)[labels == 2].mean() < 0.02
    # in the vertical, on a slope of 39 degrees
    plants = known & (truth > 0.3) & (truth < 0.6)
    assert np.median(height[plants] / truth[plants]) == pytest.approx(1.0, abs=0.05)
    for name in ("plant_error", "plant_height"):
        values = np.asarray(las[name])
        assert values.dtype == np.float32
        assert (values[labels == 2] >= 0).all()
        by_time = dict(zip(np.asarray(las.gps_time).tolist(), values.tolist(), strict=True))
        assert [by_time[t] for t in np.asarray(ground.gps_time).tolist()] == np.asarray(ground[name]).tolist()
    # most of this slope's ground shows itself between the plants
    assert np.median(ground.plant_error) == 0.0
    assert np.nanmedian(las.plant_height[truth < 1.0]) > 0.0


def test_without_refinement_nothing_is_said_of_plants(inputs, tmp_path):
    parameters = GroundParameters(refine=False, class_threshold=0.1)
    found = extract_ground(inputs[0], tmp_path / "g.laz", roi=inputs[1], parameters=parameters, pdal=any_pdal())
    for path in (found.classified, found.ground):
        assert not list(laspy.read(path).point_format.extra_dimension_names)


def test_ground_of_a_classified_cloud_replaces_what_the_file_said_of_plants(result, tmp_path):
    again = extract_ground(result.classified, tmp_path / "g.laz", pdal=any_pdal())
    for path in (again.classified, again.ground):
        names = list(laspy.read(path).point_format.extra_dimension_names)
        assert sorted(names) == ["height_over_ground", "plant_error", "plant_height"]
    assert abs(again.ground_points - result.ground_points) < 0.01 * result.ground_points


def test_the_reported_figures_are_those_of_the_points(pair, inputs, result):
    raw, found = laspy.read(inputs[0]), laspy.read(result.ground)
    region = geopandas.read_file(inputs[1]).geometry[0]
    inside = shapely.contains_xy(region, np.array(raw.x), np.array(raw.y))
    assert result.raw_points == len(raw.x)
    assert result.raw_area == len(set(zip(np.floor(raw.x).tolist(), np.floor(raw.y).tolist(), strict=True)))
    assert result.raw_density == pytest.approx(result.raw_points / result.raw_area)
    assert abs(result.roi_points - inside.sum()) <= 3
    assert result.roi_area == pytest.approx(region.area)
    assert result.roi_density == pytest.approx(result.roi_points / region.area)
    assert result.ground_points == len(found.x)
    assert result.ground_ratio == pytest.approx(len(found.x) / result.roi_points)
    u, v = pair.scene.slope[2:]
    assert result.vegetation_cover == pytest.approx(pair.canopy.cover((-1.0, -1.0, u + 1, v + 1)), abs=0.06)
    assert result.plane_dip == pytest.approx(39.0, abs=1.5)
    assert set(result.seconds) == {"read", "clip", "denoise", "cloth", "refine", "write"}
    assert {"roi_points", "ground_ratio", "vegetation_cover"} <= result.figures().keys()
    json.dumps(result.figures())


def test_the_same_input_gives_the_same_bytes_and_the_kept_pipelines_run_again(inputs, result, tmp_path):
    again = extract_ground(inputs[0], tmp_path / "a_ground.laz", roi=inputs[1], pdal=any_pdal())
    for one, other in ((result.ground, again.ground), (result.clipped, again.clipped)):
        assert one.read_bytes() == other.read_bytes()
    names = {p.name for p in tmp_path.iterdir()}
    assert {"a_ground.laz", "a_clipped.laz", "a_classified.laz", "a_clip.json", "a_select.json"} <= names
    assert names == {p.name for p in (again.ground, again.clipped, again.classified, *again.pipelines)}
    if any_pdal().path is None:
        return
    # outliers are not taken out by PDAL: the points that it clips are these and the others
    for name, output in (("select", again.ground), ("clip", again.clipped)):
        output.unlink()
        subprocess.run([any_pdal().path, "pipeline", tmp_path / f"a_{name}.json"], check=True, cwd="/")
    one, other = laspy.read(again.ground), laspy.read(result.ground)
    assert list(one.point_format.dimension_names) == list(other.point_format.dimension_names)
    assert all(np.array_equal(one[name], other[name]) for name in one.point_format.dimension_names)
    assert tuple(one.header.scales) == tuple(other.header.scales)
    assert tuple(one.header.offsets) == tuple(other.header.offsets)
    assert rows(result.clipped) <= rows(again.clipped)
    assert len(rows(again.clipped)) == result.roi_points


class CodingSpy:
    """Points that are decompressed and compressed by laspy's decoder and encoder, and those of files PDAL handles."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.decoded: list[int] = []
        self.encoded: list[int] = []
        decode, encode, run = lazrs.decompress_points_with_chunk_table, laspy.LasWriter, Pdal.run
        spy = self

        def decompress(data, record, out, group, selection):
            spy.decoded.append(sum(points for points, _ in group))
            return decode(data, record, out, group, selection)

        class Writer(encode):
            def close(self) -> None:
                super().close()
                if self.header.are_points_compressed:
                    spy.encoded.append(int(self.header.point_count))

        def run_pdal(self, pipeline, **options):
            run(self, pipeline, **options)
            for stage, found in ((pipeline[0], spy.decoded), (pipeline[-1], spy.encoded)):
                header = preflight(Path(stage["filename"]))
                if header.compressed:
                    found.append(header.count)

        monkeypatch.setattr(lazrs, "decompress_points_with_chunk_table", decompress)
        monkeypatch.setattr(laspy, "LasWriter", Writer)
        monkeypatch.setattr(Pdal, "run", run_pdal)


@pytest.mark.parametrize("stray", [False, True])
def test_an_epoch_is_decoded_twice_and_encoded_once_into_each_file(pair, inputs, tmp_path, monkeypatch, stray):
    """Once to check all of its points and once by PDAL; clipped and classified cloud hold it, the ground a part."""

    def lift(las: laspy.LasData) -> None:
        las.z[:2] = las.z[:2] + 40.0 * stray

    cloud = write(pair, tmp_path / "a.laz", lift)
    spy = CodingSpy(monkeypatch)
    found = extract_ground(cloud, tmp_path / "g.laz", pdal=old_pdal())
    assert (found.outliers > 0) or not stray
    assert sum(spy.decoded) == 2 * found.raw_points
    kept = found.roi_points - found.outliers
    assert sorted(spy.encoded) == sorted([kept, kept, found.ground_points])


def test_without_pdal_the_ground_is_the_same(inputs, tmp_path):
    for folder, pdal in (("own", NO_PDAL), ("other", old_pdal())):
        (tmp_path / folder).mkdir()
        extract_ground(inputs[0], tmp_path / folder / "a_ground.laz", roi=inputs[1], pdal=pdal)
    for name in ("a_ground.laz", "a_clipped.laz", "a_classified.laz"):
        own, other = (laspy.read(tmp_path / folder / name) for folder in ("own", "other"))
        for dimension in own.point_format.dimension_names:
            np.testing.assert_array_equal(np.asarray(own[dimension]), np.asarray(other[dimension]), err_msg=dimension)
    hole = tmp_path / "hole.gpkg"  # within the cloud's bounds, but none of its points
    gap = shapely.Point(laspy.read(inputs[0]).xyz[0, :2] + 0.0004).buffer(0.0001)
    geopandas.GeoDataFrame(geometry=[gap], crs=geopandas.read_file(inputs[1]).crs).to_file(hole)
    for pdal in (NO_PDAL, any_pdal()):
        with pytest.raises(InputError, match=r"has no point inside the region .*hole\.gpkg'; check both"):
            extract_ground(inputs[0], tmp_path / "b_ground.laz", roi=hole, pdal=pdal)


def test_arrays_and_files_give_the_same_ground(result):
    las = laspy.read(result.clipped)
    found = ground_mask(np.array(las.xyz), last=np.asarray(las.return_number == las.number_of_returns))
    assert set(laspy.read(result.ground).gps_time) == set(las.gps_time[found])


def test_a_region_of_parts_with_holes_in_another_system_is_taken(pair, inputs, tmp_path):
    whole = shapely.Polygon(pair.roi)
    half = shapely.affinity.scale(whole, 0.4, 0.9, origin=whole.exterior.coords[0])
    parts = shapely.MultiPolygon([half.difference(half.centroid.buffer(1.5)), whole.centroid.buffer(2.0)])
    geopandas.GeoSeries([parts], crs=pair.crs).to_crs(4326).to_file(tmp_path / "roi.geojson")
    found = extract_ground(inputs[0], tmp_path / "g.laz", roi=tmp_path / "roi.geojson", pdal=any_pdal())
    raw = pair.first.xyz
    inside = shapely.contains_xy(shapely.union_all(list(parts.geoms)), raw[:, 0], raw[:, 1])
    assert found.roi_points == pytest.approx(inside.sum(), abs=20)
    assert any("transformed" in w for w in found.warnings)


def test_feet_give_the_same_ground_in_metres(pair, result, inputs, tmp_path):
    foot = 0.3048

    cloud = pair.first
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001 / foot] * 3, np.floor(cloud.xyz.mean(axis=0)) / foot
    header.add_crs(CRS.from_epsg(2222))
    las = laspy.LasData(header)
    las.x, las.y, las.z = cloud.xyz.T / foot
    las.return_number, las.number_of_returns = cloud.return_number, cloud.number_of_returns
    las.write(tmp_path / "feet.las")
    metres = CRS.from_user_input(extract_crs(tmp_path / "feet.las"))
    geopandas.GeoSeries([shapely.Polygon(pair.roi)], crs=metres).to_file(tmp_path / "roi.gpkg")
    found = extract_ground(tmp_path / "feet.las", tmp_path / "g.laz", roi=tmp_path / "roi.gpkg", pdal=any_pdal())
    assert any("feet" in w for w in found.warnings)
    assert abs(found.ground_points - result.ground_points) < 0.002 * result.ground_points
    one, other = (np.sort(np.array(laspy.read(r.ground).xyz), axis=0) for r in (found, result))
    assert np.abs(one.mean(axis=0) - other.mean(axis=0)).max() < 0.01


def extract_crs(path: Path) -> CRS:
    from slopewatch.engine.pointcloud.reading import open_cloud

    return open_cloud(path)[1].crs


def test_the_published_profile_is_the_plain_filter(pair, inputs, tmp_path):
    parameters = GroundParameters.build(profile="paper")
    found = extract_ground(inputs[0], tmp_path / "g.laz", roi=inputs[1], parameters=parameters, pdal=old_pdal())
    las = laspy.read(found.clipped)
    plain = cloth_ground(np.array(las.xyz), parameters)
    assert set(laspy.read(found.ground).gps_time) == set(las.gps_time[plain])


@pytest.mark.parametrize(
    ("name", "recall", "precision"),
    [
        ("alpine_slope", 0.5, 0.9),
        ("test_data_77050_627755_LA93_IGN69", 0.95, 0.98),
        ("test_data_77050_627760_LA93_IGN69", 0.94, 0.98),
    ],
)
def test_ground_of_real_clouds_is_the_vendors(shared_data, tmp_path, name, recall, precision):
    cloud = shared_data / "real" / "ign_tiles" / f"{name}.laz"
    found = extract_ground(cloud, tmp_path / "g.laz", pdal=any_pdal())
    raw = laspy.read(cloud)
    vendor = rows_of(raw, np.asarray(raw.classification) == 2)
    own = rows_of(laspy.read(found.ground))
    assert len(vendor & own) / len(vendor) > recall
    assert len(vendor & own) / len(own) > precision


def rows_of(las: laspy.LasData, chosen: np.ndarray | None = None) -> set[tuple[int, ...]]:
    chosen = np.ones(len(las.x), bool) if chosen is None else chosen
    return set(zip(*(np.asarray(las[n])[chosen].tolist() for n in ("X", "Y", "Z")), strict=True))


def test_a_real_jungle_slope(shared_data, tmp_path):
    found = extract_ground(
        shared_data / "real" / "ign_tiles" / "sample_lareunion_epsg2975.laz", tmp_path / "g.laz", pdal=any_pdal()
    )
    # hardly a pulse reaches the ground, and plants are not taken for it
    assert 0.002 < found.ground_ratio < 0.02
    assert any("no ground" in w or "below its ground" in w for w in found.warnings)
    assert 20 < found.plane_dip < 40
    assert found.vegetation_cover > 0.8
    # nearly nothing lies more than half a metre below what was found
    las, ground = laspy.read(found.clipped), laspy.read(found.ground)
    from scipy.spatial import cKDTree

    distance, nearest = cKDTree(np.array(ground.xyz)[:, :2]).query(np.array(las.xyz)[:, :2])
    below = (las.z - np.array(ground.z)[nearest] < -0.5) & (distance < 0.3)
    assert below.mean() < 0.002


def test_strips_of_a_survey_are_fitted_in_its_ground(pair, inputs, tmp_path):
    """The later line lies 8 cm too high; in the ground both lie alike, and all else of a point stays."""

    def misfit(las: laspy.LasData) -> None:
        las.point_source_id = pair.first.line
        las.z[pair.first.line == pair.first.line.max()] += 0.08

    cloud = write(pair, tmp_path / "a.las", misfit)
    found = {}
    for strips in ("off", "auto"):
        parameters = GroundParameters(strips=strips)
        made = extract_ground(cloud, tmp_path / f"{strips}_ground.laz", roi=inputs[1], parameters=parameters)
        las = laspy.read(made.ground)
        off = np.asarray(las.z) - pair.scene.with_changes(()).height_at(np.array(las.xyz))
        line = np.asarray(las.point_source_id)
        found[strips] = made, las, np.median(off[line == line.max()]) - np.median(off[line < line.max()])
    made, las, apart = found["auto"]
    assert found["off"][0].strips is None
    assert found["off"][2] == pytest.approx(0.08, abs=0.015)
    assert apart == pytest.approx(0.0, abs=0.01)
    assert made.strips["correction"] in ("height", "position", "drift")
    assert made.figures()["strips_disagreement_after_m"] < 0.015 < made.figures()["strips_disagreement_before_m"]
    assert any("fitted to one another" in warning for warning in made.warnings)
    # The ground is the lowest layer: it held next to nothing of the line that lay higher.
    assert len(las) > 1.3 * len(found["off"][1])
    assert made.raw_points == len(pair.first)
    raw = laspy.read(cloud)
    at = np.searchsorted(raw.gps_time, las.gps_time)
    for name in ("intensity", "return_number", "point_source_id", "user_data"):
        assert np.array_equal(las[name], raw[name][at]), name
    assert not list(tmp_path.glob("*fitted*"))
    clip = (tmp_path / "auto_clip.json").read_text(encoding="utf-8")
    assert "a.las" in clip
