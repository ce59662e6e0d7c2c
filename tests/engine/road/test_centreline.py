"""Centrelines read from files: chainages by fields or by length, and what cannot be used."""

from __future__ import annotations

import math
import tracemalloc
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pytest
import shapely
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.road.centreline import read_roads
from slopewatch.engine.road.network import Network, Place
from slopewatch.engine.vector.field_mapping import FieldMapping
from slopewatch.interface.parameters import RoadParameters

UTM = CRS.from_epsg(32651)
X, Y = 500_000.0, 2_500_000.0


def layer(path: Path, lines: Sequence[Any], crs: Any = UTM, **fields: Any) -> Path:
    """Lines of corners from (X, Y)."""
    shapes = [shapely.LineString(np.asarray(line, dtype=float) + (X, Y)) for line in lines]
    geopandas.GeoDataFrame(fields, geometry=shapes, crs=UTM).to_crs(crs).to_file(path, layer="road")
    return path


def network(path: Path, names: FieldMapping | None = None, near: Any = None, **parameters: Any) -> Network:
    return read_roads(path, UTM, RoadParameters(**parameters), names).network(near)[0]


def at(found: Network, x: float, y: float) -> Place:
    place = found.place_of(shapely.Point(X + x, Y + y))
    assert isinstance(place, Place), place
    return place


def refused(path: Path, words: str, **parameters: Any) -> None:
    with pytest.raises(InputError) as caught:
        network(path, **parameters)
    sentence = str(caught.value)
    assert words in sentence
    assert path.name in sentence
    assert sentence.endswith(".")
    assert "\n" not in sentence


def test_pieces_that_join_are_one_road_by_its_length(tmp_path: Path) -> None:
    path = layer(tmp_path / "r.gpkg", [[(0, 0), (100, 0)], [(-100, 0), (0, 0)], [(100, 0), (100, 50)]])
    assert at(network(path), 40, 5).chain_from == 140.0
    assert at(network(path, chainage_start=12_000.0), 95, 45).chain_from == 12_245.0
    back = at(network(path, chainage_direction="reversed"), 40, 5)
    assert (back.chain_from, back.side) == (110.0, "right")
    assert at(network(path, route_name="S1"), 40, 5).text == "S1 K0+140"


def test_another_reference_system_and_the_layer_by_its_name(tmp_path: Path) -> None:
    degrees = layer(tmp_path / "r.gpkg", [[(0, 0), (1000, 0)]], 4326)
    found = at(network(degrees, centreline_layer="road"), 400, 30)
    # a straight line in degrees of longitude bends by millimetres here
    assert (found.chain_from, found.offset) == pytest.approx((400, 30), abs=0.02)
    refused(degrees, "has no layer axis; its layers are road", centreline_layer="axis")


@pytest.mark.parametrize(("unit", "metres"), [("m", 1.0), ("km", 1000.0), ("ft", 0.3048), ("us_ft", 1200 / 3937)])
def test_chainages_of_the_fields_in_their_unit(tmp_path: Path, unit: str, metres: float) -> None:
    path = layer(
        tmp_path / "r.gpkg", [[(0, 0), (100, 0)], [(200, 0), (100, 0)]], route=["S1", "S1"],
        chain_from=[12_300 / metres, 12_500 / metres], chain_to=[12_400 / metres, 12_400 / metres],
    )  # fmt: skip
    found = network(path, chainage_unit=unit)
    assert len(found.stretches) == 1, "the second line was drawn against its chainage"
    for x in (30, 130):
        place = at(found, x, 5)
        assert (place.route, place.side) == ("S1", "left")
        assert place.chain_from == pytest.approx(12_300 + x, abs=0.006)
    other = {"m": "km"}.get(unit, "m")
    refused(path, "check them and --chainage-unit", chainage_unit=other)


def test_chainage_is_scaled_between_what_the_fields_say(tmp_path: Path) -> None:
    """101 m of chainage on a line of 100 m, as where a road was measured on its slope."""
    path = layer(tmp_path / "r.gpkg", [[(0, 0), (100, 0)]], chain_from=["K1+000"], chain_to=["K1+101"])
    assert at(network(path), 50, 5).chain_from == pytest.approx(1050.5)


def test_an_agencys_own_names(tmp_path: Path) -> None:
    path = layer(tmp_path / "r.gpkg", [[(0, 0), (100, 0)]], ROAD_NO=[7.0], START=[500.0], ENDCH=[600.0])
    theirs = {"route": "road_no", "chain_from": "START", "chain_to": "ENDCH"}
    place = at(network(path, FieldMapping({"centreline": theirs})), 10, 5)
    assert (place.route, place.chain_from) == ("7", 510.0)
    assert at(network(path, FieldMapping({"": theirs})), 10, 5).text == "7 K0+510"
    with pytest.raises(InputError, match=r"has no field RD \(route\); its fields are ROAD_NO, START, ENDCH\."):
        network(path, FieldMapping({"centreline": {"route": "RD"}}))
    assert at(network(path, FieldMapping({"": {"route": "RD"}})), 10, 5).route == "", "it may be the zones' name"


def test_gaps_equations_and_steps_back(tmp_path: Path) -> None:
    lines = [[(0, 0), (100, 0)], [(100, 0), (200, 0)]]
    jump = layer(tmp_path / "jump.gpkg", lines, chain_from=[0.0, 150.0], chain_to=[100.0, 250.0])
    refused(jump, "has a gap in its chainage, from K0+100 to K0+150 where its lines 1 and 2 join")
    found, notes = read_roads(jump, UTM, RoadParameters(chainage_equations=True)).network()
    assert any("an equation of chainage: K0+100 back is K0+150 ahead." in note for note in notes)
    assert (at(found, 90, 5).chain_from, at(found, 110, 5).chain_from) == (90.0, 160.0)
    back = layer(tmp_path / "back.gpkg", lines, chain_from=[0.0, 80.0], chain_to=[100.0, 180.0])
    refused(back, "has a step back in its chainage, from K0+100 to K0+080")
    apart = layer(
        tmp_path / "apart.gpkg", [[(0, 0), (100, 0)], [(150, 0), (250, 0)]], chain_from=[0.0, 150.0],
        chain_to=[100.0, 250.0],
    )  # fmt: skip
    found = network(apart)
    assert at(found, 160, 5).chain_from == 160.0, "the fields say it, whatever lies between"
    assert isinstance(found.place_of(shapely.Point(X + 125, Y + 5)), str)
    gap = layer(tmp_path / "gap.gpkg", [[(0, 0), (100, 0)], [(150, 0), (250, 0)]])
    refused(gap, "has a gap of 50.0 m, so that its chainage is not known beyond")


def test_roads_that_run_the_other_way_branch_or_cross(tmp_path: Path) -> None:
    turned = layer(tmp_path / "turned.gpkg", [[(0, 0), (100, 0)], [(200, 0), (100, 0)]])
    refused(turned, "has two lines, 1 and 2, that both end at x 500100.0, y 2500000.0: one runs the other way")
    fields = {"chain_from": [0.0, 300.0], "chain_to": [100.0, 200.0]}
    wrong = layer(tmp_path / "wrong.gpkg", [[(0, 0), (100, 0)], [(100, 0), (200, 0)]], **fields)
    refused(wrong, "that both end at")
    loop = [(0, 0), (100, 0), (100, 50), (50, 50), (50, -50)]
    refused(layer(tmp_path / "loop.gpkg", [loop]), "crosses itself at x 500050.0, y 2500000.0")
    cross = layer(tmp_path / "cross.gpkg", [[(0, 0), (100, 0)], [(50, -50), (50, 50)]])
    refused(cross, "crosses itself at x 500050.0, y 2500000.0")
    named = layer(tmp_path / "named.gpkg", [[(0, 0), (100, 0)], [(50, -50), (50, 50)]], route=["A", "B"])
    assert len(network(named).stretches) == 2, "two roads may cross"
    refused(layer(tmp_path / "twice.gpkg", [[(0, 0), (100, 0)], [(0, 0), (100, 0)]]), "crosses itself")
    ring = [(50 * math.cos(a), 50 * math.sin(a)) for a in np.linspace(0, 2 * np.pi, 101)]
    assert at(network(layer(tmp_path / "ring.gpkg", [[*ring[:-1], ring[0]]])), 0, 40).chain_from == pytest.approx(
        25 * np.pi, abs=0.35
    )


def test_only_roads_near_the_slope_are_checked(tmp_path: Path) -> None:
    far = [(0, 5000), (100, 5000), (100, 5050), (50, 5050), (50, 4950)]
    path = layer(tmp_path / "r.gpkg", [[(0, 0), (100, 0)], far], route=["A", "B"])
    slope = shapely.box(X, Y + 10, X + 100, Y + 50)
    assert [s.route for s in network(path, near=slope).stretches] == ["A"]
    refused(path, "crosses itself")
    beyond = shapely.box(X, Y + 1010, X + 100, Y + 1050)
    refused(path, "does not reach the slope: it ends 1010 m from it, farther than --road-reach 200", near=beyond)


def test_what_is_no_centreline_is_named(tmp_path: Path) -> None:
    refused(tmp_path / "gone.gpkg", "does not exist; check the path")
    (tmp_path / "text.gpkg").write_text("no layer")
    refused(tmp_path / "text.gpkg", "cannot be read as a vector file")
    geopandas.GeoDataFrame(geometry=[shapely.box(0, 0, 1, 1)], crs=UTM).to_file(tmp_path / "area.gpkg")
    refused(tmp_path / "area.gpkg", "holds no lines (")
    line = [[(0, 0), (100, 0)], [(100, 0), (200, 0)]]
    refused(layer(tmp_path / "t.gpkg", line, chain_from=["x", "1"]), "of line 1 of the centreline")
    refused(layer(tmp_path / "e.gpkg", line, chain_to=[1.0, 2.0]), "has chainages of the lines' ends only")
    refused(layer(tmp_path / "s.gpkg", line, chain_from=[1.0, None]), "its line 2 has none")
    own = layer(tmp_path / "o.gpkg", line, chain_from=[0.0, 100.0])
    assert at(network(own), 150, 5).chain_from == 150.0, "the end's chainage is that of its length"
    refused(own, "has chainages of its own; leave --chainage-start", chainage_start=5.0)


def test_a_file_without_a_reference_system_is_taken_in_the_surveys(tmp_path: Path) -> None:
    shape = shapely.LineString([(X, Y), (X + 100, Y)])
    geopandas.GeoDataFrame(geometry=[shape]).to_file(tmp_path / "r.shp")
    roads = read_roads(tmp_path / "r.shp", UTM)
    assert "declares no reference system" in roads.notes[0]
    assert at(roads.network()[0], 10, 5).chain_from == 10.0


def test_many_lines_in_one_place_take_no_list_of_all_their_pairs(tmp_path: Path) -> None:
    lines = [[(0, 0.0001 * n), (10, 0.0001 * n)] for n in range(3000)]
    path = layer(tmp_path / "road.gpkg", lines, route=["A"] * 3000)
    roads = read_roads(path, UTM)
    tracemalloc.start()
    with pytest.raises(InputError, match="has two lines, 1 and 2, that both end at"):
        roads.network()
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 50e6, "4,500,000 pairs take ten times as much"
