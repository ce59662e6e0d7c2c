"""Alerts from run to run: what people entered stays, and each ends or is raised again with a reason."""

from __future__ import annotations

from typing import Any

import geopandas as gpd
import pytest
import shapely
from slopewatch.workflows.batch.alert_events import FIELDS, follow_alerts, open_of
from slopewatch.workflows.batch.corridor_zones import FIELDS as ZONE_FIELDS
from slopewatch.workflows.batch.corridor_zones import attention_of
from slopewatch.workflows.batch.table_columns import column_of


def zones(*rows: tuple[str, int, float], kind: str = "subsidence") -> gpd.GeoDataFrame:
    """Zones of slopes: (zone id, attention, x of a square of 4 m)."""
    shapes = [shapely.MultiPolygon([shapely.box(x, 0, x + 4, 4)]) for _, _, x in rows]
    values: list[dict[str, Any]] = [
        {
            "zone_id": name, "slope": name.partition("/")[0], "source": "series", "attention": attention, "kind": kind,
            "alert_level": attention, "alert": "Warning", "alert_reason": "rate 2 mm/day", "location": "",
            "chain_from": 1.0,
        }
        for name, attention, _ in rows
    ]  # fmt: skip
    columns = {name: column_of([v.get(name) for v in values], kind) for name, kind in ZONE_FIELDS.items()}
    return gpd.GeoDataFrame(columns, geometry=shapes, crs=32651)


def events(frame: gpd.GeoDataFrame) -> set[tuple[Any, ...]]:
    return {
        (r["zone_id"], int(r["attention"]), r["state"], r["raised_on"], r["ended_on"]) for r in frame.to_dict("records")
    }


def entered(frame: gpd.GeoDataFrame, row: int = 0, **entries: str) -> gpd.GeoDataFrame:
    frame = frame.copy()
    for name, value in entries.items():
        frame.loc[row, name] = value
    return frame


FIRST, SECOND, THIRD = "2024-01-01", "2024-02-01", "2024-03-01"


@pytest.fixture
def raised() -> gpd.GeoDataFrame:
    return follow_alerts(None, zones(("A/1", 2, 0.0), ("A/2", 0, 20.0)), {"A": FIRST})


def test_a_zone_that_asks_raises_one(raised: gpd.GeoDataFrame) -> None:
    assert events(raised) == {("A/1", 2, "raised", FIRST, "")}
    assert list(raised.columns) == [*FIELDS, "geometry"]
    assert raised.loc[0, "reason"] == "Warning: rate 2 mm/day"
    assert len(raised.loc[0, "alert_id"]) == 10


def test_it_stays_with_what_people_entered_while_the_zone_asks_for_as_much(raised: gpd.GeoDataFrame) -> None:
    seen = entered(raised, state="acknowledged", reviewer="A. Sato", state_reason="crew sent", remarks="wet")
    later = follow_alerts(seen, zones(("A/7", 2, 0.5)), {"A": SECOND})
    (row,) = later.to_dict("records")
    assert (row["state"], row["reviewer"], row["state_reason"], row["remarks"]) == (
        "acknowledged", "A. Sato", "crew sent", "wet",
    )  # fmt: skip
    assert (row["raised_on"], row["last_on"], row["zone_id"]) == (FIRST, SECOND, "A/7"), "found by its place"
    assert row["alert_id"] == raised.loc[0, "alert_id"]


@pytest.mark.parametrize("attention", [1, 3])
def test_more_or_less_attention_closes_it_and_raises_another(raised: gpd.GeoDataFrame, attention: int) -> None:
    later = follow_alerts(raised, zones(("A/1", attention, 0.0)), {"A": SECOND})
    assert events(later) == {("A/1", 2, "closed", FIRST, SECOND), ("A/1", attention, "raised", SECOND, "")}
    closed = later[later["state"] == "closed"].iloc[0]
    assert closed["state_reason"] == f"Its attention is {attention} instead of 2 at the survey of {SECOND}."
    last = follow_alerts(later, zones(("A/1", attention, 0.0)), {"A": THIRD})
    assert events(last) == events(later), "the closed one does not speak for the zone"


@pytest.mark.parametrize(
    ("now", "words"), [((("A/1", 0, 0.0),), "does not ask for attention any more"), ((("A/9", 0, 90.0),), "No zone of")]
)
def test_it_ends_with_its_zone_and_can_return(raised: gpd.GeoDataFrame, now: tuple[Any, ...], words: str) -> None:
    later = follow_alerts(entered(raised, state_reason="look"), zones(*now), {"A": SECOND})
    assert events(later) == {("A/1", 2, "closed", FIRST, SECOND)}
    assert later.loc[0, "state_reason"].startswith("look ")
    assert words in later.loc[0, "state_reason"]
    again = follow_alerts(later, zones(("A/1", 2, 0.0)), {"A": THIRD})
    assert events(again) == {("A/1", 2, "closed", FIRST, SECOND), ("A/1", 2, "raised", THIRD, "")}
    assert again["alert_id"].is_unique


def test_what_people_closed_is_not_raised_again_until_there_is_more(raised: gpd.GeoDataFrame) -> None:
    closed = entered(raised, state=" Closed", state_reason="repaired")
    for attention in (2, 1):
        later = follow_alerts(closed, zones(("A/1", attention, 0.0)), {"A": SECOND})
        assert events(later) == {("A/1", 2, " Closed", FIRST, "")}
    more = follow_alerts(closed, zones(("A/1", 3, 0.0)), {"A": SECOND})
    assert events(more) == {("A/1", 2, " Closed", FIRST, ""), ("A/1", 3, "raised", SECOND, "")}
    gone = follow_alerts(closed, zones(("A/1", 0, 0.0)), {"A": SECOND})
    assert events(gone) == {("A/1", 2, " Closed", FIRST, SECOND)}
    back = follow_alerts(gone, zones(("A/1", 2, 0.0)), {"A": THIRD})
    assert ("A/1", 2, "raised", THIRD, "") in events(back)


def test_a_slope_that_failed_keeps_its_events_and_others_are_not_mixed(raised: gpd.GeoDataFrame) -> None:
    both = follow_alerts(raised, zones(("B/1", 2, 0.0)), {"B": SECOND})
    assert events(both) == {("A/1", 2, "raised", FIRST, ""), ("B/1", 2, "raised", SECOND, "")}
    none = follow_alerts(both, zones(), {})
    assert events(none) == events(both)
    other = follow_alerts(raised, zones(("A/1", 2, 0.0), kind="uplift"), {"A": SECOND})
    assert events(other) == {("A/1", 2, "closed", FIRST, SECOND), ("A/1", 2, "raised", SECOND, "")}


def test_nothing_at_all_has_the_fields() -> None:
    empty = follow_alerts(None, zones(), {})
    assert (list(empty.columns), len(empty)) == ([*FIELDS, "geometry"], 0)


@pytest.mark.parametrize(
    ("source", "zone", "attention"),
    [
        ("series", {"alert_level": 3}, 3),
        ("series", {"alert_level": None}, 0),
        ("change", {"severity": "high"}, 2),
        ("change", {"severity": "moderate"}, 1),
        ("change", {"severity": "unsure"}, 0),
        ("screening", {"severity": "high", "status": ""}, 1),
        ("screening", {"severity": "medium", "status": ""}, 0),
        ("screening", {"severity": "high", "status": "not confirmed"}, 0),
    ],
)
def test_how_much_a_zone_asks_for(source: str, zone: dict[str, Any], attention: int) -> None:
    assert attention_of(source, zone) == attention


def test_a_level_that_the_series_withdrew_is_withdrawn_with_its_reason(raised: gpd.GeoDataFrame) -> None:
    quiet = zones(("A/1", 0, 0.0))
    quiet[["alert_state", "alert_reason"]] = ["withdrawn", "level 2 withdrawn: no motion seen for 2 surveys or more"]
    later = follow_alerts(raised, quiet, {"A": SECOND})
    assert events(later) == {("A/1", 2, "withdrawn", FIRST, SECOND)}
    assert later.loc[0, "state_reason"].endswith("level 2 withdrawn: no motion seen for 2 surveys or more.")
    assert not len(open_of(later))
    again = follow_alerts(later, zones(("A/1", 2, 0.0)), {"A": THIRD})
    assert events(again) == {("A/1", 2, "withdrawn", FIRST, SECOND), ("A/1", 2, "raised", THIRD, "")}


def test_zones_of_one_body_have_one_event(raised: gpd.GeoDataFrame) -> None:
    parts = zones(("A/1", 2, 0.0), ("A/2", 2, 20.0))
    parts["body"] = "A/2"
    later = follow_alerts(raised, parts, {"A": SECOND})
    assert events(later) == {("A/1", 2, "closed", FIRST, SECOND), ("A/2", 2, "raised", SECOND, "")}
    closed = later[later["state"] == "closed"].iloc[0]
    assert closed["state_reason"] == f"It is one body with A/2 at the survey of {SECOND}."
