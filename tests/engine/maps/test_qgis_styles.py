"""Styles as XML."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from datetime import date
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from pyproj import CRS
from shapely import MultiPolygon, box, hausdorff_distance, unary_union
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.maps import opacity_band, qgis_styles
from slopewatch.engine.maps.palette import DIVERGING, SEQUENTIAL
from slopewatch.engine.maps.qgis_styles import (
    FOOTPRINT_FIELDS,
    cell_size_qml,
    change_qml,
    confirmed_qml,
    corridor_alerts_qml,
    corridor_zones_qml,
    footprints_qml,
    hazards_qml,
    level_qml,
    probability_qml,
    series_zones_qml,
    smallest_hazard_qml,
    states_qml,
    write_qml_next_to,
    zones_qml,
)
from slopewatch.engine.series.alerts import AlertLevel
from slopewatch.engine.series.tables import SERIES_FIELDS, ZONE_FIELDS
from slopewatch.engine.vector.review_fields import REVIEW_FIELDS
from slopewatch.engine.zones import confirmation
from slopewatch.engine.zones.extraction import footprint_frame
from slopewatch.engine.zones.fields import FIELDS, SEVERITIES, ZONE_KINDS
from slopewatch.interface.parameters import ZoneParameters
from slopewatch.models.screening import zones
from slopewatch.tests.builders.change_zones import zones_of
from slopewatch.tests.builders.styles import stops
from slopewatch.workflows.batch import alert_events, corridor_zones

ALERT = AlertLevel(3, "alarm", "#b40426", 2, 1.0, None, None, None, 0.1, 2, "close the road")
GRID = Grid(west=500000.0, north=4000030.0, cell=0.5, rows=60, columns=80)


def names_of(root: ElementTree.Element) -> set[str]:
    """The fields that a style names for people; each has a column in the attribute table."""
    aliases = {alias.get("field"): alias.get("name") for alias in root.iter("alias")}
    assert all(aliases.values())
    assert {column.get("name") for column in root.iter("column")} == set(aliases)
    return set(aliases)


def test_change_is_centred_on_zero_and_symmetrical() -> None:
    for level in (None, 0.07):
        found = stops(change_qml(0.4, level))
        values = [value for value, *_ in found]
        assert values == sorted(values)
        assert values == pytest.approx([-v for v in reversed(values)])
        assert (values[0], values[-1]) == (-0.4, 0.4)
        assert found[0][1] == "#{:02x}{:02x}{:02x}".format(*DIVERGING[-1][1])
        assert found[-1][1] == "#{:02x}{:02x}{:02x}".format(*DIVERGING[-1][2])
        assert "lowered" in found[0][3]
        assert "raised" in found[-1][3]


def test_below_the_level_is_a_faint_grey() -> None:
    found = stops(change_qml(0.4, 0.07))
    inner = [(value, colour, alpha) for value, colour, alpha, _ in found if alpha < 255]
    assert [value for value, *_ in inner] == [-0.07, 0.07]
    assert all(colour[1:3] == colour[3:5] == colour[5:7] for _, colour, _ in inner)
    beyond = [alpha for value, _, alpha, _ in found if abs(value) > 0.07]
    assert len(beyond) >= 4
    assert set(beyond) == {255}
    assert any("below the level of detection" in label for *_, label in found)


def test_a_level_beyond_the_range_is_left_out() -> None:
    for level in (0.5, 0.0, float("nan")):
        assert {alpha for *_, alpha, _ in stops(change_qml(0.4, level))} == {255}


def test_the_opacity_is_a_band_of_the_raster() -> None:
    assert 'alphaBand="2"' in change_qml(0.4, opacity_band=2)
    assert 'alphaBand="-1"' in change_qml(0.4)
    assert any("pale: within the cell's level" in label for *_, label in stops(change_qml(0.4, opacity_band=2)))


def test_the_legend_says_what_cells_without_colour_are() -> None:
    words = "no colour: compared, no change above the level"
    assert [value for value, *_, label in stops(change_qml(0.4, only_beyond=True)) if label == words] == [0.0]
    assert not any(label == words for *_, label in stops(change_qml(0.4)))


def test_cells_within_their_level_are_pale_and_those_without_data_stay_so() -> None:
    found = opacity_band.opacity(np.array([0.3, 0.3, np.nan, np.nan]), np.array([True, False, True, False]))
    np.testing.assert_array_equal(found, [255, opacity_band.WITHIN, np.nan, np.nan])
    assert 0 < opacity_band.WITHIN < 64


def test_level_ramp_runs_from_zero() -> None:
    assert [v for v, *_ in stops(level_qml(0.2))] == pytest.approx([0.2 * s for s, _ in SEQUENTIAL])


def test_zones_have_a_symbol_for_every_kind_and_severity() -> None:
    root = ElementTree.fromstring(zones_qml())
    categories = {c.get("value"): c.get("symbol") for c in root.iter("category")}
    assert set(categories) == {f"{kind}, {severity}" for kind in ZONE_KINDS for severity in SEVERITIES}
    assert set(categories.values()) == {s.get("name") for s in root.findall("renderer-v2/symbols/symbol")}
    assert names_of(root) == set(FIELDS)


def test_footprints_have_a_symbol_for_every_kind_and_names_for_their_own_fields() -> None:
    root = ElementTree.fromstring(footprints_qml().partition("\n")[2])
    categories = {c.get("value"): c.get("symbol") for c in root.iter("category")}
    assert set(categories) == set(ZONE_KINDS)
    assert set(categories.values()) == {s.get("name") for s in root.findall("renderer-v2/symbols/symbol")}
    assert names_of(root) == set(FOOTPRINT_FIELDS)
    # they are not reviewed
    assert {f.get("name") for f in root.iterfind("fieldConfiguration/field")} <= set(FOOTPRINT_FIELDS)
    none = np.zeros(GRID.shape)
    count = none.astype(int)
    found = zones_of(none, none > 0, none + 1, none + 1, count, GRID, CRS(32651), ZoneParameters())
    assert list(footprint_frame(found, GRID).columns.drop("geometry")) == list(FOOTPRINT_FIELDS)


def test_a_corridors_zones_and_alerts_have_symbols_and_names() -> None:
    root = ElementTree.fromstring(corridor_zones_qml(corridor_zones.FIELDS).partition("\n")[2])
    assert [c.get("value") for c in root.iter("category")] == ["0", "1", "2", "3", "4"]
    assert names_of(root) == set(corridor_zones.FIELDS)
    states, entered = alert_events.STATES, ("state", "state_reason", "reviewer", "remarks")
    root = ElementTree.fromstring(corridor_alerts_qml(alert_events.FIELDS, states, entered).partition("\n")[2])
    assert tuple(c.get("value") for c in root.iter("category")) == states
    offered = root.iterfind("fieldConfiguration/field[@name='state']//Option[@type='QString']")
    assert tuple(option.get("value") for option in offered) == states
    assert {f.get("name") for f in root.iterfind("editable/field")} == set(alert_events.FIELDS) - set(entered)


def test_screened_zones_that_a_change_was_asked_about_show_its_answer() -> None:
    for answer in ((), tuple(confirmation.FIELDS)):
        root = ElementTree.fromstring(hazards_qml([*zones.FIELDS, *answer]).partition("\n")[2])
        assert names_of(root) == {*zones.FIELDS, *answer}
        assert ('"confirmed"' in root.findtext("mapTip")) == bool(answer)


def test_zones_of_a_series_have_the_names_and_colours_of_its_alerts() -> None:
    alerts = [replace(ALERT, level=0, name='none & "rest"', colour="#9e9e9e"), ALERT]
    root = ElementTree.fromstring(series_zones_qml(alerts).partition("\n")[2])
    categories = {c.get("value"): c.get("label") for c in root.iter("category")}
    assert categories == {"0": '0 none & "rest"', "3": "3 alarm"}
    fills = [option.get("value") for option in root.iter("Option") if option.get("name") == "color"]
    assert fills == ["158,158,158,40", "180,4,38,40"]
    assert names_of(root) == set(ZONE_FIELDS)
    assert (title(root, "motion_m"), title(root, "motion_err_m")) == (
        "Motion along the surface (m)", "Standard error of motion along the surface (m)",
    )  # fmt: skip
    slides = ElementTree.fromstring(zones_qml())
    assert title(slides, "motion_m") == "Length of its motion (m)"


def title(root: ElementTree.Element, field: str) -> str:
    """What analysts read in place of a field."""
    return next(alias.get("name") for alias in root.iter("alias") if alias.get("field") == field)


def test_no_field_is_explained_twice() -> None:
    def once(pairs: list[tuple[str, dict]]) -> dict:
        assert len({name for name, _ in pairs}) == len(pairs)
        return dict(pairs)

    json.loads(
        (Path(qgis_styles.__file__).parent / "styles" / "fields.json").read_text("utf-8"), object_pairs_hook=once
    )


def test_states_of_a_series_follow_the_time_and_cannot_be_edited() -> None:
    root = ElementTree.fromstring(states_qml().partition("\n")[2])
    temporal = root.find("temporal")
    assert (temporal.get("startField"), temporal.get("endField")) == ("time_from", "time_to")
    assert {f.get("name") for f in root.iterfind("editable/field[@editable='0']")} == set(SERIES_FIELDS)
    assert {c.get("value") for c in root.iter("category")} == {"lowered", "raised", "below its level", "not measured"}


def test_a_raster_is_shown_from_the_day_after_the_earlier_survey() -> None:
    days = date(2024, 1, 31), date(2024, 3, 1)
    for shown, plain in (
        (change_qml(0.4, 0.07, shown=days), change_qml(0.4, 0.07)),
        (level_qml(0.2, shown=days), level_qml(0.2)),
    ):
        root = ElementTree.fromstring(shown.partition("\n")[2])
        assert root.findtext("temporal/fixedRange/start") == "2024-02-01T00:00:00Z"
        assert root.findtext("temporal/fixedRange/end") == "2024-03-01T23:59:59Z"
        assert "Temporal" in root.get("styleCategories")
        assert stops(shown) == stops(plain)
        assert "emporal" not in plain


def test_velocities_have_their_unit_in_every_label() -> None:
    for qml in (change_qml(4.0, 0.7, unit="mm/day"), level_qml(2.0, unit="mm/day")):
        labels = [label for *_, label in stops(qml)]
        assert len(labels) > 4
        assert all("mm/day" in label for label in labels if label != "below the level of detection")
        assert ElementTree.fromstring(qml).find(".//rampLegendSettings").get("suffix") == " mm/day"


def test_comparisons_that_confirm_a_cell_darken_with_their_number() -> None:
    entries = ElementTree.fromstring(confirmed_qml(3)).findall(".//paletteEntry")
    assert [e.get("label") for e in entries] == [
        "none", "1 comparison, not confirmed", "2 comparisons in a row", "3 comparisons in a row",
    ]  # fmt: skip
    assert [e.get("alpha") for e in entries] == ["0", "255", "255", "255"]
    light = [sum(bytes.fromhex(e.get("color")[1:])) for e in entries]
    assert light == sorted(light, reverse=True)


def test_probability_is_a_veil_at_zero_and_has_no_colour() -> None:
    found = stops(probability_qml())
    assert [(value, label) for value, _, _, label in found] == [(s / 4, f"{25 * s} %") for s in range(5)]
    assert 0 < found[0][2] < 128
    assert [alpha for _, _, alpha, _ in found[1:]] == [255] * 4
    assert all(colour[1:3] == colour[3:5] == colour[5:7] for _, colour, _, _ in found)


def test_the_smallest_hazard_is_shown_for_3_m_from_light_to_dark() -> None:
    qml = smallest_hazard_qml()
    found = stops(qml)
    assert [value for value, *_ in found] == [0.0, 0.25, 0.5, 0.75, 1.0]
    lightness = [sum(bytes.fromhex(colour[1:])) for _, colour, *_ in found]
    assert lightness == sorted(lightness, reverse=True)
    assert ElementTree.fromstring(qml.partition("\n")[2]).find("pipe/rasterrenderer").get("band") == "2"
    assert ElementTree.fromstring(level_qml(1.0)).find("pipe/rasterrenderer").get("band") == "1"


def outlined(qml: str, zone: MultiPolygon) -> MultiPolygon:
    """What the style's outline goes around."""
    expression = ElementTree.fromstring(qml).find(".//Option[@name='geometryModifier']").get("value")
    out, back = map(
        float, re.fullmatch(r"boundary\(buffer\(buffer\(.geometry, (.+), 4\), (.+), 4\)\)", expression).groups()
    )
    return zone.buffer(out, 4).buffer(back, 4)


def test_outlines_follow_screened_zones_and_gather_the_cells_of_a_change() -> None:
    # cells of 0.25 m: a comb, whose gaps belong to another zone
    comb = unary_union([box(0, 0, 5, 1), *(box(x, 1, x + 0.5, 2) for x in range(5))])
    seen = outlined(hazards_qml(zones.FIELDS), comb)
    assert hausdorff_distance(seen.boundary.segmentize(0.05), comb.boundary.segmentize(0.05)) < 0.13
    assert seen.contains(comb)
    apart = MultiPolygon([box(x * 0.75, 0, x * 0.75 + 0.25, 0.25) for x in range(4)])
    assert outlined(zones_qml(), apart).geom_type == "Polygon"
    assert outlined(hazards_qml(zones.FIELDS), apart).geom_type == "MultiPolygon"


def test_measured_figures_are_rounded_where_they_are_read_and_not_where_they_are_kept() -> None:
    for qml, fields in ((zones_qml(), FIELDS), (hazards_qml(zones.FIELDS), zones.FIELDS)):
        root = ElementTree.fromstring(qml.partition("\n")[2])
        rounded = {
            field.get("name"): int(field.find(".//Option[@name='Precision']").get("value"))
            for field in root.iter("field")
            if field.find("editWidget[@type='Range']") is not None
        }
        others = {"chain_from", "chain_to", "confidence"}
        measured = {name for name, kind in fields.items() if kind == "real"} - others
        assert set(rounded) == measured
        # people enter their review, and nothing else
        locked = {f.get("name") for f in root.iterfind("editable/field[@editable='0']")}
        assert locked == set(fields) - set(REVIEW_FIELDS)
        assert measured < locked


def test_written_where_qgis_looks(tmp_path: Path) -> None:
    path = write_qml_next_to(tmp_path / "elevation_change.tif", level_qml(0.2))
    assert path == tmp_path / "elevation_change.qml"
    assert path.read_text(encoding="utf-8") == level_qml(0.2)


def test_each_size_of_grown_cells_has_its_colour() -> None:
    """In the legend and on the map: the finest the lightest, each darker than the one before."""
    root = ElementTree.fromstring(cell_size_qml([0.1, 0.2, 0.4, 1.6]))
    items = root.findall(".//item")
    assert [float(item.attrib["value"]) for item in items] == [0.1, 0.2, 0.4, 1.6]
    assert [item.attrib["label"] for item in items] == ["0.1 m", "0.2 m", "0.4 m", "1.6 m"]
    light = [sum(bytes.fromhex(item.attrib["color"][1:7])) for item in items]
    assert light == sorted(light, reverse=True)
    assert len(set(light)) == 4
