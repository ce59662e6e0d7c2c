"""The raster network in the benchmark of screening by sites: which weights judge which survey."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.benchmarks.screening_ground import POINTS, Place
from slopewatch.benchmarks.screening_sites import RELIEF, relief_network
from slopewatch.models.preparation.relief_raster import relief_raster
from slopewatch.tests.builders.networks import torch

__all__ = ["torch"]


@pytest.fixture
def weights(torch, tmp_path):
    """Two files, trained without the surveys a and b and without b."""
    from slopewatch.models.network.unet import UNet, UNetConfiguration, save_unet

    paths = []
    for number, left_out in enumerate((["a", "b"], ["b"])):
        torch.manual_seed(number)
        paths.append(tmp_path / f"{number}.safetensors")
        save_unet(paths[-1], UNet(UNetConfiguration(widths=(4, 6))).eval(), {"left_out": left_out}, {})
    return paths


def test_a_survey_is_judged_by_weights_that_never_saw_it(weights) -> None:
    rng = np.random.default_rng(1)
    flat = np.column_stack([rng.uniform(0, 20, (3000, 2)), rng.normal(0, 0.05, 3000)])
    raster = relief_raster(flat, diameters=(3.0,))

    def scores(detector, group: str):
        return detector(Place(group, group, POINTS, flat, np.eye(4)), raster)[RELIEF].uplift

    both, surveys = relief_network(weights)
    alone = [relief_network([path])[0] for path in weights]
    assert surveys == {"a", "b"}
    np.testing.assert_array_equal(scores(both, "a"), scores(alone[0], "a"))
    assert np.nanmax(np.abs(scores(alone[0], "a") - scores(alone[1], "a"))) > 0.01
    # Several that never saw a survey answer together.
    assert np.nanmax(np.abs(scores(both, "b") - scores(alone[0], "b"))) > 0.001
    np.testing.assert_array_equal(np.isfinite(scores(both, "b")), raster.covered)
