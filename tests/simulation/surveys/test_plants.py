"""Closed grass, ferns and forest: as high and as dense as real ones, over a ground that stays known."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from slopewatch.interface.parameters import ParameterError, SurveyParameters
from slopewatch.simulation.surveys.plants import FERN_HEIGHT, cover_of, mown_in, profile
from slopewatch.simulation.surveys.plot import Plot, grass_plot, plot
from slopewatch.simulation.surveys.scanner import TURF_GROUND, SurveyCloud
from slopewatch.simulation.surveys.survey import simulate_pair

BARE = SurveyParameters(seed=5, vegetation=0.0, range_noise=0.0)
PAIR = SurveyParameters(
    seed=5,
    points=30_000,
    length=20.0,
    height=8.0,
    angle=35.0,
    vegetation=0.0,
    range_noise=0.0,
    amplitude=0.0,
    offset=0.0,
)


def ground_share(made: Plot) -> float:
    return float(made.cloud.truth_ground.mean())


@pytest.fixture(scope="module")
def grown() -> Plot:
    return grass_plot(1)


@pytest.fixture(scope="module")
def mown() -> Plot:
    return grass_plot(1, state="mown")


def test_grown_grass_is_as_high_and_as_closed_as_real_grass(grown):
    median, most, nearly_all = np.quantile(grown.above, [0.5, 0.9, 0.99])
    assert 0.20 < median < 0.27
    assert 0.42 < most < 0.55
    assert 0.65 < nearly_all < 0.88
    assert 0.02 < ground_share(grown) < 0.08
    assert len(grown.cloud) == pytest.approx(70_000, rel=0.03)


def test_thin_surveys_see_the_same_grass():
    thin = grass_plot(2, side=20.0, density=40.0)
    assert len(thin.cloud) == pytest.approx(16_000, rel=0.05)
    assert 0.20 < np.median(thin.above) < 0.27
    assert 0.02 < ground_share(thin) < 0.08


def test_mown_grass_is_stubble_that_a_third_of_the_pulses_pass(mown):
    assert np.quantile(mown.above, 0.99) < 0.13
    assert 0.02 < np.median(mown.above) < 0.06
    assert 0.2 < ground_share(mown) < 0.5


def test_grass_is_patchy(grown):
    """Cells of 1 m differ in height and in how many pulses reach the ground, neighbours within 0.2 m hardly."""
    place = np.floor(grown.cloud.xyz[:, :2]).astype(int)
    _, cell, count = np.unique(place, axis=0, return_inverse=True, return_counts=True)
    share = np.bincount(cell.ravel(), grown.cloud.truth_ground)[count > 300] / count[count > 300]
    assert np.quantile(share, 0.9) > 3 * np.quantile(share, 0.1)
    height = grown.cover.layers[0].height[20:-20, 20:-20].astype(float)
    height = (height - height.mean()) / height.std()
    step = grown.cover.layers[0].step
    along = [float((height[:, lag:] * height[:, :-lag]).mean()) for lag in range(1, 40)]
    length = step * (1 + next(lag for lag, value in enumerate(along) if value < np.exp(-1)))
    assert 0.3 <= length <= 3.0


def test_ground_echoes_lie_on_the_ground_and_no_plant_below_it():
    made = plot(replace(BARE, grass=1.0, ferns=0.3), density=200.0)
    ground = made.cloud.truth_ground == 1
    assert made.above.min() > -1e-3
    assert made.above[ground].max() <= TURF_GROUND + 1e-3
    assert made.above[~ground].min() > -1e-3
    x, y, z = made.cloud.xyz[ground].T
    assert np.abs(z - made.true_height(x, y)).max() <= TURF_GROUND + 1e-3


def test_the_same_ground_under_grown_and_mown_grass(grown, mown):
    assert np.array_equal(grown.scene.base.values, mown.scene.base.values)
    low, high = grown.cloud.xyz.min(axis=0), grown.cloud.xyz.max(axis=0)
    x, y = np.random.default_rng(1).uniform(low[:2], high[:2], (500, 2)).T
    assert np.array_equal(grown.true_height(x, y), mown.true_height(x, y))
    assert not np.array_equal(grown.cloud.xyz[:100], mown.cloud.xyz[:100])


def test_ferns_close_and_let_few_pulses_through():
    made = plot(replace(BARE, ferns=1.0), density=150.0)
    assert 0.01 < ground_share(made) < 0.04
    assert np.quantile(made.above, 0.3) > 0.4
    assert np.quantile(made.above, 0.99) < 1.9 * FERN_HEIGHT
    assert made.above.max() > 1.1


def test_native_forest_shows_its_ground_to_one_return_in_sixty():
    made = plot(replace(BARE, forest=1.0), side=40.0, density=32.0, slope=38.0)
    assert 1 / 90 < ground_share(made) < 1 / 40
    last = made.cloud.return_number == made.cloud.number_of_returns
    assert made.cloud.truth_ground[last].mean() < 0.05
    assert 4.0 < np.median(made.above) < 6.0
    assert 9.0 < np.quantile(made.above, 0.99) < 14.0
    assert 0.03 < (made.above < 1.0).mean() < 0.2
    assert 1.4 < 1 / (made.cloud.return_number == 1).mean() < 2.0


def test_oblique_pulses_reach_the_ground_more_seldom(grown):
    """Beer-Lambert along the beam: downhill-looking beams go through more grass of a slope than those that face it."""
    steep = plot(replace(BARE, grass=1.0), density=300.0, slope=35.0)
    first = steep.cloud.return_number == 1
    oblique = np.abs(steep.cloud.scan_angle)
    ground = steep.cloud.truth_ground[first] == 1
    # Lines on both sides: per line the mean penetration follows the path through the layer.
    shares = [ground[steep.cloud.line[first] == line].mean() for line in np.unique(steep.cloud.line)]
    assert oblique.max() > 15
    assert max(shares) > 1.5 * min(shares)


def test_half_of_the_slope_from_the_left_or_in_patches():
    for layout in ("left", "patches"):
        pair = simulate_pair(replace(PAIR, grass=0.5, layout=layout))
        local = pair.scene.frame.to_local(pair.first.xyz)
        above = pair.first.xyz[:, 2] - pair.scene.height_at(pair.first.xyz)
        u0, v0, u1, v1 = pair.scene.slope
        inside = (local[:, 0] > u0) & (local[:, 0] < u1) & (local[:, 1] > v0 + 0.5) & (local[:, 1] < v1)
        tall = above > 0.1
        assert 0.3 < tall[inside].mean() < 0.5
        left = local[:, 0] < (u0 + u1) / 2
        if layout == "left":
            assert tall[inside & left].mean() > 0.6
            assert tall[inside & (local[:, 0] > (u0 + u1) / 2 + 1)].mean() < 0.01
        assert tall[local[:, 1] < 0].mean() < 0.01, "the road is bare"


def test_litter_lifts_what_counts_as_ground():
    with_litter = plot(replace(BARE, litter=0.03), density=100.0)
    without = plot(BARE, density=100.0)
    assert with_litter.above.mean() > without.above.mean() + 0.005
    assert with_litter.above.max() < 0.09


def test_epochs_of_a_pair_are_grown_or_mown_as_asked():
    pair = simulate_pair(replace(PAIR, grass=1.0, mown="later"))
    off_road = [pair.scene.frame.to_local(c.xyz)[:, 1] > 0.5 for c in (pair.first, pair.second)]
    medians = [
        float(np.median((c.xyz[:, 2] - pair.scene.height_at(c.xyz))[o]))
        for c, o in zip((pair.first, pair.second), off_road, strict=True)
    ]
    assert medians[0] > 0.18
    assert medians[1] < 0.06
    assert [mown_in(word, 0) for word in ("never", "first", "later", "both")] == [False, True, False, True]
    assert [mown_in(word, 2) for word in ("never", "first", "later", "both")] == [False, False, True, True]


def test_grass_of_another_season_stands_mostly_in_the_same_places():
    pair = simulate_pair(replace(PAIR, points=2000, grass=1.0))
    first, second = (cover.layers[0].height.ravel() for cover in pair.covers)
    assert 0.4 < np.corrcoef(first, second)[0, 1] < 0.98
    ferns = simulate_pair(replace(PAIR, points=2000, ferns=1.0)).covers
    assert np.array_equal(ferns[0].layers[0].height, ferns[1].layers[0].height)


def test_nothing_asked_for_is_the_survey_as_it_was(pair):
    """``pair`` of the conftest asks for none of it; here all is asked for with a share of zero."""
    zero = {"grass": 0.0, "ferns": 0.0, "forest": 0.0, "litter": 0.0, "multipath": 0.0, "stray": 0.0}
    again = simulate_pair(replace(pair.parameters, **zero, mown="both", layout="left", grass_height=1.2))
    assert again.covers == (None, None)
    for one, two in ((pair.first, again.first), (pair.second, again.second)):
        for field in fields(SurveyCloud):
            assert np.array_equal(getattr(one, field.name), getattr(two, field.name)), field.name


def test_same_seed_same_plants_other_seed_others(grown):
    small = [grass_plot(seed, side=4.0, density=100.0).cloud for seed in (3, 3, 4)]
    for field in fields(SurveyCloud):
        assert np.array_equal(getattr(small[0], field.name), getattr(small[1], field.name)), field.name
    assert len(small[0]) != len(small[2]) or not np.allclose(small[0].xyz, small[2].xyz)


def test_shrubs_stand_over_grass_and_forest_over_shrubs():
    made = plot(replace(BARE, grass=1.0, vegetation=0.5, forest=0.3), density=60.0)
    order = np.lexsort((made.cloud.return_number, made.cloud.gps_time))
    same = np.diff(made.cloud.gps_time[order]) == 0
    assert same.sum() > 200
    assert (np.diff(made.cloud.xyz[order, 2])[same] < 0).all(), "later echoes of a pulse lie lower"
    assert made.above.min() > -1e-3


def test_a_plot_in_no_known_state_is_refused():
    with pytest.raises(ValueError, match="grown or mown"):
        grass_plot(1, state="burnt")


def test_profiles_have_a_mean_of_one():
    for exponents in ((0.0, 3.0), (1.0, 0.6), (0.3, 0.0)):
        values = profile(*exponents)
        assert float(((values[1:] + values[:-1]) / 2).mean()) == pytest.approx(1.0, abs=1e-6)
        assert (values >= 0).all()


def test_cover_of_a_slope_without_plants_is_none(grown):
    assert cover_of(BARE, grown.scene, 0) is None
    only = cover_of(replace(BARE, multipath=0.01), grown.scene, 0)
    assert only.layers == ()
    assert only.multipath == 0.01


@pytest.mark.parametrize("wrong", [{"grass": 1.2}, {"mown": "often"}, {"multipath": 0.2}, {"grass_height": 0.0}])
def test_values_out_of_bounds_are_refused(wrong):
    with pytest.raises(ParameterError, match=next(iter(wrong))):
        SurveyParameters(**wrong)
