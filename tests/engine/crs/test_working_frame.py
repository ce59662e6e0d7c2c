"""The metre frame: converted coordinates must lie where PROJ puts the original ones."""

from __future__ import annotations

import laspy
import numpy as np
import pytest
from pyproj import CRS, Transformer
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.crs.working_frame import plausibility, working_frame
from slopewatch.engine.pointcloud.declared_crs import declared_crs
from slopewatch.engine.pointcloud.header import preflight
from slopewatch.engine.pointcloud.reading import open_cloud
from slopewatch.interface.parameters import InputParameters

FOOT, US_FOOT = 0.3048, 1200 / 3937


def frame(text: str, **inputs):
    return working_frame(CRS.from_user_input(text), InputParameters(**inputs), "cloud.las")


@pytest.mark.parametrize(
    ("text", "x", "y", "factor", "unit"),
    [
        ("EPSG:2227", 6.1e6, 2.05e6, US_FOOT, "US survey feet"),  # California zone 3
        ("EPSG:3089", 4.9e6, 3.8e6, US_FOOT, "US survey feet"),  # Kentucky
        ("EPSG:2992", 6.4e5, 8.5e5, FOOT, "international feet"),  # Oregon
        ("EPSG:2222", 7.0e5, 9.0e5, FOOT, "international feet"),  # Arizona east
        ("EPSG:2314", 4.0e5, 4.5e5, 0.3047972654, "units of 0.3047972654 m"),  # Trinidad, Clarke's feet
    ],
)
def test_feet_become_metres_at_the_same_place(text, x, y, factor, unit):
    found = frame(text)
    assert found.horizontal_factor == pytest.approx(factor, rel=1e-12)
    assert found.vertical_factor == found.horizontal_factor  # no vertical part: heights in the horizontal unit
    assert {axis.unit_conversion_factor for axis in found.crs.axis_info} == {1.0}
    assert found.notes
    assert all(unit in note for note in found.notes)
    geographic = CRS.from_user_input(text).geodetic_crs
    original = Transformer.from_crs(text, geographic, always_xy=True).transform(x, y)
    converted = Transformer.from_crs(found.crs, geographic, always_xy=True).transform(x * factor, y * factor)
    # 1e-11 degrees are a micrometre
    assert np.allclose(original, converted, rtol=0, atol=1e-11)


def test_heights_in_feet_lose_no_place_and_get_the_code_of_their_metre_sibling():
    found = frame("EPSG:2227+6360")
    assert found.factors == pytest.approx((US_FOOT, US_FOOT, US_FOOT), rel=1e-12)
    assert found.crs.sub_crs_list[1].to_epsg() == 5703
    metres = CRS("EPSG:26943+5703")
    x, y, z = Transformer.from_crs("EPSG:2227+6360", metres, always_xy=True).transform(6.1e6, 2.05e6, 1000.0)
    ours = Transformer.from_crs(found.crs, metres, always_xy=True).transform(
        *(np.array([6.1e6, 2.05e6, 1000.0]) * US_FOOT)
    )
    assert np.allclose(ours, (x, y, z), rtol=0, atol=1e-4)


def test_metres_stay_as_they_are():
    found = frame("EPSG:2154+5720")
    assert found.crs == CRS("EPSG:2154+5720")
    assert found.in_metres
    assert found.notes == ()


def test_metres_with_heights_in_feet():
    found = frame("EPSG:26910+6360")
    assert found.factors == (1.0, 1.0, pytest.approx(US_FOOT))
    assert found.crs.equals(CRS("EPSG:26910+5703"))


@pytest.mark.parametrize(("unit", "factor"), [("metre", 1.0), ("foot", FOOT), ("us-survey-foot", US_FOOT)])
def test_the_unit_of_heights_can_be_given(unit, factor):
    assert frame("EPSG:32651", height_unit=unit).vertical_factor == pytest.approx(factor)
    assert frame("EPSG:2227", height_unit=unit).factors == pytest.approx((US_FOOT, US_FOOT, factor))
    against = frame("EPSG:26910+6360", height_unit=unit)
    assert against.vertical_factor == pytest.approx(factor)
    assert any("as given" in note for note in against.notes) == (unit != "us-survey-foot")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("EPSG:4326", "geographic"),
        ("EPSG:4979", "geographic"),
        ("EPSG:4326+5773", "geographic"),
        ("EPSG:4978", "geocentric"),
        ("EPSG:5703", "no plane"),
        ("EPSG:32719+5715", "downwards"),
    ],
)
def test_what_has_no_metric_plane_is_refused_with_the_remedy(text, words):
    with pytest.raises(InputError, match=words) as caught:
        frame(text)
    assert "cloud.las" in str(caught.value)
    assert "--crs EPSG:n" in str(caught.value)


def test_none_is_refused_unless_one_is_given():
    with pytest.raises(InputError, match=r"cloud\.las.* no coordinate reference system.*--crs"):
        working_frame(None, InputParameters(), "cloud.las")
    assert working_frame(None, InputParameters(crs="EPSG:32651"), "cloud.las").crs == CRS("EPSG:32651")


def test_a_given_one_replaces_the_declared_and_says_so():
    found = frame("EPSG:4978", crs="EPSG:32613")
    assert found.crs == CRS("EPSG:32613")
    assert "WGS 84 / UTM zone 13N is used instead" in found.notes[0]
    assert frame("EPSG:32613", crs="EPSG:32613").notes == ()


def test_declared_heights_stay_where_the_given_one_has_none():
    found = frame("EPSG:26910+6360", crs="EPSG:26911")
    assert found.vertical_factor == pytest.approx(US_FOOT)
    assert found.crs.equals(CRS("EPSG:26911+5703"))


def test_unknown_text_is_refused():
    with pytest.raises(InputError, match="crs is 'EPSG:999999'"):
        working_frame(None, InputParameters(crs="EPSG:999999"), "cloud.las")


def test_a_local_grid_in_metres_is_accepted():
    found = frame('LOCAL_CS["site",UNIT["metre",1]]')
    assert found.in_metres
    assert plausibility(found, 10.0, 20.0) == []


def test_distorted_areas_and_far_places_are_warned_of():
    assert plausibility(frame("EPSG:32651"), 500_000, 3_500_000) == []
    x, y = Transformer.from_crs(4326, 3857, always_xy=True).transform(7.0, 45.0)
    (warning,) = plausibility(frame("EPSG:3857"), x, y)
    assert "2 times" in warning.replace("1.99", "2").replace("2.01", "2")
    # Lambert-93 coordinates of the French Alps taken for a UTM zone of China's coast
    assert any("area of use" in w for w in plausibility(frame("EPSG:32651"), 961_000, -6_431_000))


def test_the_area_of_use_is_known_with_heights_in_feet():
    found = frame("EPSG:26910+6360")
    assert not found.in_metres
    assert plausibility(found, 500_000, 4_500_000) == []
    assert any("area of use" in w for w in plausibility(found, 500_000, 500_000))


def test_a_bound_reference_system_in_feet_becomes_its_own_projection_in_metres():
    """With parameters towards WGS 84, which stay out of what is computed."""
    projection = "+proj=tmerc +lat_0=0 +lon_0=9 +x_0=500000 +ellps=bessel +units={} +type=crs"
    found = frame(projection.format("us-ft") + " +towgs84=598.1,73.7,418.2,0.202,0.045,-2.455,6.7")
    assert found.horizontal_factor == pytest.approx(US_FOOT, rel=1e-15)
    assert not found.crs.is_bound
    there = Transformer.from_crs(found.crs, projection.format("m"), always_xy=True)
    assert np.allclose(there.transform(510_000.0, 5_000_000.0), (510_000.0, 5_000_000.0), rtol=0, atol=1e-6)


@pytest.mark.parametrize("unit", ['"degree",0.0174532925199433', '"radian",1'])
def test_a_local_grid_in_angles_is_refused(unit):
    with pytest.raises(InputError, match=r"whose unit is nan m"):
        frame(f'LOCAL_CS["site",UNIT[{unit}],AXIS["E",EAST],AXIS["N",NORTH]]')


def test_declared_in_wkt(tmp_path, las_file):
    path = las_file(tmp_path / "a.laz", crs="EPSG:2154+5720")
    crs, warnings = declared_crs(preflight(path))
    assert crs is not None
    assert crs.equals(CRS("EPSG:2154+5720"), ignore_axis_order=True)
    assert warnings == ()


def test_declared_in_geotiff_keys(tmp_path, las_file):
    path = las_file(tmp_path / "a.las", crs=32651, point_format=3, version="1.2")
    header = preflight(path)
    assert header.wkt is None
    assert declared_crs(header)[0] == CRS(32651)


def test_broken_wkt_is_named_and_treated_as_none(tmp_path, las_file):
    path = las_file(tmp_path / "a.las", crs=None)
    las = laspy.read(path)
    las.vlrs.append(laspy.VLR("LASF_Projection", 2112, record_data=b"PROJCS[this is broken\0"))
    las.write(path)
    crs, warnings = declared_crs(preflight(path))
    assert crs is None
    assert "WKT" in warnings[0]


def test_real_pair_in_mixed_units(shared_data):
    """Oregon Lambert in metres, heights in US survey feet."""
    header, found = open_cloud(shared_data / "real" / "autzen_bmx" / "autzen-bmx-2010.las")
    assert header.count == 829
    assert found.factors == (1.0, 1.0, pytest.approx(0.3048006096, rel=1e-10))
    assert found.crs.sub_crs_list[1].to_epsg() == 5703
    assert any("US survey feet" in note for note in found.notes)


def test_real_cloud_with_a_wrong_declaration(shared_data):
    path = shared_data / "real" / "lone-star.copc.laz"
    with pytest.raises(InputError, match="geocentric"):
        open_cloud(path)
    assert open_cloud(path, InputParameters(crs="EPSG:32613"))[1].crs.to_epsg() == 32613
