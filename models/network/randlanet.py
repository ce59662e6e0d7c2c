"""RandLA-Net (Hu et al. 2020, doi:10.1109/CVPR42600.2020.01112), written from the paper.

Points of all blocks of a batch lie one after the other in flat tensors and neighbours are indices into them, so that
blocks may differ in size and nothing is padded. Linear layers before a batch normalisation have no bias of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from ..configuration import ModelConfiguration
from ..preparation.pyramid import Level

SLOPE = 0.2
"""Of LeakyReLU on the negative side."""
PART = 1024
"""Points that are worked on together where that is free to choose: measured best of 512 to 16,384."""


@dataclass(frozen=True)
class Graph:
    """One level of a batch: ``neighbours`` (n, k), ``kept`` (m,) and ``nearest`` (n,) as in ``pyramid.Level``,
    int64.
    """

    neighbours: Tensor
    kept: Tensor
    nearest: Tensor

    def to(self, device: torch.device) -> Graph:
        return Graph(*(t.to(device, non_blocking=True) for t in (self.neighbours, self.kept, self.nearest)))


def batch_graphs(pyramids: Sequence[Sequence[Level]]) -> tuple[Graph, ...]:
    """The levels of several blocks put together; indices of the later blocks are moved behind the earlier ones."""
    graphs = []
    for levels in zip(*pyramids, strict=True):
        here = np.cumsum([0, *(len(level.neighbours) for level in levels)])
        below = np.cumsum([0, *(len(level.kept) for level in levels)])
        parts = [
            np.concatenate([getattr(level, name).astype(np.int64) + at for level, at in zip(levels, offsets)])
            for name, offsets in (("neighbours", here), ("kept", here), ("nearest", below))
        ]
        graphs.append(Graph(*(torch.from_numpy(part) for part in parts)))
    return tuple(graphs)


def rows(values: Tensor, index: Tensor) -> Tensor:
    """Rows of ``values`` (n, c) at ``index`` (any shape), shape (*index, c).

    Through ``gather``: its gradient adds up in place, where that of indexing sorts first.
    """
    flat = index.reshape(-1, 1).expand(-1, values.shape[1])
    return values.gather(0, flat).view(*index.shape, values.shape[1])


def spatial_encoding(
    coordinates: Tensor, neighbours: Tensor, scale: float = 1.0, points: Tensor | None = None
) -> Tensor:
    """The ten numbers of each neighbour (m, k, 10): distance, offset, the point itself, the neighbour.

    Args:
        coordinates: (n, 3).
        neighbours: (m, k), indices into them.
        scale: factor of distance and offset.
        points: (m, 3) whose neighbours they are; all the coordinates by default.
    """
    near = rows(coordinates, neighbours)
    centre = (coordinates if points is None else points).unsqueeze(1).expand_as(near)
    offset = (centre - near) * scale
    distance = offset.square().sum(dim=-1, keepdim=True).clamp_min(1e-12).sqrt()
    return torch.cat([distance, offset, centre, near], dim=-1)


def decimate(features: Tensor, neighbours: Tensor, kept: Tensor) -> Tensor:
    """Features (m, c) of the kept points: the largest of their neighbours'."""
    return rows(features, rows(neighbours, kept)).amax(dim=1)


def interpolate(features: Tensor, nearest: Tensor) -> Tensor:
    """Features (n, c) of the nearest kept point."""
    return rows(features, nearest)


class Dense(nn.Module):
    """A linear layer on the last axis with batch normalisation over all others and, unless switched off, LeakyReLU."""

    def __init__(self, inputs: int, outputs: int, *, active: bool = True, bias: bool = False) -> None:
        super().__init__()
        self.linear = nn.Linear(inputs, outputs, bias=bias)
        self.norm: nn.Module = nn.BatchNorm1d(outputs)
        self.active = active

    def forward(self, x: Tensor) -> Tensor:
        y = self.norm(self.linear(x.reshape(-1, x.shape[-1]))).view(*x.shape[:-1], -1)
        return functional.leaky_relu(y, SLOPE) if self.active else y


class AttentivePooling(nn.Module):
    """Sum of the neighbours' features (n, k, c), weighted channel by channel by a softmax over the neighbours."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.score = nn.Linear(inputs, inputs, bias=False)
        self.dense = Dense(inputs, outputs)

    def pool(self, x: Tensor) -> Tensor:
        """(n, c) before the last layer."""
        return (torch.softmax(self.score(x), dim=1) * x).sum(dim=1)

    def forward(self, x: Tensor) -> Tensor:
        result: Tensor = self.dense(self.pool(x))
        return result


class DilatedResidualBlock(nn.Module):
    """Two rounds of local spatial encoding and attentive pooling, with a shortcut; ``2 * width`` channels come out."""

    def __init__(self, inputs: int, width: int) -> None:
        super().__init__()
        half = width // 2
        self.narrow = Dense(inputs, half)
        self.encode_first = Dense(10, half)
        self.pool_first = AttentivePooling(width, half)
        self.encode_second = Dense(half, half)
        self.pool_second = AttentivePooling(width, width)
        self.widen = Dense(width, 2 * width, active=False)
        self.shortcut = Dense(inputs, 2 * width, active=False)

    def forward(self, features: Tensor, coordinates: Tensor, neighbours: Tensor, scale: float) -> Tensor:
        """Features (n, inputs) of points at ``coordinates`` (n, 3) to (n, 2 * width)."""
        # Batch statistics need all points at once; without them, parts that fit into a cache are twice as fast.
        size = len(features) if self.training or features.is_cuda else PART
        parts = [slice(start, start + size) for start in range(0, len(features), size)]
        encoded = [
            self.encode_first(spatial_encoding(coordinates, neighbours[part], scale, coordinates[part]))
            for part in parts
        ]
        x = self.narrow(features)
        x = self._gathered(x, neighbours, encoded, parts, self.pool_first)
        encoded = [self.encode_second(e) for e in encoded]
        x = self._gathered(x, neighbours, encoded, parts, self.pool_second)
        return functional.leaky_relu(self.widen(x) + self.shortcut(features), SLOPE)

    @staticmethod
    def _gathered(
        x: Tensor, neighbours: Tensor, encoded: Sequence[Tensor], parts: Sequence[slice], pool: AttentivePooling
    ) -> Tensor:
        """The neighbours' features with their encodings, pooled."""
        pooled = [pool(torch.cat([e, rows(x, neighbours[p])], dim=-1)) for e, p in zip(encoded, parts, strict=True)]
        return torch.cat(pooled) if len(pooled) > 1 else pooled[0]


class RandLANet(nn.Module):
    """The network of a configuration: logits (n, classes) of every point of a batch."""

    def __init__(self, configuration: ModelConfiguration) -> None:
        super().__init__()
        self.configuration = configuration
        self.scales = configuration.offset_scales()
        self.stem = Dense(configuration.inputs, configuration.stem, bias=True)
        channels, skips = configuration.stem, []
        self.encoder = nn.ModuleList()
        for width in configuration.widths:
            self.encoder.append(DilatedResidualBlock(channels, width))
            channels = 2 * width
            skips.append(channels)
        self.middle = Dense(channels, channels)
        self.decoder = nn.ModuleList()
        # The finest skip is the first block's output before its decimation.
        for skip in [*reversed(skips[:-1]), skips[0]]:
            self.decoder.append(Dense(skip + channels, skip))
            channels = skip
        self.head = nn.Sequential(Dense(channels, 64), Dense(64, 32), nn.Dropout(configuration.dropout))
        self.classify = nn.Linear(32, len(configuration.classes))

    def forward(self, features: Tensor, coordinates: Tensor, graphs: Sequence[Graph]) -> Tensor:
        """Logits of every point.

        Args:
            features: (n, inputs).
            coordinates: (n, 3), scaled as in the features.
            graphs: a level for each encoder block.
        """
        x = self.stem(features)
        skips: list[Tensor] = []
        for block, graph, scale in zip(self.encoder, graphs, self.scales, strict=True):
            x = block(x, coordinates, graph.neighbours, scale)
            if not skips:
                skips.append(x)
            x = decimate(x, graph.neighbours, graph.kept)
            coordinates = rows(coordinates, graph.kept)
            skips.append(x)
        x = self.middle(skips.pop())
        for dense, graph in zip(self.decoder, reversed(graphs), strict=True):
            x = dense(torch.cat([skips.pop(), interpolate(x, graph.nearest)], dim=-1))
        result: Tensor = self.classify(self.head(x))
        return result

    @property
    def parameter_count(self) -> int:
        return sum(p.numel() for p in self.parameters())


def fold_normalisation(network: RandLANet) -> RandLANet:
    """Put every batch normalisation into the linear layer before it, in place, for inference; the outputs stay the
    same.
    """
    network.eval()
    for module in network.modules():
        if isinstance(module, Dense) and isinstance(module.norm, nn.BatchNorm1d):
            norm, linear = module.norm, module.linear
            if norm.running_var is None or norm.running_mean is None:
                continue
            gain = norm.weight.data / torch.sqrt(norm.running_var + norm.eps)
            bias = linear.bias.data if linear.bias is not None else torch.zeros_like(gain)
            linear.weight.data = linear.weight.data * gain[:, None]
            linear.bias = nn.Parameter((bias - norm.running_mean) * gain + norm.bias.data)
            module.norm = nn.Identity()
    return network
