"""Objects that are put into clouds."""

from __future__ import annotations

import numpy as np
from slopewatch.lab.benchmarks.put_objects import Shape, Thing, ended


def test_a_pulse_ends_at_its_first_return_on_an_object():
    number = np.array([1, 2, 3, 1, 2, 1, 1, 2], dtype=np.uint8)
    hit = np.array([False, True, True, True, True, True, True, False])
    # the first pulse passes a crown; of the second only the first return is left; the last one misses with its second
    assert ended(hit, number).tolist() == [True, True, False, True, False, True, True, True]


def test_returns_below_the_top_go_up_to_it():
    thing = Thing(Shape("wall", 4.0, 1.0, 1.2), (0.0, 0.0, 10.0), (0.5, 0.0), 0.0, True)
    xyz = np.array([[0.0, 0.0, 10.0], [1.0, 0.2, 10.5], [1.0, 0.2, 12.5], [1.0, 2.0, 10.5]])
    moved, hit = thing.put_into(xyz, np.random.default_rng(1))
    assert hit.tolist() == [True, True, False, False]
    np.testing.assert_allclose(moved[:2, 2], [11.2, 11.7], atol=0.1)
    np.testing.assert_array_equal(moved[2:], xyz[2:])
