"""A cloud in parts gives what the whole cloud gives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.geometry.dominant_plane import apply_matrix
from slopewatch.models.configuration import SMOKE
from slopewatch.models.preparation.prepare import prepare_cloud
from slopewatch.models.preparation.streaming import prepare_parts, prepared_in_voxels, sample_parts
from slopewatch.models.preparation.thinning import Thinning
from slopewatch.models.preparation.voxel_sums import VoxelSums
from slopewatch.models.preparation.voxels import voxel_grid


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
