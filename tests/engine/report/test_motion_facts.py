"""Figures and words of the report's section on motion along the surface."""

from __future__ import annotations

import geopandas as gpd
import numpy as np
import pytest
from slopewatch.engine.displacement.displacement import measure_displacement
from slopewatch.engine.displacement.registered import Registered
from slopewatch.engine.report.motion import surest
from slopewatch.engine.report.motion_facts import direction_in_words, motion_facts
from slopewatch.interface.parameters import DisplacementParameters
from slopewatch.tests.builders.rough_ground import axes, relief, sampled

PARAMETERS = DisplacementParameters(wide_window=5.0)


@pytest.mark.parametrize(
    ("off_dip", "error", "dip", "words"),
    [
        (0.0, 5.0, 35.0, "down the slope"),
        (-22.0, 5.0, 35.0, "down the slope"),
        (40.0, 5.0, 35.0, "down and to the left"),
        (-40.0, 5.0, 35.0, "down and to the right"),
        (95.0, 5.0, 35.0, "across, to the left"),
        (-120.0, 5.0, 35.0, "up and to the right"),
        (179.0, 5.0, 35.0, "up the slope"),
        (-179.0, 5.0, 35.0, "up the slope"),
        (0.0, 50.0, 35.0, "direction uncertain"),
        (0.0, float("nan"), 35.0, "direction uncertain"),
        (0.0, 5.0, 1.0, "on level ground"),
    ],
)
def test_the_direction_against_the_dip_in_words(off_dip: float, error: float, dip: float, words: str) -> None:
    assert direction_in_words(off_dip, error, dip) == words


@pytest.fixture(scope="module")
def clouds() -> tuple[np.ndarray, np.ndarray]:
    """The later one has moved to the left and a little downwards."""
    heights = relief(14.0, 0.15, seed=11)
    first, later = (sampled(heights, 60.0, 0.02, seed) for seed in (1, 2))
    return first, later + np.array([0.03, 0.12, 0.0]) @ axes()


def test_facts_are_those_of_the_vectors_and_zones(clouds) -> None:
    covariance = np.diag([0, 0, 0, 4e-4, 4e-4, 1e-6]).astype(float)
    registered = Registered(covariance, np.zeros(3), known=True)
    found = measure_displacement(*clouds, PARAMETERS, registered)
    facts = motion_facts(found, PARAMETERS, registered)
    (zone,) = facts["zones"]
    assert zone["direction"] == "across, to the left"
    assert zone["off_dip_deg"] == pytest.approx(76, abs=12)
    # seen from above the dip is to the east, so that left as one looks down is north
    assert zone["azimuth_deg"] == pytest.approx(12, abs=12)
    # across the dip 0.02 m of the registration's error, down the dip 0.02 m / cos 35 at most
    assert 0.0199 < facts["registration_error_m"] < 0.0201
    assert zone["length_err_m"] > 0.019
    assert facts["significant_vectors"] == int(found.significant.sum())
    shares = [row["share"] for row in facts["refused"]]
    assert shares == sorted(shares, reverse=True)
    assert sum(shares) + facts["measured_share"] == pytest.approx(1.0)
    assert facts["common"]["beyond_its_error"] is True
    assert facts["common"]["motion_m"][1] == pytest.approx(0.12, abs=0.03)


def test_without_a_registration_its_error_is_not_known(clouds) -> None:
    found = measure_displacement(*clouds, PARAMETERS, Registered.unknown())
    facts = motion_facts(found, PARAMETERS, Registered.unknown())
    assert (facts["registration_known"], facts["registration_error_m"]) == (False, None)


def test_of_many_vectors_the_surest_of_each_square_are_drawn() -> None:
    rng = np.random.default_rng(2)
    x, y = rng.uniform(0, 20, (2, 300))
    vectors = gpd.GeoDataFrame({"p_value": rng.uniform(0, 0.01, 300)}, geometry=gpd.points_from_xy(x, y))
    drawn = surest(vectors, 4.0)
    square = np.floor(np.column_stack([x, y]) / 4.0).astype(int)
    best = {}
    for number, key in enumerate(map(tuple, square)):
        if key not in best or vectors["p_value"][number] < vectors["p_value"][best[key]]:
            best[key] = number
    assert sorted(best.values()) == list(drawn.index)
    assert len(surest(vectors.iloc[:0], 4.0)) == 0
