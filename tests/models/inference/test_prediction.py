"""Predictions with a network whose answers are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from slopewatch.engine.core.errors import InputError
from slopewatch.models.configuration import SMOKE
from slopewatch.models.inference.baseline import residual_probabilities
from slopewatch.models.preparation.prepare import prepare_cloud

PLAIN = replace(SMOKE, interpolation=1)
"""Every point has its own voxel's answer, so that it can be looked up."""


@pytest.fixture
def known(torch):
    """A function that makes a 'network' of a configuration: logits that are functions of a point's features."""

    def make(configuration, function):
        class Known(torch.nn.Module):
            def __init__(self):
                super().__init__()
                self.configuration = configuration

            def forward(self, features, coordinates, graphs):
                return function(features, coordinates)

        return Known().eval()

    return make


def by_height(torch):
    return lambda features, _: torch.stack([0 * features[:, 3], 40 * features[:, 3], -40 * features[:, 3]], dim=1)


def test_every_point_gets_the_class_of_its_voxel_in_the_cloud_s_order(torch, known, small_scene):
    from slopewatch.models.inference.prediction import predict

    prediction = predict(known(PLAIN, by_height(torch)), small_scene.xyz)
    cloud = prepare_cloud(small_scene.xyz, SMOKE)
    height = cloud.residuals[cloud.voxels.inverse, 0] / SMOKE.residual_scale
    expected = np.where(height > 0, 1, 2)
    clear = np.abs(height) > 0.02
    np.testing.assert_array_equal(prediction.labels[clear], expected[clear])
    assert prediction.probabilities.shape == (len(small_scene), 3)
    np.testing.assert_allclose(prediction.probabilities.sum(axis=1), 1, atol=1e-5)
    assert prediction.filled == 0.0
    # In another order the points keep their answers.
    order = np.random.default_rng(1).permutation(len(small_scene))
    again = predict(known(PLAIN, by_height(torch)), small_scene.xyz[order])
    assert (again.labels == prediction.labels[order]).mean() > 0.98  # RANSAC draws other points


def test_each_thinning_keeps_other_points_and_their_answers_are_averaged(torch, small_scene):
    """The 'network' is sure of class 1 on the points that the first level keeps, and of class 0 on the others."""
    from slopewatch.models.inference.prediction import predict_voxels

    class Kept(torch.nn.Module):
        def __init__(self, thinnings):
            super().__init__()
            self.configuration = replace(PLAIN, window=500.0, step=500.0, thinnings=thinnings)

        def forward(self, features, coordinates, graphs):
            logits = torch.zeros(len(features), 3)
            logits[:, 2] = -99.0
            logits[:, 0], logits[graphs[0].kept, 1] = 20.0, 40.0
            return logits

    cloud = prepare_cloud(small_scene.xyz, PLAIN)
    once, four = (predict_voxels(Kept(n).eval(), cloud)[0][:, 1] for n in (1, 4))
    assert set(np.round(once, 3)) == {0.0, 1.0}
    assert set(np.round(four, 3)) <= {0.0, 0.25, 0.5, 0.75, 1.0}
    assert len(set(np.round(four, 3))) > 2
    # The first of the four is the one alone: it alone can lift them by a quarter.
    assert (four[once > 0.5] >= 0.25 - 1e-6).all()
    assert four.mean() == pytest.approx(once.mean(), rel=0.1)


def test_probabilities_not_logits_are_averaged_over_windows(torch, known, small_scene):
    """x over the window's middle decides: where two windows overlap, one is sure of it and the other of the
    contrary.
    """
    from slopewatch.models.inference.prediction import predict

    configuration = replace(PLAIN, window=12.0, step=6.0, centre_weighting=False)

    def side(features, _):
        return torch.stack([30 * features[:, 0], -30 * features[:, 0], 0 * features[:, 0] - 60], dim=1)

    prediction = predict(known(configuration, side), small_scene.xyz)
    cloud = prepare_cloud(small_scene.xyz, configuration)
    from slopewatch.models.preparation.windows import windows

    points = cloud.voxels.points
    total, count = np.zeros((len(points), 3)), np.zeros(len(points))
    for window in windows(points, 12.0, 6.0, spread=True):
        mine = points[window.points]
        logits = 30 * (mine[:, 0] - mine[:, 0].mean()) / configuration.xy_scale
        share = 1 / (1 + np.exp(-2 * logits))
        total[window.points] += np.column_stack([share, 1 - share, 0 * share])
        count[window.points] += 1
    expected = (total / count[:, None])[cloud.voxels.inverse]
    np.testing.assert_allclose(prediction.probabilities, expected, atol=1e-3)


def test_points_in_no_window_take_the_nearest_covered_point_s(torch, known, small_scene):
    from slopewatch.models.inference.prediction import predict

    sparse = replace(PLAIN, minimum_points=1500, step=18.0)
    prediction = predict(known(sparse, by_height(torch)), small_scene.xyz)
    assert 0.0 < prediction.filled < 0.6
    cloud = prepare_cloud(small_scene.xyz, sparse)
    from slopewatch.models.preparation.windows import windows

    points = cloud.voxels.points
    covered = np.unique(np.concatenate([w.points for w in windows(points, 20.0, 18.0, 1500)]))
    uncovered = np.setdiff1d(np.arange(len(points)), covered)
    voxel = np.zeros((len(points), 3))
    voxel[cloud.voxels.inverse] = prediction.probabilities
    nearest = covered[cKDTree(points[covered]).query(points[uncovered])[1]]
    np.testing.assert_allclose(voxel[uncovered], voxel[nearest], atol=1e-6)
    assert prediction.filled == pytest.approx(np.isin(cloud.voxels.inverse, uncovered).mean())
    with pytest.raises(InputError, match="100000 points"):
        predict(known(replace(PLAIN, minimum_points=100_000), by_height(torch)), small_scene.xyz)


def test_threads_and_repeating_change_nothing(torch, small_scene):
    from slopewatch.models.inference.prediction import predict
    from slopewatch.models.network.randlanet import RandLANet

    torch.manual_seed(2)
    configuration = replace(SMOKE, window=10.0, step=7.0)
    network = RandLANet(configuration).eval()
    one, two = (predict(network, small_scene.xyz, threads=n).probabilities for n in (1, 3))
    np.testing.assert_array_equal(one, two)


def test_rotations_are_averaged(torch, known, small_scene):
    from slopewatch.models.inference.prediction import predict

    def direction(features, _):
        return torch.stack([20 * features[:, 0], -20 * features[:, 0], 0 * features[:, 0] - 60], dim=1)

    once = predict(known(PLAIN, direction), small_scene.xyz).probabilities[:, 0]
    twice = predict(known(PLAIN, direction), small_scene.xyz, rotations=2).probabilities[:, 0]
    # x and -x are of equal weight: no point is nearer to either class.
    assert np.abs(once - 0.5).mean() > 0.3
    np.testing.assert_allclose(twice, 0.5, atol=1e-4)


def test_windows_are_seen_as_training_showed_them(torch):
    from slopewatch.models.inference.prediction import views

    plain, mirrored, *others = (np.array(view) for view in views(6, aligned=True))
    np.testing.assert_allclose(plain, np.eye(2))
    np.testing.assert_allclose(mirrored, np.diag([-1.0, 1.0]))
    for view in others:
        # Lengths stay, and up the slope stays up to the 15 degrees of training.
        np.testing.assert_allclose(view @ view.T, np.eye(2), atol=1e-12)
        assert np.degrees(np.arccos(view[1, 1])) < 15
    assert len({tuple(np.round(v, 6).ravel()) for v in views(16, aligned=True)}) == 16
    around = [np.array(view) @ [1.0, 0.0] for view in views(4, aligned=False)]
    np.testing.assert_allclose(around, [[1, 0], [0, 1], [-1, 0], [0, -1]], atol=1e-12)


def test_fixed_blocks_reach_every_point(torch, known, small_scene):
    from slopewatch.models.inference.prediction import predict

    fixed = replace(PLAIN, block_points=500)
    prediction = predict(known(fixed, by_height(torch)), small_scene.xyz)
    assert prediction.filled == 0.0
    free = predict(known(PLAIN, by_height(torch)), small_scene.xyz)
    assert (prediction.labels == free.labels).mean() > 0.999


def test_the_residual_threshold_labels_by_height_over_the_trend(small_scene):
    probabilities = residual_probabilities(small_scene.xyz, threshold=0.1, voxel=SMOKE.voxel)
    configuration = replace(SMOKE, trends=((4.0, 4.0),))
    cloud = prepare_cloud(small_scene.xyz, configuration)
    height = cloud.residuals[cloud.voxels.inverse, 0]
    labels = probabilities.argmax(axis=1)
    assert (labels[height > 0.105] == 1).all()
    assert (labels[height < -0.105] == 2).all()
    assert (labels[np.abs(height) < 0.095] == 0).all()
    np.testing.assert_allclose(probabilities.sum(axis=1), 1, atol=1e-5)
