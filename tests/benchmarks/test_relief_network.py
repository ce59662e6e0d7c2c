"""The raster network in the benchmark of screening by sites: which weights judge which survey."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.benchmarks.screening_ground import POINTS, Place
from slopewatch.benchmarks.screening_sites import RELIEF, relief_network
from slopewatch.benchmarks.screening_trials import NOTHING_M, try_place
from slopewatch.models.preparation.raster_zones import Scores
from slopewatch.models.preparation.relief_raster import ReliefRaster, relief_raster
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


def test_places_with_nothing_put_in_are_found_by_what_sees_hazards_everywhere() -> None:
    rng = np.random.default_rng(2)
    flat = np.column_stack([rng.uniform(0, 40, (12000, 2)), rng.normal(0, 0.02, 12000)])
    where = Place("one", "one", POINTS, flat, np.eye(4))

    def detector(place: Place, raster: ReliefRaster) -> dict[str, Scores]:
        touched = float(np.abs(place.flat[:, 2]).max() > 0.2)
        everywhere = np.where(raster.covered, touched, np.nan)
        return {"height": Scores.signed(raster.height, 0.5), "any": Scores(everywhere, everywhere, 0.5)}

    trials = try_place(where, [detector], 2).trials
    nothing = [one for one in trials if abs(one.height) <= NOTHING_M]
    hazards = [one for one in trials if abs(one.height) >= 0.5]
    assert len(nothing) == 8
    assert all(one.strength["height"] < 0.1 for one in nothing)
    assert np.mean([one.strength["height"] > 0.1 for one in hazards]) > 0.9
    assert np.mean([one.strength["any"] == 1.0 for one in nothing]) > 0.8
