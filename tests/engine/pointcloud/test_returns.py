"""Last returns, and return numbers that cannot be believed."""

from __future__ import annotations

import numpy as np
from slopewatch.engine.pointcloud.returns import last_returns


def test_last_and_only_returns_are_chosen():
    number, total = np.array([1, 1, 2, 1, 2, 3]), np.array([1, 2, 2, 3, 3, 3])
    found = last_returns(number, total)
    assert found.usable
    assert not found.mixed
    assert found.last.tolist() == [True, False, True, False, False, True]


def test_numbers_that_make_no_sense_leave_every_point_in():
    zeros = last_returns(np.zeros(5, int), np.zeros(5, int))
    assert zeros.last.all()
    assert not zeros.usable
    assert not zeros.mixed
    assert zeros.note
    some = last_returns(np.array([0, 1, 1, 1]), np.array([0, 1, 1, 1]))
    assert some.last.all()
    assert not some.usable
    assert some.mixed
    # a cloud of which somebody kept the first returns only
    firsts = last_returns(np.ones(10, int), np.array([1, 1, 1, 2, 2, 2, 3, 3, 2, 2]))
    assert firsts.last.all()
    assert not firsts.usable
    assert not firsts.mixed
