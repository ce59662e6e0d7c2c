"""From voxels to points, against the sum written out."""

from __future__ import annotations

import numpy as np
from slopewatch.models.inference.interpolation import VoxelInterpolation


def test_inverse_square_of_the_distance_to_the_nearest_few():
    rng = np.random.default_rng(3)
    points, values = rng.uniform(0, 10, (300, 3)), rng.uniform(size=(300, 3))
    asked = rng.uniform(0, 10, (40, 3))
    found = VoxelInterpolation(points, 0.4, 4).at(asked, values)
    for point, result in zip(asked, found):
        distance = np.linalg.norm(points - point, axis=1)
        nearest = np.argsort(distance)[:4]
        weight = 1 / (distance[nearest] ** 2 + (0.05 * 0.4) ** 2)
        np.testing.assert_allclose(result, (weight[:, None] * values[nearest]).sum(axis=0) / weight.sum(), rtol=1e-5)


def test_one_neighbour_is_the_nearest_and_few_voxels_are_enough():
    points, values = np.array([[0.0, 0, 0], [1.0, 0, 0]]), np.array([[1.0, 0], [0.0, 1]])
    asked = np.array([[0.2, 0, 0], [0.9, 0, 0]])
    np.testing.assert_array_equal(VoxelInterpolation(points, 0.4, 1).at(asked, values), [[1, 0], [0, 1]])
    two = VoxelInterpolation(points, 0.4, 4).at(asked, values)
    assert two[0, 0] > 0.9
    assert two[1, 1] > 0.9
    np.testing.assert_allclose(two.sum(axis=1), 1.0, rtol=1e-6)


def test_an_outline_lies_nearer_to_the_truth_than_voxels_allow():
    # The boundary of two classes runs across voxels of 1 m whose averages are known.
    rng = np.random.default_rng(5)
    xy = rng.uniform(0, 40, (60_000, 2))
    truth = (xy[:, 0] + 0.5 * xy[:, 1] > 30).astype(int)
    cell = np.floor(xy).astype(int)
    index = cell[:, 0] * 40 + cell[:, 1]
    count = np.bincount(index, minlength=1600)
    share = np.bincount(index, weights=truth, minlength=1600) / count
    middle = np.stack([np.bincount(index, weights=xy[:, k], minlength=1600) / count for k in range(2)], axis=1)
    points, values = np.column_stack([middle, np.zeros(1600)]), np.column_stack([1 - share, share])
    flat = np.column_stack([xy, np.zeros(len(xy))])
    stepped = (values[index].argmax(axis=1) != truth).mean()
    between = (VoxelInterpolation(points, 1.0, 4).at(flat, values).argmax(axis=1) != truth).mean()
    assert between < 0.8 * stepped
