"""What a network on rasters of relief answers to a raster of any size: in tiles, each looked at in four ways.

Needs no torch: the network is one of ``unet``, or of ``plain_unet``, by numpy.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ...engine.core.arrays import Float32
from ...engine.core.errors import InputError
from ...engine.core.json_shapes import MisfitError
from ...engine.core.progress import Progress
from ..configuration import CLASSES
from ..preparation.relief_channels import CHANNELS, upside_down
from ..preparation.relief_raster import CELL_M
from .description import RELIEF as KIND
from .description import RELIEF_CONFIGURATION

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


class ReliefNetwork(Protocol):
    """A network in whatever way it computes."""

    @property
    def configuration(self) -> UNetConfiguration:
        """What it reads, and how wide it is."""

    @property
    def chosen(self) -> Sequence[int]:
        """The numbers of its channels among all ``CHANNELS``."""

    def answer(self, values: Float32) -> Float32:
        """Logits (3, columns, rows) of the chosen channels (k, columns, rows), in its own thread."""


def configuration_of(path: Path, description: Mapping[str, Any]) -> UNetConfiguration:
    """The configuration that the description of the weights ``path`` states.

    Raises:
        InputError: they are of another kind of network, or not made for this version.
    """
    if description.get("kind") != KIND:
        raise InputError(f"The weights {path} are not those of a {KIND}; give the file that belongs here.")
    stated = description["configuration"]
    try:
        RELIEF_CONFIGURATION(stated, "configuration")
    except MisfitError as error:
        raise misfit(path) from error
    found = UNetConfiguration(tuple(stated["channels"]), tuple(stated["widths"]), float(stated["cell"]))
    if set(found.channels) - set(CHANNELS) or found.cell != CELL_M:
        raise InputError(f"The weights {path} read other channels or cells than this version makes; train them again.")
    return found


def misfit(path: Path) -> InputError:
    """What is said of weights that are not those described."""
    return InputError(f"The weights {path} do not fit their description; take both from one source.")


def raster_logits(
    network: ReliefNetwork,
    channels: Float32,
    *,
    mirrored: bool = True,
    tile: int = TILE_CELLS,
    threads: int = 1,
    progress: Progress | None = None,
) -> Float32:
    """Logits (3, columns, rows) of all ``CHANNELS`` (k, columns, rows) of a raster of any size.

    Args:
        network: ready to answer.
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


def _look(network: ReliefNetwork, channels: Float32, look: tuple[bool, bool]) -> Float32:
    """Logits of a tile by one look: with x mirrored or not, and upside down or not, and put back as the tile lies."""
    mirrored, inverse = look
    seen = upside_down(channels) if inverse else channels
    found = network.answer(np.ascontiguousarray((seen[:, ::-1] if mirrored else seen)[network.chosen]))
    found = found[[0, 2, 1]] if inverse else found
    return np.asarray(found[:, ::-1] if mirrored else found, dtype=np.float32)


def log_odds(logits: Float32) -> tuple[Float32, Float32]:
    """Log odds (columns, rows) of uplift and of subsidence against the other two classes."""
    background, up, down = logits
    return up - np.logaddexp(background, down), down - np.logaddexp(background, up)
