"""What the door lets in, and what it refuses at once."""

from __future__ import annotations

import os
import socket
import sys
import zipfile
from pathlib import Path

import pytest
from slopewatch.engine.core.checksums import sha256
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.input_files import (
    MissingInput,
    check_input,
    check_layer,
    open_input,
    read_input,
    refuse_odd_outputs,
    refuse_unusable,
)
from slopewatch.engine.core.json_shapes import parse_json
from slopewatch.interface.input_files import FIELD_NAMES, LAYER, PART, RASTER, InputKind

posix = pytest.mark.skipif(os.name != "posix", reason="pipes, devices and links of POSIX")
TINY = InputKind(10)


def refused(path: Path, words: str, kind: InputKind = PART) -> None:
    with pytest.raises(InputError, match=words) as caught:
        check_input(path, kind)
    sentence = str(caught.value)
    assert sentence.startswith("'")
    assert sentence.endswith(".")
    assert "\n" not in sentence


def test_a_file_is_read_from_its_beginning_also_through_a_link(tmp_path):
    (tmp_path / "a").write_bytes(b"0123456789")
    (tmp_path / "b").symlink_to("a")
    assert read_input(tmp_path / "b", TINY) == b"0123456789"
    with open_input(tmp_path / "b", TINY) as stream:
        assert stream.read(3) == b"012"


def test_what_is_missing_is_also_a_file_not_found(tmp_path):
    refused(tmp_path / "none\n", "does not exist")
    refused(tmp_path / "zero\0", "does not exist")
    with pytest.raises(FileNotFoundError):
        open_input(tmp_path / "none", PART)
    assert issubclass(MissingInput, InputError)


@posix
def test_no_pipe_socket_device_folder_or_loop_is_opened(tmp_path, monkeypatch):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "loop").symlink_to("loop")
    monkeypatch.chdir(tmp_path)  # a socket's name is short
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind("socket")
        for name in ("pipe", "socket", "/dev/zero", "/dev/null"):
            refused(tmp_path / name, "pipe or a device")
    refused(tmp_path, "is a folder")
    refused(tmp_path / "loop", "leads back to itself")
    with pytest.raises(InputError, match="pipe or a device"):
        sha256(tmp_path / "pipe")


@posix
def test_a_pipe_that_takes_the_name_between_looking_and_opening_stops_nothing(tmp_path, monkeypatch):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").write_bytes(b"x")
    known = os.stat(tmp_path / "file")
    monkeypatch.setattr(os, "stat", lambda *_, **__: known)
    refused(tmp_path / "pipe", "pipe or a device")


def test_a_larger_file_than_its_kind_is_refused(tmp_path):
    (tmp_path / "a").write_bytes(b"x" * 11)
    refused(tmp_path / "a", "at most 1e-05 MB", TINY)
    with (tmp_path / "large").open("wb") as file:
        file.truncate(FIELD_NAMES.most_bytes + 1)
    refused(tmp_path / "large", "has 1.0 MB, and at most 1 MB are read", FIELD_NAMES)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a file without a size")
def test_a_file_that_grows_is_read_to_its_limit_only():
    with pytest.raises(InputError, match="at most"):
        read_input(Path("/proc/self/maps"), InputKind(100))  # states no size


def test_the_first_bytes_decide(tmp_path):
    (tmp_path / "a.tif").write_bytes(b"\x89PNG")
    refused(tmp_path / "a.tif", "is not a GeoTIFF; give one", RASTER)
    for start in (b"<OGRVRTDataSource>", b"\xef\xbb\xbf\n <OGRVRTDataSource>", b"<VRTDataset>", b"\x1f\x8b\x08"):
        (tmp_path / "a.vrt").write_bytes(start)
        refused(tmp_path / "a.vrt", "is not a GeoPackage", LAYER)


def test_text_of_a_layer_may_be_smaller_only(tmp_path):
    for name, start in {"a.geojson": b' {"type"', "a.kml": b"<?xml", "a.fgb": b"fgb"}.items():
        with (tmp_path / name).open("wb") as file:
            file.write(start)
            file.truncate(LAYER.most_text_bytes + 1)
        if name != "a.fgb":
            refused(tmp_path / name, "of text", LAYER)
        else:
            check_input(tmp_path / name, LAYER)


def test_an_archive_counts_with_its_content(tmp_path):
    with zipfile.ZipFile(tmp_path / "bomb.shz", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for part in range(3):
            archive.writestr(f"{part}.shp", bytes(100_000_000))
    assert (tmp_path / "bomb.shz").stat().st_size < 3_000_000
    refused(tmp_path / "bomb.shz", "has 300.0 MB", LAYER)
    (tmp_path / "cut.shz").write_bytes((tmp_path / "bomb.shz").read_bytes()[:1000])
    refused(tmp_path / "cut.shz", "damaged archive", LAYER)


def test_of_folders_only_a_file_geodatabase_is_let_in(tmp_path):
    (folder := tmp_path / "a.gdb").mkdir()
    with pytest.raises(InputError, match="no file geodatabase"):
        check_layer(folder)
    (folder / "a00000001.gdbtable").write_bytes(b"")
    check_layer(folder)
    (folder / "inner").mkdir()
    with pytest.raises(InputError, match="no file geodatabase"):
        refuse_unusable([("roi", folder)])


@posix
def test_of_outputs_pipes_devices_and_loops_are_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "loop").symlink_to("loop")
    refuse_odd_outputs([tmp_path / "new", tmp_path, Path(__file__), tmp_path / "none" / "new"])
    with pytest.raises(InputError, match="is a pipe or a device"):
        refuse_odd_outputs([tmp_path / "pipe"])
    with pytest.raises(InputError, match="leads back to itself"):
        refuse_odd_outputs([tmp_path / "loop" / "run.json"])


@pytest.mark.parametrize("text", ["[" + "[]," * 5_000_000 + "0]", "[" + '{"":1},' * 900_000 + "0]"])
def test_json_of_too_many_values_is_refused_before_it_is_read(text):
    with pytest.raises(ValueError, match="too many values"):
        parse_json(text.encode())
