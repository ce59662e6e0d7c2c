"""Returns that are no surface's: as many as asked for, alone, below the ground or along their beam."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from slopewatch.interface.parameters import SurveyParameters
from slopewatch.simulation.surveys.plot import plot

BARE = SurveyParameters(seed=9, vegetation=0.0, range_noise=0.0)


@pytest.mark.parametrize("share", [0.002, 0.01, 0.05])
def test_share_of_returns_below_the_ground(share):
    made = plot(replace(BARE, multipath=share, grass=1.0), density=300.0, slope=20.0)
    below = made.above < -0.02
    expected = share * len(made.cloud)
    assert below.sum() == pytest.approx(expected, abs=4 * np.sqrt(expected))
    assert not made.cloud.truth_ground[below].any()
    depth = -made.above[below]
    assert depth.min() > 0.05
    assert 0.2 < np.median(depth) < 2.0
    # Single points: the next one below the ground is as far as chance puts it.
    if share < 0.01:
        places = made.cloud.xyz[below]
        near = cKDTree(places).query(places, k=2)[0][:, 1]
        assert np.median(near) > 0.3


def test_stray_returns_lie_along_the_beam():
    made = plot(replace(BARE, stray=0.05), density=100.0, slope=20.0)
    away = np.abs(made.above) > 0.05
    assert away.mean() == pytest.approx(0.05, abs=0.01)
    assert made.above.max() > 8.0
    assert made.above.min() < -1.0
    assert not made.cloud.truth_ground[away].any()


def test_echo_numbers_stay_whole():
    made = plot(replace(BARE, multipath=0.05, stray=0.05, grass=1.0), density=100.0)
    assert (made.cloud.return_number <= made.cloud.number_of_returns).all()
    order = np.lexsort((made.cloud.return_number, made.cloud.gps_time))
    same = np.diff(made.cloud.gps_time[order]) == 0
    assert (np.diff(made.cloud.xyz[order, 2])[same] < 0).all()
