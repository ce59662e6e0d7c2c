"""What the header says, compared with what laspy reads of it."""

from __future__ import annotations

import struct
from pathlib import Path

import laspy
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.messages import shown
from slopewatch.engine.pointcloud import header
from slopewatch.engine.pointcloud.header import CloudHeader, EmptyCloud, preflight


@pytest.mark.parametrize(("point_format", "version"), [(f, "1.2") for f in range(4)] + [(f, "1.4") for f in range(11)])
@pytest.mark.parametrize("extension", ["las", "laz"])
def test_header_is_read_as_laspy_reads_it(tmp_path, las_file, point_format, version, extension):
    path = las_file(tmp_path / f"a.{extension}", point_format=point_format, version=version, points=300)
    header = preflight(path)
    with laspy.open(path) as reader:
        expected = reader.header
    assert header.version == str(expected.version)
    assert header.point_format == expected.point_format.id == point_format
    assert header.record_length == expected.point_format.size
    assert header.count == expected.point_count == 300
    assert header.compressed == (extension == "laz")
    assert header.scales == tuple(expected.scales)
    assert header.offsets == tuple(expected.offsets)
    assert header.bounds_low == tuple(expected.mins)
    assert header.bounds_high == tuple(expected.maxs)
    assert header.bounds_trusted
    assert header.points_by_return[:5] == tuple(expected.number_of_points_by_return[:5])
    assert header.warnings == ()


def test_extended_records_are_read_and_end_the_points(tmp_path, las_file):
    path = las_file(tmp_path / "a.las", crs=None, points=100)
    las = laspy.read(path)
    las.evlrs = laspy.vlrs.vlrlist.VLRList([laspy.VLR("LASF_Projection", 2112, record_data=b"PROJCS[...]\0")])
    las.write(path)
    header = preflight(path)
    assert header.wkt == b"PROJCS[...]\0"
    assert header.warnings == ()


def test_an_extended_record_beyond_the_file_is_refused(tmp_path, las_file):
    path = las_file(tmp_path / "a.las", crs=None)
    data = bytearray(path.read_bytes())
    struct.pack_into("<QI", data, 235, len(data) + 500, 1)
    path.write_bytes(data)
    with pytest.raises(InputError, match="extended records"):
        preflight(path)


def test_an_extended_record_longer_than_the_file_is_refused(tmp_path, las_file):
    path = las_file(tmp_path / "a.las", crs=None)
    data = path.read_bytes()
    record = struct.pack("<H16sHQ32s", 0, b"LASF_Projection", 2112, 2**62, b"")
    changed = bytearray(data + record + b"x")
    struct.pack_into("<QI", changed, 235, len(data), 1)
    path.write_bytes(changed)
    with pytest.raises(InputError, match="extended record"):
        preflight(path)


def test_both_counts_of_a_contradiction_are_told(tmp_path, las_file):
    path = las_file(tmp_path / "a.las", point_format=3, points=50)
    data = bytearray(path.read_bytes())
    struct.pack_into("<I", data, 107, 40)
    path.write_bytes(data)
    header = preflight(path)
    assert header.count == 50
    assert any("50 and 40" in w for w in header.warnings)


def test_count_of_the_old_field_serves_where_the_new_one_is_empty(tmp_path, las_file):
    path = las_file(tmp_path / "a.las", point_format=3, points=50)
    data = bytearray(path.read_bytes())
    struct.pack_into("<I", data, 107, 50)
    struct.pack_into("<Q", data, 247, 0)
    path.write_bytes(data)
    header = preflight(path)
    assert header.count == 50
    assert any("50" in w for w in header.warnings)


def test_no_points_is_its_own_error(tmp_path, las_file):
    path = las_file(tmp_path / "a.las", points=0)
    with pytest.raises(EmptyCloud, match="no points"):
        preflight(path)


def test_names_in_messages_stay_on_one_line():
    assert shown("a\nb\tc é 漢") == "'a\\nb\\tc é 漢'"


def test_reading_is_bounded(tmp_path, las_file, monkeypatch):
    """A large file costs as little as a small one: the header and its records are all that is read."""
    path = las_file(tmp_path / "a.las", points=200_000)
    read = []
    original = header.open_input

    def counted(*args):
        stream = original(*args)

        class Counting:
            def __enter__(self):
                return self

            def __exit__(self, *_):
                stream.close()

            def read(self, n):
                read.append(n)
                return stream.read(n)

            def __getattr__(self, name):
                return getattr(stream, name)

        return Counting()

    monkeypatch.setattr(header, "open_input", counted)
    assert preflight(path).count == 200_000
    assert 0 < sum(read) < 10_000


def test_copc_is_accepted(shared_data):
    header = preflight(shared_data / "real" / "lone-star.copc.laz")
    assert header.copc
    assert header.compressed
    assert header.count == 518_862
    assert np.allclose(header.bounds_low, [515368.602, 4918340.364, 2322.896], atol=1e-3)


# where a field of the header or of the first variable length record begins, and its bytes
_FIELDS = [
    *((24, 1), (25, 1), (94, 2), (96, 4), (100, 4), (104, 1), (105, 2), (107, 4), (131, 8), (155, 8), (179, 8)),
    *((235, 8), (243, 4), (247, 8), (229, 1), (245, 2), (247, 2), (281, 2), (377, 1), (393, 2), (395, 2), (429, 2)),
]
_NUMBERS = [0, 1, 2, 20, 99, 100, 101, 128, 227, 375, 376, 2**15, 2**31, 2**32 - 1, 2**63, 2**64 - 1]
_EXTREMES = [
    *(number.to_bytes(8, "little") for number in _NUMBERS),
    *(struct.pack("<d", number) for number in (np.nan, np.inf, -np.inf, -1.0, 1e308)),
]
_KINDS = ["1.2.las", "1.4.las", "1.2.laz", "1.4.laz"]


@pytest.mark.parametrize("kind", _KINDS)
def test_a_field_that_cannot_be_true_is_read_or_refused_in_a_sentence(sound_files, kind):
    path, sound = sound_files[kind]
    for place, width in _FIELDS:
        for value in _EXTREMES:
            check(path, sound[:place] + value[:width] + sound[place + width :])


@settings(max_examples=50, deadline=None)
@given(
    kind=st.sampled_from(_KINDS),
    damage=st.lists(st.tuples(st.integers(26, 700), st.binary(min_size=1, max_size=8)), max_size=3),
    cut=st.integers(0, 1500),
)
def test_a_damaged_header_is_read_or_refused_in_a_sentence(sound_files, kind, damage, cut):
    """Whatever bytes stand in it, and wherever the file ends."""
    path, sound = sound_files[kind]
    data = bytearray(sound)
    for place, value in damage:
        data[place : place + len(value)] = value
    check(path, bytes(data))
    check(path, sound[:cut])


def check(path: Path, data: bytes) -> None:
    """What is read of ``data`` fits it, or a sentence with the file's name refuses it."""
    path.write_bytes(data)
    found = outcome(path)
    if isinstance(found, str):
        assert shown(path) in found
    else:
        assert found.count > 0
        assert found.offset_to_points <= found.file_size == len(data)
        assert all(0 < scale < np.inf for scale in found.scales)


def outcome(path: Path) -> CloudHeader | str:
    """The header, or the sentence that refuses it."""
    try:
        return preflight(path)
    except InputError as refused:
        return str(refused)


@pytest.fixture(scope="module")
def sound_files(tmp_path_factory, las_file):
    """For each kind a path to write to, and the bytes of a file without damage."""
    folder, found = tmp_path_factory.mktemp("headers"), {}
    for version in ("1.2", "1.4"):
        for extension in ("las", "laz"):
            path = folder / f"{version}.{extension}"
            las_file(path, version=version, point_format=3 if version == "1.2" else 7, points=100)
            found[path.name] = path, path.read_bytes()
    return found
