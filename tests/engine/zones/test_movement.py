"""The decision of what a zone did, and the zones of ground that is known to have slid, sunk, or lost its surface."""

from __future__ import annotations

from dataclasses import replace
from datetime import date

import numpy as np
import pytest
from slopewatch.engine.zones.extraction import Origin, Zones
from slopewatch.engine.zones.movement import (
    BULGED,
    GAINED,
    LOST,
    SANK,
    SLID,
    UNDECIDED,
    Evidence,
    decide,
    sliding_probability,
)
from slopewatch.tests.builders.what_ground_did import Ground, zones_of

SLOPE = 35.0
TANGENT = float(np.tan(np.radians(SLOPE)))
SMALL = np.diag([0.01, 0.01]) ** 2
KNOWN = Evidence(-0.2, 0.01, np.array([0.2 * TANGENT, 0.0]), SMALL, 1.0, 0.1, SLOPE)
ORIGIN = Origin((date(2024, 5, 1), date(2024, 5, 11)), "a method", "a run")


def test_ground_that_seems_to_slide_up_the_slope_is_undecided():
    along = np.array([0.3, 0.0])
    assert decide(replace(KNOWN, normal=0.0, along=along)).movement == SLID
    assert decide(replace(KNOWN, normal=0.0, along=-along)).movement == UNDECIDED


def test_ground_that_sinks_straight_down_or_along_the_normal_did_not_slide():
    assert decide(KNOWN).movement == SANK
    assert decide(replace(KNOWN, along=np.zeros(2))).movement == SANK
    assert decide(replace(KNOWN, normal=0.2, along=np.array([-0.2 * TANGENT, 0.0]))).movement == BULGED


def test_motion_that_neither_explains_is_sliding():
    assert decide(replace(KNOWN, along=np.array([0.5, 0.0]))).movement == SLID
    assert decide(replace(KNOWN, along=np.array([0.1, 0.3]))).movement == SLID
    assert decide(replace(KNOWN, normal=0.0, along=np.array([0.1, 0.0]))).movement == SLID
    assert decide(replace(KNOWN, normal=0.2, along=np.array([0.3, 0.0]))).movement == SLID
    # a bulge does not rise evenly
    assert decide(replace(KNOWN, normal=0.2, along=np.array([0.05, 0.0]))).movement == BULGED


def test_another_surface_is_material_that_left_or_came():
    assert decide(replace(KNOWN, kept=0.1)).movement == LOST
    assert decide(replace(KNOWN, kept=0.1, normal=0.2)).movement == GAINED
    # whatever a fit of two surfaces that have nothing in common says of their motion
    assert decide(replace(KNOWN, kept=0.1, along=np.array([0.5, 0.0]))).movement == LOST


def test_what_is_not_known_is_not_decided():
    assert decide(replace(KNOWN, kept=float("nan"))).movement == UNDECIDED
    assert decide(replace(KNOWN, along=None, covariance=None)).movement == UNDECIDED
    assert decide(replace(KNOWN, normal=-0.01, along=np.zeros(2))).movement == UNDECIDED
    # sliding by as much as it sank would not have been seen
    assert decide(replace(KNOWN, covariance=1000 * SMALL)).movement == UNDECIDED


def test_sinking_ground_is_said_to_slide_as_seldom_as_the_confidence_says():
    rng = np.random.default_rng(3)
    covariance = np.diag([0.03, 0.02, 0.01]) ** 2
    share = rng.uniform(0.0, 1.0, 2000)
    truth = np.column_stack([0.2 * TANGENT * share, np.zeros(2000), np.full(2000, -0.2)])
    seen = truth + rng.multivariate_normal(np.zeros(3), covariance, 2000)
    chance = np.array([sliding_probability(row[:2], row[2], covariance, SLOPE) for row in seen])
    assert (chance < 0.01).mean() < 0.015
    assert (chance < 0.2).mean() < 0.22


@pytest.fixture(scope="module")
def ground() -> Ground:
    return Ground.at_rest()


def most(zones: Zones) -> dict:
    return zones.frame.loc[zones.frame["area_m2"].idxmax()].to_dict()


def test_ground_that_slid_is_one_zone_without_volumes_lost_or_gained(ground):
    zones = zones_of(ground.first, ground.slid(0.2), ORIGIN)
    zone = most(zones)
    assert (zone["kind"], zone["movement"], zone["severity"]) == ("sliding", SLID, "moderate")
    assert zone["motion_m"] == pytest.approx(0.2, abs=4 * zone["motion_err_m"])
    assert zone["motion_err_m"] < 0.02
    assert zone["azimuth_deg"] == pytest.approx(90, abs=15)
    assert zone["plunge_deg"] == pytest.approx(35, abs=10)
    assert np.isnan(zone["vol_loss_m3"])
    assert np.isnan(zone["vol_gain_m3"])
    assert np.isfinite(zone["vol_net_m3"])
    assert zone["rate_mm_day"] == pytest.approx(100 * zone["motion_m"], rel=1e-6)
    assert (zone["days"], zone["method"], zone["run_id"]) == (10, "a method", "a run")
    assert zone["area_m2"] == pytest.approx((zones.labels == 1 + zones.frame["area_m2"].idxmax()).sum() * 0.04, rel=2)
    assert zones.volumes.total == pytest.approx(
        (sum(zones.volumes.net[zones.frame["kind"] != "sliding"]), zones.volumes.total[1])
    )
    assert zones.volumes.sliding[0] == pytest.approx(sum(zones.volumes.net[zones.frame["kind"] == "sliding"]))


def test_ground_that_sank_or_bulged_with_its_relief_keeps_its_zone_and_volume(ground):
    for height, kind, movement in ((-0.2, "subsidence", SANK), (0.2, "uplift", BULGED)):
        zone = most(zones_of(ground.first, ground.lifted(height)))
        assert (zone["kind"], zone["movement"]) == (kind, movement)
        assert np.sign(zone["normal_m"]) == np.sign(height)
        assert zone["relief_kept"] == pytest.approx(1.0, abs=0.2)
        assert abs(zone["vol_net_m3"]) == pytest.approx(np.pi / 3 * 25 * 0.2 * np.cos(np.radians(35)), rel=0.35)


def test_another_surface_is_lost_or_gained_material(ground):
    for height, movement in ((-0.25, LOST), (0.25, GAINED)):
        zone = most(zones_of(ground.first, ground.replaced(height)))
        assert zone["movement"] == movement
        assert zone["relief_kept"] < 0.5
