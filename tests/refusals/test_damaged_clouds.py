"""Damaged and odd clouds: each is refused in one sentence, or read and its fault said, fast and in little memory."""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
import time
from pathlib import Path

import laspy
import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.pointcloud.header import EmptyCloud, preflight
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.engine.pointcloud.summary import describe_cloud
from slopewatch.engine.pointcloud.writing import copy_with
from slopewatch.interface.parameters import InputParameters

UTM = InputParameters(crs="EPSG:32651")
SCALE, OFFSET, BOX = 131, 155, 179


def refused(path: Path, *words: str) -> str:
    """The one sentence with which the cloud is refused; it names the file and holds ``words``."""
    with pytest.raises(InputError) as caught:
        read_cloud(path, UTM)
    sentence = str(caught.value)
    assert "\n" not in sentence
    assert path.name in sentence
    assert sentence.endswith(".")
    for word in words:
        assert word in sentence, sentence
    return sentence


def patched(path: Path, place: int, layout: str, *values: object) -> Path:
    data = bytearray(path.read_bytes())
    struct.pack_into("<" + layout, data, place, *values)
    path.write_bytes(data)
    return path


@pytest.fixture
def las(tmp_path, las_file) -> Path:
    return las_file(tmp_path / "a.las")


@pytest.fixture
def laz(tmp_path, las_file) -> Path:
    return las_file(tmp_path / "a.laz", points=60_000)


def test_missing_and_folder(tmp_path):
    refused(tmp_path / "none.las", "does not exist")
    (tmp_path / "folder.las").mkdir()
    refused(tmp_path / "folder.las", "folder")


def test_a_name_that_no_file_can_have(tmp_path):
    refused(tmp_path / ("n" * 300 + ".las"), "cannot be read")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no named pipes")
def test_a_pipe_is_refused_without_waiting_for_it(tmp_path):
    os.mkfifo(tmp_path / "pipe.las")
    refused(tmp_path / "pipe.las", "not a regular file")


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root reads everything")
def test_a_file_without_permission(las):
    las.chmod(0)
    refused(las, "permissions")


def test_01_zero_bytes(tmp_path):
    (tmp_path / "a.las").touch()
    refused(tmp_path / "a.las", "0 bytes")


@pytest.mark.parametrize("content", [b"hello", b"\x89PNG" + bytes(500), b"LASX" + bytes(500), b"PK\3\4" + bytes(300)])
def test_02_wrong_signature(tmp_path, content):
    (tmp_path / "a.laz").write_bytes(content)
    refused(tmp_path / "a.laz", "not a LAS or LAZ file")


def test_02_header_cut_short(las):
    las.write_bytes(las.read_bytes()[:200])
    refused(las, "cut short")


def test_03_truncated_las_says_both_counts(las):
    las.write_bytes(las.read_bytes()[: -500 * 36 - 5])
    refused(las, "holds 1499 of the 2000 points")


@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.99, 0.9999])
def test_04_truncated_laz(laz, share):
    data = laz.read_bytes()
    laz.write_bytes(data[: int(share * len(data))])
    refused(laz, "copy")


def test_04_truncated_laz_of_old_point_format(tmp_path, las_file):
    path = las_file(tmp_path / "a.laz", point_format=3, version="1.2", points=60_000)
    data = path.read_bytes()
    for keep in (len(data) - 1, len(data) - 20, len(data) // 2):
        path.write_bytes(data[:keep])
        refused(path, "copy")


def test_05_damage_inside_a_layer_is_found_by_where_the_points_go(laz):
    """A changed byte in the first chunk's heights: all sizes hold, and most often the decoder finds no fault either."""
    good = laz.read_bytes()
    start = preflight(laz).offset_to_points + 8 + 36
    plane, layer = struct.unpack_from("<2I", good, start + 4)
    begin = start + 4 + 4 * 10 + plane  # point count, then the sizes of nine layers of the point and one of its colours
    sentences = []
    for share in np.linspace(0.1, 0.9, 9):
        data = bytearray(good)
        data[begin + int(share * layer)] ^= 0x10
        laz.write_bytes(data)
        sentences.append(refused(laz, "damaged"))
    assert sum("of its 60000 points decode to places outside" in sentence for sentence in sentences) >= 5


def test_05_layer_sizes_that_cannot_be_true_are_never_allocated(laz):
    """Left to the decompressor, each takes 4 GB and more than ten seconds."""
    started = time.process_time()
    start = preflight(laz).offset_to_points + 8 + 36 + 4
    for layer in range(10):
        data = laz.read_bytes()
        patched(laz, start + 4 * layer, "I", 0xFFFFFFF0)
        refused(laz, "damaged inside its compressed points")
        laz.write_bytes(data)
    assert time.process_time() - started < 5


def test_05_chunk_tables_that_cannot_be_true(laz):
    data = laz.read_bytes()
    table = struct.unpack_from("<q", data, preflight(laz).offset_to_points)[0]
    for place, layout, value in (
        (table, "I", 7),
        (table + 4, "I", 2**31),
        (table + 4, "I", 3),
        (preflight(laz).offset_to_points, "q", len(data) + 10),
        (preflight(laz).offset_to_points, "q", 3),
        (preflight(laz).offset_to_points, "q", -1),
    ):
        laz.write_bytes(data)
        refused(patched(laz, place, layout, value), "chunk")


def test_05_laszip_records_that_cannot_be_true(laz):
    data = laz.read_bytes()
    start = data.index(b"laszip encoded") + 52
    for place, layout, value in (
        (start, "H", 9),  # compressor
        (start + 12, "I", 0),  # chunk size
        (start + 12, "I", 10**9),
        (start + 32, "H", 500),  # number of items
        (start + 34, "H", 6),  # kind of the first item
        (start + 36, "H", 60000),  # its size
    ):
        laz.write_bytes(data)
        refused(patched(laz, place, layout, value))
    laz.write_bytes(data.replace(b"laszip encoded", b"laszip removed"))
    refused(laz, "LASzip record")


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


def test_43_a_stale_index_beside_a_laz_is_left_alone(laz):
    truth = laspy.read(laz).xyz
    laz.with_suffix(".lax").write_bytes(b"LASX" + bytes(100))
    cloud = read_cloud(laz)
    assert np.array_equal(cloud.xyz, truth)
    copy_with(laz, laz.with_name("b.laz"))
    assert np.array_equal(laspy.read(laz.with_name("b.laz")).xyz, truth)


def test_a_panic_of_the_decompressor_is_an_input_error(laz, monkeypatch):
    """A panic in compiled Rust code arrives as an exception that is not an Exception."""
    import lazrs

    class PanicException(BaseException):
        pass

    def panic(*_):
        raise PanicException("index out of bounds")

    monkeypatch.setattr(lazrs, "decompress_points_with_chunk_table", panic)
    refused(laz, "damaged")


def test_a_file_that_shrinks_while_it_is_read(las, monkeypatch):
    header = preflight(las)
    las.write_bytes(las.read_bytes()[:-1000])
    monkeypatch.setattr("slopewatch.engine.pointcloud.reading.preflight", lambda _: header)
    refused(las, "shorter")


def test_more_points_than_memory(las, monkeypatch):
    def no_memory(*_, **__):
        raise MemoryError

    monkeypatch.setattr("slopewatch.engine.pointcloud.reading.np.empty", no_memory)
    refused(las, "2000 points", "clip")


@pytest.mark.parametrize(
    ("name", "outcome"),
    [
        ("1.2-empty-geotiff-vlrs.las", 43),
        ("bad-geotiff-keys.las", 10),
        ("bad_vlr_count.las", "number 3 of 3"),
        ("garbage_nVariableLength.las", "1069128089 variable length records"),
        ("gps-time-nan.las", 1),
        ("lots_of_vlr.las", 1),
        ("no-points.las", "no points"),
        ("single_point.laz", 1),
        ("spurious.las", 1065),
    ],
)
def test_samples_of_damaged_files(shared_data, name, outcome):
    path = shared_data / "bad_las" / name
    started = time.process_time()
    if isinstance(outcome, str):
        refused(path, outcome)
    else:
        cloud = read_cloud(path, UTM, colours=True)
        assert np.array_equal(cloud.xyz, laspy.read(path).xyz)
        assert len(cloud) == outcome
    assert time.process_time() - started < 2
    if name == "spurious.las":
        assert any("1 of its 1065 points outside" in note for note in cloud.notes)


@pytest.mark.skipif(sys.platform != "linux", reason="limits the address space as Linux does")
@pytest.mark.parametrize(
    ("name", "options", "cases"),
    [
        ("new.laz", {"point_format": 7, "points": 50_500}, 210),
        ("old.laz", {"point_format": 3, "version": "1.2", "points": 50_500}, 105),
        ("new.las", {"point_format": 7}, 700),
        ("old.las", {"point_format": 1, "version": "1.2"}, 700),
    ],
)
def test_random_damage_is_refused_or_said(tmp_path, las_file, name, options, cases):
    source = las_file(tmp_path / name, **options)
    program = [sys.executable, Path(__file__).parents[1] / "builders" / "fuzz_clouds.py"]
    arguments = [source, tmp_path / f"fuzzed{source.suffix}", cases, 1]
    done = subprocess.run([*program, *map(str, arguments)], capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    outcomes = result["outcomes"]
    assert result["slowest"] < 2
    allowed = {"refused", "as before", "said", "few moved unnoticed", "many moved unnoticed"}
    assert {outcome for counts in outcomes.values() for outcome in counts} <= allowed, result["odd"]
    assert set(outcomes["truncated"]) == {"refused"}
    # The last bits of a compressed stream, a plain coordinate or a low bit of a scale leave no trace.
    assert sum(counts.get("many moved unnoticed", 0) for counts in outcomes.values()) <= 2, result["odd"]
