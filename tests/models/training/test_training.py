"""Batches, augmentation, and a training that learns, stops and goes on."""

from __future__ import annotations

import csv
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.models.configuration import SMOKE
from slopewatch.models.preparation.prepare import UNKNOWN
from slopewatch.models.training.dataset import labelled_blocks
from slopewatch.simulation.hazard_scenes.scenes import scene

TINY = replace(SMOKE, widths=(4, 8), voxel=0.5, trends=((4.0, 4.0),))


def scene_blocks(scene, configuration, **settings):
    """The blocks of a scene, of which the surroundings of the labels' limit are unknown."""
    labels = np.where(scene.ignore, np.uint8(UNKNOWN), scene.label)
    return labelled_blocks(scene.xyz, labels, configuration, **settings)


@pytest.fixture(scope="module")
def tiny_blocks():
    scenes = (scene(1_000_000 + k, "published", area=250.0, density=25.0) for k in range(3))
    return [block for number, s in enumerate(scenes) for block in scene_blocks(s, TINY, seed=number)]


def test_blocks_carry_the_labels_of_their_points(small_scene):
    for block in scene_blocks(small_scene, TINY):
        assert set(np.unique(block.labels)) <= {0, 1, 2, UNKNOWN}
        # Where the middle of a hazard is, most labels are its own; the limit's surroundings are unknown.
        assert 0.02 < (block.labels == UNKNOWN).mean() < 0.4
    everything = labelled_blocks(small_scene.xyz, small_scene.label, TINY)
    labels = np.concatenate([block.labels for block in everything])
    assert UNKNOWN not in labels
    share = np.bincount(labels, minlength=3) / len(labels)
    np.testing.assert_allclose(share, small_scene.shares, atol=0.06)


def test_a_label_that_is_no_class_is_refused(small_scene):
    labels = small_scene.label.copy()
    labels[7] = 9
    with pytest.raises(InputError, match="class 9"):
        labelled_blocks(small_scene.xyz, labels, TINY)


def test_resident_blocks_make_the_same_batches(torch, tiny_blocks):
    from slopewatch.models.network.batches import ResidentBlocks, make_batch

    resident = ResidentBlocks(tiny_blocks, torch.device("cpu"))
    expected, found = make_batch([tiny_blocks[k] for k in (2, 0)]), resident.batch([2, 0])
    for name in ("coordinates", "residuals", "labels", "block"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    for a, b in zip(found.graphs, expected.graphs, strict=True):
        for name in ("neighbours", "kept", "nearest"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


def test_features_are_scaled_as_configured(torch, tiny_blocks):
    from slopewatch.models.network.batches import make_batch, network_inputs

    batch = make_batch(tiny_blocks[:1])
    features, scaled = network_inputs(batch.coordinates, batch.residuals, TINY)
    x, y, z = batch.coordinates.numpy().T
    np.testing.assert_allclose(features, np.column_stack([x / 10, y / 10, z / 0.5, batch.residuals / 0.2]), rtol=1e-5)
    np.testing.assert_array_equal(scaled, features[:, :3])


def test_augmentation_turns_mirrors_and_stretches_each_block_and_keeps_up_up(torch, tiny_blocks):
    from slopewatch.models.network.batches import NO_AUGMENTATION, Augmentation, make_batch

    batch = make_batch(tiny_blocks[:3])
    generator = torch.Generator().manual_seed(4)
    same = NO_AUGMENTATION(batch, generator)
    np.testing.assert_allclose(same, batch.coordinates, atol=1e-6)
    changed = Augmentation(turn=180.0, mirror=True, stretch=0.1, jitter=0.005)(batch, generator)
    signs, angles = set(), []
    for k in range(3):
        mine = (batch.block == k).numpy()
        before, after = batch.coordinates.numpy()[mine, :2], changed.numpy()[mine, :2]
        matrix, *_ = np.linalg.lstsq(before, after, rcond=None)
        np.testing.assert_allclose(before @ matrix, after, atol=1e-3)
        size = np.sqrt(abs(np.linalg.det(matrix)))
        np.testing.assert_allclose(matrix @ matrix.T, np.eye(2) * size**2, atol=1e-3)
        assert 0.9 <= size <= 1.1
        signs.add(np.sign(np.linalg.det(matrix)))
        angles.append(np.arctan2(matrix[0, 1], matrix[0, 0]))
    assert len({round(a, 3) for a in angles}) == 3
    dz = (changed[:, 2] - batch.coordinates[:, 2]).numpy()
    assert dz.std() == pytest.approx(0.005, rel=0.1)
    assert np.abs(dz).max() < 0.05
    draws = [Augmentation()(make_batch(tiny_blocks[:1]), torch.Generator().manual_seed(s)) for s in range(8)]
    before = tiny_blocks[0].coordinates[:, :2]
    flips = {np.sign(np.linalg.det(np.linalg.lstsq(before, d.numpy()[:, :2], rcond=None)[0])) for d in draws}
    assert flips == {-1.0, 1.0}


def test_every_block_is_used_once_before_any_again(torch, tiny_blocks):
    from slopewatch.models.training.training import TrainingParameters, block_provider

    provider = block_provider(tiny_blocks, TrainingParameters(batch=1), torch.device("cpu"))
    count = len(tiny_blocks)
    first = [provider(step).coordinates.numpy().tobytes() for step in range(count)]
    assert len(set(first)) == count
    assert set(first) == {block.coordinates.tobytes() for block in tiny_blocks}
    assert provider(0).coordinates.numpy().tobytes() == first[0]
    second = [provider(step).coordinates.numpy().tobytes() for step in range(count, 2 * count)]
    assert set(second) == set(first)


def test_the_learning_rate_warms_up_and_falls_to_zero(torch):
    from slopewatch.models.training.training import TrainingParameters, learning_rates

    optimiser = torch.optim.SGD([torch.zeros(1, requires_grad=True)], lr=0.02)
    schedule = learning_rates(optimiser, TrainingParameters(steps=100, learning_rate=0.02))
    rates = []
    for _ in range(101):
        rates.append(optimiser.param_groups[0]["lr"])
        optimiser.step()
        schedule.step()
    assert rates[0] == pytest.approx(0.02 / 5)
    assert max(rates) == pytest.approx(0.02)
    assert rates.index(max(rates)) in (4, 5)
    assert rates[100] == pytest.approx(0.0)
    assert all(a >= b for a, b in pairwise(rates[5:]))


def test_a_training_that_broke_off_ends_with_the_same_weights(torch, tiny_blocks, tmp_path):
    from slopewatch.models.training.training import TrainingParameters, block_provider, class_frequencies, train

    parameters = TrainingParameters(steps=7, batch=2, seed=3)
    frequencies = class_frequencies(tiny_blocks, 3)
    provider = block_provider(tiny_blocks, parameters, torch.device("cpu"))
    whole = train(TINY, provider, frequencies, parameters, tmp_path / "whole")

    def breaks(step):
        if step == 4:
            raise KeyboardInterrupt
        return provider(step)

    with pytest.raises(KeyboardInterrupt):
        train(TINY, breaks, frequencies, parameters, tmp_path / "broken", save_every=-1.0)
    after_limit = train(TINY, provider, frequencies, parameters, tmp_path / "broken", seconds=0.0)
    assert (after_limit.step, after_limit.finished) == (4, False)
    resumed = train(TINY, provider, frequencies, parameters, tmp_path / "broken")
    assert (resumed.step, resumed.finished, whole.finished) == (7, True, True)
    for name, tensor in whole.network.state_dict().items():
        np.testing.assert_array_equal(resumed.network.state_dict()[name], tensor, err_msg=name)
    log = (tmp_path / "broken" / "log.csv").read_text()
    steps = [int(row["step"]) for row in csv.DictReader(log.splitlines())]
    assert steps == list(range(1, 8))
    with pytest.raises(InputError, match="other settings"):
        train(TINY, provider, frequencies, replace(parameters, learning_rate=0.5), tmp_path / "broken")


def test_training_goes_on_from_given_weights(torch, tiny_blocks, tmp_path):
    from slopewatch.models.network.randlanet import RandLANet
    from slopewatch.models.training.training import TrainingParameters, block_provider, class_frequencies, train

    parameters = TrainingParameters(steps=1, batch=1)
    start = RandLANet(TINY)
    with torch.no_grad():
        start.classify.bias.fill_(7.0)
    provider = block_provider(tiny_blocks, parameters, torch.device("cpu"))
    state = train(TINY, provider, class_frequencies(tiny_blocks, 3), parameters, tmp_path, start=start)
    assert state.network.classify.bias.min() > 6.9


def test_what_cannot_be_trained_on_is_refused(torch, tiny_blocks):
    from slopewatch.models.training.training import TrainingParameters, block_provider, class_frequencies

    with pytest.raises(InputError, match="no blocks"):
        block_provider([], TrainingParameters(), torch.device("cpu"))
    unknown = [replace(tiny_blocks[0], labels=np.full(len(tiny_blocks[0]), UNKNOWN, dtype=np.uint8))]
    with pytest.raises(InputError, match="label"):
        class_frequencies(unknown, 3)
    with pytest.raises(InputError, match="weighting"):
        TrainingParameters(weighting="none")


def test_a_small_net_learns_within_seconds_to_beat_the_majority_and_the_threshold(torch, tmp_path):
    from slopewatch.models.inference.baseline import residual_probabilities
    from slopewatch.models.inference.prediction import predict
    from slopewatch.models.network.batches import Augmentation
    from slopewatch.models.training.evaluation import LabelScores
    from slopewatch.models.training.training import TrainingParameters, block_provider, class_frequencies, train

    scenes = [scene(1_000_000 + k, "published", area=500.0, density=100.0) for k in range(16)]
    blocks = [block for k, s in enumerate(scenes) for block in scene_blocks(s, SMOKE, seed=k, step=20.0)]
    parameters = TrainingParameters(steps=50, batch=2, learning_rate=0.02, augmentation=Augmentation(turn=20.0))
    provider = block_provider(blocks, parameters, torch.device("cpu"))
    state = train(SMOKE, provider, class_frequencies(blocks, 3), parameters, tmp_path)
    learnt, threshold = LabelScores(), LabelScores()
    for seed in range(2_000_000, 2_000_006):
        unseen = scene(seed, "published", area=500.0, density=100.0)
        learnt.add_points(unseen.label, predict(state.network, unseen.xyz).probabilities)
        threshold.add_points(unseen.label, residual_probabilities(unseen.xyz, voxel=0.3))
    majority = learnt.counts.sum(axis=1).max() / learnt.counts.sum()
    scores, others = learnt.summary(), threshold.summary()
    assert scores["overall_accuracy"] > majority + 0.06
    assert scores["mean_iou"] > others["mean_iou"] + 0.03
    assert min(scores["iou"].values()) > 0.25
