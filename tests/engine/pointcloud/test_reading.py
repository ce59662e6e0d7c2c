"""Reading clouds into metres, compared with laspy."""

from __future__ import annotations

import laspy
import numpy as np
import pytest
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.pointcloud.extent import CheckedRecords
from slopewatch.engine.pointcloud.header import POINT_SIZES, preflight
from slopewatch.engine.pointcloud.reading import eight_bits, open_cloud, read_cloud, read_dimension, sample_cloud
from slopewatch.engine.pointcloud.records import PLACES, new_dimension, read_records, record_dtype
from slopewatch.interface.parameters import InputParameters
from slopewatch.tests.builders.pdal_columns import by_pdal

US_FOOT = 1200 / 3937
REAL = [
    "real/ign_tiles/sample_lareunion_epsg2975.laz",
    "real/ign_tiles/alpine_slope.laz",
    "real/ign_tiles/test_data_77050_627755_LA93_IGN69.laz",
    "real/lone-star.copc.laz",
]


@pytest.mark.parametrize(("point_format", "version"), [(f, "1.2") for f in range(4)] + [(f, "1.4") for f in range(11)])
@pytest.mark.parametrize("extension", ["las", "laz"])
def test_every_point_format_is_read_as_laspy_reads_it(tmp_path, las_file, point_format, version, extension):
    path = las_file(tmp_path / f"a.{extension}", point_format=point_format, version=version, points=500)
    cloud = read_cloud(path, colours=True)
    las = laspy.read(path)
    assert np.array_equal(cloud.xyz, las.xyz)
    assert np.array_equal(cloud.classification, las.classification)
    assert np.array_equal(cloud.intensity, las.intensity)
    if "red" in las.point_format.dimension_names:
        assert np.array_equal(cloud.rgb, np.column_stack([las.red, las.green, las.blue]) // 256)
    else:
        assert cloud.rgb is None
    assert cloud.crs.to_epsg() == 32651
    assert cloud.notes == ()


@pytest.mark.parametrize(
    ("point_format", "version"), [(0, "1.2"), (1, "1.2"), (2, "1.2"), (3, "1.2"), (6, "1.4"), (7, "1.4"), (8, "1.4")]
)
def test_points_are_read_as_pdal_reads_them(tmp_path, las_file, point_format, version):
    def labelled(las):
        las.add_extra_dim(laspy.ExtraBytesParams("label", "i2"))
        las.label = np.arange(500) - 250

    path = las_file(tmp_path / "a.laz", point_format=point_format, version=version, points=500, change=labelled)
    cloud = read_cloud(path, colours=True)
    names = ["X", "Y", "Z", "Intensity", "Classification"] + (["Red", "Green", "Blue"] if cloud.rgb is not None else [])
    found = by_pdal(path, *names)
    assert np.abs(np.column_stack([found[axis] for axis in "XYZ"]) - cloud.xyz).max() < 1e-8
    assert np.array_equal(found["Intensity"], cloud.intensity)
    assert np.array_equal(found["Classification"], cloud.classification)
    assert (cloud.rgb is None) == (point_format in (0, 1, 6))
    if cloud.rgb is not None:
        assert np.array_equal(np.column_stack([found[c] for c in ("Red", "Green", "Blue")]) // 256, cloud.rgb)
    assert np.array_equal(read_dimension(path, "label"), np.arange(500) - 250)


@pytest.mark.parametrize("name", REAL)
def test_real_clouds_are_read_as_laspy_reads_them(shared_data, name):
    wrong = InputParameters(crs="EPSG:32613") if "lone" in name else None
    cloud = read_cloud(shared_data / name, wrong, colours=True)
    las = laspy.read(shared_data / name)
    assert np.array_equal(cloud.xyz, las.xyz)
    assert np.array_equal(cloud.classification, las.classification)
    assert np.array_equal(cloud.intensity, las.intensity)


def test_groups_of_chunks_and_the_short_last_one_join_without_a_seam(tmp_path, las_file, monkeypatch):
    """120,000 points are three chunks; groups of one chunk each must give what one group gives."""
    path = las_file(tmp_path / "a.laz", points=120_001)
    las = laspy.read(path)
    monkeypatch.setattr("slopewatch.engine.pointcloud.records._GROUP_BYTES", 1)
    groups = list(read_records(preflight(path)))
    assert [len(g) for g in groups] == [50_000, 50_000, 20_001]
    assert np.array_equal(np.concatenate([g["X"] for g in groups]), las.X)
    assert np.array_equal(np.concatenate([g["gps_time"] for g in groups]), las.gps_time)
    assert np.array_equal(np.concatenate([np.asarray(g["return_number"]) for g in groups]), las.return_number)
    plain = las_file(tmp_path / "a.las", points=10)
    assert len(list(read_records(preflight(plain)))) == 10


@pytest.mark.parametrize("extension", ["las", "laz"])
@pytest.mark.parametrize(("point_format", "version"), [(3, "1.2"), (7, "1.4")])
def test_fields_that_share_bytes(tmp_path, las_file, point_format, version, extension):
    """Against the bytes of the uncompressed file and the bits of the specification."""

    def flag(las):
        las.withheld, las.edge_of_flight_line = np.arange(2000) % 2, np.arange(2000) % 3 == 0

    options = {"point_format": point_format, "version": version, "change": flag}
    header = preflight(las_file(tmp_path / "plain.las", **options))
    rows = np.frombuffer((tmp_path / "plain.las").read_bytes()[header.offset_to_points :], np.uint8).reshape(2000, -1)
    returns, labels = (rows[:, 14], rows[:, 15] & 31) if point_format == 3 else (rows[:, 14], rows[:, 16])
    bits = 3 if point_format == 3 else 4
    (records,) = read_records(preflight(las_file(tmp_path / f"a.{extension}", **options)))
    assert np.array_equal(records["return_number"], returns & (2**bits - 1))
    assert np.array_equal(records["number_of_returns"], returns >> bits & (2**bits - 1))
    assert np.array_equal(records["classification"], labels)
    assert len(np.unique(labels)) > 1


def test_eight_raw_extra_bytes_are_read(tmp_path, las_file):
    """Their number stands where others mark a scale; laspy 2.7 refuses such files."""
    path = las_file(tmp_path / "a.las", change=lambda las: las.add_extra_dim(laspy.ExtraBytesParams("raw", "8u1")))
    plain = laspy.read(las_file(tmp_path / "b.las"))
    assert np.array_equal(read_cloud(path).xyz, plain.xyz)


@pytest.mark.parametrize("point_format", range(11))
def test_record_structures_have_the_specified_size(point_format):
    extra = [new_dimension("a", np.dtype("u1")), new_dimension("X", np.dtype("f8"))]
    assert record_dtype(point_format).itemsize == POINT_SIZES[point_format]
    assert record_dtype(point_format, extra).itemsize == POINT_SIZES[point_format] + 9


def test_heights_in_feet_become_metres(shared_data):
    path = shared_data / "real" / "autzen_bmx" / "autzen-bmx-2010.las"
    progress = Progress()
    cloud = read_cloud(path, progress=progress)
    raw = laspy.read(path).xyz
    assert np.allclose(cloud.xyz[:, :2], raw[:, :2], rtol=0, atol=1e-9)
    assert np.allclose(cloud.xyz[:, 2], raw[:, 2] * 0.3048006096, rtol=1e-10)
    assert {axis.unit_conversion_factor for axis in cloud.crs.axis_info} == {1.0}
    assert any("US survey feet" in note for note in cloud.notes)
    assert any("US survey feet" in warning for warning in progress.warnings)


def test_both_axes_in_feet_become_metres(tmp_path, las_file):
    path = las_file(tmp_path / "a.las", crs=2227)
    cloud = read_cloud(path)
    assert np.allclose(cloud.xyz, laspy.read(path).xyz * US_FOOT, rtol=1e-12)


def test_colours_of_eight_and_of_sixteen_bits():
    assert eight_bits(np.array([[0, 128, 255]], np.uint16)).tolist() == [[0, 128, 255]]
    assert eight_bits(np.array([[0, 32768, 65535]], np.uint16)).tolist() == [[0, 128, 255]]
    assert eight_bits(np.empty((0, 3), np.uint16)).shape == (0, 3)


def test_colours_and_classes_only_where_asked_for(tmp_path, las_file):
    path = las_file(tmp_path / "a.laz")
    plain = read_cloud(path, classification=False)
    assert plain.rgb is None
    assert plain.intensity is None
    assert plain.classification is None
    assert np.array_equal(plain.xyz, read_cloud(path, colours=True).xyz)


def test_extent_is_that_of_the_points(tmp_path, las_file):
    path = las_file(tmp_path / "a.laz", crs=2227)
    header, frame = open_cloud(path)
    checked = CheckedRecords(header, PLACES)
    assert sum(len(records) for records in checked) == checked.done == header.count
    extent = checked.extent(frame)
    xyz = laspy.read(path).xyz * US_FOOT
    assert np.allclose(extent.low, xyz.min(axis=0), rtol=1e-12)
    assert np.allclose(extent.high, xyz.max(axis=0), rtol=1e-12)
    assert np.allclose(extent.bounds, [*xyz.min(axis=0)[:2], *xyz.max(axis=0)[:2]], rtol=1e-12)
    assert extent.warnings == ()


def test_progress_ends_at_the_end(tmp_path, las_file):
    class Seen(Progress):
        def emit(self, percent, message):
            seen.append(percent)

    seen: list[float] = []
    read_cloud(las_file(tmp_path / "a.laz"), progress=Seen())
    assert seen[-1] == 100.0
    assert seen == sorted(seen)


@pytest.mark.parametrize("extension", ["las", "laz"])
def test_a_sample_is_some_stretches_of_the_points_evenly_over_the_file(tmp_path, las_file, extension):
    path = las_file(tmp_path / f"a.{extension}", points=270_000)
    xyz = laspy.read(path).xyz
    parts = [xyz[start : start + 50_000] for start in range(0, 270_000, 50_000)]
    assert np.array_equal(sample_cloud(path, stretches=3), np.concatenate([parts[i] for i in (0, 2, 5)]))
    assert np.array_equal(sample_cloud(path, stretches=9), xyz)
    assert np.array_equal(
        sample_cloud(las_file(tmp_path / f"b.{extension}", points=20)), read_cloud(tmp_path / f"b.{extension}").xyz
    )


@pytest.mark.parametrize("name", REAL)
def test_a_sample_of_a_real_cloud_is_part_of_it(shared_data, name):
    inputs = InputParameters(crs="EPSG:32613") if "lone" in name else None
    whole = read_cloud(shared_data / name, inputs).xyz
    sample = sample_cloud(shared_data / name, inputs, stretches=2)
    rows = {row.tobytes() for row in whole}
    assert 0 < len(sample) <= len(whole)
    assert all(row.tobytes() in rows for row in sample[:: max(1, len(sample) // 500)])
