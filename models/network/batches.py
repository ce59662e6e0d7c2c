"""From blocks to tensors, and the changes to coordinates that make a model indifferent to where a slope faces."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ..configuration import ModelConfiguration
from ..preparation.prepare import Block
from .randlanet import Graph, batch_graphs


@dataclass(frozen=True)
class Batch:
    """Several blocks one after the other: ``coordinates`` (n, 3) and ``residuals`` (n, trends) in m, ``labels``
    int64.
    """

    coordinates: Tensor
    residuals: Tensor
    labels: Tensor
    block: Tensor
    graphs: tuple[Graph, ...]

    def to(self, device: torch.device) -> Batch:
        return Batch(
            self.coordinates.to(device, non_blocking=True),
            self.residuals.to(device, non_blocking=True),
            self.labels.to(device, non_blocking=True),
            self.block.to(device, non_blocking=True),
            tuple(graph.to(device) for graph in self.graphs),
        )


def make_batch(blocks: Sequence[Block]) -> Batch:
    """A batch of blocks of any sizes."""
    return Batch(
        torch.from_numpy(np.concatenate([block.coordinates for block in blocks])),
        torch.from_numpy(np.concatenate([block.residuals for block in blocks])),
        torch.from_numpy(np.concatenate([block.labels for block in blocks]).astype(np.int64)),
        torch.from_numpy(np.repeat(np.arange(len(blocks)), [len(block) for block in blocks])),
        batch_graphs([block.levels for block in blocks]),
    )


class ResidentBlocks:
    """Blocks that were put on a device once; batches are put together there, without the processor.

    Indices are kept in 32 bits: a block of n points takes about 120 n bytes.
    """

    def __init__(self, blocks: Sequence[Block], device: torch.device) -> None:
        self.device = device
        self._flat = [
            [torch.from_numpy(x).to(device) for x in (block.coordinates, block.residuals, block.labels)]
            for block in blocks
        ]
        self._levels = [
            [[torch.from_numpy(x).to(device) for x in (v.neighbours, v.kept, v.nearest)] for v in block.levels]
            for block in blocks
        ]

    def __len__(self) -> int:
        return len(self._flat)

    def batch(self, chosen: Sequence[int]) -> Batch:
        """What ``make_batch`` makes of the blocks of these numbers."""
        flat = [torch.cat([self._flat[k][column] for k in chosen]) for column in range(3)]
        graphs = []
        for depth in range(len(self._levels[chosen[0]])):
            levels = [self._levels[k][depth] for k in chosen]
            here = below = 0
            parts: list[list[Tensor]] = [[], [], []]
            for neighbours, kept, nearest in levels:
                parts[0].append(neighbours.long() + here)
                parts[1].append(kept.long() + here)
                parts[2].append(nearest.long() + below)
                here, below = here + len(neighbours), below + len(kept)
            graphs.append(Graph(*(torch.cat(part) for part in parts)))
        count = torch.tensor([len(self._flat[k][0]) for k in chosen], device=self.device)
        block = torch.repeat_interleave(torch.arange(len(chosen), device=self.device), count)
        return Batch(flat[0], flat[1], flat[2].long(), block, tuple(graphs))


def network_inputs(coordinates: Tensor, residuals: Tensor, configuration: ModelConfiguration) -> tuple[Tensor, Tensor]:
    """Features (n, inputs) and scaled coordinates (n, 3) from coordinates and residual heights in metres."""
    scale = coordinates.new_tensor([1 / configuration.xy_scale, 1 / configuration.xy_scale, 1 / configuration.z_scale])
    scaled = coordinates * scale
    columns = {"x": scaled[:, 0:1], "y": scaled[:, 1:2], "z": scaled[:, 2:3]}
    columns["residuals"] = residuals / configuration.residual_scale
    return torch.cat([columns[name] for name in configuration.features], dim=1), scaled


@dataclass(frozen=True)
class Augmentation:
    """Random changes of a block's coordinates that leave its labels true.

    ``turn``: largest rotation about the vertical, degrees; ``mirror``: flip x (and, where the turn is whole, y);
    ``stretch``: factor of x and y, from 1 - to 1 + this; ``jitter``: m of noise in z. z is never flipped: that would
    make bulges of hollows.
    """

    turn: float = 180.0
    mirror: bool = True
    stretch: float = 0.1
    jitter: float = 0.005

    def __call__(self, batch: Batch, generator: torch.Generator) -> Tensor:
        """Changed coordinates (n, 3), each block in its own way; ``generator`` is one of the processor's."""
        count = int(batch.block.max()) + 1
        draw = torch.rand(count, 4, generator=generator) * 2 - 1
        angle = draw[:, 0] * math.radians(self.turn)
        size = 1 + draw[:, 1] * self.stretch
        sign = torch.where(draw[:, 2] < 0, -1.0, 1.0) if self.mirror else torch.ones(count)
        c, s = torch.cos(angle) * size, torch.sin(angle) * size
        matrix = torch.stack([torch.stack([c * sign, -s], 1), torch.stack([s * sign, c], 1)], 1)
        noise = torch.randn(len(batch.coordinates), generator=generator) * self.jitter
        device = batch.coordinates.device
        each = matrix.to(device)[batch.block]
        xy = (each @ batch.coordinates[:, :2, None])[..., 0]
        z = batch.coordinates[:, 2] + noise.to(device)
        return torch.cat([xy, z[:, None]], dim=1)


NO_AUGMENTATION = Augmentation(turn=0.0, mirror=False, stretch=0.0, jitter=0.0)
