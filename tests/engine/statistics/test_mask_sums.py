"""Sums over a mask, against every cell's own."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import correlate
from slopewatch.engine.statistics.mask_sums import mask_sums


@pytest.mark.parametrize("shape", [(1, 1), (3, 5), (9, 3), (21, 21)])
def test_sums_are_those_of_the_cells_under_the_mask(shape):
    random = np.random.default_rng(5)
    values, mask = random.normal(0.0, 1.0, (14, 9, 2)), random.random(shape) < 0.6
    told = np.stack([correlate(values[..., k], mask.astype(float), mode="constant") for k in (0, 1)], axis=-1)
    np.testing.assert_allclose(mask_sums(values, mask), told, atol=1e-12)
