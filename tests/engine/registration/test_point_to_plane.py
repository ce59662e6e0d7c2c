"""Residuals between surfaces whose distance is known, and what is robust about their scale."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slopewatch.engine.geometry.pose import Pose
from slopewatch.engine.registration.point_to_plane import Matcher, regional_weights, tukey_weights
from slopewatch.engine.registration.surface import Surface
from slopewatch.engine.statistics.robust import robust_scale


def dome(seed: int, n: int = 20_000, noise: float = 0.0) -> np.ndarray:
    """A sphere's cap of radius 5 m: strongly curved, so that planes cut off its hollow side."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-2, 2, (2, n))
    return np.column_stack([x, y, np.sqrt(25 - x**2 - y**2) - 5 + rng.normal(0, noise, n)])


def test_residual_is_the_moving_surface_above_the_reference_in_both_directions():
    up = np.array([0.0, 0.0, 0.03])
    matcher = Matcher(Surface(dome(1), 0.1), Surface(dome(2) + up, 0.1))
    sources = matcher.sample(5000)
    for pairs in (
        matcher.onto_reference(Pose.identity(), sources[1], 0.3, 0.8),
        matcher.onto_moving(Pose.identity(), sources[0], 0.3, 0.8),
    ):
        upwards = pairs.residual * np.sign(pairs.normal[:, 2]) / np.abs(pairs.normal[:, 2])
        assert np.median(upwards) == pytest.approx(0.03, abs=0.004)


def test_curvature_cancels_between_the_two_directions():
    matcher = Matcher(Surface(dome(1), 0.1), Surface(dome(2), 0.1))
    sources = matcher.sample(20_000)
    one = matcher.onto_reference(Pose.identity(), sources[1], 0.3, 0.8)
    two = matcher.onto_moving(Pose.identity(), sources[0], 0.3, 0.8)
    biases = [float(np.mean(p.residual * np.sign(p.normal[:, 2]))) for p in (one, two)]
    assert biases[0] > 5e-4
    assert biases[1] < -5e-4
    assert abs(sum(biases)) < 0.1 * abs(biases[0])


def test_the_gap_is_the_distance_of_the_surfaces_with_about_half_the_noise_of_a_point():
    """Of a point and the mean of the twelve around it, itself one of them, half of the sum has 0.56 of its noise."""
    rng = np.random.default_rng(3)
    flat = [np.column_stack([*rng.uniform(-4, 4, (2, 60_000)), rng.normal(0, 0.004, 60_000)]) for _ in range(2)]
    matcher = Matcher(Surface(flat[0], 0.05), Surface(flat[1] + [0.0, 0.0, 0.01], 0.05))
    turn = Pose.from_vector(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.02]), 1.0)
    sources = matcher.sample(100_000)
    for pairs in (matcher.onto_reference(turn, sources[1], 0.3, 0.8), matcher.onto_moving(turn, sources[0], 0.3, 0.8)):
        assert (pairs.normal[:, 2] > 0).all()
        assert pairs.gap.mean() == pytest.approx(0.03, abs=5e-4)
        assert 0.5 * pairs.residual.std() < pairs.gap.std() < 0.7 * pairs.residual.std()


def test_pairs_do_not_depend_on_what_was_matched_before():
    """Neighbours that are kept from call to call are those of a new search."""
    surfaces = Surface(dome(1), 0.1), Surface(dome(2), 0.1)
    used = Matcher(*surfaces)
    rng = np.random.default_rng(0)
    pose = Pose.identity()
    for size, limit in ((0.2, 500), (0.02, 3000), (0.002, 1000), (0.03, 3000)):
        pose = pose.moved(rng.normal(0, size, 6), 2.0)
        new = Matcher(*surfaces).match(pose, used.sample(limit), 0.3)
        again = used.match(pose, used.sample(limit), 0.3)
        assert len(new) > 100
        for one, other in zip(vars(new).values(), vars(again).values(), strict=True):
            assert np.array_equal(one, other)


def test_jacobian_is_the_change_of_the_residual():
    matcher = Matcher(Surface(dome(1), 0.1), Surface(dome(2), 0.1))
    _, sources = matcher.sample(500)
    start = Pose.from_vector(np.array([0.01, -0.02, 0.01, 0.02, 0.01, -0.03]), 2.0)
    before = matcher.onto_reference(start, sources, 0.5, 0.5)
    # a rotation turns half of the mean normal, too, by its angle times the distance of the pair's points
    for motion, rounding in (([0, 0, 0, 1e-7, 5e-7, -3e-7], 1e-11), ([3e-7, -2e-7, 4e-7, 0, 0, 0], 3e-7 * 0.1)):
        after = matcher.onto_reference(start.moved(np.array(motion), 2.0), sources, 0.5, 0.5)
        assert np.array_equal(before.source, after.source)
        assert np.abs(after.residual - before.residual - before.jacobian(2.0) @ motion).max() < rounding


def test_only_pairs_on_stable_ground_are_made():
    reference, moving = Surface(dome(1), 0.1), Surface(dome(2), 0.1)
    matcher = Matcher(reference, moving, reference.points[:, 0] < 0)
    pairs = matcher.match(Pose.identity(), matcher.sample(5000), 0.3)
    assert len(pairs) > 1000
    assert pairs.place[:, 0].max() < 0.1  # half a voxel and more, as a point just beyond may be nearest to one within


@pytest.mark.parametrize("share", [0.0, 0.3, 0.55])
def test_scale_is_that_of_the_unchanged_part(share):
    rng = np.random.default_rng(0)
    residual = rng.normal(0, 0.02, 20_000)
    residual[: int(share * len(residual))] -= 0.3
    assert robust_scale(residual) == pytest.approx(0.02, rel=0.25)
    # what a median makes of it, so that the test can fail
    if share > 0.5:
        assert 1.4826 * np.median(np.abs(residual)) > 0.1


def test_weights_fall_from_one_to_zero():
    assert tukey_weights(np.array([0.0, 0.01, 0.0469, 1.0]), 0.01) == pytest.approx([1.0, 0.911, 0.0, 0.0], abs=1e-3)


def test_a_region_that_changed_is_left_out_as_a_whole():
    """Also its pairs whose residual is small by chance."""
    matcher = Matcher(Surface(dome(1), 0.1), Surface(dome(2), 0.1))
    pairs = matcher.match(Pose.identity(), matcher.sample(5000), 0.3)
    changed = pairs.place[:, 0] > 1.0
    residual = np.where(changed & (np.arange(len(pairs)) % 3 > 0), 0.3, 0.0)
    weight = regional_weights(replace(pairs, residual=residual), scale=0.01, block=0.25)
    # blocks that the surface only grazes hold too few pairs to tell; they are few
    agreeing = changed & (residual == 0)
    assert np.mean(weight[agreeing & (pairs.place[:, 0] > 1.3)]) < 0.05
    assert np.mean(weight[pairs.place[:, 0] < 0.7]) > 0.95
