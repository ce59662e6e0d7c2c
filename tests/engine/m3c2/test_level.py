"""The calibrated level of detection of M3C2 against distances whose errors were put in."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.m3c2.distances import (
    Cylinder,
    Cylinders,
    Distances,
    Status,
    cylinder_statistics,
    level_of_detection,
)
from slopewatch.engine.m3c2.lattice import Lattice
from slopewatch.engine.m3c2.level import calibrated, level_facts, report_level, sampling_errors, slope_of
from slopewatch.engine.m3c2.spread import Spread

SIDE, POINTS, SCATTER = 100, 30, 0.05
RADIUS = 0.5
SAMPLING = SCATTER * np.sqrt(2 / POINTS)


def face(
    distance: np.ndarray, dip: np.ndarray | float, *, registration: float = 0.0, side: int = SIDE, **cylinders
) -> Distances:
    """Core points 1 m apart (their cylinders share nothing) on a face whose normals dip by ``dip`` degrees."""
    m = distance.size
    v, u = np.divmod(np.arange(m), side)
    dip = np.radians(np.broadcast_to(dip, m))
    normal = np.column_stack([np.zeros(m), -np.sin(dip), np.cos(dip)])
    middle = float(np.median(dip))
    core = np.column_stack([u, v * np.cos(middle), v * np.sin(middle)]).astype(float)
    one = Cylinders(np.full(m, POINTS), np.zeros(m), np.full(m, SCATTER), **cylinders)
    two = Cylinders(np.full(m, POINTS), distance, np.full(m, SCATTER), **cylinders)
    level = level_of_detection(one, two, 0.95, registration)
    return Distances(
        core, normal, distance, level, np.abs(distance) > level, one, two, np.zeros(m, np.uint8), 0.95, registration
    )


def noise(seed: int, factor: np.ndarray | float = 1.0, size: int = SIDE**2) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=size) * SAMPLING * factor


def beyond(found: Distances) -> float:
    return float(found.significant[found.measured].mean())


class TestSharesBeyond:
    @pytest.mark.parametrize("dip", [20.0, 60.0, 90.0])
    @pytest.mark.parametrize("factor", [0.6, 1.0, 1.8])
    def test_unchanged_ground_is_beyond_as_often_as_the_confidence_says(self, factor, dip):
        """On a slope, a face and a wall, whose core points lie on a line in the map."""
        plain = face(noise(1, factor), dip)
        found = calibrated(plain, RADIUS)
        assert 0.04 <= beyond(found) <= 0.06
        assert found.model.kind == "calibrated"
        assert found.model.typical == pytest.approx(factor, rel=0.06)
        # ... also with what was learned elsewhere
        other = noise(2, factor)
        assert 0.04 <= np.mean(np.abs(other) > found.level) <= 0.06

    def test_each_slope_has_its_own(self):
        dip = np.random.default_rng(3).uniform(5, 75, SIDE**2)
        truth = np.interp(dip, [0, 80], [0.5, 2.0])
        found = calibrated(face(noise(4, truth), dip), RADIUS)
        for low in range(5, 75, 10):
            inside = (dip >= low) & (dip < low + 10)
            assert 0.03 <= found.significant[inside].mean() <= 0.07, low
        assert not 0.03 <= beyond(face(noise(4, truth), dip)) <= 0.07, "the published level needs it"

    def test_the_registrations_error_is_summed_in_squares(self):
        """One bias for all of a survey, drawn anew for each: of many surveys 5 % of the core points are beyond."""
        error, shares, published = 0.02, [], []
        for seed in range(40):
            bias = np.random.default_rng(100 + seed).normal() * error
            plain = face(noise(seed, size=3000) + bias, 30.0, registration=error)
            squares = 1.959964 * np.hypot(SAMPLING, error)
            found = calibrated(plain, RADIUS)
            assert np.all(found.level >= 1.959964 * error)
            shares.append(np.mean(np.abs(plain.distance) > squares))
            published.append(beyond(plain))
        assert 0.02 <= np.mean(shares) <= 0.08
        assert np.mean(published) < 0.5 * np.mean(shares)

    def test_plants_that_the_clouds_tell_of_widen_it_along_the_normal(self):
        dip, plants = 60.0, 0.08
        blocks = np.kron(np.random.default_rng(5).normal(size=(25, 25)), np.ones((4, 4))).ravel()
        errors = np.full(SIDE**2, plants)
        distance = noise(6) + blocks * plants * np.sqrt(2) * np.cos(np.radians(dip))
        told = calibrated(face(distance, dip, value=errors), RADIUS)
        assert 0.02 <= beyond(told) <= 0.07
        bare = face(distance, dip)
        assert beyond(bare) > 0.3
        # nothing of it stays with plants that err alike in both epochs
        alike = calibrated(face(noise(7), dip, value=errors), RADIUS)
        assert alike.plants_factor < 0.5
        assert np.median(alike.level) < 0.6 * np.median(told.level)


class TestLeftAsPublished:
    def test_where_more_than_a_third_has_moved(self):
        moved = np.repeat([0.3, 0.0], [4000, 6000])
        plain = face(noise(8) + moved, 30.0, registration=0.01)
        found = calibrated(plain, RADIUS)
        np.testing.assert_array_equal(found.level, plain.level)
        progress = Progress()
        report_level(found, progress)
        assert "more than a third" in progress.warnings[0]
        assert "as published" in level_facts(found, calibrate=True)["level"]

    def test_where_all_has_moved(self):
        plain = face(noise(9) + 0.3, 30.0, registration=0.01)
        np.testing.assert_array_equal(calibrated(plain, RADIUS, uniform=True).level, plain.level)

    def test_of_too_few_core_points(self):
        plain = face(noise(10, 0.5, size=40), 30.0, registration=0.01)
        found = calibrated(plain, RADIUS)
        np.testing.assert_array_equal(found.level, plain.level)
        assert "only 40" in found.model.notes[0]

    def test_of_too_few_that_share_no_points(self):
        """Nine core points in each cylinder tell of little more than one."""
        plain = face(noise(11, 0.5, size=100), 30.0)
        assert calibrated(plain, RADIUS).model.kind == "calibrated"
        assert calibrated(plain, 3 * RADIUS).model.kind == "uncalibrated"

    def test_where_the_squares_are_wider(self):
        """Few points and no registration error: Student's quantile is wider than the normal one."""
        few = Cylinders(np.full(40, 5), np.zeros(40), np.full(40, SCATTER))
        plain = face(noise(12, size=40), 30.0)
        found = calibrated(Distances(**(vars(plain) | {"reference": few, "moving": few})), RADIUS)
        expected = stats.t.ppf(0.975, 8) * SCATTER * np.sqrt(2 / 5)
        assert np.all(found.level == pytest.approx(expected))


def test_it_is_narrowed_only_where_both_halves_of_the_ground_agree():
    """Patches of a chessboard in turn with the errors that their points say, and half of them."""
    side, size = 108, 108 * 27  # twelve patches of 9 m along, three across
    v, u = np.divmod(np.arange(size), side)
    quiet = ((u // 9 + v // 9) % 2).astype(bool)
    found = calibrated(face(noise(13, np.where(quiet, 0.4, 1.0), size), 0.0, side=side), RADIUS)
    assert found.model.typical > 0.9
    everywhere = calibrated(face(noise(13, 0.4, size), 0.0, side=side), RADIUS)
    assert everywhere.model.typical < 0.5


def test_a_change_does_not_widen_the_level_of_the_rest():
    distance = noise(14)
    distance.reshape(SIDE, SIDE)[20:40, 20:40] -= 0.2
    found = calibrated(face(distance, 30.0), RADIUS)
    changed = (distance < -0.15).reshape(SIDE, SIDE)
    assert found.significant.reshape(SIDE, SIDE)[20:40, 20:40].all()
    assert changed[20:40, 20:40].mean() > 0.95
    assert found.model.typical == pytest.approx(1.0, abs=0.06)


def test_stable_ground_that_is_given_alone_counts():
    west = np.arange(SIDE**2) % SIDE < 50
    found = calibrated(face(noise(15, np.where(west, 1.0, 2.0)), 30.0), RADIUS, given=west)
    assert found.model.typical == pytest.approx(1.0, abs=0.06)
    assert 0.04 <= found.significant[west].mean() <= 0.06
    assert found.significant[~west].mean() > 0.2


def test_students_quantile_after_welch():
    """Against many pairs of samples: 5 % of their means are beyond, which the normal quantile does not give."""
    rng = np.random.default_rng(16)
    first, second = rng.normal(0, 0.05, (20_000, 5)), rng.normal(0, 0.02, (20_000, 8))
    one, two = (Cylinders(np.full(20_000, s.shape[1]), s.mean(axis=1), s.std(axis=1, ddof=1)) for s in (first, second))
    difference = np.abs(two.mean - one.mean)
    assert np.mean(difference > 1.959964 * sampling_errors(one, two, 0.95)) == pytest.approx(0.055, abs=0.005)
    assert np.mean(difference > level_of_detection(one, two, 0.95, 0.0)) > 0.08
    k = 7
    result = stats.ttest_ind(second[k], first[k], equal_var=False)
    level = 1.959964 * sampling_errors(one, two, 0.95)[k]
    assert level == pytest.approx(result.confidence_interval(0.95).high - (two.mean - one.mean)[k], rel=1e-4)


def test_uneven_sampling_is_part_of_the_error():
    spread = [Spread(np.array([[x, 0.0]]), np.array([[1.0, 1.0, 0.0, 0.2, 0.0]])) for x in (0.0, 0.3)]
    one, two = (Cylinders(np.array([1000]), np.zeros(1), np.array([0.1]), spread=s) for s in spread)
    left = 0.1**2 - 0.2**2 / 999  # about the plane, which rises 0.2 m a metre
    assert sampling_errors(one, two, 0.95)[0] == pytest.approx(np.hypot(np.sqrt(2 * left / 1000), 0.2 * 0.3), rel=0.01)


def test_points_at_random_on_a_tilted_surface_have_the_error_of_their_scatter():
    """Cylinders of two clouds on a plane of 39 degrees, measured upright: their distances scatter by it."""
    rng = np.random.default_rng(19)
    clouds = [np.column_stack([xy, xy @ [0.8, 0.0] + rng.normal(0, 0.02, 60_000)])
              for xy in (rng.uniform(0, 60, (60_000, 2)) for _ in range(2))]  # fmt: skip
    core = np.stack(np.meshgrid(np.arange(1, 59, 1.0), np.arange(1, 59, 1.0), [0.0]), axis=-1).reshape(-1, 3)
    core[:, 2] = 0.8 * core[:, 0]
    up = np.tile([0.0, 0.0, 1.0], (len(core), 1))
    one, two = (cylinder_statistics(Lattice(c, 0.5), core, up, Cylinder(0.5, 2.0), spread=True) for c in clouds)
    error, distance = sampling_errors(one, two, 0.95), two.mean - one.mean
    assert np.sqrt(np.mean(error**2)) == pytest.approx(np.sqrt(np.mean(distance**2)), rel=0.05)
    assert np.mean(np.abs(distance) > 1.959964 * error) < 0.06
    # and more than the scatter alone it tells which
    assert np.corrcoef(error, np.abs(distance))[0, 1] > 0.8


def test_unmeasured_core_points_stay_without_a_level():
    plain = face(noise(17), 30.0)
    status = plain.status.copy()
    status[:3] = Status.FEW_POINTS, Status.NO_POINTS, Status.NO_NORMAL
    level = plain.level.copy()
    level[:3] = np.nan
    found = calibrated(Distances(**(vars(plain) | {"status": status, "level": level})), RADIUS)
    assert np.isnan(found.level[:3]).all()
    assert not found.significant[:3].any()
    assert np.isfinite(found.level[3:]).all()


def test_slopes_of_normals():
    normal = np.array([[0, 0, 1.0], [0, 0, -1], [1, 0, 0], [0, np.sqrt(0.5), np.sqrt(0.5)], [0, 0, 0]])
    np.testing.assert_allclose(slope_of(normal), [0, 0, 90, 45, np.nan], atol=1e-6)


def test_a_cylinders_mean_value_is_that_of_its_points():
    rng = np.random.default_rng(18)
    cloud, values = rng.uniform(0, 4, (3000, 3)), rng.uniform(0, 1, 3000)
    core = rng.uniform(1, 3, (30, 3))
    axis = np.tile([0.0, 0.6, 0.8], (30, 1))
    found = cylinder_statistics(Lattice(cloud, 0.5, values=values), core, axis, Cylinder(0.5, 0.8)).value
    for place, value in zip(core, found, strict=True):
        offset = cloud - place
        along = offset @ axis[0]
        inside = (np.abs(along) <= 0.8) & (np.linalg.norm(offset - along[:, None] * axis[0], axis=1) <= 0.5)
        assert value == pytest.approx(values[inside].mean())


def test_core_points_far_apart_need_no_huge_grid():
    plain = face(noise(20), 30.0)
    found = calibrated(Distances(**(vars(plain) | {"core": plain.core * 5000})), RADIUS)
    assert found.model.kind == "calibrated"
    assert 0.04 <= beyond(found) <= 0.06
