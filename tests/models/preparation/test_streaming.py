"""A cloud in parts gives what the whole cloud gives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.geometry.dominant_plane import apply_matrix
from slopewatch.models.configuration import SMOKE
from slopewatch.models.inference.baseline import residual_configuration
from slopewatch.models.preparation.bump_filter import cell_heights
from slopewatch.models.preparation.prepare import prepare_cloud
from slopewatch.models.preparation.relief_channels import CHANNELS, relief_channels
from slopewatch.models.preparation.relief_raster import CELL_M
from slopewatch.models.preparation.streaming import prepare_parts, prepared_in_voxels, sample_parts
from slopewatch.models.preparation.thinning import Thinning
from slopewatch.models.preparation.voxel_sums import VoxelSums
from slopewatch.models.preparation.voxels import voxel_grid
from slopewatch.models.screening.detectability import PART_M


def in_parts(xyz, sizes):
    def parts():
        start = 0
        for size in sizes:
            yield xyz[start : start + size]
            start += size
        yield xyz[start:]

    return parts


def test_sums_are_the_averages_of_the_voxel_grid_in_its_order(small_scene):
    matrix = prepare_cloud(small_scene.xyz, SMOKE).matrix
    expected = voxel_grid(apply_matrix(matrix, small_scene.xyz), 0.3)
    sums = VoxelSums(matrix, 0.3)
    sums.add(small_scene.xyz)
    found = sums.finish()
    np.testing.assert_allclose(found.grid.points, expected.points, atol=2e-6)
    np.testing.assert_array_equal(found.grid.count, expected.count)
    np.testing.assert_array_equal(found.lookup(small_scene.xyz), expected.inverse)
    assert (found.lookup(small_scene.xyz[:10] + 500.0) == -1).all()


def test_however_a_cloud_is_cut_its_voxels_are_the_same_bit_for_bit(small_scene):
    xyz = small_scene.xyz
    whole, voxel = prepared_in_voxels(xyz, SMOKE)
    for sizes in ([1, 7, 0, 5000], [len(xyz) // 3] * 2, [100] * 50):
        parts = in_parts(xyz, sizes)
        cloud, voxels = prepare_parts(parts, sample_parts(parts), SMOKE)
        np.testing.assert_array_equal(cloud.voxels.points, whole.voxels.points)
        np.testing.assert_array_equal(cloud.residuals, whole.residuals)
        np.testing.assert_array_equal(np.concatenate([voxels.lookup(part) for part in parts()]), voxel)


def test_merging_on_the_way_changes_nothing():
    rng = np.random.default_rng(3)
    xyz = rng.uniform(0, 100, (1_200_000, 3)) * (1, 1, 0.01)
    at_once, in_turns = VoxelSums(np.eye(4), 0.25), VoxelSums(np.eye(4), 0.25)
    at_once.add(xyz)
    for part in np.array_split(xyz, 13):
        in_turns.add(part)
    first, second = at_once.finish(), in_turns.finish()
    np.testing.assert_array_equal(first.grid.points, second.grid.points)
    assert int(first.grid.count.sum()) == len(xyz)


def test_the_sample_is_even_bounded_and_depends_on_the_number_of_points_alone():
    rows = np.arange(10_007)
    for cuts in ([10_007], [3, 4000, 1, 6003], [10] * 1000 + [7]):
        thinning = Thinning(1000)
        for part in np.split(rows, np.cumsum(cuts)[:-1]):
            thinning.add(part)
        np.testing.assert_array_equal(thinning.rows(), rows[::16])
    whole = Thinning(20_000)
    whole.add(rows)
    np.testing.assert_array_equal(whole.rows(), rows)


def test_prediction_of_parts_is_that_of_the_whole(torch, small_scene):
    from slopewatch.models.inference.prediction import predict, predict_voxels
    from slopewatch.models.network.randlanet import RandLANet

    torch.manual_seed(4)
    network = RandLANet(replace(SMOKE, window=10.0, step=7.0, interpolation=1)).eval()
    expected = predict(network, small_scene.xyz, rotations=2).probabilities
    parts = in_parts(small_scene.xyz, [1234, 5, 9000])
    cloud, voxels = prepare_parts(parts, sample_parts(parts), network.configuration)
    found, _ = predict_voxels(network, cloud, rotations=2, threads=2)
    for part, same in zip(parts(), np.split(expected, [1234, 1239, 10239])):
        np.testing.assert_array_equal(found[voxels.lookup(part)], same)


def test_what_cannot_be_prepared_is_refused():
    xyz = np.random.default_rng(0).uniform(0, 10, (100, 3))
    with pytest.raises(InputError, match="30 ground points"):
        sample_parts(in_parts(xyz[:30], [10]))
    xyz[50, 1] = np.nan
    with pytest.raises(InputError, match="not numbers"):
        sample_parts(in_parts(xyz, [60]))
    far = VoxelSums(np.eye(4), 0.1)
    with pytest.raises(InputError, match="outliers"):
        far.add(np.array([[0.0, 0.0, 0.0], [2e5, 0.0, 0.0]]))


def test_a_cloud_with_a_far_outlier_is_refused_rather_than_filling_the_memory(small_scene):
    far = small_scene.xyz.mean(axis=0) + [9000.0, 9000.0, 0.0]
    parts = in_parts(np.concatenate([small_scene.xyz, far[np.newaxis]]), [100])
    with pytest.raises(InputError, match="remove its outliers"):
        prepare_parts(parts, sample_parts(parts), SMOKE)


@pytest.mark.parametrize("density", [3.0, 60.0])
def test_cells_and_channels_of_parts_are_those_of_all_points_at_once(density):
    """Scatter within cells too, though only averages of quarters of the cells are held."""
    rng = np.random.default_rng(8)
    flat = np.column_stack([rng.uniform(0, 30, (round(900 * density), 2)), rng.normal(0, 0.05, round(900 * density))])
    flat[:, 2] += 0.2 * np.sin(flat[:, 0]) + np.where(flat[:, 0] > 15, 2.0 * (flat[:, 0] - 15), 0.0)
    turn = np.array([[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]])
    parts = in_parts(flat @ turn.T + (5e5, 3.5e6, 100.0), [100, 1, 1500])
    cloud, voxels = prepare_parts(parts, sample_parts(parts), residual_configuration(PART_M), spread=True)
    points = apply_matrix(cloud.matrix, np.concatenate(list(parts())))
    origin = np.floor(points[:, :2].min(axis=0) / CELL_M) * CELL_M
    shape = tuple(int(n) + 1 for n in np.floor((points[:, :2].max(axis=0) - origin) / CELL_M))
    whole = cell_heights(points, CELL_M, origin, shape)
    found = cell_heights(cloud.voxels.points, CELL_M, origin, shape, cloud.voxels.count, voxels.spread)
    np.testing.assert_array_equal(found.count, whole.count)
    np.testing.assert_allclose(found.height, whole.height, atol=2e-6)
    np.testing.assert_allclose(found.scatter, whole.scatter, atol=2e-6)
    np.testing.assert_allclose(relief_channels(found).channels, relief_channels(whole).channels, atol=1e-3)
    averages = cell_heights(cloud.voxels.points, CELL_M, origin, shape, cloud.voxels.count)
    number = CHANNELS.index("log scatter in cells")
    off = relief_channels(averages).channels[number] - relief_channels(whole).channels[number]
    assert density < 10 or np.abs(off).max() > 0.2, "the test would not see averages of parts taken for points"


def test_the_spread_within_voxels_is_that_of_their_points():
    rng = np.random.default_rng(9)
    xyz = rng.uniform(0, 2, (500, 3))
    sums = VoxelSums(np.eye(4), 0.5, spread=True)
    for part in np.array_split(xyz, 7):
        sums.add(part)
    found = sums.finish()
    place = found.lookup(xyz)
    for voxel in range(len(found.grid.points)):
        own = xyz[place == voxel] - xyz[place == voxel].mean(axis=0)
        expected = (own.T @ own)[np.triu_indices(3)]
        np.testing.assert_allclose(found.spread[voxel], expected, atol=1e-5)
    without = VoxelSums(np.eye(4), 0.5)
    without.add(xyz)
    assert without.finish().spread is None
