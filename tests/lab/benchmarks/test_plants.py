"""Heights over the ground as the benchmark of plants measures them."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.lab.benchmarks import plants
from slopewatch.lab.benchmarks.real_data import DATA
from slopewatch.simulation.surveys.plot import grass_plot


def test_heights_are_over_the_plane_of_the_nearest_ground_points():
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0.0, 20.0, (2, 4000))
    above = np.where(rng.random(4000) < 0.2, 0.0, rng.uniform(0.5, 9.0, 4000))
    # Far from the origin, where products of coordinates lose their digits.
    xyz = np.column_stack([x + 5e5, y + 3e6, 0.7 * x - 0.4 * y + above + 800.0])
    assert plants.height_over_ground(xyz, above == 0) == pytest.approx(above, abs=1e-4)


def test_ground_points_in_one_line_give_no_tilt_across_it():
    line = np.column_stack([np.arange(30.0), np.zeros(30), np.zeros(30)])
    xyz = np.vstack([line, [[15.0, 0.5, 2.0]]])
    assert plants.height_over_ground(xyz, xyz[:, 2] == 0)[-1] == pytest.approx(2.0, abs=1e-3)


def test_figures_of_a_plot():
    made = grass_plot(1, density=100.0)
    found = plants.returns_of(made, 10.0)
    assert plants.like_grass(found)
    assert int(found.text().split("; ")[-1].removesuffix("/m²")) == pytest.approx(100, abs=5)
    assert f"ground {100 * made.cloud.truth_ground.mean():.1f} %" in found.text()
    assert not plants.like_grass(plants.returns_of(grass_plot(1, density=100.0, state="mown"), 10.0))


def test_lowest_returns_of_cells():
    made = grass_plot(1, side=5.0, density=700.0)
    least, median = plants.lowest(made, 0.5, 0.0), plants.lowest(made, 0.5, 0.5)
    assert -0.1 < least < plants.lowest(made, 0.5, 0.05) < median
    assert median == pytest.approx(float(np.median(made.above)), abs=0.03)


def test_grass_of_real_heights_only_is_like_grass():
    grown = plants.returns_of(grass_plot(2, density=100.0), 10.0)
    assert plants.like_grass(grown)
    low = plants.Returns(0.5 * grown.above, grown.ground, grown.number, grown.area)
    assert not plants.like_grass(low)


@pytest.mark.skipif(not (DATA / plants.REAL[plants.FOREST_EXAMPLE]).is_file(), reason="real clouds are missing")
def test_the_real_forest_is_what_the_simulated_one_is_tuned_to():
    found = plants.real(DATA / plants.REAL[plants.FOREST_EXAMPLE])
    assert found.ground_share == pytest.approx(1 / 59, abs=0.001)
    assert float(np.median(found.above)) == pytest.approx(4.95, abs=0.1)
