"""The raster network in the benchmark of screening by sites: which weights judge which survey."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.lab.benchmarks import screening_trials
from slopewatch.lab.benchmarks.screening_ground import POINTS, SIMULATED, Place
from slopewatch.lab.benchmarks.screening_networks import load_weights, runs_of
from slopewatch.lab.benchmarks.screening_trials import strengths, try_place
from slopewatch.models.preparation.raster_zones import Scores
from slopewatch.models.preparation.relief_raster import ReliefRaster, relief_raster
from slopewatch.tests.builders.networks import torch
from slopewatch.tests.builders.screening_places import somewhere

__all__ = ["torch"]


@pytest.fixture
def saved(torch, tmp_path):
    """Writes weights that left surveys out, with a seed."""
    from slopewatch.models.network.relief_looks import UNetConfiguration
    from slopewatch.models.network.unet import UNet, save_unet

    def save(seed: int, *left_out: str, ground: tuple[str, ...] = ()) -> Path:
        torch.manual_seed(seed + 10 * len(left_out))
        path = tmp_path / f"{seed}{'_'.join(left_out)}.safetensors"
        training = {"left_out": list(left_out), "seed": seed, "real_ground": list(ground)}
        save_unet(path, UNet(UNetConfiguration(widths=(4, 6))).eval(), training, {})
        return path

    return save


def test_a_survey_is_judged_by_weights_that_never_saw_it(saved) -> None:
    weights = load_weights([saved(0, "a", "b"), saved(0, "chablais"), saved(1, "a", "b", ground=("c",)), saved(1, "d")])
    one, other, second, third = weights
    assert runs_of(somewhere("a"), weights) == [one, second]
    assert runs_of(somewhere("b"), weights) == [one, second]
    # The seed that never left the survey out is replaced.
    assert runs_of(somewhere("chablais"), weights) == [other, other]
    assert runs_of(somewhere("d"), weights) == [third, third]
    # What was in no training: the first fold. What was, or may have been: none.
    assert runs_of(somewhere("simulated 1", SIMULATED), weights) == [one, second]
    assert runs_of(somewhere("my slope"), weights) == [one, second]
    assert runs_of(somewhere("c"), weights) == []
    assert runs_of(somewhere("alpine"), weights) == []
    assert runs_of(somewhere("alpine"), []) == []


def test_each_file_answers_for_itself(saved) -> None:
    here = somewhere("a")
    raster = relief_raster(here.flat, diameters=(3.0,))
    weights = load_weights([saved(0, "a"), saved(1, "a")])
    found = [one.detector()(here, raster)[one.name].uplift for one in weights]
    assert weights[0].name != weights[1].name
    assert np.nanmax(np.abs(found[0] - found[1])) > 0.01
    np.testing.assert_array_equal(np.isfinite(found[0]), raster.covered)


def test_the_same_fold_and_seed_twice_is_refused(saved, tmp_path) -> None:
    with pytest.raises(InputError, match=r"seed of others that are given; leave one out\.$"):
        load_weights([saved(0, "a"), saved(0, "a")])


def test_places_with_nothing_put_in_are_found_by_what_sees_hazards_everywhere(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(2)
    flat = np.column_stack([rng.uniform(0, 40, (12000, 2)), rng.normal(0, 0.02, 12000)])
    where = Place("one", "one", POINTS, flat, np.eye(4))

    def detector(place: Place, raster: ReliefRaster) -> dict[str, Scores]:
        touched = float(np.abs(place.flat[:, 2]).max() > 0.2)
        everywhere = np.where(raster.covered, touched, np.nan)
        return {"height": Scores.signed(raster.height, 0.5), "any": Scores(everywhere, everywhere, 0.5)}

    monkeypatch.setattr(screening_trials, "filter_scores", detector)
    result = try_place(where, [], 2)
    height, anything = (strengths(result.trials, result.answers[name], 0.5) for name in ("height", "any"))
    nothing = np.array([one.empty for one in result.trials])
    hazards = np.array([abs(one.height) >= 0.5 for one in result.trials])
    assert nothing.sum() == 8
    assert (height[nothing] < 0.1).all()
    assert (height[hazards] > 0.1).mean() > 0.9
    assert (anything[nothing] == 1.0).mean() > 0.8
