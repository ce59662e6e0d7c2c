"""The network against hand-computed cases and against a second, slow implementation in NumPy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slopewatch.models.configuration import PAPER, SMOKE
from slopewatch.models.preparation.pyramid import Level, build_pyramid


@pytest.fixture
def network_module(torch):
    from slopewatch.models.network import randlanet

    return randlanet


TINY = replace(SMOKE, widths=(4, 6), stem=4, neighbours=5, trends=((4.0, 4.0),))


def made(network_module, torch, configuration=TINY, seed=1):
    """A network in evaluation mode whose every number, statistics of the normalisation included, is random."""
    torch.manual_seed(seed)
    net = network_module.RandLANet(configuration)
    with torch.no_grad():
        for name, tensor in net.state_dict().items():
            if name.endswith(("running_var", "norm.weight")):
                tensor.uniform_(0.5, 1.5)
            elif name.endswith(("running_mean", "bias")):
                tensor.normal_(0, 0.3)
    return net.eval()


def block(configuration, count, seed):
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(-1, 1, (count, 3)).astype(np.float32)
    features = rng.standard_normal((count, configuration.inputs)).astype(np.float32)
    levels = build_pyramid(xyz, len(configuration.widths), configuration.neighbours, 4, np.random.default_rng(seed))
    return features, xyz, levels


def run(network_module, torch, net, features, xyz, *pyramids):
    with torch.inference_mode():
        graphs = network_module.batch_graphs(pyramids)
        return net(torch.from_numpy(features), torch.from_numpy(xyz), graphs).numpy()


def test_the_network_has_the_published_number_of_parameters(network_module):
    assert network_module.RandLANet(PAPER).parameter_count == 1_236_547
    assert network_module.RandLANet(replace(PAPER, widths=(8, 32, 64, 128))).parameter_count == 314_203
    assert 24_000 < network_module.RandLANet(SMOKE).parameter_count < 25_000


def test_local_spatial_encoding_by_hand(network_module, torch):
    coordinates = torch.tensor([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0], [0.0, 0.0, 2.0]])
    neighbours = torch.tensor([[0, 1], [1, 0], [2, 0]])
    encoded = network_module.spatial_encoding(coordinates, neighbours, 2.0)
    # Point 1 and its neighbour 0: distance 5, offset (3, 4, 0), both times 2; the point; the neighbour.
    expected = [10.0, 6.0, 8.0, 0.0, 3.0, 4.0, 0.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(encoded[1, 1], expected, atol=1e-6)
    np.testing.assert_allclose(encoded[2, 1], [4.0, 0, 0, 4, 0, 0, 2, 0, 0, 0], atol=1e-6)
    # A point is its own first neighbour.
    np.testing.assert_allclose(encoded[1, 0], [0, 0, 0, 0, 3, 4, 0, 3, 4, 0], atol=1e-5)


def test_attentive_pooling_by_hand(network_module, torch):
    pooling = network_module.AttentivePooling(2, 3)
    assert pooling.score.bias is None
    x = torch.tensor([[[1.0, 0.0], [3.0, 2.0]]])
    with torch.no_grad():
        pooling.score.weight.zero_()
        np.testing.assert_allclose(pooling.pool(x)[0], [2.0, 1.0])  # equal scores: the mean
        pooling.score.weight.copy_(torch.tensor([[1.0, 0.0], [0.0, 0.0]]))
        # Channel 0 scores (1, 3), channel 1 scores (0, 0).
        e = np.exp(2.0)
        np.testing.assert_allclose(pooling.pool(x)[0], [(1 + 3 * e) / (1 + e), 1.0], rtol=1e-6)


def test_decimation_and_interpolation_by_hand(network_module, torch):
    features = torch.tensor([[1.0, 9.0], [5.0, 2.0], [3.0, 3.0], [0.0, 4.0]])
    neighbours = torch.tensor([[0, 1], [1, 2], [2, 3], [3, 0]])
    pooled = network_module.decimate(features, neighbours, torch.tensor([0, 2]))
    np.testing.assert_array_equal(pooled, [[5.0, 9.0], [3.0, 4.0]])
    np.testing.assert_array_equal(
        network_module.interpolate(pooled, torch.tensor([1, 0, 0, 1])), pooled.numpy()[[1, 0, 0, 1]]
    )


class Reference:
    """RandLA-Net's forward pass in NumPy, point by point, from the names of the weights."""

    def __init__(self, net, configuration):
        self.weights = {name: tensor.numpy() for name, tensor in net.state_dict().items()}
        self.configuration = configuration

    def dense(self, name, x, active=True):
        w = self.weights
        y = x @ w[f"{name}.linear.weight"].T + w.get(f"{name}.linear.bias", 0.0)
        deviation = np.sqrt(w[f"{name}.norm.running_var"] + 1e-5)
        y = (y - w[f"{name}.norm.running_mean"]) / deviation * w[f"{name}.norm.weight"] + w[f"{name}.norm.bias"]
        return np.where(y > 0, y, 0.2 * y) if active else y

    def pool(self, name, x):
        score = x @ self.weights[f"{name}.score.weight"].T
        share = np.exp(score - score.max(axis=0))
        share /= share.sum(axis=0)
        return self.dense(f"{name}.dense", (share * x).sum(axis=0))

    def encoder(self, name, features, xyz, neighbours, scale):
        narrow = self.dense(f"{name}.narrow", features)
        encoded = []
        for i, near in enumerate(neighbours):
            offset = (xyz[i] - xyz[near]) * scale
            numbers = [
                np.linalg.norm(offset, axis=1)[:, None],
                offset,
                np.repeat(xyz[i : i + 1], len(near), 0),
                xyz[near],
            ]
            encoded.append(self.dense(f"{name}.encode_first", np.concatenate(numbers, axis=1)))
        x = np.stack(
            [
                self.pool(f"{name}.pool_first", np.concatenate([e, narrow[near]], axis=1))
                for e, near in zip(encoded, neighbours)
            ]
        )
        encoded = [self.dense(f"{name}.encode_second", e) for e in encoded]
        x = np.stack(
            [
                self.pool(f"{name}.pool_second", np.concatenate([e, x[near]], axis=1))
                for e, near in zip(encoded, neighbours)
            ]
        )
        y = self.dense(f"{name}.widen", x, False) + self.dense(f"{name}.shortcut", features, False)
        return np.where(y > 0, y, 0.2 * y)

    def __call__(self, features, xyz, levels):
        x = self.dense("stem", features)
        outputs = []
        scales = self.configuration.offset_scales()
        for number, level in enumerate(levels):
            x = self.encoder(f"encoder.{number}", x, xyz, level.neighbours, scales[number])
            if number == 0:
                outputs.append(x)
            x = np.stack([x[level.neighbours[kept]].max(axis=0) for kept in level.kept])
            xyz = xyz[level.kept]
            outputs.append(x)
        x = self.dense("middle", x)
        skips = outputs[-2::-1]
        for number, (skip, level) in enumerate(zip(skips, levels[::-1])):
            x = self.dense(f"decoder.{number}", np.concatenate([skip, x[level.nearest]], axis=1))
        x = self.dense("head.1", self.dense("head.0", x))
        return x @ self.weights["classify.weight"].T + self.weights["classify.bias"]


@pytest.mark.parametrize("level_scaling", [True, False])
def test_the_network_is_the_slow_reference(network_module, torch, level_scaling):
    configuration = replace(TINY, level_scaling=level_scaling)
    net = made(network_module, torch, configuration)
    features, xyz, levels = block(configuration, 90, 3)
    logits = run(network_module, torch, net, features, xyz, levels)
    np.testing.assert_allclose(logits, Reference(net, configuration)(features, xyz, levels), atol=2e-4, rtol=2e-4)


def test_the_order_of_points_does_not_matter(network_module, torch):
    net = made(network_module, torch)
    features, xyz, levels = block(TINY, 300, 5)
    before = run(network_module, torch, net, features, xyz, levels)
    order = np.random.default_rng(6).permutation(300)
    place = np.argsort(order).astype(np.int32)  # where each old point is now
    first = levels[0]
    moved = Level(place[first.neighbours][order], place[first.kept], first.nearest[order])
    after = run(network_module, torch, net, features[order], xyz[order], (moved, *levels[1:]))
    np.testing.assert_allclose(after, before[order], atol=1e-5)


def test_blocks_of_a_batch_do_not_see_each_other(network_module, torch):
    net = made(network_module, torch)
    one, two = block(TINY, 120, 7), block(TINY, 75, 8)
    alone = [run(network_module, torch, net, *b) for b in (one, two)]
    features, xyz = (np.concatenate([one[k], two[k]]) for k in (0, 1))
    together = run(network_module, torch, net, features, xyz, one[2], two[2])
    np.testing.assert_allclose(together, np.concatenate(alone), atol=1e-5)


def test_working_in_parts_and_folding_the_normalisation_change_nothing(network_module, torch, monkeypatch):
    net = made(network_module, torch)
    features, xyz, levels = block(TINY, 2500, 9)
    whole = run(network_module, torch, net, features, xyz, levels)
    monkeypatch.setattr(network_module, "PART", 10_000)
    np.testing.assert_allclose(run(network_module, torch, net, features, xyz, levels), whole, atol=1e-5)
    folded = network_module.fold_normalisation(net)
    assert not any(isinstance(m, torch.nn.BatchNorm1d) for m in folded.modules())
    np.testing.assert_allclose(run(network_module, torch, folded, features, xyz, levels), whole, atol=1e-4)


def test_gathering_rows_has_the_gradient_of_indexing(network_module, torch):
    values = torch.randn(20, 3, requires_grad=True)
    index = torch.randint(0, 20, (7, 4))
    weights = torch.randn(7, 4, 3)
    (network_module.rows(values, index) * weights).sum().backward()
    gathered = values.grad.clone()
    values.grad = None
    (values[index] * weights).sum().backward()
    np.testing.assert_allclose(gathered, values.grad, atol=1e-6)


def test_every_parameter_learns(network_module, torch):
    net = network_module.RandLANet(TINY).train()
    features, xyz, levels = block(TINY, 200, 10)
    logits = net(torch.from_numpy(features), torch.from_numpy(xyz), network_module.batch_graphs([levels]))
    torch.nn.functional.cross_entropy(logits, torch.randint(0, 3, (200,))).backward()
    assert all(p.grad is not None and p.grad.abs().sum() > 0 for p in net.parameters())
