"""Clouds that are written, read again by laspy and by the bytes of the specification."""

from __future__ import annotations

import struct
from dataclasses import replace
from datetime import date
from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS
from slopewatch.engine.core.errors import EngineError, InputError
from slopewatch.engine.core.version import VERSION
from slopewatch.engine.pointcloud import writing
from slopewatch.engine.pointcloud.cloud import PointCloud
from slopewatch.engine.pointcloud.header import preflight
from slopewatch.engine.pointcloud.reading import read_cloud, read_dimension
from slopewatch.engine.pointcloud.records import read_records
from slopewatch.engine.pointcloud.writing import Copy, copies, copy_with, wkt_of, write_cloud
from slopewatch.interface.parameters import InputParameters


def same_dimensions(a: laspy.LasData, b: laspy.LasData, keep=slice(None)) -> list[str]:
    """Dimensions of ``a`` that ``b`` has not or has otherwise."""
    held = set(b.point_format.dimension_names)
    return [
        name
        for name in a.point_format.dimension_names
        if name not in held or not np.array_equal(np.asarray(a[name])[keep], np.asarray(b[name]))
    ]


def extra_dimensions(las: laspy.LasData) -> None:
    """Three described dimensions of different types."""
    n = len(las.points)
    for name, kind in (("truth", "u1"), ("range", "f8"), ("normal", "3f4")):
        las.add_extra_dim(laspy.ExtraBytesParams(name, kind))
    las.truth, las.range = np.arange(n) % 3, np.linspace(5, 9, n)
    las.normal = np.arange(3 * n).reshape(n, 3).astype(np.float32)


@pytest.mark.parametrize("colours", [True, False])
def test_a_written_cloud_is_read_by_laspy(tmp_path, las_file, colours):
    cloud = read_cloud(las_file(tmp_path / "a.laz", crs="EPSG:32651+5773"), colours=colours)
    labels = np.arange(len(cloud)) % 3
    path = tmp_path / "b.laz"
    share = np.linspace(0, 1, len(cloud), dtype=np.float32)
    dimensions = {"slopewatch_class": labels.astype(np.uint8), "slopewatch_prob": share}
    write_cloud(path, cloud, dimensions=dimensions, classification=labels + 200)
    las = laspy.read(path)
    assert (las.header.version.minor, las.point_format.id) == (4, 7 if colours else 6)
    assert np.abs(las.xyz - cloud.xyz).max() <= 0.0005 + 1e-9
    assert tuple(las.header.scales) == (0.001,) * 3
    assert np.array_equal(las.classification, labels + 200)
    assert np.array_equal(las.slopewatch_class, labels)
    assert np.array_equal(las.slopewatch_prob, share)
    assert las.header.global_encoding.wkt
    assert las.header.parse_crs().equals(cloud.crs, ignore_axis_order=True)
    assert las.header.number_of_points_by_return[0] == len(cloud)
    assert np.allclose(las.header.mins, las.xyz.min(axis=0), rtol=0, atol=1e-9)
    assert np.allclose(las.header.maxs, las.xyz.max(axis=0), rtol=0, atol=1e-9)
    if colours:
        assert np.array_equal(np.column_stack([las.red, las.green, las.blue]) // 256, cloud.rgb)
        assert np.array_equal(las.intensity, cloud.intensity)
    again = read_cloud(path, colours=colours)
    assert again.notes == ()
    assert np.array_equal(again.classification, labels + 200)
    if colours:
        assert np.array_equal(again.rgb, cloud.rgb)


@pytest.mark.parametrize("extension", ["las", "laz"])
@pytest.mark.parametrize(("point_format", "version"), [(1, "1.2"), (3, "1.2"), (3, "1.4"), (6, "1.4"), (8, "1.4")])
def test_a_copy_keeps_every_dimension(tmp_path, las_file, point_format, version, extension):
    source = las_file(
        tmp_path / f"a.{extension}", point_format=point_format, version=version, change=extra_dimensions, scale=0.01
    )
    copy_with(source, tmp_path / "b.laz")
    before, after = laspy.read(source), laspy.read(tmp_path / "b.laz")
    assert same_dimensions(before, after) == []
    assert np.array_equal(after.xyz, before.xyz)
    assert after.header.parse_crs().to_epsg() == 32651
    assert np.array_equal(after.header.number_of_points_by_return[:3], before.header.number_of_points_by_return[:3])


def test_a_copy_moves_selects_and_adds(tmp_path, las_file):
    source = las_file(tmp_path / "a.laz", change=extra_dimensions)
    cloud = read_cloud(source)
    keep = np.zeros(len(cloud), bool)
    keep[5::3] = True
    xyz = cloud.xyz[keep] + [1000.4, -0.25, 7.0]
    ids = np.arange(keep.sum(), dtype=np.int32)
    copy_with(
        source,
        tmp_path / "b.laz",
        keep=keep,
        xyz=xyz,
        dimensions={"zone": ids, "truth": ids.astype("f8")},
        classification=np.full(keep.sum(), 2),
    )
    before, after = laspy.read(source), laspy.read(tmp_path / "b.laz")
    assert np.abs(after.xyz - xyz).max() <= 0.0005 + 1e-9
    assert np.array_equal(after.zone, ids)
    assert np.array_equal(after.truth, ids)  # replaced, with its new type
    assert (after.classification == 2).all()
    assert set(same_dimensions(before, after, keep)) == {"X", "Y", "Z", "classification", "truth"}


def test_several_copies_are_those_made_one_by_one(tmp_path, las_file, monkeypatch):
    source = las_file(tmp_path / "a.laz", change=extra_dimensions)
    keep = np.random.default_rng(0).random(2000) < 0.3
    zone = np.arange(keep.sum(), dtype=np.uint16)
    changes = ({}, {"keep": keep, "dimensions": {"zone": zone}}, {"classification": np.full(2000, 6)})
    for number, change in enumerate(changes):
        copy_with(source, tmp_path / f"one{number}.laz", **change)
    read = []
    monkeypatch.setattr(writing, "read_records", lambda header: read.append(header) or read_records(header))
    copies(source, [Copy(tmp_path / f"all{number}.laz", **change) for number, change in enumerate(changes)])
    assert len(read) == 1
    for number in range(len(changes)):
        assert (tmp_path / f"all{number}.laz").read_bytes() == (tmp_path / f"one{number}.laz").read_bytes()


def test_one_copy_that_cannot_be_made_leaves_none(tmp_path, las_file):
    source = las_file(tmp_path / "a.laz")
    with pytest.raises(EngineError, match="keep has 9 values"):
        copies(source, [Copy(tmp_path / "b.laz"), Copy(tmp_path / "c.laz", keep=np.ones(9, bool))])
    assert [p.name for p in tmp_path.iterdir()] == ["a.laz"]


def test_a_copy_named_las_is_not_compressed(tmp_path, las_file):
    source = las_file(tmp_path / "a.laz", change=extra_dimensions)
    copy_with(source, tmp_path / "b.las")
    assert not preflight(tmp_path / "b.las").compressed
    assert same_dimensions(laspy.read(source), laspy.read(tmp_path / "b.las")) == []


def test_a_copy_of_feet_is_metres_with_the_same_integers(shared_data, tmp_path):
    source = shared_data / "real" / "autzen_bmx" / "autzen-bmx-2010.las"
    copy_with(source, tmp_path / "b.laz")
    before, after = laspy.read(source), laspy.read(tmp_path / "b.laz")
    assert same_dimensions(before, after) == []
    assert np.allclose(after.z, np.asarray(before.z) * 0.3048006096, rtol=1e-10)
    assert np.array_equal(after.x, before.x)
    assert after.header.parse_crs().sub_crs_list[1].to_epsg() == 5703
    assert np.array_equal(read_cloud(tmp_path / "b.laz").xyz, read_cloud(source).xyz)


def test_a_copy_of_a_real_copc_is_a_plain_laz(shared_data, tmp_path):
    source = shared_data / "real" / "lone-star.copc.laz"
    copy_with(source, tmp_path / "b.laz", InputParameters(crs="EPSG:32613"))
    assert not preflight(tmp_path / "b.laz").copc
    before, after = laspy.read(source), laspy.read(tmp_path / "b.laz")
    assert same_dimensions(before, after) == []
    assert after.header.parse_crs().to_epsg() == 32613


def test_overlap_and_withheld_flags_survive(tmp_path, las_file):
    def flag(las):
        las.withheld, las.synthetic = np.arange(len(las.points)) % 2, np.arange(len(las.points)) % 3 == 0

    for point_format, version in ((3, "1.2"), (7, "1.4")):
        source = las_file(tmp_path / "a.las", point_format=point_format, version=version, change=flag)
        copy_with(source, tmp_path / "b.laz", classification=np.full(2000, 9))
        before, after = laspy.read(source), laspy.read(tmp_path / "b.laz")
        assert same_dimensions(before, after) == ["classification"]
        assert (after.classification == 9).all()


def test_undescribed_extra_bytes_are_carried(tmp_path, las_file):
    """Records may be longer than the format's without a word why; the bytes stay."""
    source = las_file(tmp_path / "a.las", change=extra_dimensions, points=40)
    data = source.read_bytes().replace(b"LASF_Spec\0\0\0\0\0\0\0\x04\0", b"LASF_Nope\0\0\0\0\0\0\0\x04\0")
    source.write_bytes(data)
    copy_with(source, tmp_path / "b.laz", dimensions={"zone": np.arange(40, dtype=np.int32)})
    size = 1 + 8 + 12
    assert laspy.read(tmp_path / "b.laz").point_format.size == 36 + size + 4
    original = np.frombuffer(data[-40 * (36 + size) :], f"V{36 + size}").view(np.uint8).reshape(40, -1)
    (records,) = read_records(preflight(tmp_path / "b.laz"))
    extra = records["extra:undescribed"].copy().view(np.uint8).reshape(40, size)
    assert np.array_equal(extra, original[:, 36:])
    assert np.array_equal(laspy.read(tmp_path / "b.laz").zone, np.arange(40))


@pytest.mark.parametrize("fault", [b"\x00\x63", b"\x0b\x00"])
def test_descriptions_that_do_not_fit_the_records_are_bytes(tmp_path, las_file, fault):
    """The second of three dimensions has another type: 99 raw bytes, or two of one byte for what were eight."""
    source = las_file(tmp_path / "a.las", change=extra_dimensions, points=40)
    data = bytearray(source.read_bytes())
    place = data.index(b"range\0") - 2
    data[place : place + 2] = fault
    source.write_bytes(data)
    copy_with(source, tmp_path / "b.laz")
    before, after = (next(iter(read_records(preflight(tmp_path / name)))).array for name in ("a.las", "b.laz"))
    assert before.tobytes() == after.tobytes() == data[-40 * (36 + 21) :]
    assert np.array_equal(read_dimension(tmp_path / "b.laz", "truth"), np.arange(40) % 3)


def test_far_coordinates_get_an_offset_of_their_own(tmp_path, las_file):
    cloud = read_cloud(las_file(tmp_path / "a.laz"))
    far = replace(cloud, xyz=cloud.xyz + [9e6, -2e7, 0])
    write_cloud(tmp_path / "b.laz", far)
    assert np.abs(laspy.read(tmp_path / "b.laz").xyz - far.xyz).max() <= 0.0005 + 1e-8


def test_what_32_bits_do_not_hold_is_refused(tmp_path, las_file):
    cloud = read_cloud(las_file(tmp_path / "a.laz"))
    xyz = cloud.xyz.copy()
    xyz[7, 0] += 5e6
    with pytest.raises(InputError, match=r"b\.laz.* in x .*outliers"):
        write_cloud(tmp_path / "b.laz", replace(cloud, xyz=xyz))
    assert [p.name for p in tmp_path.iterdir()] == ["a.laz"]


def test_a_fine_scale_gives_way_where_the_points_are_spread(tmp_path, las_file):
    """A scale of 1e-7 m holds 429 m; the moved points need more and get millimetres."""
    source = las_file(tmp_path / "a.las", scale=1e-7)
    cloud = read_cloud(source)
    xyz = cloud.xyz.copy()
    xyz[0] += 2000
    copy_with(source, tmp_path / "b.laz", xyz=xyz)
    las = laspy.read(tmp_path / "b.laz")
    assert np.abs(las.xyz - xyz).max() <= 0.0005 + 1e-9


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_coordinates_that_are_not_finite_are_never_written(tmp_path, las_file, bad):
    cloud = read_cloud(las_file(tmp_path / "a.laz"))
    xyz = cloud.xyz.copy()
    xyz[3, 2] = bad
    with pytest.raises(EngineError, match="finite"):
        write_cloud(tmp_path / "b.laz", replace(cloud, xyz=xyz))
    assert not (tmp_path / "b.laz").exists()


def test_arrays_that_do_not_fit_are_refused(tmp_path, las_file):
    source = las_file(tmp_path / "a.laz", points=10)
    cloud = read_cloud(source)
    target = tmp_path / "b.laz"
    for wrong in (
        lambda: write_cloud(target, cloud, dimensions={"a": np.zeros(9)}),
        lambda: write_cloud(target, cloud, dimensions={"a" * 33: np.zeros(10)}),
        lambda: write_cloud(target, cloud, dimensions={"a": np.zeros(10, complex)}),
        lambda: write_cloud(target, cloud, classification=np.zeros(9, int)),
        lambda: write_cloud(target, cloud, classification=np.full(10, 256)),
        lambda: copy_with(source, target, xyz=cloud.xyz[:9]),
        lambda: copy_with(source, target, keep=np.ones(9, bool)),
    ):
        with pytest.raises(EngineError):
            wrong()
    assert not target.exists()


def test_nothing_to_write_is_an_input_error(tmp_path, las_file):
    source = las_file(tmp_path / "a.laz")
    with pytest.raises(InputError, match="no points"):
        copy_with(source, tmp_path / "b.laz", keep=np.zeros(2000, bool))
    assert not (tmp_path / "b.laz").exists()


def test_extra_dimensions_are_described_in_a_copy_as_in_its_source(tmp_path, las_file):
    """All 192 bytes, with no-data value, range, scale and a name that is not UTF-8."""
    source = las_file(tmp_path / "a.las", change=extra_dimensions, points=40)
    data = bytearray(source.read_bytes())
    start = data.index(b"truth\0") - 4
    struct.pack_into("<BB32s4s3Q3Q3Q", data, start + 2, 1, 7, b"H\xf6he", b"", 9, 0, 0, 1, 0, 0, 2, 0, 0)
    source.write_bytes(data)
    copy_with(source, tmp_path / "b.laz", dimensions={"zone": np.arange(40, dtype=np.int32)})
    described = preflight(tmp_path / "b.laz").vlrs["LASF_Spec", 4]
    assert described[:576] == data[start : start + 576]
    assert described[576:612] == struct.pack("<HBB32s", 0, 6, 0, b"zone")
    assert described[612:] == bytes(156)


def test_a_dimension_named_as_a_field_is_carried(tmp_path, las_file):
    source = las_file(tmp_path / "a.las", change=extra_dimensions, points=40)
    data = source.read_bytes()
    place = data.index(b"truth\0")
    source.write_bytes(data[:place] + b"gps_time".ljust(32, b"\0") + data[place + 32 :])
    copy_with(source, tmp_path / "b.laz")
    assert np.array_equal(read_dimension(tmp_path / "b.laz", "gps_time"), np.arange(40) % 3)
    (records,) = read_records(preflight(tmp_path / "b.laz"))
    assert np.all(np.diff(records["gps_time"]) >= 0)


def header_fields(path: Path) -> dict[str, object]:
    """Fields of a LAS 1.4 header by the specification's table 3."""
    data = path.read_bytes()
    names = "signature", "source", "encoding", "guid", "version", "system", "software", "day", "year"
    return dict(zip(names, struct.unpack_from("<4sHH16s2s32s32sHH", data), strict=True)) | {
        "legacy": struct.unpack_from("<I5I", data, 107),
        "scales": struct.unpack_from("<3d", data, 131),
        "evlrs": struct.unpack_from("<QI", data, 235),
        "counts": struct.unpack_from("<Q15Q", data, 247),
    }


def test_the_header_of_a_new_file(tmp_path, las_file):
    cloud = read_cloud(las_file(tmp_path / "a.laz", points=70))
    write_cloud(tmp_path / "b.laz", cloud)
    assert header_fields(tmp_path / "b.laz") == {
        "signature": b"LASF",
        "source": 0,
        "encoding": 17,  # WKT, standard GPS times
        "guid": bytes(16),
        "version": b"\1\4",
        "system": b"SlopeWatch".ljust(32, b"\0"),
        "software": f"SlopeWatch {VERSION}".encode().ljust(32, b"\0"),
        "day": 0,
        "year": 0,
        "legacy": (0,) * 6,
        "scales": (0.001,) * 3,
        "evlrs": (0, 0),
        "counts": (70, 70, *(0,) * 14),
    }


@pytest.mark.parametrize(("point_format", "version"), [(3, "1.2"), (6, "1.4")])
def test_a_copy_keeps_day_and_source_of_its_file(tmp_path, las_file, point_format, version):
    def dated(las):
        las.header.creation_date, las.header.file_source_id = date(2021, 12, 31), 77
        las.return_number[:] = np.repeat([1, 2, 3], [1000, 600, 400])

    source = las_file(tmp_path / "a.las", point_format=point_format, version=version, change=dated)
    copy_with(source, tmp_path / "b.laz")
    fields = header_fields(tmp_path / "b.laz")
    assert (fields["day"], fields["year"], fields["source"]) == (365, 2021, 77)
    assert fields["encoding"] == 16  # the source's GPS times are seconds of the week
    assert fields["counts"] == (2000, 1000, 600, 400, *(0,) * 12)


@pytest.mark.parametrize("point_format", [4, 5, 9, 10])
def test_waveform_packets_are_carried(tmp_path, las_file, point_format):
    def waves(las):
        las.wavepacket_index, las.wavepacket_offset = np.arange(2000) % 200, np.arange(2000) * 10**9
        las.x_t = np.linspace(-1, 1, 2000)

    source = las_file(tmp_path / "a.las", point_format=point_format, change=waves)
    copy_with(source, tmp_path / "b.laz")
    assert same_dimensions(laspy.read(source), laspy.read(tmp_path / "b.laz")) == []


def test_the_same_cloud_gives_the_same_bytes(tmp_path, las_file):
    source = las_file(tmp_path / "a.laz", points=60_000)
    cloud = read_cloud(source, colours=True)
    for name in ("b.laz", "c.laz"):
        write_cloud(tmp_path / name, cloud)
    assert (tmp_path / "b.laz").read_bytes() == (tmp_path / "c.laz").read_bytes()


@pytest.mark.parametrize(
    "text", ["EPSG:32651", "EPSG:2154+5720", "EPSG:2193+7839", "EPSG:31467", "EPSG:3857", "EPSG:5514"]
)
def test_the_written_reference_system_is_the_same(text):
    assert CRS.from_wkt(wkt_of(CRS(text))).equals(CRS(text), ignore_axis_order=True)


def test_single_precision_input_is_no_trouble(tmp_path):
    xyz = np.array([[500_000.0, 3_500_000.0, 1.0], [500_001.0, 3_500_001.0, 2.0]])
    write_cloud(tmp_path / "b.laz", PointCloud(xyz.astype(np.float32), CRS(32651), tmp_path / "none"))
    assert np.allclose(laspy.read(tmp_path / "b.laz").xyz, xyz, atol=0.001)
