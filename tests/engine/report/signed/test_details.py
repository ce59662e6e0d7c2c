"""Details of a report to sign: texts of places, what each survey has, what is missing."""

from __future__ import annotations

import geopandas as gpd
import pytest
import shapely
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.report.signed.details import chainage_text, details_of, place_text


def record(**details: str) -> dict:
    return {"parameters": {"details": {"pdf": True, **details}}}


@pytest.mark.parametrize(
    ("metres", "text"),
    [(12340.4, "12+340"), (0.0, "0+000"), (999.6, "1+000"), (-25.0, "\u22120+025"), (100.0, "0+100")],
)
def test_a_chainage_is_written_as_on_a_kilometre_post(metres, text):
    assert chainage_text(metres) == text


def test_a_zone_without_a_road_has_no_place_on_it():
    assert place_text({"route": "", "chain_from": float("nan"), "chain_to": None, "side": None}) == ""


def test_a_zone_at_one_chainage_and_with_an_offset():
    zone = {"route": "S320", "chain_from": 50.2, "chain_to": 50.4, "side": "right", "offset_m": 4.26}
    assert place_text(zone) == "S320 0+050, right, 4.3 m"


def test_each_survey_has_its_own_part_or_the_common_one():
    found = details_of(record(sensor="L1；L2", uav="M350"), ["2024", "2025"])
    assert [found.of_flight("sensor", n) for n in (0, 1)] == ["L1", "L2"]
    assert [found.of_flight("uav", n) for n in (0, 1)] == ["M350", "M350"]
    assert [found.of_flight("flight_dates", n) for n in (0, 1)] == ["2024", "2025"]
    assert [found.of_flight("weather", n) for n in (0, 1)] == ["", ""]


def test_missing_details_are_named_in_their_order():
    found = details_of(record(client="A", sensor="B"), ["2024"])
    assert found.missing == ["Name of the slope", "Route", "Chainage", "Author", "Checker", "UAV", "Flying height",
                             "Weather"]  # fmt: skip


def test_route_and_chainage_come_from_the_zones():
    box = shapely.box(0, 0, 1, 1)
    zones = gpd.GeoDataFrame(
        {"route": ["S2", "S1", None], "chain_from": [10.0, 1250.0, None], "chain_to": [20.0, 1300.0, None]},
        geometry=[box] * 3,
    )
    found = details_of(record(), ["2024"], [zones])
    assert (found["report_route"], found["chainage_range"]) == ("S1, S2", "0+010–1+300")
    given = details_of(record(report_route="A 7"), ["2024"], [zones])
    assert given["report_route"] == "A 7"


def test_a_detail_that_is_a_whole_book_is_refused():
    with pytest.raises(
        InputError, match=r"^report_remarks is 1501 letters wide; give 1500 at most, Chinese ones as two"
    ):
        details_of(record(report_remarks="x" * 1501), ["2024"])
    with pytest.raises(InputError, match=r"^slope_name is 162 letters wide; give 160 at most"):
        details_of(record(slope_name="坡" * 81), ["2024"])
