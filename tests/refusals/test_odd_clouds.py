"""Sound files with odd content, odd names or neighbours: read, with what is odd said, or refused in one sentence."""

from __future__ import annotations

import laspy
import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.pointcloud.header import EmptyCloud
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.engine.pointcloud.summary import describe_cloud
from slopewatch.engine.pointcloud.writing import copy_with
from slopewatch.tests.builders.damaged_clouds import UTM, refused


def test_20_no_points(tmp_path, las_file, shared_data):
    with pytest.raises(EmptyCloud):
        read_cloud(las_file(tmp_path / "a.laz", points=0))
    refused(shared_data / "bad_las" / "no-points.las", "no points")


def test_21_one_point(shared_data, tmp_path, las_file):
    for path in (shared_data / "bad_las" / "single_point.laz", las_file(tmp_path / "a.laz", points=1)):
        cloud = read_cloud(path, UTM)
        assert np.array_equal(cloud.xyz, laspy.read(path).xyz)
        assert len(cloud) == 1


def test_22_23_collinear_and_duplicate_points(tmp_path, las_file):
    def collapse(data):
        data.x, data.y, data.z = 500_000 + np.arange(2000) // 1000, np.full(2000, 3_500_000), np.full(2000, 5)

    path = las_file(tmp_path / "a.laz", change=collapse)
    cloud = read_cloud(path)
    assert cloud.notes == ()
    assert describe_cloud(path)["area"] == 2
    copy_with(path, tmp_path / "b.laz", xyz=cloud.xyz)
    assert np.array_equal(read_cloud(tmp_path / "b.laz").xyz, cloud.xyz)


def test_24_25_no_and_geographic_reference_systems(tmp_path, las_file, shared_data):
    path = las_file(tmp_path / "a.las", crs=None)
    with pytest.raises(InputError, match=r"a\.las.*no coordinate reference system.*--crs"):
        read_cloud(path)
    assert len(read_cloud(path, UTM)) == 2000
    with pytest.raises(InputError, match="geographic"):
        read_cloud(las_file(tmp_path / "b.las", crs=4326))
    with pytest.raises(InputError, match="geographic"):
        read_cloud(shared_data / "bad_las" / "spurious.las")


def test_27_feet_are_converted_and_said(tmp_path, las_file):
    path = las_file(tmp_path / "a.laz", crs=2227)
    cloud = read_cloud(path)
    assert np.allclose(cloud.xyz, laspy.read(path).xyz * 1200 / 3937, rtol=1e-12)
    assert sum("US survey feet" in note for note in cloud.notes) == 2


def test_39_return_numbers_all_zero_are_said(tmp_path, las_file):
    def unnumbered(data):
        data.return_number = data.number_of_returns = np.zeros(2000, np.uint8)

    for name in ("a.las", "a.laz"):
        cloud = read_cloud(las_file(tmp_path / name, change=unnumbered))
        assert len(cloud) == 2000
        assert any("no return numbers" in note for note in cloud.notes)


@pytest.mark.parametrize(
    "name",
    ['it\'s, "quoted"', "Böschung 漢字", "a\nb", "[a] *?", "a#b", "%41 & $HOME `x`", " -rf ", "a;b|c", "\u202eabc"],
)
def test_40_41_odd_names_work(tmp_path, las_file, name):
    path = las_file(tmp_path / "a.laz").rename(tmp_path / f"{name}.laz")
    target = tmp_path / f"{name} 2.laz"
    copy_with(path, target)
    assert np.array_equal(read_cloud(target).xyz, laspy.read(path).xyz)
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([path.name, target.name])
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(InputError) as caught:
        read_cloud(path)
    assert "\n" not in str(caught.value)


def test_43_a_stale_index_next_to_a_laz_is_left_alone(laz):
    truth = laspy.read(laz).xyz
    laz.with_suffix(".lax").write_bytes(b"LASX" + bytes(100))
    cloud = read_cloud(laz)
    assert np.array_equal(cloud.xyz, truth)
    copy_with(laz, laz.with_name("b.laz"))
    assert np.array_equal(laspy.read(laz.with_name("b.laz")).xyz, truth)
