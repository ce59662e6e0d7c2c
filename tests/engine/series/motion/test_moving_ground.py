"""Ground that creeps through four surveys: windows, zones and their errors against the motion that was put in."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.displacement.registered import Registered
from slopewatch.engine.displacement.status import Status
from slopewatch.engine.series.motion.field import Surveys, motion_field
from slopewatch.engine.series.motion.windows import Layout, PairMotion, layout_of, measure_pair
from slopewatch.engine.series.motion.zones import _tracks, moving_ground, unevenness
from slopewatch.interface.parameters import DisplacementParameters
from slopewatch.tests.builders.rough_ground import axes, in_the_map, relief, sampled

SIDE_M, EDGE_M = 18.0, 9.0
DAYS = np.array([0.0, 30.0, 60.0, 90.0])
RATE = 0.002  # m a day, down the dip
PARAMETERS = DisplacementParameters()
SURVEYS = Surveys(DAYS, (Registered.unknown(),) * len(DAYS))


def along(points: np.ndarray) -> np.ndarray:
    """Place down the dip, metres."""
    return np.asarray(((points - in_the_map(np.zeros((1, 3)))) @ axes().T)[:, 0])


@pytest.fixture(scope="module")
def clouds() -> list[np.ndarray]:
    heights = relief(SIDE_M, 0.15, seed=5)
    still = [sampled(heights, 80.0, 0.02, number + 1, gaps=0.3) for number in range(len(DAYS))]
    return [
        np.where((along(c) < EDGE_M)[:, None], c + RATE * day * axes()[0], c)
        for c, day in zip(still, DAYS, strict=True)
    ]


@pytest.fixture(scope="module")
def measured(clouds) -> tuple[Layout, list[PairMotion]]:
    layout = layout_of(clouds[0], PARAMETERS)
    pairs = SURVEYS.links.pairs
    return layout, [measure_pair(clouds[a], clouds[b], layout, PARAMETERS, Progress()) for a, b in pairs]


@pytest.fixture(scope="module")
def field(measured):
    return motion_field(measured[1], measured[0], SURVEYS, PARAMETERS)


def test_velocities_of_windows_are_true_within_their_errors(field):
    place = along(field.layout.places)
    inside = (place < EDGE_M - 4.0) & np.isfinite(field.velocity).all(axis=1)
    assert inside.sum() > 15
    off = field.velocity[inside] - RATE * axes()[0]
    error = np.sqrt(np.einsum("nii->ni", field.velocity_covariance[inside]))
    assert np.mean(np.abs(off) < 2 * error) > 0.85
    assert field.significant[-1][inside].mean() > 0.95
    still = (place > EDGE_M + 4.5) & field.looks[-1].measured
    assert field.significant[-1][still].mean() < 0.1


def test_steps_add_up_to_the_motion(field):
    known = np.isfinite(field.motion[:, -1]).all(axis=1)
    assert field.step[known, 1:].sum(axis=1) == pytest.approx(field.motion[known, -1])
    first = field.motion[known, 1]
    assert field.step[known, 1] == pytest.approx(first)


def test_ground_that_moves_as_one_is_one_zone_with_its_motion(field, measured, clouds):
    asked = []

    def two(earlier: int, later: int) -> tuple[np.ndarray, np.ndarray]:
        asked.append((earlier, later))
        return clouds[earlier], clouds[later]

    (zone,) = moving_ground(field, measured[1], two, PARAMETERS)
    assert zone.zone_id == "M001"
    assert zone.along - RATE * DAYS == pytest.approx(0.0, abs=0.012)
    assert (np.abs(zone.along - RATE * DAYS)[1:] < 3.5 * zone.along_error[1:]).all()
    off = zone.velocity - RATE * axes()[0]
    assert off @ np.linalg.solve(zone.velocity_covariance, off) < 16.3  # 99.9 % of three degrees of freedom
    assert abs(zone.off_dip) < 8.0
    assert zone.probability < 1e-6
    assert zone.found == 1
    assert (zone.along_variance > 0).all()
    assert along(field.layout.places[zone.windows]).max() < EDGE_M + 2.5
    assert sorted(asked) == sorted(SURVEYS.links.pairs)
    assert all(set(a) & set(b) for a, b in pairwise(asked))  # one survey stays in memory


def test_motion_that_began_at_the_last_survey_is_a_zone_too(measured, clouds):
    """Its velocity says less than its last place."""
    layout, pairs = measured
    surveys = Surveys(np.array([0.0, 300.0, 600.0, 630.0]), SURVEYS.registered)
    moving = {row: pairs[0] for row, (_, later) in enumerate(SURVEYS.links.pairs) if later == 3}
    sizes = tuple(replace(w, motion=w.motion - np.nanmean(w.motion, axis=0)) for w in pairs[0].sizes)
    still = replace(pairs[0], sizes=tuple(replace(w, motion=0 * w.motion) for w in sizes))
    found = motion_field([moving.get(row, still) for row in range(len(pairs))], layout, surveys, PARAMETERS)
    inside = (along(layout.places) < EDGE_M - 4.0) & found.looks[-1].measured
    assert not found.significant[1].any()
    assert found.significant[2][inside].mean() > 0.5


def test_windows_that_move_the_other_way_are_no_part_of_a_zone(measured):
    """They begin a survey later, at a corner of ground that slides down."""
    layout = measured[0]
    column, row = (layout.columns - layout.columns.min(axis=0)).T
    large = (column < 5) & (row < 4)
    small = (column > 4) & (column < 7) & (row > 3) & (row < 6)
    assert (np.count_nonzero(large), np.count_nonzero(small)) == (20, 4)

    place = np.zeros((len(layout.cell), len(DAYS), 3))
    place[large, :, 0] = [0.0, 0.1, 0.2, 0.3]
    place[small, :, 0] = [0.0, 0.0, -0.1, -0.2]
    found = motion_field(seen(measured, place), layout, SURVEYS, PARAMETERS)
    sliding, opposite = (set(layout.number[t.sightings[-1].cells]) for t in _tracks(found, PARAMETERS))
    assert sliding == set(np.flatnonzero(large))
    assert opposite == set(np.flatnonzero(small))


def test_still_ground_has_no_zone(clouds):
    heights = relief(SIDE_M, 0.15, seed=8)
    still = [sampled(heights, 80.0, 0.02, number + 1, gaps=0.3) for number in range(3)]
    surveys = Surveys(DAYS[:3], SURVEYS.registered[:3])
    layout = layout_of(still[0], PARAMETERS)
    pairs = [measure_pair(still[a], still[b], layout, PARAMETERS, Progress()) for a, b in surveys.links.pairs]
    found = motion_field(pairs, layout, surveys, PARAMETERS)
    assert found.looks[-1].measured.sum() > 20
    assert found.significant[-1].mean() < 0.08
    assert moving_ground(found, pairs, lambda a, b: (still[a], still[b]), PARAMETERS) == ()


def test_the_motion_of_stable_ground_is_taken_off(measured):
    layout, pairs = measured
    shift = np.array([0.03, -0.02, 0.0])  # of the last survey, by its registration
    moved = [
        replace(pair, sizes=tuple(replace(w, motion=w.motion + shift * (later == 3)) for w in pair.sizes))
        for pair, (_, later) in zip(pairs, SURVEYS.links.pairs, strict=True)
    ]
    place = along(layout.places)
    found = motion_field(moved, layout, SURVEYS, PARAMETERS, lambda xy: place > EDGE_M + 4.0)
    assert found.references.taken_off[3] @ axes().T == pytest.approx(shift, abs=0.012)
    assert np.abs(found.references.taken_off[1]).max() < 0.012
    still = (place > EDGE_M + 4.5) & found.looks[-1].measured
    assert np.median(found.motion[still, 3] @ axes().T, axis=0) == pytest.approx(0.0, abs=0.012)
    without = motion_field(moved, layout, SURVEYS, PARAMETERS)
    assert np.median(without.motion[still, 3] @ axes().T, axis=0)[0] == pytest.approx(0.03, abs=0.012)


def seen(measured, place: np.ndarray) -> list[PairMotion]:
    """Pairs in which windows were at ``place`` (windows, surveys, 3) in the plane, known to 3 mm."""
    layout, pairs = measured
    rng, known = np.random.default_rng(4), np.full(len(layout.cell), int(Status.MEASURED))
    error = np.tile(9e-6 * np.eye(3), (len(known), 1, 1))
    found = []
    for pair, (earlier, later) in zip(pairs, SURVEYS.links.pairs, strict=True):
        way = place[:, later] - place[:, earlier] + rng.normal(0, 0.003, (len(known), 3))
        sizes = tuple(replace(w, motion=way, covariance=error, status=known) for w in pair.sizes)
        found.append(replace(pair, sizes=sizes))
    return found


def test_what_a_slide_pulls_the_registration_by_is_taken_off(measured):
    layout, shift = measured[0], np.array([-0.03, 0.01, 0.0])
    sliding = along(layout.places) < 5.0
    place = np.zeros((len(layout.cell), len(DAYS), 3))
    place[sliding] = 0.1 * np.arange(len(DAYS))[:, None] * [1.0, 0.0, 0.0]
    place[:, 3] += shift
    stated = Registered(np.diag([1e-8] * 3 + [4e-6] * 3), layout.places[0], known=True)
    surveys = Surveys(DAYS, (stated,) * len(DAYS))
    found = motion_field(seen(measured, place), layout, surveys, PARAMETERS)
    back = found.references
    assert 0.05 < sliding.mean() < 0.4
    assert back.taken_off[3] @ axes().T == pytest.approx(shift, abs=0.004)
    assert back.taken_off[1] @ axes().T == pytest.approx(0.0, abs=0.004)
    off = found.motion[:, 3] @ axes().T - (place[:, 3] - shift)
    assert off == pytest.approx(0.0, abs=0.012)
    assert np.abs(off[:, :2].mean(axis=0)) == pytest.approx(0.0, abs=0.002)
    # its turn stays in the error: 0.1 mm a metre from the middle on
    far = back.centre + 30.0 * axes()[0]
    near, away = (np.sqrt(back.error_at(p[None], surveys.registered)[0, 3, 1, 1]) for p in (back.centre, far))
    assert near < 0.002
    assert away == pytest.approx(np.hypot(near, 30e-4), rel=0.02)


@pytest.mark.parametrize("case", ["registration unknown", "no motion of most", "stable ground"])
def test_nothing_is_taken_off_where_nothing_says_what_rests(measured, case):
    layout = measured[0]
    place = np.zeros((len(layout.cell), len(DAYS), 3))
    place[:, 3] += [-0.03, 0.01, 0.0]
    if case == "no motion of most":
        place[:, 3, 0] += 0.1 * (np.arange(len(place)) % 4)
    known = Registered.shift(0.002, 0.001)
    surveys = SURVEYS if case == "registration unknown" else Surveys(DAYS, (known,) * len(DAYS))
    stable = (lambda xy: np.zeros(len(xy), bool)) if case == "stable ground" else None  # seen by no window
    found = motion_field(seen(measured, place), layout, surveys, PARAMETERS, stable)
    assert not found.references.taken_off[3].any()
    assert not found.references.of_slope[3]


def test_what_was_kept_of_a_pair_comes_back(measured, tmp_path):
    pair = measured[1][0]
    pair.save(tmp_path / "motion.npz")
    again = PairMotion.load(tmp_path / "motion.npz")
    assert again.kernel == pair.kernel
    for one, other in zip(pair.sizes, again.sizes, strict=True):
        assert np.array_equal(one.motion, other.motion, equal_nan=True)
        assert np.array_equal(one.common, other.common)
        assert one.radius == other.radius
    (tmp_path / "motion.npz").write_bytes(b"nothing")
    with pytest.raises(InputError, match="remove the folder"):
        PairMotion.load(tmp_path / "motion.npz")


def test_ground_that_creeps_unevenly_has_a_mean_that_is_less_sure():
    rng = np.random.default_rng(1)
    even = 0.5 + rng.normal(0, 0.05, 4000)
    assert unevenness(even, np.full(4000, 0.05), 1.0) < 0.03
    mixed = np.where(np.arange(4000) % 2, 0.3, 0.7) + rng.normal(0, 0.05, 4000)
    assert unevenness(mixed, np.full(4000, 0.05), 4.0) == pytest.approx(0.2 / 2 / 0.5, rel=0.05)
    assert unevenness(mixed[:1], np.full(1, 0.05), 1.0) == 0.0
