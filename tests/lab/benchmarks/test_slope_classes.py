"""Shares by class of slope, and halves of a slope, by hand."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from slopewatch.lab.benchmarks import slope_classes
from slopewatch.lab.benchmarks.real_data import split
from slopewatch.lab.benchmarks.table import counted, ratio_class


def test_shares_are_of_the_classes_that_hold_enough():
    slope = np.concatenate([np.full(300, 10.0), np.full(400, 15.0), np.full(199, 50.0)])
    significant = np.zeros(899, dtype=bool)
    significant[:12], significant[300:340] = True, True
    shares = slope_classes.shares_by_slope(slope, significant)
    assert shares == {"0-15°": pytest.approx(0.04), "15-30°": pytest.approx(0.1)}
    assert slope_classes.text(shares) == "0-15° 4.0 %, 15-30° 10.0 %"
    assert not slope_classes.met(shares)
    assert slope_classes.met({"0-15°": 0.03}, {"0-15°": 0.07})
    assert not slope_classes.met({"0-15°": 0.05}, {"0-15°": 0.08})


def test_halves_meet_at_the_median_and_reach_beyond_the_points():
    xyz = np.column_stack([[0.0, 1.0, 10.0], [0.0, 5.0, 2.0], np.zeros(3)])
    (west, middle, western), (east, same, eastern) = slope_classes.halves(xyz, 2.0)
    assert (middle, same, western, eastern) == (1.0, 1.0, True, False)
    assert west.bounds == (-2.0, -2.0, 1.0, 7.0)
    assert east.bounds == (1.0, -2.0, 12.0, 7.0)
    assert shapely.intersection(west, east).area == 0.0


def test_a_split_shares_no_point_and_leaves_none():
    cloud = np.random.default_rng(1).random((1001, 3))
    first, second = split(cloud, 3)
    assert (len(first), len(second)) == (500, 501)
    assert {tuple(p) for p in first} | {tuple(p) for p in second} == {tuple(p) for p in cloud}


def test_words_for_counts_and_classes():
    assert counted([True, False, True], 0) == "2 of 3 (67 %)"
    assert counted([]) == "0 of 0"
    assert (ratio_class(1.5, 3.0), ratio_class(3.0, np.inf)) == ("1.5 to 3", "3 and more")
