"""Quantiles against numpy's."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.statistics.quantiles import sample_quantile

RNG = np.random.default_rng(1)
COUNT = 20_011
SAMPLES = {
    "normal": RNG.normal(size=COUNT),
    "sorted, with a long tail": np.sort(RNG.pareto(1.5, COUNT)),
    "few": RNG.normal(size=7),
    "one": np.array([3.0]),
    "all alike": np.full(COUNT, 2.5),
    "many alike": RNG.integers(0, 3, COUNT).astype(float),
    "a period that every probe hits": np.where(np.arange(COUNT) % 20, RNG.normal(size=COUNT), 1e6),
}


@pytest.mark.parametrize("kind", SAMPLES)
def test_quantiles_equal_numpys(kind):
    values = SAMPLES[kind]
    before = values.copy()
    for probability in (0.0, 0.003, 0.5, 0.9, 0.95, 0.9999, 1.0):
        assert sample_quantile(values, probability) == pytest.approx(np.quantile(values, probability), rel=1e-15)
    assert np.array_equal(values, before), "the values are not the function's to sort"
