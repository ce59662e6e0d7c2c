"""What a rigid motion leaves on stable ground: a bend counts, errors that neighbours share and vegetation do not."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.geometry.pose import Pose
from slopewatch.engine.registration.point_to_plane import Matcher
from slopewatch.engine.registration.quality import agreement
from slopewatch.engine.registration.surface import Surface

SIDE, SPACING = 30.0, 0.25
"""Blocks of the misfit are 20 times the spacing wide."""
AMPLITUDE = 0.02


def surface(seed: int, shape: str = "plane", plants: float | None = None) -> Surface:
    """A plane with a noise of 5 mm; ``bend`` adds one sine wave over the side, ``tufts`` errors of squares of 1 m."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, SIDE, (int((SIDE / SPACING) ** 2), 2))
    z = 0.005 * rng.standard_normal(len(xy))
    if shape == "bend":
        z += AMPLITUDE * np.sin(2 * np.pi * xy[:, 0] / SIDE)
    elif shape == "tufts":
        square = np.floor(xy).astype(int)
        z += AMPLITUDE * rng.standard_normal((int(SIDE), int(SIDE)))[square[:, 0], square[:, 1]]
    xyz = np.column_stack([xy - SIDE / 2, z])
    return Surface(xyz, 0.1, None if plants is None else np.full(len(xyz), plants))


def misfit(moving: Surface, reference: Surface | None = None) -> float:
    return agreement(Matcher(reference or surface(1), moving), Pose.identity(), 1.0).misfit


def test_a_bend_is_what_a_rigid_motion_leaves():
    # six blocks in a wave of 30 m, at 30, 90, 150 degrees and on: half of the amplitude at the median, 5 % smoothed
    assert misfit(surface(2, "bend")) == pytest.approx(1.4826 * 0.5 * 0.95 * AMPLITUDE, rel=0.2)


def test_errors_that_neighbours_share_are_noise_of_the_blocks_means():
    # 25 tufts in a block leave 4 mm of its mean, which is no misfit
    found = [misfit(surface(seed, "tufts")) for seed in range(3, 9)]
    assert np.sqrt(np.mean(np.square(found))) < 0.003


def test_under_vegetation_a_spread_is_no_misfit():
    assert misfit(surface(2, "bend", plants=0.03)) == 0.0
    assert misfit(surface(2, "bend"), surface(1, plants=0.03)) == 0.0
    assert misfit(surface(2, "bend", plants=0.0), surface(1, plants=0.0)) > 0.5 * AMPLITUDE
