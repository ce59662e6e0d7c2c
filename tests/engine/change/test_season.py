"""Which change the plants explain: mowing is no hazard, a slump under grass is one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slopewatch.engine.change.difference import difference
from slopewatch.engine.change.doubts import warn_of_doubtful_change
from slopewatch.engine.change.plant_calibration import squares_of
from slopewatch.engine.change.result import Change
from slopewatch.engine.change.season import (
    around,
    compare_seasons,
    explained_by_plants,
    explained_share,
    judge_season,
)
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.grid.plant_cells import PlantCells
from slopewatch.engine.statistics.layout import Layout
from slopewatch.engine.zones.change_zones import change_zones
from slopewatch.interface.parameters import ChangeParameters
from slopewatch.tests.builders.plant_clouds import SIDE, Grass, Ground, grassy_slope

TALL, MOWN = Grass(0.25, lifted=0.08, error=0.03), Grass(0.05, lifted=0.01, error=0.01)


def changed(first: Ground, second: Ground, *, told: bool = True, **options) -> Change:
    plants = (first.plants, second.plants) if told else (None, None)
    return difference(first.xyz, second.xyz, ChangeParameters(**options), registration_error=0.002, plants=plants)


def surveys(first: Grass, second: Grass, **options) -> tuple[Ground, Ground]:
    return grassy_slope(1, first, bare_share=0.3), grassy_slope(2, second, bare_share=0.3, **options)


@pytest.fixture(scope="module")
def mown() -> Change:
    return changed(*surveys(TALL, MOWN))


def test_mowing_makes_no_zone_and_is_named(mown):
    before = changed(*surveys(TALL, MOWN), told=False)
    assert len(change_zones(before).frame) > 0, "what the plants' height is for"
    assert before.significant.sum() > 1000
    assert len(change_zones(mown).frame) == 0
    assert mown.season is not None
    assert mown.season.verdict == "lower"
    assert "The plants stood 0.25 m high in the first survey and 0.05 m in the second" in mown.season.sentence
    assert mown.season.dz_plants == pytest.approx(-0.07, abs=0.005)
    assert mown.season.dz_bare == pytest.approx(0.0, abs=0.005)
    progress = Progress()
    warn_of_doubtful_change(mown, progress)
    assert sum("The plants stood" in w for w in progress.warnings) == 1


def test_growth_that_raises_the_ground_is_no_zone_either():
    grown = changed(*surveys(MOWN, TALL))
    assert grown.season is not None
    assert grown.season.verdict == "higher"
    assert len(change_zones(grown).frame) == 0


@pytest.mark.parametrize("adaptive", [True, False])
def test_a_slump_of_30_cm_under_mown_grass_is_reported(adaptive):
    options = {} if adaptive else {"adaptive": False, "cell": 0.5}
    change = changed(*surveys(TALL, MOWN, slump=0.3), **options)
    zones = change_zones(change)
    assert len(zones.frame) == 1
    assert zones.frame["kind"].tolist() == ["subsidence"]
    assert zones.frame["area_m2"][0] == pytest.approx(np.pi * 9, rel=0.15)
    assert zones.frame["dz_mean_m"][0] == pytest.approx(-0.37, abs=0.03), "with what the grass makes of it"


def test_what_sank_by_less_than_plants_explain_is_counted_and_not_silent():
    """12 cm of slump and 7 cm of mowing, on grass whose own error is small: counted, named, in no zone."""
    first, second = surveys(replace(TALL, error=0.01), replace(MOWN, error=0.01), slump=0.0)
    change = changed(first, second)
    assert change.explained is not None
    assert change.explained.sum() > 1000
    assert not (change.explained & change.significant).any()
    assert np.array_equal(change.beyond, change.explained | change.significant)
    progress = Progress()
    warn_of_doubtful_change(change, progress)
    area = change.explained.sum() * change.grid.cell**2
    assert any(w.startswith(f"{area:.1f} m² of change beyond the level") for w in progress.warnings)


def test_the_same_season_explains_nothing():
    change = changed(*surveys(TALL, TALL, slump=0.3))
    assert change.season is not None
    assert change.season.verdict == "alike"
    assert change.explained is not None
    assert change.explained.sum() < 0.002 * change.valid.sum(), "beside the road plants differ by chance"
    assert len(change_zones(change).frame) == 1
    progress = Progress()
    warn_of_doubtful_change(change, progress)
    assert not any("plants" in w.lower() for w in progress.warnings)


def test_a_whole_slope_of_grass_that_was_mown_is_named_for_what_it_is():
    first = grassy_slope(3, replace(TALL, error=0.005), bare_share=0.0)
    second = grassy_slope(4, replace(MOWN, error=0.005), bare_share=0.0)
    change = changed(first, second, adaptive=False, cell=0.5)
    assert change.uniform_dz == pytest.approx(-0.07, abs=0.005)
    progress = Progress()
    warn_of_doubtful_change(change, progress)
    assert any("most likely the plants, not a deformation" in w for w in progress.warnings)
    assert not any("datum" in w for w in progress.warnings)


def test_the_rule_cell_by_cell():
    """Limit: half of the difference of the plants, and the level."""
    dz = np.array([-0.14, -0.16, 0.14, -0.14, -0.14, 0.14, np.nan])
    first = np.array([0.25, 0.25, 0.25, 0.09, 0.05, 0.05, 0.25])
    second = np.array([0.05, 0.05, 0.05, 0.05, 0.25, 0.25, 0.05])
    explained = explained_by_plants(dz, np.full(7, 0.05), first, second)
    assert explained.tolist() == [True, False, False, False, False, True, False]


@pytest.mark.parametrize(("wrong", "share"), [(0.0, 0.1), (0.35, 0.45)])
def test_a_run_whose_ground_is_right_under_its_plants_explains_little_by_them(wrong, share):
    """Grass of 0.25 m mown to 0.05 m; where a tenth of the slope sank by 15 cm, that is the ground's if it is right."""
    random = np.random.default_rng(4)
    shape = (120, 120)
    first, second = np.full(shape, 0.25), np.full(shape, 0.05)
    dz = -0.2 * wrong + 0.01 * random.standard_normal(shape)
    dz[20:60, 20:60] -= 0.15
    square = squares_of(Layout(shape), 0.2)
    learned = explained_share(dz, first, second, square)
    assert wrong <= learned <= share
    assert explained_share(dz[:10], first[:10], second[:10], square[:10]) == 0.5, "twelve squares tell nothing"
    plants = PlantCells(np.zeros(shape), np.zeros(shape), first, second)
    _, explained = judge_season(plants, dz, np.full(shape, 0.06), 0.2)
    assert explained is not None
    assert explained[20:60, 20:60].mean() < 0.01
    assert explained[70:].mean() > 0.95 or wrong == 0.0


def test_verdicts():
    grass, road = np.full(100, 0.25), np.zeros(100)
    assert compare_seasons(np.full(5, np.nan), np.zeros(5)) is None
    bare = compare_seasons(road, road + 0.01)
    assert bare is not None
    assert (bare.verdict, bare.cells, bare.differs) == ("no plants", 0, False)
    assert bare.sentence == "Hardly any of the compared ground had plants in either survey."
    half = compare_seasons(np.concatenate([grass, road]), np.concatenate([grass - 0.2, road]))
    assert half is not None
    assert (half.verdict, half.cells, half.share, half.lower_share) == ("lower", 100, 0.5, 1.0)
    few = np.where(np.arange(100) < 40, 0.1, 0.25)  # 40 % were mown: the season is the same, some grass is not
    some = compare_seasons(grass, few)
    assert some is not None
    assert (some.verdict, some.lower_share) == ("alike", 0.4)
    facts = half.facts()
    assert facts["sentence"] == half.sentence
    assert facts["dz_median_bare_m"] is None
    assert half.explains(-0.1)
    assert not half.explains(0.1)
    assert not half.explains(-0.3)


@pytest.mark.parametrize("beside", [True, False])
def test_the_margin_of_mown_grass_whose_own_plants_were_taken_for_ground(beside):
    """Grass that ends 0.6 m before the road: the ground within it came out 6 cm high, and looked bare."""
    first, second = surveys(TALL, MOWN)
    x = first.xyz[:, 0]
    margin = first.bare & (np.abs(x - SIDE / 2) > 0.15 * SIDE - 0.6) if beside else np.abs(x - SIDE / 2) < 0.3
    xyz = first.xyz.copy()
    xyz[margin, 2] += 0.06
    change = changed(Ground(xyz, first.plants, first.bare), second)
    assert change_zones(change).frame.empty == beside, "in the middle of the road it is change"


def test_plants_around_are_those_within_a_metre():
    first, second = np.full((40, 40), 0.02), np.full((40, 40), 0.01)
    first[:, :10], second[:, :10] = 0.3, 0.1
    first[5, 5] = np.nan
    before, after = around(first, second, 0.2)
    assert before[20, 12] == pytest.approx(0.3), "bare cells do not count"
    assert after[20, 12] == pytest.approx(0.1)
    assert np.isfinite(before[:, :15]).all()
    assert np.isnan(before[:, 15:]).all()
    assert before[5, 5] == pytest.approx(0.3)


def test_few_plants_around_tell_nothing_where_most_of_the_ground_is_bare():
    first, second = np.full((40, 40), 0.02), np.full((40, 40), 0.01)
    first[:, :10], second[:, :10] = 0.3, 0.1
    first[30, 30], second[30, 30] = 0.3, 0.1
    before, after = around(first, second, 0.2, 0.5)
    assert before[20, 4] == pytest.approx(0.3)
    assert after[20, 9] == pytest.approx(0.1), "five of its eleven columns are bare"
    assert np.isnan(before[:, 11:]).all()


@pytest.mark.parametrize("covered", [0.3, 0.02])
def test_a_shrub_that_was_sampled_otherwise_explains_no_change_of_the_bare_ground_beside_it(covered):
    """But at the margin of what was mown all over it does."""
    first, second = np.full((100, 100), 0.015), np.full((100, 100), 0.015)
    plants = round(100 * covered)
    first[:, :plants], second[:, :plants] = 0.25, 0.05
    first[:, 60:98], second[:, 60:98] = (0.25, 0.25) if covered < 0.1 else (0.01, 0.01)
    dz = np.full((100, 100), -0.05)
    season, explained = judge_season(
        PlantCells(np.zeros(dz.shape), np.zeros(dz.shape), first, second), dz, np.full(dz.shape, 0.03), 0.2
    )
    assert season is not None
    assert season.differs == (covered > 0.1)
    assert explained is not None
    assert explained[:, :plants].all()
    assert explained[:, plants + 2].all() == season.differs
    assert not explained[:, plants + 6 : 60].any()
