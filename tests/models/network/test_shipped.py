"""The shipped weights: what they must answer, and that they are of use."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.models.network.shipped import SHIPPED_WEIGHTS, shipped_model
from slopewatch.simulation.hazard_scenes.scenes import scene

GOLDEN = [
    [4.6246, 1.773, -5.9081],
    [3.6947, -3.4681, -0.5434],
    [4.3477, -0.7896, -4.1346],
    [3.6454, -1.1872, -3.2002],
    [4.9756, -0.9602, -4.4928],
    [3.3641, -2.5744, -1.9366],
    [3.9175, -2.2151, -2.7121],
    [0.4187, -4.6486, 3.0608],
]
"""Logits of every 400th voxel of the first window below, as torch 2.13.0 gave them when the weights were made."""


@pytest.fixture
def shipped(torch):
    from slopewatch.models.network.weights import load_model

    return load_model(*shipped_model())


def test_golden_logits(torch, shipped):
    from slopewatch.models.network.batches import make_batch, network_inputs
    from slopewatch.models.preparation.prepare import blocks, prepare_cloud

    # A ripple with a bulge and a hollow on it: no simulator, no random number but the decimation's.
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0, 24, 0.2), np.arange(0, 24, 0.2)))
    z = 0.7 * y + 0.03 * np.sin(1.3 * x) * np.cos(0.9 * y)
    z += 0.3 * np.exp(-((x - 7) ** 2 + (y - 7) ** 2) / 2) - 0.3 * np.exp(-((x - 16) ** 2 + (y - 15) ** 2) / 2)
    configuration = shipped.configuration
    cloud = prepare_cloud(np.column_stack([x, y, z]), configuration)
    block = next(blocks(cloud, configuration, np.random.default_rng(0)))
    batch = make_batch([block])
    with torch.inference_mode():
        features, scaled = network_inputs(batch.coordinates, batch.residuals, configuration)
        logits = shipped.network(features, scaled, batch.graphs).numpy()[::400]
    np.testing.assert_allclose(logits, GOLDEN, atol=2e-3)


def test_what_stands_out_is_found(torch, shipped):
    from slopewatch.models.inference.prediction import predict

    one = scene(4245, "realistic", area=2000.0, density=60.0)
    found = predict(shipped.network, one.xyz).labels
    background = one.label == 0
    assert (found[background] == 0).mean() > 0.9
    high = np.abs(one.displacement) > 0.3
    assert high.sum() > 500
    assert (found[high] == one.label[high]).mean() > 0.7


def test_what_lies_next_to_the_weights_describes_them(shipped):
    facts = shipped.metadata
    assert facts["training"]["steps"] > 0
    assert 0.3 < facts["metrics"]["calibration"]["temperature"] < 3
    assert facts["sha256"] == shipped.sha256
    card = SHIPPED_WEIGHTS.with_name("README.md").read_text(encoding="utf-8")
    assert shipped.sha256 in card
    rows = SHIPPED_WEIGHTS.with_name("training_log.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0] == "step,loss,learning_rate,seconds"
    assert int(rows[-1].split(",")[0]) == facts["training"]["steps"]
