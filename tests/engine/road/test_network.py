"""Places on roads, against lines whose chainages are known by geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from slopewatch.engine.road.chainages import METRES_OF, as_text, chainage_of, range_text
from slopewatch.engine.road.network import Network, Place, Stretch


def stretch(corners: object, start: float = 0.0, route: str = "A1", carriageway: str = "") -> Stretch:
    line = shapely.LineString(corners)
    return Stretch(route, carriageway, line, np.array([0.0, line.length]), np.array([start, start + line.length]))


def square(x: float, y: float, side: float = 2.0) -> shapely.Polygon:
    return shapely.box(x - side / 2, y - side / 2, x + side / 2, y + side / 2)


def placed(network: Network, shape: object) -> Place:
    found = network.place_of(shape)
    assert isinstance(found, Place), found
    return found


def test_along_a_straight_line_and_against_it() -> None:
    there = placed(Network((stretch([(0, 0), (100, 0)], 1000.0),)), square(30, 10))
    assert (there.chain_from, there.chain_to, there.side) == (1029.0, 1031.0, "left")
    assert (there.offset, there.offset_mid) == (9.0, 10.0)
    assert there.text == "A1 K1+029 to K1+031"
    back = placed(Network((stretch([(100, 0), (0, 0)]),)), square(30, 10))
    assert (back.chain_from, back.chain_to, back.side) == (69.0, 71.0, "right")


@pytest.mark.parametrize("degrees", [10, 45, 80])
@pytest.mark.parametrize(("radius", "side"), [(130.0, "right"), (70.0, "left")])
def test_along_a_circle(degrees: float, radius: float, side: str) -> None:
    """A quarter of a circle of 100 m: chainage is the radius times the angle, offset the difference of the radii."""
    angles = np.linspace(0, np.pi / 2, 4001)
    network = Network((stretch(100 * np.column_stack([np.cos(angles), np.sin(angles)])),))
    angle, half = math.radians(degrees), 0.05
    # a sector of a ring from one angle to another, whose feet are known: those of its straight sides
    ring = np.linspace(angle - half, angle + half, 101)
    outer, inner = (np.column_stack([r * np.cos(ring), r * np.sin(ring)]) for r in (radius + 5, radius - 5))
    found = placed(network, shapely.Polygon([*outer, *inner[::-1]]))
    assert found.chain_from == pytest.approx(100 * (angle - half), abs=0.01)
    assert found.chain_to == pytest.approx(100 * (angle + half), abs=0.01)
    assert found.offset == pytest.approx(25.0, abs=0.01)
    assert found.side == side
    centroid = 2 / 3 * math.sin(half) / half * ((radius + 5) ** 3 - (radius - 5) ** 3)
    centroid /= (radius + 5) ** 2 - (radius - 5) ** 2
    assert found.offset_mid == pytest.approx(abs(centroid - 100), abs=0.02)


@pytest.mark.parametrize("x", [3.0, 42.0, 96.5])
def test_shapely_gives_the_same_feet_on_a_bent_line(x: float) -> None:
    line = shapely.LineString([(0, 0), (40, 5), (70, -10), (100, 0)])
    point = shapely.Point(x, 12.0)
    found = placed(Network((stretch(line.coords, 500.0),)), point)
    assert found.chain_from == found.chain_to == pytest.approx(500 + line.project(point), abs=0.005)
    assert found.offset == pytest.approx(point.distance(line), abs=0.005)
    assert line.interpolate(found.chain_from - 500).distance(point) == pytest.approx(found.offset, abs=0.01)


@pytest.mark.parametrize(("x", "y", "side"), [(12, -12, "right"), (8, 3, "left"), (15, 0.2, "right"), (9.7, 2, "left")])
def test_the_side_at_a_corner(x: float, y: float, side: str) -> None:
    """A line that goes east and then turns north: left is inside of the turn."""
    network = Network((stretch([(0, 0), (10, 0), (10, 20)]),))
    assert placed(network, square(x, y, 0.1)).side == side


def test_the_carriageway_that_is_nearest_has_it() -> None:
    east = stretch([(0, 0), (100, 0)], 0.0, "A1", "east")
    west = stretch([(100, 12), (0, 12)], 5000.0, "A1", "west")
    network = Network((east, west))
    above, below = placed(network, square(30, 25)), placed(network, square(30, -13))
    assert (above.carriageway, above.side, above.chain_from, above.offset) == ("west", "right", 5069.0, 12.0)
    assert (below.carriageway, below.side, below.chain_from, below.offset) == ("east", "right", 29.0, 12.0)
    assert above.text == "A1 west K5+069 to K5+071"


def test_two_roads_that_are_equally_near_are_named() -> None:
    network = Network((stretch([(0, 0), (100, 0)], 0.0, "A1"), stretch([(0, 40), (100, 40)], 700.0, "B2")))
    assert network.place_of(square(30, 20.4)) == "It lies equally near to B2 at K0+729 and A1 at K0+029."
    assert placed(network, square(30, 20.6)).route == "B2", "farther apart than the tolerance of a metre"
    assert placed(Network(network.stretches, tolerance=0.1), square(30, 20.4)).route == "B2"
    # on both: the one that is nearer to its middle
    assert placed(network, shapely.box(10, -5, 20, 60)).route == "B2"
    assert isinstance(network.place_of(shapely.box(10, -5, 20, 45)), str)


def test_two_bends_of_one_road_are_two_places() -> None:
    """A hairpin of two legs 60 m apart; a zone belongs to its leg only, and between the legs to neither."""
    hairpin = stretch([(0, 0), (200, 0), (230, 30), (200, 60), (0, 60)])
    network = Network((hairpin,))
    lower = placed(network, shapely.box(40, 5, 50, 28))
    assert (lower.chain_from, lower.chain_to) == (40.0, 50.0)
    upper = placed(network, shapely.box(40, 35, 50, 50))
    legs = 200 + 2 * math.hypot(30, 30)
    assert (upper.chain_from, upper.chain_to) == pytest.approx((legs + 150, legs + 160), abs=0.01)
    found = network.place_of(square(45, 30))
    assert found == "It lies equally near to A1 at K0+044 and A1 at K0+439."


def test_beyond_the_end_and_out_of_reach() -> None:
    network = Network((stretch([(0, 0), (100, 0)], 12_000.0),))
    assert network.place_of(square(110, 5)) == "It lies beyond the end of A1 at K12+100."
    assert network.place_of(square(50, 250)) == "It lies farther than 200 m from every road."
    assert network.place_of(None) == network.place_of(shapely.Polygon()) == "It has no shape."
    partly = placed(network, shapely.box(90, 5, 130, 10))
    assert (partly.chain_from, partly.chain_to) == (12_090.0, 12_100.0)
    # the road goes on under another name
    further = Network((*network.stretches, stretch([(100, 0), (200, 0)], 0.0, "B2")))
    assert placed(further, square(110, 5)).text == "B2 K0+009 to K0+011"
    assert placed(further, shapely.box(90, 5, 130, 10)).route == "B2", "its middle has its foot there"


def test_beyond_either_end_whatever_the_last_digits_are() -> None:
    """Only a part of the road is looked at, whose length counted from its start is not to the last digit the road's."""
    rng = np.random.default_rng(0)
    for _ in range(200):
        west, south, way = 500_000 + rng.uniform(0, 1000), 3_500_000 + rng.uniform(0, 1000), rng.uniform(30, 200)
        angle = rng.uniform(0, 2 * np.pi)
        along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
        tips = np.array([west, south]), np.array([west, south]) + way * along
        network = Network((stretch(tips),))
        for tip, outward in ((tips[0], -along), (tips[1], along)):
            middle = tip + rng.uniform(5, 40) * outward + rng.uniform(3, 30) * across
            found = network.place_of(shapely.Point(middle).buffer(1.0))
            assert isinstance(found, str), found
            assert "beyond the end" in found
            inside = network.place_of(shapely.Point(tip - 5 * outward + 10 * across).buffer(1.0))
            assert isinstance(inside, Place), inside


def test_on_the_axis_it_lies_on_both_sides() -> None:
    found = placed(Network((stretch([(0, 0), (100, 0)]),)), square(20, 0.5))
    assert (found.side, found.offset, found.offset_mid) == ("both", 0.0, 0.5)


def test_an_equation_of_chainage_is_followed() -> None:
    """100 m in, K0+100 back is K0+250 ahead."""
    line = shapely.LineString([(0, 0), (200, 0)])
    jump = Stretch("A1", "", line, np.array([0.0, 100.0, 100.0, 200.0]), np.array([0.0, 100.0, 250.0, 350.0]))
    network = Network((jump,))
    for begin, end, expected in (
        (40, 60, (40, 60)), (140, 160, (290, 310)), (90, 110, (90, 260)), (80, 100, (80, 100)), (100, 120, (250, 270)),
    ):  # fmt: skip
        found = placed(network, shapely.box(begin, 5, end, 10))
        assert (found.chain_from, found.chain_to) == expected


@pytest.mark.parametrize(
    ("metres", "style", "unit", "text"),
    [
        (12_345.4, "K12+345", "m", "K12+345"), (12_345.4, "12+345", "m", "12+345"), (999.6, "K12+345", "m", "K1+000"),
        (7.0, "K12+345", "m", "K0+007"), (-150.0, "K12+345", "m", "K-0+150"), (12_345.4, "km", "m", "12.345 km"),
        (12_345.4, "m", "m", "12345 m"), (1234 * 0.3048, "stations", "ft", "12+34"),
        (1234567 * 1200 / 3937, "stations", "us_ft", "12345+67"),
    ],
)  # fmt: skip
def test_chainages_as_people_write_them(metres: float, style: str, unit: str, text: str) -> None:
    assert as_text(metres, style, unit) == text


def test_chainages_as_fields_hold_them() -> None:
    assert chainage_of("K12+345.5", "m") == chainage_of("12+345.5", "km") == 12_345.5
    assert chainage_of("-0+150", "m") == -150.0
    assert chainage_of("123+45", "ft") == pytest.approx(12_345 * 0.3048)
    assert chainage_of(2.5, "km") == chainage_of("2500", "m") == 2500.0
    assert chainage_of(1000, "us_ft") == pytest.approx(304.8006096)
    assert all(chainage_of(empty, "m") is None for empty in (None, "", " ", float("nan")))
    for wrong in ("about 12", "12+", float("inf")):
        with pytest.raises(ValueError, match=r"."):
            chainage_of(wrong, "m")
    assert range_text(10.2, 10.4) == "K0+010"
    assert METRES_OF["ft"] == 0.3048
