"""How intervals of volumes are judged, against a brute-force reference."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.lab.benchmarks.demchange import Volumes


def test_intervals_are_scored_by_their_width_and_by_what_they_miss() -> None:
    measured, error, true = np.array([0.0, 10.0, -4.0]), np.array([1.0, 2.0, 0.5]), np.array([1.0, 16.0, -8.0])
    scores = []
    for m, e, t in zip(measured, error, true, strict=True):
        low, high = m - 1.959964 * e, m + 1.959964 * e
        scores.append(high - low + 40 * max(low - t, 0) + 40 * max(t - high, 0))
    volumes = Volumes(measured, error, true, np.ones(3))
    assert volumes.interval_score == pytest.approx(np.mean(scores), rel=1e-6)
    assert volumes.covered == [True, False, False]
    wider = Volumes(measured, 100 * error, true, np.ones(3))
    assert all(wider.covered)
    assert wider.interval_score > volumes.interval_score
