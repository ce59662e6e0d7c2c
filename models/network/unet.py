"""U-Net (Ronneberger et al. 2015, doi:10.1007/978-3-319-24574-4_28) on rasters of relief: three classes a cell.

Two convolutions of 3 x 3 cells with batch normalisation at each level, the maximum of 2 x 2 cells from level to level,
and on the way up bilinear steps joined with what was there on the way down. With the usual widths it has 0.21 million
parameters and sees some 30 m of 0.5 m cells.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from ...engine.core.arrays import Float32
from ..configuration import CLASSES
from ..preparation.relief_channels import CHANNELS
from .description import RELIEF as KIND
from .relief_looks import UNetConfiguration, configuration_of, misfit
from .weights import load_tensors, save_tensors


class UNet(nn.Module):
    """From channels (batch, channels, columns, rows) to logits (batch, 3, columns, rows). ``chosen`` are the numbers of
    its channels among all ``CHANNELS``.
    """

    def __init__(self, configuration: UNetConfiguration) -> None:
        super().__init__()
        self.configuration = configuration
        self.chosen = [CHANNELS.index(name) for name in configuration.channels]
        widths = configuration.widths
        before = (len(configuration.channels), *widths[:-1])
        self.down = nn.ModuleList(_block(a, b) for a, b in zip(before, widths, strict=True))
        self.up = nn.ModuleList(_block(deep + fine, fine) for deep, fine in zip(widths[:0:-1], widths[-2::-1]))
        self.head = nn.Conv2d(widths[0], len(CLASSES), 1)

    def forward(self, values: Tensor) -> Tensor:
        kept: list[Tensor] = []
        for number, block in enumerate(self.down):
            values = block(functional.max_pool2d(values, 2) if number else values)
            kept.append(values)
        for block, fine in zip(self.up, kept[-2::-1], strict=True):
            wide = functional.interpolate(values, scale_factor=2.0, mode="bilinear", align_corners=False)
            values = block(torch.cat([wide, fine], dim=1))
        return torch.as_tensor(self.head(values))

    def answer(self, values: Float32) -> Float32:
        """Logits (3, columns, rows) of its channels (k, columns, rows), on the device that it is on."""
        with torch.inference_mode():
            found = self(torch.from_numpy(values)[None].to(self.head.weight.device))
        return np.asarray(found[0].cpu().numpy())

    @property
    def parameter_count(self) -> int:
        return sum(parameter.numel() for parameter in self.parameters())


def save_unet(path: Path, network: UNet, training: dict[str, Any], metrics: dict[str, Any]) -> str:
    """Write weights and their description, as ``weights.save_model`` does; the weights' SHA-256."""
    facts = {
        "kind": KIND,
        "configuration": asdict(network.configuration),
        "parameters": network.parameter_count,
        "training": training,
        "metrics": metrics,
    }
    return save_tensors(path, network.state_dict(), facts)


def load_unet(path: Path, sha256: str | None = None) -> tuple[UNet, dict[str, Any]]:
    """A network in evaluation mode and its description; nothing in either file is executed.

    Raises:
        InputError: a file is missing, pickled, tampered with, of another kind or not made for this version.
    """
    description, tensors, _ = load_tensors(path, sha256)
    configuration = configuration_of(path, description)
    network = UNet(configuration)
    try:
        network.load_state_dict(tensors)
    except RuntimeError as error:
        raise misfit(path) from error
    network.eval()
    return network, description


def _block(before: int, after: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for width in (before, after):
        layers += [nn.Conv2d(width, after, 3, padding=1, bias=False), nn.BatchNorm2d(after), nn.ReLU(inplace=True)]
    return nn.Sequential(*layers)
