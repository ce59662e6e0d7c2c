"""Hedges whose top goes on level from a terrace are no ground: the few returns that reach the ground below decide."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.ground.filtering import ground_mask

SIDE_M, TERRACE_M, HEIGHT_M = 40.0, 18.0, 1.1


@pytest.mark.parametrize(("returns", "width"), [(12, 3.0), (40, 1.5)])
def test_a_hedge_level_with_a_terrace_is_no_ground(returns, width):
    """A seventh of the returns passes through it."""
    rng = np.random.default_rng(1)
    xy = rng.uniform(0.0, SIDE_M, (round(returns * SIDE_M**2), 2))
    before = (xy[:, 0] >= TERRACE_M) & (xy[:, 0] < TERRACE_M + width) & (np.abs(xy[:, 1] - SIDE_M / 2) < 10.0)
    hedge = before & (rng.random(len(xy)) > 1 / 7)
    top = np.where((xy[:, 0] < TERRACE_M) | hedge, HEIGHT_M, 0.0)
    found = ground_mask(np.column_stack([xy, 0.3 * xy[:, 1] + top + rng.normal(0.0, 0.03, len(xy))]))
    assert found[hedge].mean() < 0.12
    assert found[~before].mean() > 0.93
