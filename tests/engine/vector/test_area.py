"""Areas of interest in all the shapes in which people hand them over."""

from __future__ import annotations

from pathlib import Path

import geopandas
import numpy as np
import pytest
import shapely
from pyproj import CRS
from shapely.geometry import LineString, MultiPolygon, Point, Polygon
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.pointcloud.reading import open_cloud
from slopewatch.engine.vector.area import read_roi, refuse_outside

UTM = CRS(32651)
X, Y = 500_000.0, 3_500_000.0


def square(x: float, y: float, side: float, *holes: list[tuple[float, float]]) -> Polygon:
    ring = [(X + x, Y + y), (X + x + side, Y + y), (X + x + side, Y + y + side), (X + x, Y + y + side)]
    return Polygon(ring, [[(X + a, Y + b) for a, b in hole] for hole in holes])


def save(path: Path, *geometries, crs: object = UTM) -> Path:
    geopandas.GeoDataFrame(geometry=list(geometries), crs=UTM).to_crs(crs).to_file(path)
    return path


pytestmark = pytest.mark.filterwarnings("ignore:'crs' was not provided")
HOLED = square(0, 0, 20, [(5, 5), (10, 5), (10, 10)])


@pytest.mark.parametrize("name", ["a.gpkg", "a.shp", "a.geojson", "a.fgb", "a.gml", "a.kml", "a.shz"])
def test_formats(tmp_path, name):
    path = tmp_path / name
    if name == "a.kml":  # by its ending alone, a folder of shapefiles would be written
        geopandas.GeoDataFrame(geometry=[HOLED], crs=UTM).to_crs(4326).to_file(path, driver="KML")
    else:
        save(path, HOLED)
    roi = read_roi(path, UTM)
    assert roi.area == pytest.approx(400 - 12.5, rel=1e-6)
    assert roi.geometry.symmetric_difference(HOLED).area < 1e-4
    assert roi.bounds == pytest.approx((X, Y, X + 20, Y + 20), abs=1e-5)


@pytest.mark.parametrize(
    "name", ['it\'s, a "test".gpkg', "Böschung 漢字.gpkg", "a[1]b*?#.gpkg", "a%20b&c.gpkg", "a|b.gpkg", " a b .gpkg"]
)
def test_odd_names(tmp_path, name):
    assert read_roi(save(tmp_path / name, HOLED), UTM).area == pytest.approx(387.5)


@pytest.mark.parametrize("name", ["a.geojson", "a.shp"])
def test_a_line_break_in_the_name(tmp_path, name):
    folder = tmp_path / "two\tparts"
    folder.mkdir()
    save(tmp_path / name, HOLED)
    for file in tmp_path.glob("a.*"):
        file.rename(folder / f"a\nb{file.suffix}")
    assert read_roi(folder / f"a\nb{Path(name).suffix}", UTM).area == pytest.approx(387.5)


def test_several_and_multipart_polygons_are_united(tmp_path):
    parts = MultiPolygon([square(0, 0, 10), square(50, 0, 10)])
    roi = read_roi(save(tmp_path / "a.gpkg", parts, square(5, 0, 10)), UTM)
    assert roi.area == pytest.approx(100 + 100 + 50)
    assert any("3 polygons" in note for note in roi.notes)


@pytest.mark.parametrize("crs", [4326, 3857, 32652, 4490])
def test_another_reference_system_is_transformed(tmp_path, crs):
    roi = read_roi(save(tmp_path / "a.gpkg", HOLED, crs=crs), UTM)
    assert roi.geometry.symmetric_difference(HOLED).area < 0.01
    assert any("transformed" in note for note in roi.notes)


def test_the_vertical_part_of_the_clouds_system_does_not_matter(tmp_path):
    roi = read_roi(save(tmp_path / "a.gpkg", HOLED), CRS("EPSG:32651+5773"))
    assert roi.geometry.symmetric_difference(HOLED).area == 0
    assert roi.notes == ()


def test_an_area_in_feet_fits_the_cloud_in_metres(tmp_path, las_file):
    """Drawn around a cloud in feet, in that cloud's own system: it must enclose the converted points."""
    _, frame = open_cloud(las_file(tmp_path / "a.las", crs=2227))
    drawn = shapely.box(X - 1, Y - 1, X + 31, Y + 21)
    for name, crs in (("a.gpkg", 2227), ("b.gpkg", None)):
        geopandas.GeoDataFrame(geometry=[drawn], crs=crs).to_file(tmp_path / name)
        roi = read_roi(tmp_path / name, frame.crs, unit=frame.horizontal_factor)
        assert roi.bounds == pytest.approx(np.array(drawn.bounds) * 1200 / 3937, abs=1e-3)


def test_no_reference_system_is_taken_for_the_clouds_and_said(tmp_path):
    geopandas.GeoDataFrame(geometry=[HOLED]).to_file(tmp_path / "a.shp")
    roi = read_roi(tmp_path / "a.shp", UTM)
    assert roi.area == pytest.approx(387.5)
    assert any("assumed" in note for note in roi.notes)


def test_a_polygon_that_crosses_itself_is_repaired_and_said(tmp_path):
    bow_tie = Polygon([(X, Y), (X + 10, Y + 10), (X + 10, Y), (X, Y + 10)])
    roi = read_roi(save(tmp_path / "a.gpkg", bow_tie), UTM)
    assert roi.geometry.is_valid
    assert roi.area == pytest.approx(50)
    assert any("crosses itself" in note for note in roi.notes)


def test_the_first_layer_of_polygons_is_taken(tmp_path):
    path = tmp_path / "a.gpkg"
    geopandas.GeoDataFrame(geometry=[LineString([(X, Y), (X, Y + 5)])], crs=UTM).to_file(path, layer="roads")
    geopandas.GeoDataFrame(geometry=[square(0, 0, 5)], crs=UTM).to_file(path, layer="slope")
    geopandas.GeoDataFrame(geometry=[square(0, 0, 9)], crs=UTM).to_file(path, layer="other")
    roi = read_roi(path, UTM)
    assert roi.area == pytest.approx(25)
    assert any("layer slope" in note for note in roi.notes)


def test_lines_and_points_among_polygons_are_left_out_and_said(tmp_path):
    roi = read_roi(save(tmp_path / "a.geojson", square(0, 0, 5), Point(X, Y)), UTM)
    assert roi.area == pytest.approx(25)
    assert any("left out" in note for note in roi.notes)


@pytest.mark.parametrize("geometry", [Point(X, Y), LineString([(X, Y), (X, Y + 5)])])
@pytest.mark.parametrize("name", ["a.gpkg", "a.geojson"])
def test_no_polygons_are_refused(tmp_path, geometry, name):
    with pytest.raises(InputError, match="no polygons"):
        read_roi(save(tmp_path / name, geometry), UTM)


def test_an_empty_layer_is_refused(tmp_path):
    geopandas.GeoDataFrame({"geometry": geopandas.GeoSeries([], crs=UTM)}).to_file(tmp_path / "a.gpkg")
    with pytest.raises(InputError, match=r"a\.gpkg.* no polygons"):
        read_roi(tmp_path / "a.gpkg", UTM)


def test_a_polygon_without_area_is_refused(tmp_path):
    flat = Polygon([(X, Y), (X + 5, Y + 5), (X + 10, Y + 10)])
    with pytest.raises(InputError, match="no extent"):
        read_roi(save(tmp_path / "a.geojson", flat), UTM)


@pytest.mark.parametrize(
    "content", [b"", b"hello", b"LASF" + bytes(500), b'{"type": "FeatureCollection", "features": [{']
)
@pytest.mark.parametrize("name", ["a.gpkg", "a.geojson", "a.shp", "a.txt"])
def test_what_is_no_vector_file_is_refused(tmp_path, content, name):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=name.replace(".", r"\.")):
        read_roi(tmp_path / name, UTM)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"none\.gpkg.*does not exist"):
        read_roi(tmp_path / "none.gpkg", UTM)


def test_an_area_outside_of_the_cloud_names_both_extents(tmp_path):
    roi = read_roi(save(tmp_path / "a.gpkg", square(1000, 0, 5)), UTM)
    with pytest.raises(InputError) as caught:
        refuse_outside(roi, (X, Y, X + 30, Y + 20), tmp_path / "cloud.laz")
    for words in ("a.gpkg", "cloud.laz", "x 501000.0 to 501005.0", "x 500000.0 to 500030.0"):
        assert words in str(caught.value)
    refuse_outside(roi, (X, Y, X + 1000, Y + 20), tmp_path / "cloud.laz")


def test_a_hole_that_holds_the_whole_cloud_is_outside(tmp_path):
    ring = square(-100, -100, 300, [(-50, -50), (100, -50), (100, 100), (-50, 100)])
    roi = read_roi(save(tmp_path / "a.gpkg", ring), UTM)
    with pytest.raises(InputError, match="outside of the cloud"):
        refuse_outside(roi, (X, Y, X + 30, Y + 20), tmp_path / "cloud.laz")


def test_a_place_where_the_clouds_system_does_not_reach(tmp_path):
    geopandas.GeoDataFrame(geometry=[shapely.box(-90, 10, -89, 11)], crs=4326).to_file(tmp_path / "a.gpkg")
    far = CRS("+proj=tmerc +lon_0=123 +ellps=bessel +approx")
    with pytest.raises(InputError, match=r"a\.gpkg"):
        read_roi(tmp_path / "a.gpkg", far)
