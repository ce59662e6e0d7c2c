"""Gaps filled from the nearest known cell, against looking at every cell."""

from __future__ import annotations

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from slopewatch.engine.statistics.nearest_known import nearest_known


@given(arrays(bool, st.tuples(st.integers(1, 6), st.integers(1, 6))))
def test_each_cell_gets_a_known_one_that_none_is_nearer_than(known: np.ndarray) -> None:
    assume(known.any())
    row, column = nearest_known(known)
    places = np.argwhere(known)
    for i, j in np.ndindex(known.shape):
        assert known[row[i, j], column[i, j]]
        nearest = np.hypot(*(places - (i, j)).T).min()
        assert np.hypot(row[i, j] - i, column[i, j] - j) == nearest
        assert not known[i, j] or (row[i, j], column[i, j]) == (i, j)
