"""Motion along the surface against known vectors, and refused where nothing can be said."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.displacement.displacement import Displacement, measure_displacement
from slopewatch.engine.displacement.registered import Registered
from slopewatch.engine.displacement.status import Status
from slopewatch.engine.report.motion_facts import doubts
from slopewatch.interface.parameters import DisplacementParameters
from slopewatch.tests.builders.rough_ground import axes, in_the_map, relief, sampled

SIDE_M = 18.0


def measured(first: np.ndarray, later: np.ndarray, registered: Registered | None = None, **given) -> Displacement:
    return measure_displacement(first, later, DisplacementParameters(**given), registered or Registered.unknown())


@pytest.fixture(scope="module")
def ground() -> tuple[np.ndarray, np.ndarray]:
    heights = relief(SIDE_M, 0.15, seed=5)
    return tuple(sampled(heights, 80.0, 0.02, seed, gaps=0.3) for seed in (1, 2))


@pytest.fixture(scope="module")
def moved(ground) -> tuple[Displacement, np.ndarray]:
    motion = np.array([0.12, -0.05, 0.01]) @ axes()
    return measured(ground[0], ground[1] + motion), motion


def test_the_motion_is_found_within_its_errors(moved):
    found, motion = moved
    vectors = found.vectors
    assert vectors.measured.sum() > 30
    error = (vectors.motion - motion)[vectors.measured]
    stated = np.sqrt(np.einsum("nii->ni", vectors.covariance[vectors.measured]))
    assert np.sqrt(np.mean(error**2)) < 0.03
    assert np.mean(np.abs(error) < 2 * stated) > 0.85
    assert np.hypot(*vectors.in_plane[vectors.measured, :2].T).mean() == pytest.approx(0.13, abs=0.02)


def test_the_zone_s_vector_is_that_of_all_its_ground(moved):
    found, motion = moved
    (zone,) = found.zones
    error = zone.motion - motion
    assert error @ np.linalg.solve(zone.covariance, error) < 16.3  # 99.9 % of three degrees of freedom
    assert np.linalg.norm(error) < 0.015
    assert zone.off_dip == pytest.approx(np.degrees(np.arctan2(-0.05, 0.12)), abs=8)
    assert zone.probability < 1e-6


def test_still_ground_shows_no_vectors_and_no_zone(ground):
    found = measured(*ground)
    assert found.vectors.measured.sum() > 30
    assert found.significant.mean() < 0.03
    assert found.zones == ()
    assert found.doubtful == ()
    assert np.abs(found.common.motion).max() < 0.015
    assert found.common.share > 0.9


def test_ground_that_seems_to_move_up_the_slope_is_doubtful_and_no_zone(ground):
    found = measured(ground[0], ground[1] - 0.15 * axes()[0])
    assert found.zones == ()
    (doubtful,) = found.doubtful
    assert doubtful.in_plane[0] == pytest.approx(-0.15, abs=0.02)
    assert found.uphill[found.significant].mean() > 0.9
    said = doubts(found, DisplacementParameters(), stable_given=False)
    assert any("up the slope. This is doubtful and no zone" in sentence for sentence in said)


def test_sparse_surveys_claim_no_vector_and_no_zone():
    heights = relief(SIDE_M, 0.15, seed=5)
    first, later = (sampled(heights, 12.0, 0.02, seed) for seed in (1, 2))
    found = measured(first, later + 0.5 * axes()[0])
    assert found.points_per_m2 < 20
    assert (found.vectors.statistic[found.vectors.measured] > 20).any()
    assert not found.significant.any()
    assert found.zones == ()


def test_only_what_moves_has_vectors(ground):
    first, later = ground
    plane = (later - in_the_map(np.zeros((1, 3)))) @ axes().T
    moving = plane[:, 0] < 9.0
    later = np.where(moving[:, None], later + 0.25 * axes()[0], later)
    found = measured(first, later)
    east = (found.vectors.places - in_the_map(np.zeros((1, 3)))) @ axes().T
    seen = found.vectors.measured
    assert found.significant[seen & (east[:, 0] < 6.0)].mean() > 0.9
    assert found.significant[seen & (east[:, 0] > 13.5)].mean() < 0.1
    assert found.zones[0].in_plane[0] == pytest.approx(0.25, abs=0.03)


def test_ground_that_moved_farther_than_the_smallest_motion_is_seen(ground):
    found = measured(ground[0], ground[1] + 0.04 * axes()[0])
    assert np.nanmean(found.smallest) > 1.2 * np.nanmean(found.vectors.smallest)  # a window alone knows less
    farther = found.vectors.measured & (found.smallest < 0.04)
    assert np.count_nonzero(farther) > 10
    assert found.significant[farther].mean() > 0.9


def test_motion_of_most_of_a_metre_is_found(ground):
    found = measured(ground[0], ground[1] + 0.8 * axes()[0])
    error = found.vectors.in_plane[found.vectors.measured] - [0.8, 0.0, 0.0]
    assert found.vectors.measured.sum() > 20
    assert np.abs(error).max() < 0.15


def test_a_plane_has_no_vectors():
    flat = np.zeros((int(SIDE_M / 0.05),) * 2)
    found = measured(*(sampled(flat, 80.0, 0.02, seed) for seed in (1, 2)))
    assert found.vectors.measured.sum() == 0
    assert set(np.unique(found.vectors.status)) <= {Status.NO_RELIEF, Status.RELIEF_ONE_WAY, Status.LITTLE_SEEN}


def test_furrows_hold_in_one_direction_only():
    x = np.arange(int(SIDE_M / 0.05)) * 0.05
    furrows = np.tile(0.1 * np.sin(2 * np.pi * x / 0.9), (len(x), 1))
    found = measured(*(sampled(furrows, 80.0, 0.02, seed) for seed in (1, 2)))
    assert found.vectors.measured.sum() == 0
    assert (found.vectors.status == Status.RELIEF_ONE_WAY).mean() > 0.5


def test_furrows_hold_the_motion_across_them():
    x = np.arange(int(SIDE_M / 0.05)) * 0.05
    furrows = np.tile(0.1 * np.sin(2 * np.pi * x / 0.9), (len(x), 1))
    first, later = (sampled(furrows, 80.0, 0.02, seed) for seed in (1, 2))
    found = measured(first, later + np.array([0.05, 0.12, 0.0]) @ axes(), spacing=4.0).components
    assert len(found.number) > 8
    assert np.abs(found.direction @ axes()[1]).min() > np.cos(np.radians(3))
    assert np.degrees(found.turn).max() < 3
    error = found.amount - 0.12
    assert np.abs(error / found.error).max() < 4
    assert np.sqrt(np.mean(error**2)) < 0.005
    assert found.significant(0.99).all()
    assert (found.p_value < 0.01).all()


def test_steps_that_come_and_go_claim_no_vector():
    rng = np.random.default_rng(4)
    flat = np.zeros((int(SIDE_M / 0.05),) * 2)

    def with_boxes() -> np.ndarray:
        heights = flat.copy()
        for row, column in rng.integers(0, len(flat) - 30, size=(12, 2)):
            heights[row : row + 20, column : column + 30] += rng.uniform(0.2, 0.5)
        return heights

    found = measured(*(sampled(with_boxes(), 80.0, 0.02, seed) for seed in (1, 2)))
    assert not found.significant.any()
    assert found.zones == ()


def test_the_registration_s_error_is_in_every_error(ground):
    exact, doubtful = measured(*ground), measured(*ground, Registered.shift(0.03, 0.01))
    more = doubtful.vectors.covariance - exact.vectors.covariance
    same = exact.vectors.width == doubtful.vectors.width
    known = np.isfinite(more[:, 0, 0]) & same
    assert np.allclose(more[known], np.diag([9e-4, 9e-4, 1e-4]), atol=1e-12)


def test_the_shift_of_stable_ground_is_taken_off(ground):
    first, later = ground
    shift = np.array([0.06, 0.02, 0.0])
    found = measured(first, later + shift)
    assert found.common.motion == pytest.approx(shift, abs=0.02)
    assert (found.taken_off == 0).all()
    known = measure_displacement(
        first, later + shift, DisplacementParameters(), Registered.unknown(), lambda xy: np.ones(len(xy), dtype=bool)
    )
    assert known.taken_off == pytest.approx(shift, abs=0.02)
    assert known.significant.mean() < 0.06
    assert (measured(first, later + shift, subtract=True).taken_off == known.taken_off).all()


def test_surveys_that_do_not_meet_are_refused(ground):
    with pytest.raises(InputError, match=r"do not overlap: the first spans x 500000\.4 to"):
        measured(ground[0], ground[1] + [500.0, 0.0, 0.0])
