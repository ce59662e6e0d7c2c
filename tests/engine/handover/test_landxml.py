"""LandXML against the rules of its schema, and sections with gaps and bends in it and in the drawing."""

from __future__ import annotations

import os
from datetime import date
from pathlib import Path
from xml.etree import ElementTree

import ezdxf
import geopandas as gpd
import numpy as np
import pytest
import shapely
from pyproj import CRS
from slopewatch.engine.grid.geotiff import Raster
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.handover.drawing import write_dxf
from slopewatch.engine.handover.held import Held, HeldLayer, Section, stretches
from slopewatch.engine.handover.landxml import NAMESPACE, write_landxml
from slopewatch.engine.handover.surfaces import mesh
from slopewatch.tests.builders.landxml_rules import faults

_L = {"l": NAMESPACE}
_SCHEMA = "SLOPEWATCH_LANDXML_XSD"
_NAN = float("nan")


def section(name: str = "bent") -> Section:
    """Ten metres to the east and ten to the north; the earlier survey has a gap, and a point alone within it."""
    xy = np.array([[x, 0.0] for x in range(11)] + [[10.0, y] for y in range(1, 11)])
    earlier = np.linspace(100, 120, 21)
    earlier[[5, 6, 8, 9]] = _NAN
    return Section(name, xy, np.arange(21.0), earlier, np.linspace(100, 119, 21))


def held(folder: Path) -> Held:
    grid = Grid(0.0, 10.0, 1.0, 10, 10)
    ground = Raster(np.add.outer(np.arange(10.0), np.arange(10.0)).astype(np.float32), grid, None, "", "m", {})
    alone = np.full((10, 10), _NAN, dtype=np.float32)
    alone[4, 4] = 7.0
    hole = shapely.Polygon([(0, 0), (8, 0), (8, 8), (0, 8)], [[(2, 2), (2, 4), (4, 4), (4, 2)]])
    shapes = [shapely.MultiPolygon([hole, shapely.box(9, 9, 10, 10)]), shapely.box(0, 0, 1, 1)]
    zones = gpd.GeoDataFrame({"zone_id": ["Z1", "Z1"], "kind": ['<&">', ""]}, geometry=shapes, crs=32651)
    surfaces = {"ground earlier": ground, "ground later": Raster(alone, grid, None, "", "m", {})}
    return Held(folder, {"command": "change"}, {}, {}, {}, {}, (HeldLayer("zones", zones, ""),),
                surfaces, (section(), section("two")),
                CRS.from_user_input("EPSG:32651+5773"), (date(2024, 5, 1), date(2025, 5, 1)))  # fmt: skip


@pytest.fixture
def written(tmp_path: Path) -> Path:
    one = held(tmp_path)
    path = tmp_path / "landxml.xml"
    write_landxml(path, one, {name: mesh(surface, 400) for name, surface in one.surfaces.items()}, "Slope 12")
    return path


def test_the_document_keeps_to_the_rules_of_the_schema(written: Path) -> None:
    assert faults(written) == []
    names = [s.get("name") for s in ElementTree.parse(written).getroot().iter(f"{{{NAMESPACE}}}Surface")]
    assert names == ["ground earlier"], "a surface without a triangle is none"


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ('linearUnit="meter"', 'linearUnit="metre"', "Metric/linearUnit"),
        ('staStart="0.000"', "", "Alignment lacks staStart"),
        ('name="two" length', 'name="bent" length', "two Alignment of one name"),
        ("<Start>0.000 0.000</Start>", "", "Line has 0 Start"),
        ('<P id="2">', '<P id="1">', "two P of one id"),
    ],
)
def test_the_rules_find_what_the_schema_would(written: Path, old: str, new: str, fault: str) -> None:
    text = written.read_text(encoding="utf-8")
    assert old in text
    written.write_text(text.replace(old, new, 1), encoding="utf-8")
    assert any(fault in found for found in faults(written))
    # the schema means names and ids to be unique, but its paths have no namespace, so that they select nothing
    if os.environ.get(_SCHEMA, "") and "of one" not in fault:
        assert schema_faults(written)


def schema_faults(path: Path) -> list[str]:
    """By the schema; a skip where there is none."""
    schema = os.environ.get(_SCHEMA, "")
    if not schema:
        pytest.skip(f"no schema at hand: {_SCHEMA} does not name a LandXML-1.2.xsd")
    etree = pytest.importorskip("lxml.etree", reason="lxml is not installed")
    checker = etree.XMLSchema(etree.parse(schema))
    checker.validate(etree.parse(str(path)))
    return [str(error) for error in checker.error_log]


def test_the_document_is_valid_where_the_schema_is_at_hand(written: Path) -> None:
    assert schema_faults(written) == []


def test_nothing_is_drawn_over_a_gap_and_a_bent_section_is_bent(written: Path, tmp_path: Path) -> None:
    root = ElementTree.parse(written).getroot()
    alignment = root.find("l:Alignments/l:Alignment[@name='bent']", _L)
    lines = [[[float(v) for v in line.find(f"l:{end}", _L).text.split()] for end in ("Start", "End")]
             for line in alignment.findall("l:CoordGeom/l:Line", _L)]  # fmt: skip
    assert lines == [[[0, 0], [0, 10]], [[0, 10], [10, 10]]]  # northing, easting
    assert float(alignment.get("length")) == 20
    parts = {s.get("name"): [p.text.split()[::2] for p in s.findall("l:PntList2D", _L)]
             for s in alignment.iter(f"{{{NAMESPACE}}}ProfSurf")}  # fmt: skip
    assert [[float(s) for s in part] for part in parts["earlier"]] == [[0, 1, 2, 3, 4], [*range(10, 21)]]
    assert len(parts["later"]) == 1
    one = held(tmp_path)
    write_dxf(tmp_path / "drawing.dxf", one, {}, {})
    drawn = ezdxf.readfile(tmp_path / "drawing.dxf").modelspace().query('POLYLINE[layer=="SECTIONS_EARLIER"]')
    assert sorted(len(line.vertices) for line in drawn) == [5, 5, 11, 11]


def test_stretches_are_those_of_two_points_or_more() -> None:
    for heights, expected in (
        ([1, 2, _NAN, 3, _NAN, 4, 5], [(0, 2), (5, 7)]), ([_NAN, _NAN], []), ([1.0], []), ([1, 2], [(0, 2)]), ([], []),
    ):  # fmt: skip
        assert [(s.start, s.stop) for s in stretches(np.array(heights, dtype=float))] == expected
