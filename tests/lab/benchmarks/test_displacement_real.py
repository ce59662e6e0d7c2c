"""Halves of a real cloud hold all of its points once, moved by what is said."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.lab.benchmarks.displacement_real import REAL, SHIFTS_M, real_pair

GULLIES = next(ground for ground in REAL if ground.patches)


@pytest.mark.skipif(not GULLIES.path.exists(), reason=f"{GULLIES.path.name} is not here")
def test_halves_of_a_patch_are_moved_down_the_dip():
    for number in (2, 3):
        pair = real_pair(GULLIES, number)
        assert np.linalg.norm(pair.motion) == pytest.approx(SHIFTS_M[number])
        assert pair.motion[2] < 0
        back = pair.later - pair.motion
        both = np.concatenate([pair.first, back])
        assert np.ptp(both[:, 0]) <= 40.0
        assert np.ptp(both[:, 1]) <= 40.0
        assert abs(len(pair.first) - len(back)) <= 1
        assert len(np.unique(both.round(4), axis=0)) == len(both)
        assert 1.0 < pair.points_per_m2 < 20.0
