"""Groups of voxels that are nowhere clearly a hazard, against flood fill on a grid."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
import pytest
import torch
from scipy import ndimage
from slopewatch.engine.core.errors import InputError
from slopewatch.models.configuration import PAPER, SMOKE, ModelConfiguration
from slopewatch.models.inference.groups import without_faint
from slopewatch.models.inference.prediction import predict_voxels
from slopewatch.models.network.randlanet import RandLANet
from slopewatch.models.preparation.prepare import prepare_cloud
from slopewatch.models.training.recipes import SHIPPED, SLOPEWATCH


def grid_of_voxels(rng, rows=40, columns=50, voxel=0.4):
    """Voxels' averages near the middles of a sloping grid, and smooth probabilities of three classes."""
    x, y = np.meshgrid(np.arange(columns) * voxel, np.arange(rows) * voxel)
    points = np.column_stack([x.ravel(), y.ravel(), 0.1 * x.ravel()]) + rng.uniform(-0.05, 0.05, (rows * columns, 3))
    field = ndimage.gaussian_filter(rng.standard_normal((3, rows, columns)), (0, 1.5, 1.5))
    raised = np.exp(8 * field)
    return points, (raised / raised.sum(axis=0)).reshape(3, -1).T.astype(np.float32), (rows, columns)


@pytest.mark.parametrize("least", [0.6, 0.8, 0.95])
def test_groups_are_those_that_flood_fill_finds(least):
    points, probabilities, shape = grid_of_voxels(np.random.default_rng(3))
    changed = without_faint(points, probabilities, 0.4, least)
    labels = probabilities.argmax(axis=1).reshape(shape)
    expected = probabilities.copy()
    faint_groups = clear_groups = 0
    for kind in (1, 2):
        marked, count = ndimage.label(labels == kind, np.ones((3, 3)))
        for group in range(1, count + 1):
            mine = marked.ravel() == group
            if probabilities[mine, kind].max() < least:
                expected[mine, 0], expected[mine, kind] = probabilities[mine, kind], probabilities[mine, 0]
                faint_groups += 1
            else:
                clear_groups += 1
    assert faint_groups > 3
    assert clear_groups > 3
    np.testing.assert_array_equal(changed, expected)
    np.testing.assert_allclose(changed.sum(axis=1), 1.0, atol=1e-6)


def test_the_other_hazard_next_to_a_faint_group_stays():
    points = np.array([[0.0, 0, 0], [0.4, 0, 0], [0.8, 0, 0], [4.0, 0, 0]])
    probabilities = np.array([[0.4, 0.6, 0], [0.05, 0.05, 0.9], [0.3, 0.1, 0.6], [0.45, 0.1, 0.45]], np.float32)
    changed = without_faint(points, probabilities, 0.4, 0.7)
    np.testing.assert_array_equal(changed.argmax(axis=1), [0, 2, 2, 0])
    np.testing.assert_allclose(changed[0], [0.6, 0.4, 0.0])
    np.testing.assert_array_equal(without_faint(points[:0], probabilities[:0], 0.4, 0.7), probabilities[:0])


def test_a_screening_judges_groups_if_its_model_does(small_scene):
    """The network is untrained: what matters is that its probabilities pass through the groups, once."""
    torch.manual_seed(0)
    network = RandLANet(SMOKE).eval()
    cloud = prepare_cloud(small_scene.xyz, SMOKE)
    alone, covered = predict_voxels(network, cloud)
    peaked = float(alone[:, 1:].max()) + 0.01
    strict = replace(SMOKE, least_peak=peaked)
    judged = RandLANet(strict).eval()
    judged.load_state_dict(network.state_dict())
    together, _ = predict_voxels(judged, cloud)
    np.testing.assert_array_equal(together, without_faint(cloud.voxels.points, alone, SMOKE.voxel, peaked))
    assert covered.any()
    assert (alone.argmax(axis=1) != together.argmax(axis=1)).any()


def test_models_made_before_and_the_published_pipeline_judge_voxel_by_voxel():
    values = asdict(SMOKE)
    del values["least_peak"]
    assert ModelConfiguration.from_mapping(values).least_peak == 0
    assert PAPER.least_peak == 0
    assert SLOPEWATCH.configuration.least_peak == 0
    assert 0.5 < SHIPPED.configuration.least_peak < 1
    with pytest.raises(InputError, match="least_peak"):
        replace(SMOKE, least_peak=1.0)
