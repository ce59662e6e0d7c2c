"""Objects put onto a simulated slope: what is found, as what, how large, and what is left alone."""

from __future__ import annotations

from dataclasses import replace
from datetime import date
from xml.etree import ElementTree

import geopandas as gpd
import numpy as np
import pytest
import shapely
from pyproj import CRS
from slopewatch.engine.maps.qgis_styles import objects_qml
from slopewatch.engine.objects.base import Base
from slopewatch.engine.objects.evidence import Counts, likelihood_ratio
from slopewatch.engine.objects.find import find_groups
from slopewatch.engine.objects.survey import Survey
from slopewatch.engine.objects.table import Origin, object_figures, objects_frame

SIDE, DENSITY = 24.0, 12.0
GRADIENT = 0.5
ORIGIN = Origin(CRS.from_epsg(6677), (date(2024, 5, 1), date(2024, 6, 1)), "run")
NO_ZONES = gpd.GeoDataFrame({"zone_id": []}, geometry=[], crs=6677)


def bare(seed, density=DENSITY):
    random = np.random.default_rng(seed)
    xy = random.uniform(0.0, SIDE, (int(density * SIDE**2), 2))
    z = GRADIENT * xy[:, 0] + random.normal(0.0, 0.02, len(xy))
    every = np.ones(len(xy), dtype=bool)
    return Survey(np.column_stack([xy, z]), every, every)


def solid(survey, top):
    """A body whose ``top`` (m over the ground at x, y; 0 outside) ends every pulse."""
    over = top(*survey.xyz[:, :2].T)
    raised = survey.xyz + over[:, None] * [0.0, 0.0, 1.0]
    return Survey(raised, survey.ground & (over == 0.0), survey.last)


def boulder(x, y, diameter=1.6):
    radius = diameter / 2
    return lambda e, n: np.sqrt(np.maximum(radius**2 - (e - x) ** 2 - (n - y) ** 2, 0.0))


def box(x, y, length, width, height):
    return lambda e, n: np.where((abs(e - x) <= length / 2) & (abs(n - y) <= width / 2), height, 0.0)


def bush(survey, x, y, seed=5):
    """Half of the pulses end in a crown 3 m wide and 1.5 m high; half of those before go on."""
    random = np.random.default_rng(seed)
    within = np.hypot(survey.xyz[:, 0] - x, survey.xyz[:, 1] - y) < 1.5
    hit = within & (random.random(len(within)) < 0.5)
    xyz = survey.xyz.copy()
    xyz[hit, 2] += random.uniform(0.3, 1.5, hit.sum())
    return Survey(xyz, survey.ground & ~hit, survey.last & ~(hit & (random.random(len(hit)) < 0.5)))


def found(first, later, zones=NO_ZONES):
    return objects_frame(find_groups(first, later), zones, ORIGIN)


@pytest.mark.parametrize("diameter", [1.2, 1.6, 2.4])
def test_a_boulder_that_fell_onto_the_slope(diameter):
    later = solid(bare(2), boulder(10.0, 12.0, diameter))
    (row,) = found(bare(1), later).to_dict("records")
    assert (row["kind"], row["change"], row["deposit"]) == ("boulder", "appeared", 1)
    assert row["geometry"].centroid.distance(shapely.Point(10.0, 12.0)) < 0.3
    assert row["height_m"] == pytest.approx(diameter / 2, abs=0.15)
    # half of a sphere
    assert row["volume_m3"] == pytest.approx(np.pi * diameter**3 / 12, rel=0.35)


def test_a_boulder_that_is_gone_is_no_deposit():
    (row,) = found(solid(bare(1), boulder(10.0, 12.0)), bare(2)).to_dict("records")
    assert (row["kind"], row["change"], row["deposit"]) == ("boulder", "vanished", 0)


def test_a_wall_that_was_removed():
    (row,) = found(solid(bare(1), box(12.0, 12.0, 0.5, 9.0, 1.2)), bare(2)).to_dict("records")
    assert (row["kind"], row["change"]) == ("wall", "vanished")
    assert row["length_m"] == pytest.approx(9.0, abs=0.6)
    assert row["height_m"] == pytest.approx(1.2, abs=0.1)


def test_a_wall_with_few_returns_is_one_wall():
    tops = box(12.0, 12.0, 0.5, 9.0, 1.2)
    tables = [found(bare(1, 4.0), solid(bare(seed, 4.0), tops)) for seed in range(10, 20)]
    walls = [table for table in tables if table["kind"].tolist() == ["wall"]]
    assert len(walls) >= 8
    # 18 returns on it: the outermost lie half a metre from the ends
    assert np.median([float(table["length_m"].iloc[0]) for table in walls]) == pytest.approx(9.0, abs=1.0)


def cone(x, y, radius, height):
    return lambda e, n: np.maximum(height * (1.0 - np.hypot(e - x, n - y) / radius), 0.0)


@pytest.mark.parametrize(
    ("top", "volume", "width"),
    [
        (boulder(10.0, 12.0, 2.4), np.pi * 2.4**3 / 12, 0.5),
        (box(12.0, 12.0, 0.5, 9.0, 1.2), 5.4, 1.3),  # all of its triangles are edges
        (box(12.0, 12.0, 4.4, 1.8, 1.5), 11.88, 0.5),
        (cone(12.0, 12.0, 1.8, 1.26), np.pi * 1.8**2 * 1.26 / 3, 0.5),
    ],
    ids=["boulder", "wall", "car", "heap"],
)
def test_the_volume_is_right_in_the_mean_and_its_interval_holds(top, volume, width):
    tables = [found(bare(seed + 50), solid(bare(seed), top)) for seed in range(20, 30)]
    volumes = [table["volume_m3"].sum() for table in tables]
    assert np.mean(volumes) == pytest.approx(volume, rel=0.1)
    holds = [t["volume_low_m3"].sum() <= volume <= t["volume_high_m3"].sum() for t in tables]
    assert sum(holds) >= 9
    widths = [t["volume_high_m3"].sum() - t["volume_low_m3"].sum() for t in tables]
    assert np.median(widths) < width * volume


def test_vegetation_lower_than_a_wall_does_not_hide_it():
    """Where a wall is built into brush, both surveys have returns over the ground; only one has a closed flat top."""
    first = bare(1, 4.0)
    random = np.random.default_rng(3)
    brush = np.where(random.random(len(first)) < 0.7, random.uniform(0.35, 0.75, len(first)), 0.0)
    grown = replace(first, xyz=first.xyz + brush[:, None] * [0.0, 0.0, 1.0], ground=brush == 0.0)
    top = box(12.0, 12.0, 0.5, 9.0, 1.2)
    over = np.maximum(top(*first.xyz[:, :2].T), brush)
    later = replace(first, xyz=first.xyz + over[:, None] * [0.0, 0.0, 1.0], ground=over == 0.0)
    table = found(grown, later)
    assert (table["kind"] == "wall").sum() == 1
    assert table["length_m"].max() > 7.0


def test_low_vegetation_below_a_boulder_is_no_part_of_it():
    first = bare(1)
    random = np.random.default_rng(3)
    grass = np.where(random.random(len(first)) < 0.8, random.uniform(0.18, 0.26, len(first)), 0.0)
    first = replace(first, xyz=first.xyz + grass[:, None] * [0.0, 0.0, 1.0], ground=grass == 0.0)
    (row,) = found(first, solid(bare(2), boulder(10.0, 12.0, 2.4))).to_dict("records")
    assert row["kind"] == "boulder"
    assert row["confidence"] > 0.99999


def test_a_car_is_no_boulder():
    (row,) = found(bare(1), solid(bare(2), box(12.0, 12.0, 4.4, 1.8, 1.5))).to_dict("records")
    assert row["kind"] == "vehicle or heap"
    assert row["area_m2"] == pytest.approx(4.4 * 1.8, rel=0.2)


def test_ground_points_that_stand_out_are_an_object_too():
    later = solid(bare(2), boulder(10.0, 12.0, 2.4))
    (row,) = found(bare(1), replace(later, ground=np.ones(len(later), dtype=bool))).to_dict("records")
    assert row["kind"] == "boulder"


def test_pulses_go_through_vegetation():
    (row,) = found(bare(1), bush(bare(2), 12.0, 12.0)).to_dict("records")
    assert (row["kind"], row["deposit"]) == ("vegetation", 0)


def test_a_bush_in_both_surveys_is_no_change():
    assert found(bush(bare(1), 12.0, 12.0, 5), bush(bare(2), 12.0, 12.0, 6)).empty


def test_nothing_is_found_where_nothing_changed():
    first, later = (solid(bare(seed), boulder(10.0, 12.0)) for seed in (1, 2))
    assert found(first, later).empty


def test_ground_that_rose_or_was_taken_away_is_left_to_the_zones():
    def mound(height):
        def top(e, n):
            share = np.minimum(np.hypot(e - 12.0, n - 12.0) / 4.0, 1.0)
            return height * np.cos(0.5 * np.pi * share) ** 2

        later = solid(bare(2), top)
        return replace(later, ground=np.ones(len(later), dtype=bool))

    assert found(bare(1), mound(1.0)).empty
    assert found(bare(1), mound(-1.0)).empty
    dug = solid(bare(2), box(12.0, 12.0, 4.0, 4.0, -0.8))
    assert found(bare(1), replace(dug, ground=np.ones(len(dug), dtype=bool))).empty


def test_a_place_that_the_first_survey_did_not_see_shows_no_object():
    first = bare(1)
    hidden = np.hypot(first.xyz[:, 0] - 10.0, first.xyz[:, 1] - 12.0) < 3.0
    assert found(first.part(np.flatnonzero(~hidden)), solid(bare(2), boulder(10.0, 12.0))).empty


def test_an_object_names_the_zone_that_it_lies_in_and_counts_once():
    zones = gpd.GeoDataFrame(
        {"zone_id": ["Z1", "Z2"]}, geometry=[shapely.box(0, 0, 5, 5), shapely.box(8, 10, 12, 14)], crs=6677
    )
    frame = found(bare(1), solid(bare(2), boulder(10.0, 12.0)), zones)
    assert frame["zone_id"].tolist() == ["Z2"]
    assert object_figures(frame)["object_deposits_beside_zones_m3"] == 0.0
    alone = found(bare(1), solid(bare(2), boulder(10.0, 12.0)))
    assert object_figures(alone)["object_deposits_beside_zones_m3"] == pytest.approx(alone["volume_m3"].sum())


def test_the_legend_names_what_occurs():
    root = ElementTree.fromstring(objects_qml({("boulder", "appeared"), ("wall", "vanished")}))
    assert [one.get("label") for one in root.iter("category")] == ["Boulder, appeared", "Wall, vanished"]


def test_the_same_surveys_give_the_same_table():
    pair = bush(bare(1), 5.0, 5.0), solid(bare(2), boulder(10.0, 12.0))
    assert found(*pair).to_wkb().equals(found(*pair).to_wkb())


def test_heights_over_a_plane_are_exact():
    ground = bare(1).xyz
    ground[:, 2] = 100.0 + GRADIENT * ground[:, 0] - 0.2 * ground[:, 1]
    points = np.array([[3.0, 4.0, 103.0], [12.5, 20.0, 90.0]])
    truth = points[:, 2] - (100.0 + GRADIENT * points[:, 0] - 0.2 * points[:, 1])
    np.testing.assert_allclose(Base(ground).heights(points), truth, atol=1e-9)


def test_the_likelihood_ratio_is_that_of_two_binomials():
    # 4 of 4 against 0 of 4: one share of a half gives (1/2)^8, two shares give 1
    assert likelihood_ratio(Counts(4, 0), Counts(0, 4)) == pytest.approx(2.0**-8)
    assert likelihood_ratio(Counts(3, 3), Counts(5, 5)) == pytest.approx(1.0)
