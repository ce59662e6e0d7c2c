"""Last returns, and return numbers that cannot be believed."""

from __future__ import annotations

import numpy as np
from slopewatch.engine.pointcloud.records import record_dtype
from slopewatch.engine.pointcloud.returns import last_returns, return_totals


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


def test_number_of_returns_is_unpacked_from_both_layouts():
    for point_format, packed in ((1, 2 | 5 << 3), (7, 2 | 12 << 4)):
        records = np.zeros(
            3, record_dtype(point_format, record_dtype(point_format, 34 if point_format == 1 else 36).itemsize)
        )
        records["flags"] = packed
        assert return_totals(records, point_format).tolist() == [5 if point_format == 1 else 12] * 3
