"""Training of the raster network: it learns, it can be repeated, and an interruption does not change its weights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.models.preparation.relief_channels import CHANNELS
from slopewatch.models.training.relief_patches import Ground, Grounds, PatchParameters


@pytest.fixture
def ground() -> Ground:
    rng = np.random.default_rng(1)
    points = rng.uniform(0, 60, (20000, 3))
    points[:, 2] = 0.3 * points[:, 1] + rng.normal(0, 0.03, len(points))
    return Ground("slope", points, 5.5)


@pytest.fixture
def small(torch):
    from slopewatch.models.network.relief_looks import UNetConfiguration
    from slopewatch.models.training.sim_on_real import ReliefTraining

    torch.set_num_threads(1)
    patch = PatchParameters(side=32, needs=(3.0, 8.0), diameters=(2.0, 6.0))
    return UNetConfiguration(widths=(6, 8)), ReliefTraining(steps=6, patches=3, pool=4, first=3, decay=0.5, patch=patch)


def test_it_learns_where_hazards_are(small, ground, tmp_path, torch):
    from slopewatch.models.network.relief_looks import raster_logits
    from slopewatch.models.training.sim_on_real import new_patch, train_relief

    configuration, parameters = small
    # So few steps of a tiny network are too few to tell structures from hazards.
    patch = replace(parameters.patch, structures=0.0, needs=(5.0, 12.0))
    parameters = replace(parameters, steps=150, patches=8, decay=0.9, learning_rate=0.01, patch=patch)
    state = train_relief(configuration, Grounds([ground]), parameters, tmp_path)
    assert state.finished
    assert not state.network.training
    right = known = 0
    background = []
    for step in range(200, 212):  # patches that no step saw
        patch = new_patch(Grounds([ground]), parameters, step)
        found = raster_logits(state.network, patch.channels).argmax(axis=0)
        hit = (patch.labels == 1) | (patch.labels == 2)
        right += np.count_nonzero(found[hit] == patch.labels[hit])
        known += np.count_nonzero(hit)
        background.append(np.mean(found[patch.labels == 0] == 0))
    assert right / known > 0.75
    assert np.mean(background) > 0.8


def test_an_interrupted_training_gives_the_same_weights(small, ground, tmp_path, monkeypatch):
    from slopewatch.models.training.sim_on_real import train_relief

    configuration, parameters = small
    parameters = replace(parameters, patch=replace(parameters.patch, structures=0.7))
    grounds = Grounds([ground], [replace(ground, name="simulated")])
    whole = train_relief(configuration, grounds, parameters, tmp_path / "whole")
    assert whole.finished
    from slopewatch.models.training import sim_on_real

    state, parts = None, 0
    clock = iter(np.arange(0.0, 1000.0, 1.0))
    monkeypatch.setattr(sim_on_real.time, "monotonic", lambda: next(clock))
    while state is None or not state.finished:
        # Each look at the clock is a second: some steps are done each time.
        state = train_relief(configuration, grounds, parameters, tmp_path / "parts", seconds=4.0)
        parts += 1
        assert parts < 8
    assert parts > 1
    for name, tensor in whole.network.state_dict().items():
        np.testing.assert_array_equal(state.network.state_dict()[name], tensor, err_msg=name)
    rows = (tmp_path / "whole" / "log.csv").read_text().splitlines()
    assert rows[0] == "step,loss,learning_rate,seconds"
    assert len(rows) == 7


def test_training_from_weights_begins_with_them_and_goes_on_exactly(small, ground, tmp_path, monkeypatch, torch):
    from slopewatch.models.network.relief_looks import UNetConfiguration
    from slopewatch.models.network.unet import UNet
    from slopewatch.models.training import sim_on_real
    from slopewatch.models.training.sim_on_real import train_relief

    configuration, parameters = small
    parameters = replace(parameters, steps=4, learning_rate=1e-4)
    own = Grounds([replace(ground, labels=(ground.points[:, 0] > 30).astype(np.uint8))])
    torch.manual_seed(9)
    start = UNet(configuration)
    kept = {name: tensor.clone() for name, tensor in start.state_dict().items()}
    whole = train_relief(configuration, own, parameters, tmp_path / "whole", start=start)
    apart = {}
    for name, tensor in start.named_parameters():
        torch.testing.assert_close(tensor.detach(), kept[name], rtol=0, atol=0)
        apart[name] = float((whole.network.state_dict()[name] - tensor.detach()).abs().max())
    # AdamW moves a weight by about the rate a step, whatever it is.
    assert 0 < max(apart.values()) < 5 * 4 * 1e-4
    clock = iter(np.arange(0.0, 1000.0, 1.0))
    monkeypatch.setattr(sim_on_real.time, "monotonic", lambda: next(clock))
    first = train_relief(configuration, own, parameters, tmp_path / "parts", start=start, seconds=4.0)
    assert not first.finished
    second = train_relief(configuration, own, parameters, tmp_path / "parts", start=start)
    assert second.finished
    for name, tensor in whole.network.state_dict().items():
        np.testing.assert_array_equal(second.network.state_dict()[name], tensor, err_msg=name)
    for other in (None, UNet(configuration)):
        with pytest.raises(InputError, match="other settings"):
            train_relief(configuration, own, parameters, tmp_path / "parts", start=other)
    with pytest.raises(InputError, match="other channels or widths"):
        train_relief(UNetConfiguration(widths=(6, 10)), own, parameters, tmp_path / "wide", start=start)


def test_ground_of_unknown_class_teaches_nothing(small, ground, tmp_path, torch):
    from slopewatch.models.network.unet import UNet
    from slopewatch.models.training.sim_on_real import train_relief

    configuration, parameters = small
    torch.manual_seed(9)
    start = UNet(configuration)
    unknown = replace(ground, labels=np.full(len(ground.points), 255, dtype=np.uint8))
    parameters = replace(parameters, steps=2, weight_decay=0.0)
    state = train_relief(configuration, Grounds([unknown]), parameters, tmp_path, start=start)
    for name, tensor in start.named_parameters():
        np.testing.assert_array_equal(state.network.state_dict()[name], tensor.detach(), err_msg=name)


def test_steps_depend_on_the_seed_and_draw_from_both_halves(small, ground):
    from slopewatch.models.training.sim_on_real import new_patch

    parameters = small[1]
    again, first, other = (
        new_patch(Grounds([ground]), replace(parameters, seed=seed), 3).channels for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(again, first)
    assert np.abs(other - first).max() > 0.1
    noisy = ground.points.copy()
    noisy[:, 2] += np.random.default_rng(2).normal(0, 1.0, len(noisy))
    rough = Ground("rough", noisy, 5.5)
    unit = CHANNELS.index("log scatter 3 m")
    units = [
        np.median(new_patch(Grounds([ground], [rough]), parameters, number).channels[unit]) for number in range(12)
    ]
    assert 0.2 < np.mean(np.array(units) > 0.5) < 0.8


def test_without_ground_or_with_another_checkpoint_it_is_refused(small, ground, tmp_path):
    from slopewatch.models.training.sim_on_real import ReliefTraining, train_relief

    configuration, parameters = small
    with pytest.raises(InputError, match="no ground to train on"):
        Grounds()
    train_relief(configuration, Grounds([ground]), replace(parameters, steps=1), tmp_path)
    with pytest.raises(InputError, match="other settings"):
        train_relief(configuration, Grounds([ground]), replace(parameters, steps=1, seed=4), tmp_path)
    with pytest.raises(InputError, match="not more to begin with"):
        ReliefTraining(first=30, pool=20)
