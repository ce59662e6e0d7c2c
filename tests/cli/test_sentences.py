"""Odd clouds end with exit code 2 and a sentence that names the user's file and the remedy."""

from __future__ import annotations

import os
import struct
from pathlib import Path

import geopandas
import laspy
import numpy as np
import pytest
import shapely
from pyproj import CRS
from slopewatch.engine.core.errors import EngineError, InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.pointcloud.header import MAX_EXTRA_DIMENSIONS, preflight
from slopewatch.engine.pointcloud.pdal_program import find_pdal
from slopewatch.tests.builders.epoch_pairs import SIDE, X, Y, slope, write
from slopewatch.tests.builders.program import run


def with_dimensions(path: Path, count: int) -> Path:
    """A cloud whose extra dimensions stand in an extended record, which holds any number."""
    las = laspy.read(write(path.with_name("plain.laz"), slope(1)))
    las.add_extra_dim(laspy.ExtraBytesParams("d", "u1"))
    las.write(path)
    data = bytearray(path.read_bytes())
    offset, length = struct.unpack_from("<I", data, 96)[0], struct.unpack_from("<H", data, 105)[0]
    records = np.frombuffer(bytes(data[offset:]), np.uint8).reshape(-1, length)
    wider = np.hstack([records, np.zeros((len(records), count - 1), np.uint8)])
    place = data.index(b"LASF_Spec")
    data[place : place + 4] = b"SOME"
    struct.pack_into("<H", data, 105, length + count - 1)
    struct.pack_into("<QI", data, 235, offset + wider.size, 1)
    described = b"".join(b"\0\0\1\0" + f"d{n:03d}".encode().ljust(32, b"\0") + bytes(156) for n in range(count))
    record = struct.pack("<H16sHQ32s", 0, b"LASF_Spec", 4, len(described), b"") + described
    path.write_bytes(bytes(data[:offset]) + wider.tobytes() + record)
    return path


def refused(*words: object) -> str:
    done = run(*words)
    assert done.returncode == 2, done.stderr
    return done.stderr.strip().splitlines()[-1]


def test_more_extra_dimensions_than_a_file_takes_are_refused(tmp_path: Path) -> None:
    cloud = with_dimensions(tmp_path / "many.las", 400)
    for command in ("ground", "screen"):
        sentence = refused(command, cloud, "--output", tmp_path / "out.laz")
        assert sentence == f"Error: '{cloud}' has 400 extra dimensions; export it with at most {MAX_EXTRA_DIMENSIONS}."


def test_a_file_without_room_for_more_extra_dimensions_is_named(tmp_path: Path) -> None:
    cloud = with_dimensions(tmp_path / "full.las", MAX_EXTRA_DIMENSIONS)
    assert run("info", cloud).returncode == 0
    sentence = refused("ground", cloud, "--output", tmp_path / "out.laz")
    assert "has too many extra dimensions to add others; a file takes 341, so export it with fewer." in sentence
    assert "out.laz" not in sentence or str(cloud) in sentence
    assert not (tmp_path / "out.laz").exists()


@pytest.mark.skipif(not find_pdal().is_there, reason="PDAL is not here")
def test_an_extra_dimension_named_x_is_no_coordinate(tmp_path: Path) -> None:
    las = laspy.read(write(tmp_path / "plain.laz", slope(1)))
    las.add_extra_dim(laspy.ExtraBytesParams("Q", "f8"))
    path = tmp_path / "named.las"
    las.write(path)
    data = path.read_bytes()
    place = data.index(b"Q" + bytes(31), data.index(b"LASF_Spec"))
    path.write_bytes(data[:place] + b"X" + data[place + 1 :])
    done = run("ground", path, "--roi", _region(tmp_path), "--output", tmp_path / "out.laz")
    assert done.returncode == 0, done.stderr


def test_a_cloud_over_thousands_of_kilometres_is_not_screened(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    xyz = np.column_stack([rng.uniform(2e5, 2.2e6, 4000), rng.uniform(2e6, 4e6, 4000), rng.uniform(0, 50, 4000)])
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, np.floor(xyz.min(axis=0))
    header.add_crs(CRS.from_epsg(32651))
    las = laspy.LasData(header)
    las.xyz = xyz
    las.write(tmp_path / "far.laz")
    sentence = refused("screen", tmp_path / "far.laz", "--ground", "as_is", "--output", tmp_path / "out.laz")
    assert "far.laz" in sentence
    assert sentence.endswith("km, too much to screen at once; cut it with --roi.")


@pytest.mark.parametrize("damage", ["garbage", "unknown"])
def test_a_reference_system_that_cannot_be_read_can_be_given(tmp_path: Path, damage: str) -> None:
    cloud = write(tmp_path / "cloud.laz", slope(1))
    wkt = preflight(cloud).wkt
    assert wkt is not None
    text = {"garbage": b"PROJCRS[broken,,,".ljust(len(wkt), b"x"), "unknown": b'NOTHING["a"]'.ljust(len(wkt), b"\0")}
    cloud.write_bytes(cloud.read_bytes().replace(wkt, text[damage]))
    words = ("ground", cloud, "--roi", _region(tmp_path), "--output", tmp_path / "out.laz")
    assert refused(*words) == (
        f"Error: '{cloud}' declares a reference system in WKT that cannot be read; "
        "give a projected one with --crs EPSG:n."
    )
    done = run(*words, "--crs", "EPSG:32651")
    assert done.returncode == 0, done.stderr
    assert 0 < preflight(tmp_path / "out.laz").count < 6000


def _region(folder: Path) -> Path:
    area = shapely.box(X + 1, Y + 1, X + SIDE - 3, Y + SIDE - 3)
    geopandas.GeoDataFrame(geometry=[area], crs=32651).to_file(folder / "roi.geojson")
    return folder / "roi.geojson"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("/a/.slopewatch-part-x1_/clouds/b.laz failed", "/a/clouds/b.laz failed"),
        ("'/a/.out.b.123.part.laz' is odd", "'/a/out.b.laz' is odd"),
        ("/a/.slopewatch-part-q/.zones.9.part.gpkg", "/a/zones.gpkg"),
        ("/a/.hidden/b.part.laz", "/a/.hidden/b.part.laz"),
    ],
)
def test_unfinished_files_have_the_names_that_users_know(text: str, shown: str) -> None:
    for kind in (InputError, EngineError):
        assert str(kind(text)) == shown
    progress = Progress()
    progress.warning(text)
    assert progress.warnings == [shown]


def test_an_environment_variable_overrules_no_option(tmp_path: Path) -> None:
    env = {**os.environ, "SLOPEWATCH_PDAL": str(tmp_path / "of the variable"), "SLOPEWATCH_LANGUAGE": "zh-Hans"}
    cloud = write(tmp_path / "a.laz", slope(1))
    option = tmp_path / "of the option"
    words = ("ground", cloud, "--output", tmp_path / "out.laz", "--pdal", option, "--language", "en")
    done = run(*words, env=env)
    assert done.returncode == 2
    assert f"PDAL at '{option}' (setting) does not start" in done.stderr
    assert "没有" not in run(*words[:-1], "auto", env={**env, "LC_ALL": "C", "LANG": "C"}).stderr
