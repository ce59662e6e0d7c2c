"""Headers that cannot be true: the cloud is refused in one sentence, or read and the fault said."""

from __future__ import annotations

import struct
import time

import laspy
import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.engine.pointcloud.summary import describe_cloud
from slopewatch.engine.pointcloud.writing import copy_with
from slopewatch.tests.builders.damaged_clouds import UTM, patched, refused

SCALE, OFFSET, BOX = 131, 155, 179


def test_06_header_count_larger_than_the_file(las, laz):
    refused(patched(las, 247, "Q", 5000), "holds 2000 of the 5000 points")
    refused(patched(laz, 247, "Q", 60_500), "holds 60000 of the 60500 points")
    refused(patched(laz, 247, "Q", 2**40), "chunks")


def test_07_header_count_smaller_is_said(las, laz):
    for path, held, said in ((las, 2000, 1900), (laz, 60_000, 59_900)):
        truth = laspy.read(path).xyz[:said]
        progress = Progress()
        cloud = read_cloud(patched(path, 247, "Q", said), UTM, progress=progress)
        assert np.array_equal(cloud.xyz, truth)
        assert any(str(held) in w and str(said) in w for w in cloud.notes)
        assert any(str(held) in w and str(said) in w for w in progress.warnings)


def test_07_trailing_bytes_are_said(las):
    truth = laspy.read(las).xyz
    las.write_bytes(las.read_bytes() + b"garbage")
    cloud = read_cloud(las)
    assert np.array_equal(cloud.xyz, truth)
    assert any("7 bytes behind" in note for note in cloud.notes)


@pytest.mark.parametrize("count", [100, 10**6, 2**32 - 1])
def test_08_absurd_number_of_records(las, count):
    started = time.process_time()
    refused(patched(las, 100, "I", count), "variable length record")
    assert time.process_time() - started < 1


def test_08_absurd_length_of_a_record(las):
    refused(patched(las, 375 + 20, "H", 65535), "variable length record")


@pytest.mark.parametrize("point_format", [11, 12, 63, 64, 64 + 7])
def test_09_unknown_point_format(las, point_format):
    refused(patched(las, 104, "B", point_format), "point format")


@pytest.mark.parametrize("version", [(1, 9), (2, 0), (0, 0), (255, 255)])
def test_09_unknown_version(las, version):
    refused(patched(las, 24, "BB", *version), "LAS")


def test_10_record_length_below_the_formats(las):
    refused(patched(las, 105, "H", 35), "35 bytes", "36")
    refused(patched(las, 105, "H", 0), "0 bytes")


@pytest.mark.parametrize("value", [0.0, -0.001, np.nan, np.inf, -np.inf, 1e30])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_11_12_scales_that_give_no_coordinates(las, value, axis):
    refused(patched(las, SCALE + 8 * axis, "d", value), "scale", "xyz"[axis])


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_13_offsets_that_give_no_coordinates(las, value, axis):
    refused(patched(las, OFFSET + 8 * axis, "d", value), "offset", "xyz"[axis])


@pytest.mark.parametrize(
    "box",
    [
        (np.nan,) * 6,
        (0.0,) * 6,
        (500_000.0, 500_030.0, 3_500_000.0, 3_500_020.0, 50.0, 66.0),  # maximum and minimum exchanged
        (500_031.0, 499_999.0, 3_500_021.0, 3_499_999.0, 60.0, 50.0),  # too low
        (600_000.0, 400_000.0, 3_600_000.0, 3_400_000.0, 100.0, 0.0),  # too large
        (1e300, -1e300, 1e300, -1e300, 1e300, -1e300),
    ],
)
@pytest.mark.parametrize("name", ["las", "laz"])
def test_14_a_lying_bounding_box_is_computed_anew_and_said(request, name, box):
    path = request.getfixturevalue(name)
    truth = laspy.read(path).xyz
    progress = Progress()
    cloud = read_cloud(patched(path, BOX, "6d", *box), progress=progress)
    assert np.array_equal(cloud.xyz, truth)
    assert any("bounding box" in note for note in cloud.notes)
    assert any("bounding box" in warning for warning in progress.warnings)
    facts = describe_cloud(path)
    assert facts["x"] == [truth[:, 0].min(), truth[:, 0].max()]


def test_14_a_good_bounding_box_is_not_questioned(las, laz):
    assert read_cloud(las).notes == ()
    assert read_cloud(laz).notes == ()


def test_15_integers_and_sound_scales_leave_no_coordinate_that_is_not_finite(las):
    """Points at the ends of 32 bits, with the largest scale and offset that are accepted."""
    extreme = struct.pack("<3i", 2**31 - 1, -(2**31), 2**31 - 1)
    data = bytearray(las.read_bytes())
    start = int.from_bytes(data[96:100], "little")
    data[start : start + 12] = extreme
    struct.pack_into("<6d", data, SCALE, 1e3, 1e3, 1e3, 1e9, -1e9, 1e9)
    las.write_bytes(data)
    assert np.isfinite(read_cloud(las, UTM).xyz).all()


def test_16_coordinates_beyond_32_bits_on_writing(las):
    xyz = read_cloud(las).xyz
    xyz[0] += 1e8
    with pytest.raises(InputError, match="outliers"):
        copy_with(las, las.with_name("b.laz"), xyz=xyz)
    assert not las.with_name("b.laz").exists()
