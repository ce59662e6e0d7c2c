"""GeoTIFF keys as GDAL writes them: what is read from them must be what was written."""

from __future__ import annotations

import struct
import warnings

import pytest
import rasterio
from pyproj import CRS
from rasterio.io import MemoryFile
from slopewatch.engine.pointcloud.declared_crs import declared_crs
from slopewatch.engine.pointcloud.geotiff_keys import crs_from_keys
from slopewatch.engine.pointcloud.header import preflight


def keys_by_gdal(crs: CRS) -> tuple[bytes, bytes, bytes]:
    """The three tags of a GeoTIFF that GDAL writes for ``crs``."""
    with MemoryFile() as memory:
        options = {"driver": "GTiff", "width": 1, "height": 1, "count": 1, "dtype": "uint8"}
        with memory.open(crs=crs.to_wkt(), transform=rasterio.Affine(1, 0, 5, 0, -1, 7), **options):
            pass
        data = memory.read()
    (directory,) = struct.unpack_from("<I", data, 4)
    tags = {34735: b"", 34736: b"", 34737: b""}
    for index in range(struct.unpack_from("<H", data, directory)[0]):
        tag, kind, count, place = struct.unpack_from("<HHII", data, directory + 2 + 12 * index)
        if tag in tags:
            tags[tag] = data[place : place + count * {2: 1, 3: 2, 12: 8}[kind]]
    return tags[34735], tags[34736], tags[34737]


@pytest.mark.parametrize(
    "text",
    [
        "EPSG:32651",
        "EPSG:2154",
        "EPSG:2227",
        "EPSG:27700",
        "EPSG:4326",
        "EPSG:2154+5720",
        "EPSG:5972",
        "+proj=lcc +lat_1=46 +lat_2=44 +lat_0=43 +lon_0=-121 +x_0=400000 +y_0=0 +datum=NAD83 +units=m",
        "+proj=lcc +lat_1=46 +lat_2=44 +lat_0=43 +lon_0=-121 +x_0=400000 +y_0=0 +datum=NAD83 +units=us-ft",
        "+proj=tmerc +lat_0=0 +lon_0=9 +k=0.9999 +x_0=500000 +y_0=0 +ellps=bessel +units=m",
    ],
)
def test_what_gdal_writes_is_read(text):
    written = CRS.from_user_input(text)
    found = crs_from_keys(*keys_by_gdal(written))
    assert found is not None
    horizontal = found.sub_crs_list[0] if found.is_compound else found
    expected = written.sub_crs_list[0] if written.is_compound else written
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # PROJ strings say less; they say what matters here
        assert horizontal.to_dict() == expected.to_dict()
    if expected.to_epsg():
        assert horizontal.to_epsg() == expected.to_epsg()
    if written.is_compound:
        assert found.sub_crs_list[1].to_epsg() == written.sub_crs_list[1].to_epsg()


def directory(*keys: tuple[int, int, int, int]) -> bytes:
    return struct.pack(f"<{4 + 4 * len(keys)}H", 1, 1, 0, len(keys), *(n for key in keys for n in key))


def test_a_unit_beside_the_code_overrides_it():
    found = crs_from_keys(directory((1024, 0, 1, 1), (3072, 0, 1, 26910), (3076, 0, 1, 9003)), b"", b"")
    assert found is not None
    assert found.axis_info[0].unit_conversion_factor == pytest.approx(1200 / 3937)


def test_heights_in_feet_without_a_code():
    found = crs_from_keys(directory((1024, 0, 1, 1), (3072, 0, 1, 26910), (4099, 0, 1, 9002)), b"", b"")
    assert found is not None
    assert found.is_compound
    assert found.axis_info[2].unit_conversion_factor == pytest.approx(0.3048)


@pytest.mark.parametrize(("code", "name"), [(5703, "NAVD88 height"), (5103, "NAVD88 height")])
def test_a_unit_of_heights_overrides_the_codes(code, name):
    """5103 is the datum of those heights, which GDAL knows writers to put there."""
    keys = ((1024, 0, 1, 1), (3072, 0, 1, 26910), (4096, 0, 1, code))
    metres = crs_from_keys(directory(*keys), b"", b"")
    feet = crs_from_keys(directory(*keys, (4099, 0, 1, 9003)), b"", b"")
    assert metres is not None
    assert feet is not None
    assert metres.sub_crs_list[1].to_epsg() == 5703
    assert metres.name == feet.name == f"NAD83 / UTM zone 10N + {name}"
    assert feet.axis_info[2].unit_conversion_factor == pytest.approx(1200 / 3937)
    assert feet.axis_info[0].unit_conversion_factor == 1.0


def test_a_code_of_another_kind_than_the_model_is_read():
    """The model is a projected one, the only code is geographic."""
    found = crs_from_keys(directory((1024, 0, 1, 1), (2048, 0, 1, 4326)), b"", b"")
    assert found is not None
    assert found.to_epsg() == 4326


def test_heights_with_a_code_that_is_none_of_heights():
    """5030 is WGS 84's ellipsoid, which old writers put where a vertical system belongs."""
    found = crs_from_keys(directory((1024, 0, 1, 1), (3072, 0, 1, 32651), (4096, 0, 1, 5030)), b"", b"")
    assert found is not None
    assert found.axis_info[0].unit_conversion_factor == 1.0
    assert len(found.axis_info) == 2


@pytest.mark.parametrize(
    "broken",
    [
        b"",
        b"\1\0\1\0",
        directory((1024, 0, 1, 1))[:-3],
        struct.pack("<4H", 1, 1, 0, 65535),
        directory((3072, 0, 1, 32767), (3080, 34736, 1, 40)),
        directory((1026, 34737, 60000, 8)),
    ],
)
def test_broken_directories_raise_value_errors(broken):
    with pytest.raises(ValueError):
        crs_from_keys(broken, b"\0" * 16, b"text")


def test_no_code_is_none():
    assert crs_from_keys(directory((1024, 0, 1, 1)), b"", b"") is None
    assert crs_from_keys(directory((1024, 0, 1, 0), (3072, 0, 1, 0)), b"", b"") is None


def test_real_file_with_a_projection_of_its_own(shared_data):
    """Transverse Mercator of the user's own in US survey feet, behind 390 records."""
    crs, sentences = declared_crs(preflight(shared_data / "bad_las" / "lots_of_vlr.las"))
    assert sentences == ()
    assert crs is not None
    assert crs.is_projected
    assert crs.axis_info[0].unit_conversion_factor == pytest.approx(1200 / 3937)


def test_real_file_with_empty_keys(shared_data):
    assert declared_crs(preflight(shared_data / "bad_las" / "1.2-empty-geotiff-vlrs.las"))[0] is None


def test_a_code_beside_broken_keys_is_read(shared_data):
    crs, sentences = declared_crs(preflight(shared_data / "bad_las" / "bad-geotiff-keys.las"))
    assert sentences == ()
    assert crs is not None
    assert crs.to_epsg() == 32617
