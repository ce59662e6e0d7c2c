"""U-Net (Ronneberger et al. 2015, doi:10.1007/978-3-319-24574-4_28) on rasters of relief: three classes a cell.

Two convolutions of 3 x 3 cells with batch normalisation at each level, the maximum of 2 x 2 cells from level to level,
and on the way up bilinear steps joined with what was there on the way down. With the usual widths it has 0.21 million
parameters and sees some 30 m of 0.5 m cells.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from ...engine.core.arrays import Float32
from ...engine.core.errors import InputError
from ..configuration import CLASSES
from ..preparation.relief_channels import CHANNELS, upside_down
from ..preparation.relief_raster import CELL_M
from .weights import load_tensors, save_tensors

KIND = "relief U-Net"


@dataclass(frozen=True)
class UNetConfiguration:
    """``channels`` that the network reads (``relief_channels.CHANNELS``), ``widths`` of its levels from the finest on
    and the side ``cell`` of its cells, m. Travels with the weights.
    """

    channels: tuple[str, ...] = CHANNELS
    widths: tuple[int, ...] = (16, 24, 48, 64)
    cell: float = CELL_M

    @property
    def multiple(self) -> int:
        """Sides of a raster must be multiples of so many cells."""
        return int(2 ** (len(self.widths) - 1))


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

    @property
    def parameter_count(self) -> int:
        return sum(parameter.numel() for parameter in self.parameters())


def raster_logits(network: UNet, channels: Float32, *, mirrored: bool = True) -> Float32:
    """Logits (3, columns, rows) of all ``CHANNELS`` (k, columns, rows) of a raster of any size.

    Args:
        mirrored: the mean of four looks: as it is, with x mirrored, and both upside down with the classes exchanged.
    """
    looks = [channels]
    if mirrored:
        looks = [look for one in (channels, channels[:, ::-1]) for look in (one, upside_down(one))]
    columns, rows = channels.shape[1:]
    multiple = network.configuration.multiple
    rim = (0, -rows % multiple, 0, -columns % multiple)
    with torch.inference_mode():
        values = functional.pad(torch.from_numpy(np.stack(looks)[:, network.chosen]), rim)
        found = network(values)[:, :, :columns, :rows].numpy()
    if not mirrored:
        return np.asarray(found[0], dtype=np.float32)
    swapped = found[:, [0, 2, 1]]
    return np.asarray((found[0] + swapped[1] + found[2][:, ::-1] + swapped[3][:, ::-1]) / 4, dtype=np.float32)


def log_odds(logits: Float32) -> tuple[Float32, Float32]:
    """Log odds (columns, rows) of uplift and of subsidence against the other two classes."""
    background, up, down = logits
    return up - np.logaddexp(background, down), down - np.logaddexp(background, up)


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
    if description.get("kind") != KIND:
        raise InputError(f"The weights {path} are not those of a {KIND}; give the file that belongs here.")
    stated = description["configuration"]
    try:
        configuration = UNetConfiguration(tuple(stated["channels"]), tuple(stated["widths"]), float(stated["cell"]))
        network = UNet(configuration)
        network.load_state_dict(tensors)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise InputError(f"The weights {path} do not fit their description; take both from one source.") from error
    unknown = set(configuration.channels) - set(CHANNELS)
    if unknown or configuration.cell != CELL_M:
        raise InputError(f"The weights {path} read other channels or cells than this version makes; train them again.")
    network.eval()
    return network, description


def _block(before: int, after: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for width in (before, after):
        layers += [nn.Conv2d(width, after, 3, padding=1, bias=False), nn.BatchNorm2d(after), nn.ReLU(inplace=True)]
    return nn.Sequential(*layers)
