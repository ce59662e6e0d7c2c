"""Clouds written as COPC, read by laspy's reader of COPC and by our own."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.pointcloud import copc_writing
from slopewatch.engine.pointcloud.copc import chosen_chunks
from slopewatch.engine.pointcloud.header import preflight
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.interface.parameters import InputParameters


def cloud(path: Path, count: int, point_format: int = 6, *, crs: bool = True) -> laspy.LasData:
    chance = np.random.default_rng(7)
    header = laspy.LasHeader(point_format=point_format, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [500_000.0, 3_000_000.0, 0.0]
    if crs:
        # as text in every format, as SlopeWatch writes it
        wkt = CRS.from_epsg(32651).to_wkt("WKT1_GDAL").encode() + b"\0"
        header.vlrs.append(laspy.VLR("LASF_Projection", 2112, "", wkt))
        header.global_encoding.wkt = True
    header.add_extra_dim(laspy.ExtraBytesParams("slopewatch_prob", np.float32))
    las = laspy.LasData(header)
    xy = chance.uniform(0, 40, (count, 2))
    las.xyz = np.column_stack([xy, 0.5 * xy[:, 0] + chance.normal(0, 0.1, count)]) + header.offsets
    las.return_number[:], las.number_of_returns[:] = 1, 1
    las.classification = chance.choice([2, 5], count).astype(np.uint8)
    las.gps_time = np.sort(chance.uniform(1e5, 2e5, count))
    las.slopewatch_prob = chance.random(count).astype(np.float32)
    las.write(path)
    return las


@pytest.mark.parametrize("point_format", [1, 3, 6, 7])
def test_every_point_comes_back_with_all_its_dimensions(
    point_format: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(copc_writing, "_WHOLE_NODE", 500)
    monkeypatch.setattr(copc_writing, "_CELLS", 16)
    source = cloud(tmp_path / "a.laz", 6000, point_format)
    nodes = copc_writing.write_copc(tmp_path / "a.laz", tmp_path / "a.copc.laz")
    assert nodes > 9
    with laspy.CopcReader.open(tmp_path / "a.copc.laz") as reader:
        found = reader.query()
        assert reader.header.parse_crs() == CRS.from_epsg(32651)
        coarse = reader.query(level=0)
    assert 0 < len(coarse) < 1000
    orders = [np.lexsort((p.X, p.Y, p.Z, np.asarray(p.gps_time))) for p in (source, found)]
    for name in ("X", "Y", "Z", "classification", "gps_time", "slopewatch_prob", "return_number"):
        ours, theirs = (np.asarray(p[name])[order] for p, order in zip((source, found), orders, strict=True))
        assert np.array_equal(ours, theirs), name


def test_a_window_of_it_has_the_points_of_that_window(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(copc_writing, "_WHOLE_NODE", 500)
    monkeypatch.setattr(copc_writing, "_CELLS", 16)
    source = cloud(tmp_path / "a.laz", 6000)
    copc_writing.write_copc(tmp_path / "a.laz", tmp_path / "a.copc.laz")
    low, high = (np.array([x, x - 500_000 + 3_000_000]) for x in (500_010.0, 500_015.0))
    inside = ((np.asarray(source.xyz)[:, :2] >= low) & (np.asarray(source.xyz)[:, :2] <= high)).all(axis=1)
    with laspy.CopcReader.open(tmp_path / "a.copc.laz") as reader:
        assert len(reader.query(laspy.Bounds(mins=low, maxs=high))) == inside.sum() > 50
    header = preflight(tmp_path / "a.copc.laz")
    near = chosen_chunks(header, (low, high))
    assert near is not None
    assert inside.sum() <= near.points < 0.8 * 6000


def test_our_own_reader_takes_it_and_it_is_the_same_each_time(tmp_path: Path) -> None:
    source = cloud(tmp_path / "a.laz", 900)
    for name in ("one", "two"):
        copc_writing.write_copc(tmp_path / "a.laz", tmp_path / f"{name}.copc.laz")
    assert (tmp_path / "one.copc.laz").read_bytes() == (tmp_path / "two.copc.laz").read_bytes()
    read = read_cloud(tmp_path / "one.copc.laz", InputParameters())
    assert np.sort(read.xyz[:, 2]) == pytest.approx(np.sort(np.asarray(source.xyz)[:, 2]), abs=1e-6)


def test_what_cannot_be_copc_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cloud(tmp_path / "bare.laz", 50, crs=False)
    with pytest.raises(InputError, match="states no reference system as text"):
        copc_writing.write_copc(tmp_path / "bare.laz", tmp_path / "out.copc.laz")
    cloud(tmp_path / "a.laz", 50)
    monkeypatch.setattr(copc_writing, "machine_memory", lambda: 1000)
    with pytest.raises(InputError, match="has 50 points, too many"):
        copc_writing.write_copc(tmp_path / "a.laz", tmp_path / "out.copc.laz")
    assert not (tmp_path / "out.copc.laz").exists()
