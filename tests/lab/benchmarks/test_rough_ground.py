"""The grounds of the benchmark differ in what it says they differ in."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.lab.benchmarks import rough_ground


@pytest.fixture(scope="module")
def grounds():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rough_ground, "real_grounds", list)
        return rough_ground.grounds()


def test_rougher_grounds_are_the_same_slope_with_what_they_say_added(grounds):
    names = list(grounds)
    whole = grounds[names[0]]
    assert len(names) == 2 + 2 * len(rough_ground.TEXTURES)
    for name, (_, amount) in zip(names[2::2], rough_ground.TEXTURES, strict=True):
        added = grounds[name] - whole
        size = np.linalg.norm(added, axis=1)
        assert np.sqrt(np.mean(size**2)) == pytest.approx(amount, rel=0.02)
        direction = added[size > 0.01] / size[size > 0.01, None]
        np.testing.assert_allclose(np.abs(direction @ direction[0]), 1.0, atol=1e-6)
    for name in names[1::2]:
        assert len(grounds[name]) == pytest.approx(rough_ground.PART**2 * rough_ground.DENSITY, rel=0.25)


def test_scatter_is_that_of_the_ground_about_its_trends():
    rng = np.random.default_rng(4)
    x, y = rng.uniform(0, 40, (2, 20_000))
    wave = 0.2 * np.sin(2 * np.pi * x / 14.0)  # far wider than the short trend, followed by it; not by the long one
    near, far = rough_ground.scatter(np.column_stack([x, y, 0.7 * y + wave]))
    assert near < 0.6 * far
    assert far < 0.2
