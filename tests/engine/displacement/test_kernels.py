"""The compiled ways and numpy's give the same, and what they should."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage
from slopewatch.engine.core.compiled import Kernel
from slopewatch.engine.displacement.kernels import block_sums, sampled, sampled_in_both, tukey, weighted
from slopewatch.engine.displacement.least_squares import Region, fit_motion, middle_of
from slopewatch.engine.displacement.near_ground import near_points
from slopewatch.engine.displacement.status import Status
from slopewatch.engine.displacement.surface_kernels import half_gaussian, limits_of, smoothed_planes


def both_ways(kernel: Kernel, *args):
    """What the compiled way gives; numpy's is the same, bit for bit."""
    compiled, plain = kernel(*args), kernel.plain(*args)
    for one, other in zip(*((a if isinstance(a, tuple) else (a,)) for a in (compiled, plain)), strict=True):
        assert (one.dtype, one.shape) == (other.dtype, other.shape)
        assert np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    return compiled


def surface(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(3, 40, 30))
    values[:, rng.random((40, 30)) < 0.05] = np.nan
    return values


def nodes(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.integers(-3, 43, 500), rng.integers(-3, 33, 500)


def test_both_ways_sample_the_same_bits():
    found = both_ways(sampled, surface(0), *nodes(0), 0.3, 0.75)
    assert 50 < np.isfinite(found[0]).sum() < 450


def test_nodes_that_both_surfaces_know_have_the_values_of_each():
    first, later, (rows, columns) = surface(1), surface(2), nodes(3)
    places = np.random.default_rng(4).normal(size=(500, 3))
    seen, before, after, place = both_ways(
        sampled_in_both, first, later, rows, columns, places, (2, -1, 0.3, 0.75), (-2, 0, 0.7, 0.25)
    )
    one = sampled.plain(first, rows + 2, columns - 1, 0.3, 0.75)
    other = sampled.plain(later, rows - 2, columns, 0.7, 0.25)
    assert np.array_equal(seen, np.isfinite(one[0]) & np.isfinite(other[0]))
    assert 50 < seen.sum() < 450
    assert np.array_equal(before, one[:, seen].T)
    assert np.array_equal(after, other[:, seen].T)
    assert np.array_equal(place, places[seen])
    inside = np.full((2, 9), 10)
    whole = both_ways(
        sampled_in_both, np.ones((3, 40, 30)), np.ones((3, 40, 30)), *inside, places[:9], (0, 0, 0.5, 0.5),
        (0, 0, 0.5, 0.5),
    )  # fmt: skip
    assert whole[0].all()
    assert np.array_equal(whole[3], places[:9])


def test_weights_fall_to_nothing_at_the_limit():
    residual = np.linspace(-2.0, 2.0, 401)
    weight = both_ways(tukey, residual, 1.0)
    assert np.allclose(weight, np.clip(1 - residual**2, 0, None) ** 2)


def test_sums_of_blocks_are_those_of_their_nodes():
    rng = np.random.default_rng(5)
    before, after, place = rng.normal(size=(3, 300, 3))
    weight, residual, block = rng.random(300), rng.normal(size=300), rng.integers(0, 7, 300)
    jacobian, by_weight, later = both_ways(weighted, before, after, place, weight)
    assert np.allclose(jacobian, np.hstack([(before[:, 1:] + after[:, 1:]) / 2, place]))
    assert np.allclose(by_weight, jacobian * weight[:, None])
    assert np.allclose(later, after[:, 1:] * weight[:, None])
    sums, parts = both_ways(block_sums, before, after, jacobian, weight, residual, block, 8)
    for number in range(8):
        mine = block == number
        assert np.allclose(sums[number], jacobian[mine].T @ (weight * residual)[mine])
        want = jacobian[mine].T @ by_weight[mine]
        cross = before[mine, 1:].T @ later[mine]
        want[:2, :2] = (cross + cross.T) / 2
        # of a rise and another unknown one survey's half counts twice
        want[2:, :2] = parts[number, 2:, :2]
        want[:2, 2:] = want[2:, :2].T
        assert np.allclose(parts[number], want)
        assert np.allclose(parts[number, 2:, :2], place[mine].T @ (weight[:, None] * jacobian[:, :2])[mine])
    with pytest.raises(IndexError):
        block_sums(before, after, jacobian, weight, residual, block, 3)


@pytest.mark.parametrize("count", [1, 2, 7, 100])
def test_the_middle_value_is_the_median(count):
    values = np.random.default_rng(count).normal(size=count)
    assert middle_of(values) == np.median(values)


def test_the_gaussian_is_that_of_scipy():
    impulse = np.zeros(41)
    impulse[20] = 1.0
    for sigma in (1.0, 2.24, 3.7):
        half = half_gaussian(sigma, 3.0)
        want = ndimage.gaussian_filter(impulse, sigma, mode="constant", truncate=3.0)
        assert np.allclose(want[20 : 20 + len(half)], half, rtol=1e-14)
        assert np.count_nonzero(want) == 2 * len(half) - 1


def test_nodes_have_the_plane_of_least_squares_through_the_points_around():
    rng = np.random.default_rng(6)
    shape, sigma, step = (50, 40), 2.3, 0.05
    x, y = rng.uniform(-24, 24, 900), rng.uniform(-19, 19, 900)
    z = 0.02 * x - 0.01 * y + rng.normal(0, 0.02, 900)
    near = np.rint(np.column_stack([x + 25, y + 20])).astype(np.int64)
    half = half_gaussian(sigma, 3.0)
    values = both_ways(smoothed_planes, near[:, 0] * 40 + near[:, 1], x, y, z, shape, half, limits_of(sigma, 7.0, step))
    assert 0.5 < np.isfinite(values[0]).mean() < 1.0
    full = np.concatenate([half[:0:-1], half])
    reach = len(half) - 1
    for i, j in ((25, 20), (12, 30), (40, 8)):
        du, dv = near[:, 0] - i, near[:, 1] - j
        chosen = (np.abs(du) <= reach) & (np.abs(dv) <= reach)
        root = np.sqrt(full[du[chosen] + reach] * full[dv[chosen] + reach])
        design = np.column_stack([np.ones(chosen.sum()), x[chosen] - (i - 25), y[chosen] - (j - 20)])
        plane = np.linalg.lstsq(design * root[:, None], z[chosen] * root, rcond=None)[0]
        assert np.allclose(values[:, i, j], [plane[0] + 7.0, plane[1] / step, plane[2] / step], rtol=1e-9)
    with pytest.raises(IndexError):
        smoothed_planes(np.array([2000]), x[:1], y[:1], z[:1], shape, half, limits_of(sigma, 7.0, step))


def test_places_with_a_point_near_them_are_those_of_all_pairs():
    rng = np.random.default_rng(7)
    xyz = rng.uniform(-5, 45, size=(150, 3))
    x, y = 0.5 + np.arange(20) * 2.0, 39.5 - np.arange(18) * 2.0
    found = both_ways(near_points, xyz, x, y, 1.0)
    want = [[bool((np.hypot(xyz[:, 0] - east, xyz[:, 1] - north) < 1.0).any()) for east in x] for north in y]
    assert np.array_equal(found, want)
    assert 0.05 < found.mean() < 0.6
    assert np.array_equal(both_ways(near_points, xyz, x[:1], y[:1], 30.0), [[True]])


def test_nodes_on_one_line_hold_no_tilt():
    rng = np.random.default_rng(8)
    surfaces = rng.normal(0, 0.02, (2, 3, 40, 120))
    surfaces[:, :, :20], surfaces[:, :, 22:] = np.nan, np.nan
    found = fit_motion(*surfaces, Region.disc(2.0, 1), (20, 60), np.zeros(2), 1.0)
    assert found == Status.LITTLE_SEEN
