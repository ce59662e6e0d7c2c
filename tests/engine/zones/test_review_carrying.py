"""What people entered is found again after a run, whatever became of the zones."""

from __future__ import annotations

from collections.abc import Callable

import geopandas as gpd
import numpy as np
import pytest
import shapely
from shapely import MultiPolygon, box
from slopewatch.engine.series.tables import ZONE_FIELDS
from slopewatch.engine.vector.review_fields import REVIEW_FIELDS, in_words, is_entered, own_columns
from slopewatch.engine.zones.fields import FIELDS
from slopewatch.engine.zones.matching import match_zones
from slopewatch.engine.zones.review_carrying import carry_reviews
from slopewatch.tests.builders.zone_layers import Rectangle, entered, zone_layer

SMALL, LARGE = (0.0, 0.0, 2.0, 2.0), (3.0, 0.0, 9.0, 6.0)


def reviewed(rectangles: list[Rectangle], **options) -> gpd.GeoDataFrame:
    """A layer whose zones all have a review that no other has."""
    zones = zone_layer(rectangles, **options)
    for row in range(len(zones)):
        entered(
            zones, row, review_status=("confirmed", "rejected")[row % 2], reviewer=f"person {row}",
            remarks=f"remark {row}.", slope_id=f"slope {row}", route="S1", chain_from=100.0 + row,
            chain_to=101.0 + row, side="left",
        )  # fmt: skip
    return zones


def test_the_same_zones_keep_all_that_was_entered() -> None:
    old = reviewed([SMALL, LARGE])
    new = zone_layer([LARGE, SMALL, (20, 20, 23, 23)], run="r2")
    found = carry_reviews(old, new)
    fields = list(REVIEW_FIELDS)
    assert found.frame.loc[[1, 0], fields].to_numpy().tolist() == old[fields].to_numpy().tolist()
    assert found.frame.loc[2, fields].equals(new.loc[2, fields])
    assert found.frame.drop(columns=fields).equals(new.drop(columns=fields))
    assert list(found.frame.columns) == list(new.columns)
    assert found.frame.dtypes.equals(new.dtypes)
    assert (found.count, len(found.rest), found.joined, found.split) == (2, 0, 0, 0)
    # and again, without a word more
    again = carry_reviews(found.frame, zone_layer([SMALL, LARGE], run="r3"))
    assert again.frame[fields].to_numpy().tolist() == old[fields].to_numpy().tolist()


def test_zones_that_grew_together_say_what_all_of_them_said() -> None:
    old = reviewed([SMALL, LARGE])
    found = carry_reviews(old, zone_layer([(0, 0, 9, 6)], run="r2"))
    zone = found.frame.iloc[0]
    assert zone[["review_status", "reviewer", "slope_id", "chain_from"]].tolist() == [
        "rejected", "person 1", "slope 1", 101.0,
    ]  # fmt: skip
    assert zone["remarks"] == (
        "remark 1. Also Z001 of run r1: confirmed by person 0; slope_id: slope 0; chain_from: 100; chain_to: 101; "
        "remarks: remark 0.."
    )
    assert (found.count, found.joined, len(found.rest)) == (2, 1, 0)


def test_a_small_rejected_zone_does_not_reject_the_large_one_it_went_into() -> None:
    old = entered(zone_layer([SMALL, LARGE]), 0, review_status="rejected", reviewer="A. Sato", route="S1")
    zone = carry_reviews(old, zone_layer([(0, 0, 9, 6)])).frame.iloc[0]
    assert (zone["review_status"], zone["reviewer"]) == ("unreviewed", "")
    assert zone["remarks"] == "Also Z001 of run r1: rejected by A. Sato."
    assert zone["route"] == "S1"  # where it lies holds for the whole


def test_the_day_of_a_review_stays_with_its_state() -> None:
    old = entered(zone_layer([SMALL, LARGE]), 0, review_status="rejected", reviewer="A. Sato")
    old["review_date"] = ["2025-05-02", None]
    zone = carry_reviews(old, zone_layer([(0, 0, 9, 6)]), own=("review_date",)).frame.iloc[0]
    assert str(zone.get("review_date")) in ("None", "nan", "")
    assert zone["remarks"] == "Also Z001 of run r1: rejected by A. Sato on 2025-05-02."
    kept = carry_reviews(old, zone_layer([SMALL, LARGE]), own=("review_date",)).frame
    assert kept["review_date"].tolist()[0] == "2025-05-02"


def test_every_part_of_a_zone_that_came_apart_has_its_review() -> None:
    old = reviewed([(0, 0, 10, 4)])
    found = carry_reviews(old, zone_layer([(0, 0, 4, 4), (6, 0, 10, 4)], run="r2"))
    assert found.frame["review_status"].tolist() == ["confirmed"] * 2
    assert found.frame["slope_id"].tolist() == ["slope 0"] * 2
    assert set(found.frame["remarks"]) == {"remark 0. Z001 of run r1 came apart into Z001, Z002."}
    assert (found.count, found.split) == (1, 1)
    again = carry_reviews(found.frame, zone_layer([(0, 0, 4, 4), (6, 0, 10, 4)], run="r3"))
    assert again.frame["remarks"].tolist() == found.frame["remarks"].tolist()


def test_a_neighbour_with_a_history_of_its_own_gets_nothing() -> None:
    ring = shapely.difference(box(0, 0, 10, 10), box(4, 4, 5.2, 5.2))
    old = entered(zone_layer([(0, 0, 10, 10), (4.1, 4.1, 5.1, 5.1)]), 0, review_status="confirmed")
    old.loc[[0], "geometry"] = MultiPolygon([ring])  # whose gathered outline closes over the small one
    found = carry_reviews(old, old.assign(review_status="unreviewed"))
    assert found.frame["review_status"].tolist() == ["confirmed", "unreviewed"]
    assert found.frame["remarks"].tolist() == ["", ""]


def test_scattered_cells_are_the_same_zone_though_no_cell_is() -> None:
    def cells(shift: float) -> MultiPolygon:
        return MultiPolygon([box(x + shift, y, x + shift + 0.1, y + 0.1) for x in range(5) for y in range(5)])

    old, new = zone_layer([SMALL]), zone_layer([SMALL])
    old.loc[[0], "geometry"], new.loc[[0], "geometry"] = cells(0.0), cells(0.3)
    tight = MultiPolygon([box(x * 0.6, y * 0.6, x * 0.6 + 0.1, y * 0.6 + 0.1) for x in range(5) for y in range(5)])
    old.loc[[0], "geometry"], new.loc[[0], "geometry"] = tight, shapely.transform(tight, lambda p: p + 0.3)
    assert old.geometry.intersection(new.geometry).area.sum() == 0
    assert carry_reviews(entered(old, 0, review_status="confirmed"), new).count == 1


@pytest.mark.parametrize(
    ("place", "kind", "why"),
    [
        ((30, 0, 32, 2), "subsidence", "no zone of these results continues it"),
        (SMALL, "uplift", "only a zone of the other kind lies there now"),
        ((1.9, 0, 3.9, 2), "subsidence", "no zone of these results continues it"),
    ],
)
def test_what_nothing_continues_is_handed_back(place, kind, why) -> None:
    old = reviewed([SMALL, (50, 0, 52, 2)])
    found = carry_reviews(old, zone_layer([place, (50, 0, 52, 2)], kinds=[kind, "subsidence"]))
    assert found.count == 1
    assert found.rest["why_not_carried"].tolist() == [why]
    assert found.rest[list(REVIEW_FIELDS)].iloc[0].tolist() == old[list(REVIEW_FIELDS)].iloc[0].tolist()
    assert found.rest.geometry.iloc[0].equals(old.geometry.iloc[0])
    assert found.frame["review_status"].tolist() == ["unreviewed", "rejected"]


def test_nothing_entered_changes_nothing() -> None:
    new = zone_layer([SMALL])
    found = carry_reviews(zone_layer([SMALL]), new)
    assert found.frame is new
    assert (found.count, len(found.rest)) == (0, 0)
    assert len(carry_reviews(reviewed([SMALL]), zone_layer([])).rest) == 1


def test_columns_that_people_added_go_along() -> None:
    old = zone_layer([SMALL, LARGE, (20, 0, 22, 2)])
    old["Photo"] = ["a.jpg", None, None]
    old["visits"] = [3, 0, 1]
    old["closed"] = [True, False, False]
    old["Remarks"] = ["", "entered before there was such a field", ""]
    old = old.drop(columns="remarks")
    own = own_columns(old, FIELDS)
    assert own == ("Photo", "visits", "closed")
    found = carry_reviews(old, zone_layer([LARGE, SMALL]), own)
    assert found.frame["Photo"].fillna("none").tolist() == ["none", "a.jpg"]
    assert found.frame["visits"].tolist() == [0, 3]
    assert found.frame["visits"].dtype == "Int64"
    assert found.frame["closed"].tolist() == [False, True]
    assert found.frame["remarks"].tolist() == ["entered before there was such a field", ""]
    assert found.rest["visits"].tolist() == [1]


def test_another_reference_system_and_rows_without_shape() -> None:
    old = reviewed([SMALL, LARGE])
    old.loc[[1], "geometry"] = None
    place = gpd.GeoSeries([box(500_000, 4_000_000, 500_010, 4_000_010)], crs=32651)
    old.loc[[0], "geometry"] = [MultiPolygon([place.iloc[0]])]
    new = zone_layer([SMALL])
    new.loc[[0], "geometry"] = [MultiPolygon([place.to_crs(4326).to_crs(32652).iloc[0]])]
    found = carry_reviews(old, new.set_crs(32652, allow_override=True))
    assert found.frame["reviewer"].tolist() == ["person 0"]
    assert found.rest["reviewer"].tolist() == ["person 1"]


def test_a_chainage_that_is_no_number_is_kept_as_a_remark() -> None:
    old = zone_layer([SMALL]).astype({"chain_from": object})
    found = carry_reviews(entered(old, 0, chain_from="12+300", remarks="crack"), zone_layer([SMALL]))
    assert found.frame["remarks"].tolist() == ["crack; chain_from: 12+300"]
    assert np.isnan(found.frame["chain_from"].iloc[0])


def test_persistent_ids_count_where_the_place_agrees() -> None:
    old = reviewed([(0, 0, 4, 4), (4.2, 0, 9, 4)], ids=["S001", "S002"], fields=ZONE_FIELDS)
    # S001 grew over most of S002, which kept its id
    new = zone_layer([(0, 0, 8, 4), (8.2, 0, 9, 4)], ids=["S001", "S002"], fields=ZONE_FIELDS)
    assert match_zones(old, new).sources[0] != match_zones(old, new, persistent_ids=True).sources[0]
    found = carry_reviews(old, new, persistent_ids=True)
    assert found.frame["reviewer"].tolist() == ["person 0", "person 1"]
    # the numbers of other parameters say nothing
    new = zone_layer([(4.2, 0, 9, 4), (0, 0, 4, 4)], ids=["S001", "S002"], fields=ZONE_FIELDS)
    found = carry_reviews(old, new, persistent_ids=True)
    assert found.frame["reviewer"].tolist() == ["person 1", "person 0"]


def test_words() -> None:
    assert [is_entered("review_status", v) for v in ("unreviewed", "", None, float("nan"), "confirmed")] == [
        False, False, False, False, True,
    ]  # fmt: skip
    assert is_entered("chain_from", 0.0)
    assert in_words({"reviewer": "A", "remarks": "x"}) == "entries by A; remarks: x"


def _later(rng: np.random.Generator, old: list[Rectangle]) -> list[tuple[Rectangle, set[int]]]:
    """Rectangles of another run and which of the old ones each continues; some vanish, merge, come apart or begin."""
    found: list[tuple[Rectangle, set[int]]] = []
    number = 0
    while number < len(old):
        w, s, e, n = old[number]
        fate = rng.choice(["moved", "grown", "apart", "together", "gone"], p=[0.35, 0.2, 0.15, 0.2, 0.1])
        if fate == "together" and number + 1 < len(old) and old[number + 1][0] > w:
            found.append(((w, s, old[number + 1][2], n), {number, number + 1}))
            number += 2
            continue
        if fate == "apart":
            middle, gap = (w + e) / 2, 0.75
            found += [((w, s, middle - gap, n), {number}), ((middle + gap, s, e, n), {number})]
        elif fate == "grown":
            found.append(((w - 0.5, s - 0.5, e + 0.5, n + 0.5), {number}))
        elif fate != "gone":
            dx, dy = rng.uniform(-0.6, 0.6, 2)
            found.append(((w + dx, s + dy, e + dx, n + dy), {number}))
        number += 1
    found.append(((0, -40, 4, -36), set()))
    return [found[i] for i in rng.permutation(len(found))]


def _cells_of(zones: gpd.GeoDataFrame, rng: np.random.Generator) -> gpd.GeoDataFrame:
    """The zones as a run finds them under plants: three in four of their cells of half a metre."""
    shapes = []
    for shape in zones.geometry:
        w, s, e, n = shape.bounds
        x, y = np.meshgrid(np.arange(w, e, 0.5), np.arange(s, n, 0.5))
        keep = rng.random(x.size) < 0.75
        cells = shapely.box(x.ravel()[keep], y.ravel()[keep], x.ravel()[keep] + 0.5, y.ravel()[keep] + 0.5)
        whole = shapely.union_all(cells)
        shapes.append(whole if whole.geom_type == "MultiPolygon" else MultiPolygon([whole]))
    return zones.set_geometry(gpd.GeoSeries(shapes, crs=zones.crs))


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("layer", ["inspect", "series"])
def test_twenty_runs_again_keep_every_review(seed: int, layer: str) -> None:
    """Reviews of zones that continue are with all zones that continue them, those of others are handed back."""
    rng = np.random.default_rng(seed)
    fields, persistent = (ZONE_FIELDS, True) if layer == "series" else (FIELDS, False)
    columns, rows = 4, 4
    places = []
    for row in range(rows):
        west = 0.0
        for _ in range(columns):
            wide = rng.uniform(3, 8)
            places.append((west, 15.0 * row, west + wide, 15.0 * row + rng.uniform(3, 8)))
            west += wide + 2.5
    zones = _cells_of(reviewed(places, fields=fields), rng)
    later = _later(rng, places)
    make: Callable[..., gpd.GeoDataFrame] = zone_layer
    ids: list[str] | None = None
    if layer == "series":  # a zone that continues one keeps its id; a part that came away, and a new one, have others
        taken: set[int] = set()
        ids = []
        for number, (_, sources) in enumerate(later):
            first = min(sources, default=-1)
            ids.append(f"S{first + 1:03d}" if first >= 0 and first not in taken else f"S{100 + number}")
            taken.add(first)
        zones["zone_id"] = [f"S{i + 1:03d}" for i in range(len(zones))]
    new = _cells_of(make([place for place, _ in later], ids=ids, run="r2", fields=fields), rng)
    found = carry_reviews(zones, new, persistent_ids=persistent)
    continued = set().union(*(sources for _, sources in later))
    assert set(found.rest["reviewer"]) == {f"person {i}" for i in range(len(places)) if i not in continued}
    assert found.count == len(continued)
    for row, (_, sources) in enumerate(later):
        zone = found.frame.iloc[row]
        if not sources:
            assert (zone["review_status"], zone["remarks"]) == ("unreviewed", "")
            continue
        giver = int(zone["reviewer"].removeprefix("person "))
        assert giver in sources
        said = (zone["review_status"], zone["slope_id"], zone["chain_from"])
        assert said == (("confirmed", "rejected")[giver % 2], f"slope {giver}", 100.0 + giver)
        for source in sources:
            assert f"remark {source}." in zone["remarks"]
            if source != giver:
                assert f"{('confirmed', 'rejected')[source % 2]} by person {source}" in zone["remarks"]
        for other in set(range(len(places))) - sources:
            assert f"remark {other}." not in zone["remarks"]
