"""Places along a road, against lines whose chainage is known by geometry."""

from __future__ import annotations

import math
from pathlib import Path

import geopandas
import numpy as np
import pytest
import shapely
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.workflows.batch.chainage import place_along, read_centreline

UTM = CRS.from_epsg(32651)


def square(x: float, y: float, side: float = 2.0) -> shapely.Polygon:
    return shapely.box(x - side / 2, y - side / 2, x + side / 2, y + side / 2)


def test_along_a_straight_line_and_its_reverse() -> None:
    line = shapely.LineString([(0, 0), (100, 0)])
    there = place_along(square(30, 10), [line], 1000.0)
    assert there is not None
    assert (there.begin, there.end, there.side, there.distance) == (1029.0, 1031.0, "left", 9.0)
    back = place_along(square(30, 10), [line.reverse()], 0.0)
    assert back is not None
    assert (back.begin, back.end, back.side) == (69.0, 71.0, "right")


def test_along_a_circle() -> None:
    """A quarter of a circle of 100 m: chainage is the radius times the angle."""
    angles = np.linspace(0, np.pi / 2, 2001)
    line = shapely.LineString(100 * np.column_stack([np.cos(angles), np.sin(angles)]))
    for degrees in (10, 45, 80):
        for radius, side in ((130.0, "right"), (70.0, "left")):
            angle = math.radians(degrees)
            place = place_along(square(radius * math.cos(angle), radius * math.sin(angle), 0.02), [line])
            assert place is not None
            assert 0.5 * (place.begin + place.end) == pytest.approx(100 * angle, abs=0.02)
            assert place.distance == pytest.approx(30, abs=0.03)
            assert place.side == side


@pytest.mark.parametrize(("x", "y", "side"), [(12, -12, "right"), (8, 3, "left"), (15, 0.2, "right"), (9.7, 2, "left")])
def test_the_side_at_a_corner(x: float, y: float, side: str) -> None:
    """A line that goes east and then turns north: left is inside of the turn."""
    line = shapely.LineString([(0, 0), (10, 0), (10, 20)])
    place = place_along(square(x, y, 0.1), [line])
    assert place is not None
    assert place.side == side


def test_a_zone_on_the_road_and_the_nearest_of_two() -> None:
    lines = [shapely.LineString([(0, 50), (100, 50)]), shapely.LineString([(0, 0), (100, 0)])]
    on_it = place_along(square(20, 0), lines)
    assert on_it is not None
    assert (on_it.side, on_it.distance) == ("both", 0.0)
    assert place_along(square(20, 0), []) is None
    assert place_along(shapely.Polygon(), lines) is None


def test_pieces_that_join_are_one_line(tmp_path: Path) -> None:
    pieces = [[(500_000, 10), (500_100, 10)], [(499_900, 10), (500_000, 10)], [(500_300, 10), (500_400, 10)]]
    path = tmp_path / "road.gpkg"
    lines = [shapely.LineString(p) for p in pieces]
    geopandas.GeoDataFrame(geometry=lines, crs=UTM).to_file(path)
    joined, notes = read_centreline(path, UTM)
    assert sorted(round(line.length) for line in joined) == [100, 200]
    assert "has 2 pieces that do not join; chainage begins anew on each." in notes[-1]
    place = place_along(square(500_050, 12), joined)
    assert place is not None
    assert place.begin == pytest.approx(149.0), "from the beginning of the first piece"
    geopandas.GeoDataFrame(geometry=lines, crs=UTM).to_crs(4326).to_file(tmp_path / "degrees.gpkg")
    degrees, _ = read_centreline(tmp_path / "degrees.gpkg", UTM)
    assert sorted(line.length for line in degrees) == pytest.approx([100, 200], abs=0.01)


def test_what_is_no_line_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"The lines of the centreline '.*gone.gpkg' do not exist"):
        read_centreline(tmp_path / "gone.gpkg", UTM)
