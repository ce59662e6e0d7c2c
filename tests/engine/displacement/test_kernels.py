"""The compiled way and numpy's give the same."""

from __future__ import annotations

import numpy as np
from slopewatch.engine.displacement.kernels import sampled


def test_both_ways_sample_the_same_bits():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(3, 40, 30))
    values[:, rng.random((40, 30)) < 0.1] = np.nan
    rows, columns = rng.integers(-3, 43, 500), rng.integers(-3, 33, 500)
    compiled, plain = (way(values, rows, columns, 0.3, 0.75) for way in (sampled, sampled.plain))
    assert np.array_equal(compiled, plain, equal_nan=True)
    assert 50 < np.isfinite(plain[0]).sum() < 450
