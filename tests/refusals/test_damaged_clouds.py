"""Clouds that were cut short or changed inside: refused in one sentence, fast and in little memory."""

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
from slopewatch.engine.pointcloud.header import preflight
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.tests.builders.damaged_clouds import UTM, patched, refused


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
