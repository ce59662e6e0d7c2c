"""What was not compared, as polygons: the cells of each reason, and no others, lie in its polygon; hatched."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import shapely
from pyproj import CRS
from slopewatch.engine.change.coverage import Seen
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.handover.styles import sld_of
from slopewatch.engine.maps.palette import UNSEEN_STRIPE
from slopewatch.engine.maps.qgis_styles import not_seen_qml
from slopewatch.engine.zones.not_seen import not_seen_frame
from slopewatch.interface.seen import COMPARED, EXCLUDED, KEYS, LABELS, NOT_IN_BOTH, NOT_SEEN, TOO_FEW

GRID = Grid(west=500000.0, north=4000020.0, cell=0.5, rows=30, columns=40)
SLD = "{http://www.opengis.net/sld}"


def test_each_reason_has_one_polygon_of_its_cells() -> None:
    classes = np.random.default_rng(4).choice(list(LABELS), GRID.shape).astype(np.uint8)
    classes[classes == TOO_FEW] = COMPARED
    found = not_seen_frame(Seen(classes, GRID.cell), GRID, CRS.from_epsg(32651))
    expected = [one for one in NOT_SEEN if one != TOO_FEW]
    assert found["reason"].tolist() == [KEYS[one] for one in expected]
    row, column = np.indices(GRID.shape)
    east, north = GRID.west + (column + 0.5) * GRID.cell, GRID.north - (row + 0.5) * GRID.cell
    for one, shape, area in zip(expected, found.geometry, found["area_m2"], strict=True):
        assert shape.is_valid
        assert np.array_equal(shapely.contains_xy(shape, east, north), classes == one)
        assert area == (classes == one).sum() * 0.25 == shape.area
    assert found.crs.to_epsg() == 32651


def test_a_slope_that_was_compared_as_a_whole_has_no_polygon() -> None:
    found = not_seen_frame(Seen(np.full(GRID.shape, COMPARED, dtype=np.uint8), GRID.cell), GRID, None)
    assert found.empty
    assert list(found.columns) == ["reason", "area_m2", "geometry"]


def test_touching_cells_of_a_reason_are_one_part_and_reasons_do_not_overlap() -> None:
    classes = np.full(GRID.shape, COMPARED, dtype=np.uint8)
    classes[5:25, 5:20], classes[5:25, 20:30] = NOT_IN_BOTH, EXCLUDED
    found = not_seen_frame(Seen(classes, GRID.cell), GRID, None)
    assert [len(shape.geoms) for shape in found.geometry] == [1, 1]
    assert found.geometry[0].intersection(found.geometry[1]).area == 0


def test_the_style_and_its_descriptor_are_hatched_in_the_colour_of_the_maps() -> None:
    style = not_seen_qml()
    (symbol,) = ElementTree.fromstring(style.split("?>", 1)[-1]).iter("renderer-v2")
    assert symbol.get("type") == "singleSymbol"
    assert [one.get("class") for one in symbol.iter("layer")] == ["SimpleFill", "LinePatternFill", "SimpleLine"]
    colour = ",".join(map(str, UNSEEN_STRIPE))
    assert [o.get("value") for o in symbol.iter("Option") if o.get("name") == "line_color"] == [colour]
    fill, hatch = ElementTree.fromstring(sld_of(style, "not_seen").encode()).iter(f"{SLD}PolygonSymbolizer")
    assert fill.find(f"{SLD}Stroke") is None, "an outline of many cells would blacken the map"
    mark = hatch.find(f"{SLD}Fill/{SLD}GraphicFill/{SLD}Graphic/{SLD}Mark")
    assert mark is not None
    (stroke,) = (one.text for one in mark.iter(f"{SLD}CssParameter") if one.get("name") == "stroke")
    assert stroke == "#{:02x}{:02x}{:02x}".format(*UNSEEN_STRIPE[:3])
