"""What stands still in the scenes for displacement vectors stands still, and objects come and go as they should."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from scipy.spatial import cKDTree
from slopewatch.engine.core.arrays import Float
from slopewatch.lab.benchmarks.displacement_scenes import (
    SIDE_M,
    bare_pair,
    changing_objects,
    furrowed_pair,
    on_the_plane,
)

_DIP = np.radians(39.0)
_PLANE = np.array([[np.cos(_DIP), 0, -np.sin(_DIP)], [0, 1, 0], [np.sin(_DIP), 0, np.cos(_DIP)]])
_NOISE_M, _CELL_M, _HIGH_M = 0.02, 0.25, 0.08


def on_the_slope(xyz: Float) -> Float:
    """(n, 3): down the dip, across it, and along the normal of a slope of 39 degrees."""
    return (xyz - [500_000.0, 3_000_000.0, 100.0]) @ _PLANE.T


def cells(flat: Float) -> Float:
    """Median height of each cell, NaN where there is no point."""
    edges = np.arange(0.0, SIDE_M + _CELL_M / 2, _CELL_M)
    return np.asarray(stats.binned_statistic_2d(flat[:, 0], flat[:, 1], flat[:, 2], "median", [edges, edges])[0])


def scatter(first: Float, later: Float) -> float:
    """Standard deviation of the differences of height of points that lie within 3 cm of each other."""
    distance, number = cKDTree(first[:, :2]).query(later[:, :2])
    near = distance < 0.03
    assert near.sum() > 1000
    return float(np.std(later[near, 2] - first[number[near], 2]))


@pytest.mark.parametrize("seed", [9, 10])
def test_bare_ground_stands_still_and_has_gaps(seed):
    first, later = (on_the_slope(xyz) for xyz in bare_pair(seed, 200.0))
    still = scatter(first, later)
    assert still == pytest.approx(np.sqrt(2) * _NOISE_M, rel=0.15)
    for shift in ([0.3, 0.0, 0.0], [0.0, 0.3, 0.0]):
        assert scatter(first, later + shift) > 1.2 * still
    middle = (slice(4, -4), slice(4, -4))
    empty = [np.isnan(cells(flat))[middle] for flat in (first, later)]
    assert (empty[0] & empty[1]).mean() == pytest.approx(0.35, abs=0.1)
    assert (empty[0] != empty[1]).mean() < 0.03


def test_a_pair_is_of_its_seed():
    for scene in (bare_pair, changing_objects):
        first, again, other = (scene(seed, 30.0)[0] for seed in (9, 9, 10))
        np.testing.assert_array_equal(first, again)
        assert not np.array_equal(first[:100], other[:100])


@pytest.mark.parametrize("seed", [9, 10, 11, 12])
def test_objects_stay_come_and_go_and_a_bowl_grows(seed):
    pair = [on_the_slope(xyz) for xyz in changing_objects(seed, 200.0)]
    first, later = (cells(flat) for flat in pair)
    high = first > _HIGH_M, later > _HIGH_M
    for kind in (high[0] & high[1], high[0] & ~high[1], ~high[0] & high[1]):
        assert 10.0 < kind.sum() * _CELL_M**2 < 0.4 * SIDE_M**2
    assert np.nanmin(first) == pytest.approx(-0.15, abs=0.03)
    assert np.nanmin(later) == pytest.approx(-0.40, abs=0.03)
    plain = (np.abs(first) < _HIGH_M / 2) & (np.abs(later) < _HIGH_M / 2)
    assert plain.mean() > 0.2
    assert abs(np.mean(later[plain] - first[plain])) < 0.002


def test_the_ground_is_smooth_and_scanned_in_lines_that_turn():
    for axis, xyz in ((1, changing_objects(9, 70.0)[0]), (0, changing_objects(9, 70.0)[1])):
        flat = on_the_slope(xyz)
        off = [np.std(flat[:, k] / 0.12 - np.rint(flat[:, k] / 0.12)) for k in (axis, 1 - axis)]
        assert off[0] == pytest.approx(0.05, abs=0.01)
        assert off[1] == pytest.approx(np.sqrt(1 / 12), abs=0.01)
        low = flat[np.abs(flat[:, 2]) < 0.06, 2]
        assert np.median(np.abs(low)) == pytest.approx(0.6745 * _NOISE_M, rel=0.15)


@pytest.mark.parametrize("seed", [101, 104])
def test_furrows_move_as_they_are_said_to_and_run_across_their_direction(seed):
    motion = np.array([0.13, -0.08])
    scene = furrowed_pair(seed, 200.0, motion)
    first, later = (on_the_plane(xyz) for xyz in (scene.first, scene.later))
    back = later - np.append(motion, 0.0)
    assert scatter(first, back) == pytest.approx(np.sqrt(2) * _NOISE_M, rel=0.15)
    middle = np.array([10.0, 10.0])
    angle = scene.across(middle, 3.0)
    near = first[np.hypot(*(first[:, :2] - middle).T) < 3.0]
    along = np.array([[np.cos(a), np.sin(a)] for a in np.radians(np.arange(0, 180, 2))])
    spread = [_unevenness(near[:, :2] @ direction, near[:, 2]) for direction in along]
    best = np.radians(2 * int(np.argmin(spread)))
    assert abs(np.sin(angle - best)) < np.sin(np.radians(8))


def _unevenness(place: Float, height: Float) -> float:
    """Variance of heights within strips of 0.1 m: least where strips follow the furrows."""
    strip = np.floor(place / 0.1).astype(int)
    strip -= strip.min()
    count = np.bincount(strip)
    mean = np.bincount(strip, height) / np.maximum(count, 1)
    return float(np.mean((height - mean[strip]) ** 2))
