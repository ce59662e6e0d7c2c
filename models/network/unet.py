"""U-Net (Ronneberger et al. 2015, doi:10.1007/978-3-319-24574-4_28) on rasters of relief: three classes a cell.

Two convolutions of 3 x 3 cells with batch normalisation at each level, the maximum of 2 x 2 cells from level to level,
and on the way up bilinear steps joined with what was there on the way down. With the usual widths it has 0.21 million
parameters and sees some 30 m of 0.5 m cells.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from ...engine.core.arrays import Float32
from ...engine.core.errors import InputError
from ...engine.core.json_shapes import MisfitError
from ...engine.core.progress import Progress
from ..configuration import CLASSES
from ..preparation.relief_channels import CHANNELS, upside_down
from ..preparation.relief_raster import CELL_M
from .description import RELIEF as KIND
from .description import RELIEF_CONFIGURATION
from .weights import load_tensors, save_tensors

TILE_CELLS = 384
"""Side of what is worked on at a time, without its margin: with the usual widths it takes 0.2 GB."""


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

    @property
    def margin(self) -> int:
        """Cells about a place beyond which nothing changes its answer, as a multiple of ``multiple``.

        With m cells of the finest level along one of the coarsest, convolutions reach 2 (2 m - 1) cells on the way down
        and 2 (m - 1) on the way up, maxima m - 1 and bilinear steps 2 (m - 1): 9 m - 7 together.
        """
        return 9 * self.multiple


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


def raster_logits(
    network: UNet,
    channels: Float32,
    *,
    mirrored: bool = True,
    tile: int = TILE_CELLS,
    threads: int = 1,
    progress: Progress | None = None,
) -> Float32:
    """Logits (3, columns, rows) of all ``CHANNELS`` (k, columns, rows) of a raster of any size.

    Args:
        network: in evaluation mode; the raster goes to the device that it is on.
        mirrored: the mean of four looks: as it is, with x mirrored, and both upside down with the classes exchanged.
        tile: larger rasters are cut in tiles of at most about so many cells a side, with margins in which all lies
            that changes an answer.
        threads: looks at tiles that are worked on at the same time; the result does not depend on it.
    """
    progress = progress or Progress()
    columns, rows = channels.shape[1:]
    multiple = network.configuration.multiple
    padded = np.pad(channels, ((0, 0), (0, -columns % multiple), (0, -rows % multiple)))
    result = np.zeros((len(CLASSES), *padded.shape[1:]), dtype=np.float32)
    looks = [(x, z) for x in (False, True) for z in (False, True)] if mirrored else [(False, False)]
    jobs = [(window, look) for window in _tiles(padded.shape[1:], network.configuration, tile) for look in looks]
    with ThreadPoolExecutor(threads) as pool:
        waiting = [pool.submit(_look, network, padded[window.outer], look) for window, look in jobs]
        try:
            for done, ((window, _), future) in enumerate(zip(jobs, waiting, strict=True)):
                progress.update(done / len(jobs))
                result[window.inner] += future.result()[window.within]
        finally:
            for future in waiting:
                future.cancel()
    return np.asarray(result[:, :columns, :rows] / len(looks), dtype=np.float32)


@dataclass(frozen=True)
class _Tile:
    """All channels, the columns and the rows of a tile: with its margin, without, and the latter within the former."""

    outer: tuple[slice, slice, slice]
    inner: tuple[slice, slice, slice]
    within: tuple[slice, slice, slice]


def _tiles(shape: tuple[int, ...], configuration: UNetConfiguration, side: int) -> Iterator[_Tile]:
    """Tiles that cover a raster whose sides are multiples of ``configuration.multiple``."""
    multiple, margin = configuration.multiple, configuration.margin
    axes = []
    for size in shape:
        step = max(1, round(size / max(1, -(-size // side)) / multiple)) * multiple
        cuts = []
        for start in range(0, size, step):
            end, low = min(start + step, size), max(0, start - margin)
            outer = slice(low, min(end + margin, size))
            cuts.append((outer, slice(start, end), slice(start - low, end - low)))
        axes.append(cuts)
    for along in axes[0]:
        for across in axes[1]:
            yield _Tile(*((slice(None), *both) for both in zip(along, across, strict=True)))


def _look(network: UNet, channels: Float32, look: tuple[bool, bool]) -> Float32:
    """Logits of a tile by one look: with x mirrored or not, and upside down or not, and put back as the tile lies."""
    mirrored, inverse = look
    seen = upside_down(channels) if inverse else channels
    seen = np.ascontiguousarray((seen[:, ::-1] if mirrored else seen)[network.chosen])
    with torch.inference_mode():
        values = torch.from_numpy(seen)[None].to(network.head.weight.device)
        found = network(values)[0].cpu().numpy()
    found = found[[0, 2, 1]] if inverse else found
    return np.asarray(found[:, ::-1] if mirrored else found, dtype=np.float32)


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
    sentence = f"The weights {path} do not fit their description; take both from one source."
    try:
        RELIEF_CONFIGURATION(stated, "configuration")
    except MisfitError as error:
        raise InputError(sentence) from error
    configuration = UNetConfiguration(tuple(stated["channels"]), tuple(stated["widths"]), float(stated["cell"]))
    if set(configuration.channels) - set(CHANNELS) or configuration.cell != CELL_M:
        raise InputError(f"The weights {path} read other channels or cells than this version makes; train them again.")
    network = UNet(configuration)
    try:
        network.load_state_dict(tensors)
    except RuntimeError as error:
        raise InputError(sentence) from error
    network.eval()
    return network, description


def _block(before: int, after: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for width in (before, after):
        layers += [nn.Conv2d(width, after, 3, padding=1, bias=False), nn.BatchNorm2d(after), nn.ReLU(inplace=True)]
    return nn.Sequential(*layers)
