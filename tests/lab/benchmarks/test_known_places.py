"""What stands out by height at known places: all of it on even ground, none where the ground itself is as rough."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slopewatch.lab.benchmarks.known_places import fitted_hazards, standing_share
from slopewatch.lab.making.rough_ground import scene_normal, texture
from slopewatch.simulation.hazard_scenes.scenes import scene


@pytest.fixture(scope="module")
def hazardous():
    return scene(11, "realistic", area=1600.0, density=25.0)


def _flattened(scene_, waves):
    """The scene's hazards on a plane with ``waves`` (n,) instead of its own ground."""
    plane = scene_.to_plane(scene_.xyz)
    return replace(scene_, xyz=scene_.xyz + np.outer(scene_.displacement + waves - plane[:, 2], scene_normal(scene_)))


def test_on_even_ground_every_hazard_stands_out_with_its_own_height(hazardous):
    found = fitted_hazards(_flattened(hazardous, np.random.default_rng(1).normal(0.0, 0.01, len(hazardous))))
    assert found
    assert all(hazard.stands_out(0.05) for hazard in found)
    for hazard in found:
        assert abs(hazard.height) == pytest.approx(hazard.amplitude, rel=0.25)
        assert np.abs(hazard.places).max() < 0.05


def test_on_ground_that_rolls_higher_than_they_do_few_stand_out(hazardous):
    xy = hazardous.to_plane(hazardous.xyz)[:, :2]
    rolling = _flattened(hazardous, texture(xy, 1.2, 1.0, np.random.default_rng(2)))
    share, count = standing_share([rolling])
    assert count == len(fitted_hazards(rolling))
    assert share <= 0.34


def test_a_scene_without_large_hazards_has_none_to_fit(hazardous):
    assert fitted_hazards(hazardous, amplitude=5.0) == []
