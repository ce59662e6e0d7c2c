"""Change and its level of detection against known surfaces and the binomial expectation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
import shapely.affinity
from slopewatch.engine.change.difference import Areas, difference, uniform_shift
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.grid import common_grid as grids
from slopewatch.engine.grid.common_grid import common_grid, memory_needed, slope_area
from slopewatch.interface.parameters import ChangeParameters


def surface(x, y):
    return 100.0 + 0.4 * x + 0.2 * np.sin(y)


def epoch(seed: int, *, n: int = 60_000, noise: float = 0.02, lowered: float = 0.0, side: float = 20.0) -> np.ndarray:
    """A rough slope; x < 5 is lowered."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, side, (2, n))
    z = surface(x, y) + rng.normal(0, noise, n) - np.where(x < 5, lowered, 0.0)
    return np.column_stack([x, y, z])


def test_known_lowering_is_measured_with_its_sign():
    change = difference(epoch(1), epoch(2, lowered=0.2), ChangeParameters(cell=0.5, adaptive=False))
    west = change.dz[:, :10]
    east = change.dz[:, 10:]
    assert west.mean() == pytest.approx(-0.2, abs=0.002)
    assert east.mean() == pytest.approx(0.0, abs=0.002)
    assert change.significant[:, :10].all()


@pytest.mark.parametrize("statistic", ["mean", "plane"])
@pytest.mark.parametrize("density", [6_000, 60_000])
def test_unchanged_ground_exceeds_the_level_about_as_often_as_promised(statistic, density):
    parameters = ChangeParameters(cell=0.5, cell_value=statistic, minimum_points=1, adaptive=False)
    shares = []
    for seed in range(4):
        change = difference(epoch(10 + seed, n=density), epoch(20 + seed, n=density), parameters)
        shares.append(change.significant[change.valid].mean())
    assert 0.03 <= np.mean(shares) <= 0.07


def test_registration_error_adds_in_quadrature():
    first, second = epoch(1), epoch(2)
    parameters = ChangeParameters(cell=0.5, calibrate=False, adaptive=False)
    without = difference(first, second, parameters)
    given = difference(first, second, parameters, registration_error=0.03)
    overridden = difference(first, second, replace(parameters, registration_error=0.03))
    assert np.nanmax(np.abs(given.error**2 - without.error**2 - 0.03**2)) < 1e-12
    assert np.array_equal(given.error, overridden.error, equal_nan=True)


def test_confidence_scales_the_level():
    change = difference(epoch(1), epoch(2), ChangeParameters(cell=0.5, confidence=0.6827))
    assert np.nanmax(np.abs(change.level - change.error)) < 1e-4  # one sigma


def test_cells_count_only_with_enough_points_in_both_epochs():
    first = np.array([[0.5, 0.5, 1.0], [0.6, 0.5, 1.0], [1.5, 0.5, 1.0], [2.5, 0.5, 1.0]])
    second = np.array([[0.5, 0.5, 2.0], [0.6, 0.5, 2.0], [1.5, 0.5, 2.0], [1.6, 0.5, 2.0], [3.5, 0.5, 2.0]])
    loose = difference(first, second, ChangeParameters(cell=1.0, adaptive=False))
    strict = difference(first, second, ChangeParameters(cell=1.0, adaptive=False, minimum_points=2))
    assert loose.valid.tolist() == [[True, True, False, False]]
    assert strict.valid.tolist() == [[True, False, False, False]]
    assert loose.common_cell_rate == pytest.approx(2 / 4)
    assert strict.common_cell_rate == pytest.approx(1 / 2)


def test_one_lucky_pair_of_points_is_not_significant():
    """Two points that happen to agree do not make their cell's error zero: the neighbourhood counts."""
    first, second = epoch(1, n=3000), epoch(2, n=3000)
    for points, height in ((first, 0.0), (second, 0.03)):
        inside = (np.abs(points[:, 0] - 10.25) < 0.25) & (np.abs(points[:, 1] - 10.25) < 0.25)
        points[inside] = points[inside][:1]
        points[inside, 2] = 100.0 + height
    pair = [np.vstack([p, p[-1:]]) for p in (first, second)]
    change = difference(*pair, ChangeParameters(cell=0.5, adaptive=False))
    assert np.nanmin(change.error) > 0.005


def test_no_overlap_names_both_extents():
    far = epoch(1) + [1000.0, 0.0, 0.0]
    with pytest.raises(InputError, match=r"x 0\.0 to 20\.0.*x 1000\.0 to 1020\.0"):
        difference(epoch(1), far, ChangeParameters())


def test_too_large_a_grid_is_refused_with_a_cell_that_fits():
    first = epoch(1)
    outlier = np.vstack([first, [3e6, 10.0, 100.0]])
    with pytest.raises(InputError, match="cell of at least") as refusal:
        common_grid(first, outlier, ChangeParameters(cell=0.1, memory_limit=0.1))
    fits = float(str(refusal.value).split("at least ")[1].split(" m")[0])
    common_grid(first, outlier, ChangeParameters(cell=fits * 1.05, memory_limit=0.1))


def test_a_slope_turned_against_north_needs_what_it_covers_and_little_for_the_rectangle(monkeypatch):
    """The same area along an axis and turned: the rectangle is 12 times as large, what is needed not even twice."""
    rng = np.random.default_rng(0)
    u, v = rng.uniform(0, 700, 20_000), rng.uniform(0, 30, 20_000)
    straight = np.column_stack([u, v, 0 * u])
    turned = np.column_stack([0.8 * u - 0.6 * v, 0.6 * u + 0.8 * v, 0 * u])
    parameters = ChangeParameters(cell=0.1)
    areas = [slope_area((cloud, cloud), 0.1) for cloud in (straight, turned)]
    assert areas == pytest.approx([21_000, 21_000], rel=0.3)
    monkeypatch.setattr(grids, "_MOST_SQUARES", 0)
    assert [slope_area((cloud, cloud), 0.1) for cloud in (straight, turned)] == areas  # sorted, not marked
    needed = []
    for cloud, area in zip((straight, turned), areas, strict=True):
        west, south, east, north = *cloud[:, :2].min(axis=0), *cloud[:, :2].max(axis=0)
        needed.append(memory_needed((west, south, east, north), area, parameters, plants=False))
    assert needed[0] < 1.1e9
    assert needed[1] < 2e9


def test_a_cell_left_to_the_clouds_becomes_as_large_as_the_memory_needs():
    first, second = epoch(1, side=40.0, n=160_000), epoch(2, side=40.0, n=160_000)
    free = difference(first, second, ChangeParameters())
    assert free.grid.cell == 0.1
    tight = difference(first, second, ChangeParameters(memory_limit=0.05))
    assert tight.grid.cell == 0.2
    assert "of the 0.05 GB allowed" in tight.choice.sentence
    with pytest.raises(InputError, match=r"more than the 0\.05 GB"):
        difference(first, second, ChangeParameters(cell=0.1, memory_limit=0.05))


def test_uniform_shift_is_told_from_deformation():
    rng = np.random.default_rng(0)
    level = np.full(10_000, 0.05)
    noise = rng.normal(0, 0.02, 10_000)
    assert uniform_shift(noise - 0.3, level) == pytest.approx(-0.3, abs=0.001)
    assert uniform_shift(noise, level) is None
    assert uniform_shift(noise[:10] - 0.3, level[:10]) is None, "ten cells are no overlap to judge by"
    assert uniform_shift(noise - np.where(np.arange(10_000) < 2000, 0.3, 0.0), level) is None
    assert uniform_shift(noise - rng.uniform(0.1, 1.5, 10_000), level) is None


def test_cells_at_the_edge_of_the_clipped_area_are_left_out():
    """Clipped to a tilted square, on a steep face: edge cells hold other parts of their surface in each epoch."""
    ring = shapely.affinity.rotate(shapely.box(3, 3, 17, 17), 30)
    shift = np.array([0.17, -0.11, 0.0])
    clouds = []
    for seed, moved in ((1, 0.0), (2, 1.0)):
        points = epoch(seed, n=200_000, noise=0.005)
        points[:, 2] = 100 + 1.5 * points[:, 0]
        inside = shapely.contains_xy(ring, *(points[:, :2] - moved * shift[:2]).T)
        clouds.append(points[inside])
    area = ring.intersection(shapely.affinity.translate(ring, *shift[:2]))
    parameters = ChangeParameters(cell=0.5, adaptive=False, direction="vertical")
    change = difference(*clouds, parameters, areas=Areas(area))
    everything = difference(*clouds, parameters)
    grid = change.grid
    for row, column in np.ndindex(grid.shape):
        west, north = grid.west + column * grid.cell, grid.north - row * grid.cell
        whole = area.contains(shapely.box(west, north - grid.cell, west + grid.cell, north))
        assert whole or not change.valid[row, column]
    assert change.valid.sum() > 0.8 * everything.valid.sum()
    assert np.nanmax(np.abs(everything.dz)) > 0.05 > np.nanmax(np.abs(change.dz))


def test_without_two_points_in_any_cell_there_is_no_level_and_so_no_result():
    first = np.array([[0.5, 0.5, 1.0], [5.5, 0.5, 1.0]])
    with pytest.raises(InputError, match="larger cell"):
        difference(first, first + [0.0, 0.0, 3.0], ChangeParameters(cell=1.0))


def test_thresholds_that_state_the_error_take_cells_of_one_point():
    rng = np.random.default_rng(6)
    x, y = (axis.ravel() + 0.5 for axis in np.meshgrid(np.arange(20.0), np.arange(20.0)))
    first, second = (np.column_stack([x, y, 0.1 * x + rng.normal(0, 0.01, x.size)]) for _ in range(2))
    second[x < 5, 2] -= 0.5
    stated = {"constant": 0.2 / 1.959964, "propagated": np.hypot(0.03, 0.04)}
    for threshold, error in stated.items():
        parameters = ChangeParameters(
            cell=1.0, adaptive=False, threshold=threshold, constant_level=0.2, error_from=0.03, error_to=0.04
        )
        change = difference(first, second, parameters)
        assert np.array_equal(change.significant, np.arange(20)[None, :] * np.ones((20, 1)) < 5)
        assert change.error[change.valid] == pytest.approx(error, rel=1e-6)


def test_the_published_profile_subtracts_the_cells_means_and_calibrates_nothing():
    first, second = epoch(1, n=20_000), epoch(2, n=20_000, lowered=0.2)
    change = difference(first, second, ChangeParameters.build({"cell": 0.5}, profile="paper"))
    means = []
    for points in (first, second):
        column, row = (np.floor(points[:, axis] / 0.5).astype(int) for axis in (0, 1))
        total, count = np.zeros((40, 40)), np.zeros((40, 40))
        np.add.at(total, (39 - row, column), points[:, 2])
        np.add.at(count, (39 - row, column), 1)
        means.append(total / count)
    assert np.abs(change.dz - (means[1] - means[0])).max() < 1e-9
    assert (change.model.kind, change.threshold, change.direction) == ("uncalibrated", "probabilistic", "vertical")
    assert np.allclose(change.level, 1.959964 * change.error)
