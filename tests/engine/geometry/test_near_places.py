"""Points near to places, against every distance."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.geometry.near_places import near_places


@pytest.mark.parametrize("reach", [1.0, 2.0, 4.0])
def test_what_is_near_agrees_with_every_distance(reach):
    """Points lie in and out of the places' extent, one far off."""
    random = np.random.default_rng(17)
    places = random.uniform(-9.0, 9.0, (40, 3))
    points = np.concatenate([random.uniform(-20.0, 20.0, (4000, 3)), np.float64([[1e7, -1e7, 0.0]])])
    away = np.hypot(*(points[:, None, :2] - places[None, :, :2]).transpose(2, 0, 1)).min(axis=1)
    assert 0.05 < (away <= reach).mean() < 0.9
    assert (near_places(places, points, reach) == (away <= reach)).all()
    grid = reach * np.stack(np.meshgrid(*[np.linspace(-1.55, 1.55, 62)] * 2), axis=-1).reshape(-1, 2)
    assert (near_places(np.zeros((1, 3)), grid, reach) == (np.hypot(*grid.T) <= reach)).all()


def test_nothing_is_near_without_places():
    assert not near_places(np.zeros((0, 3)), np.zeros((5, 3)), 1.0).any()
