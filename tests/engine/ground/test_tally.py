"""Counts gathered in parts against a dictionary."""

from __future__ import annotations

from collections import Counter

import numpy as np
from slopewatch.engine.geometry.point_spacing import point_spacing, spacing_of_squares
from slopewatch.engine.ground import tally as module
from slopewatch.engine.ground.tally import Tally, metre_squares, square_keys, square_places


def test_counts_in_parts_are_those_of_a_dictionary(monkeypatch):
    monkeypatch.setattr(module, "_MAX_PENDING", 50)
    rng = np.random.default_rng(0)
    tally, expected = Tally(), Counter()
    for _ in range(40):
        part = rng.integers(-30, 30, 20)
        tally.add(part)
        expected.update(part.tolist())
    assert dict(zip(tally.found()[0].tolist(), tally.counts().tolist(), strict=True)) == expected
    assert (np.diff(tally.found()[0]) > 0).all()


def test_rows_are_summed_by_number():
    tally = Tally(2)
    tally.add_sums(np.array([3, 7]), np.array([[1.0, 2.0], [10.0, 20.0]]))
    tally.add_sums(np.array([7]), np.array([[5.0], [0.5]]))
    numbers, sums = tally.found()
    assert numbers.tolist() == [3, 7]
    assert sums.tolist() == [[1.0, 7.0], [10.0, 20.5]]


def test_places_come_back_from_their_numbers_also_west_and_south_of_zero():
    rng = np.random.default_rng(1)
    places = np.vstack([rng.integers(-(2**30), 2**30, (100, 2)), [[0, 0], [-1, -1], [-1, 0], [0, -1], [5, -7]]])
    assert np.array_equal(square_places(square_keys(places)), places)
    assert np.array_equal(square_places(metre_squares(np.array([[-0.5, 1.5]]))), [[-1, 1]])


def test_the_spacing_from_squares_is_that_of_the_points():
    rng = np.random.default_rng(2)
    # squares begin at the points' lowest in the one, at zero in the other: the corners are points here
    for density in (50.0, 3.0, 0.4):
        xy = np.vstack([[0.0, 0.0], [64.0, 64.0], rng.uniform(0, 64, (int(density * 64 * 64), 2))])
        keys, counts = np.unique(metre_squares(xy), return_counts=True)
        assert spacing_of_squares(square_places(keys), counts) == point_spacing(xy)
