"""Robust scatter, against sorting."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from slopewatch.engine.statistics.robust import NORMALISED, nmad

VALUES = st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=40)


def sorted_median(values: list[float]) -> float:
    ordered, half = sorted(values), len(values) // 2
    return ordered[half] if len(values) % 2 else (ordered[half - 1] + ordered[half]) / 2


@given(VALUES, st.one_of(st.none(), st.floats(-1e6, 1e6)))
def test_it_is_the_median_distance_from_the_middle(values: list[float], middle: float | None) -> None:
    about = sorted_median(values) if middle is None else middle
    expected = 1.4826 * sorted_median([abs(v - about) for v in values])
    assert nmad(np.array(values), middle) == pytest.approx(expected, rel=1e-12, abs=1e-9)


def test_of_normal_values_it_is_their_standard_deviation_whatever_a_third_of_them_is() -> None:
    values = np.random.default_rng(1).normal(3.0, 0.2, 200_000)
    assert nmad(values) == pytest.approx(0.2, rel=0.01)
    assert nmad(values, 3.0) == pytest.approx(0.2, rel=0.01)
    values[:30_000] += 1e6
    assert nmad(values, 3.0) < 0.25


def test_it_is_a_plain_number_also_of_single_precision() -> None:
    values = np.array([0.0, 1.0, 2.0, 4.0, 8.0], dtype=np.float32)
    assert type(nmad(values)) is float
    assert nmad(values) == 2.0 * NORMALISED
