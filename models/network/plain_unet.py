"""The network of ``unet`` by numpy alone: the same answers up to the last digits.

torch takes over a second to be imported and a quarter of a gigabyte, more than all else of a screening.

Batch normalisation is folded into the convolutions, and these are products of matrices of some rows at a time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...engine.core.arrays import Float32
from ...engine.core.errors import InputError
from ..configuration import CLASSES
from ..preparation.relief_channels import CHANNELS
from .description import checked_description
from .relief_looks import UNetConfiguration, configuration_of, misfit

_EPSILON = 1e-5
"""What torch adds to the variance of a batch normalisation."""
_COLUMN_BYTES = 1 << 19
"""Of what is gathered for a product: it stays in the processor's cache."""
_LAYERS = (0, 3)
"""Numbers of a block's convolutions among its layers; each has its normalisation behind it."""
Arrays = Mapping[str, Float32]


@dataclass(frozen=True)
class _Convolution:
    """Of 3 x 3 cells: ``weight`` (channels out, 9 times channels in, by shift) and ``bias`` (channels out, 1)."""

    weight: Float32
    bias: Float32

    def __call__(self, values: Float32) -> Float32:
        """(out, columns, rows) of values (in, columns, rows), nothing below zero; what lies beyond the edge is zero."""
        channels, columns, rows = values.shape
        padded = np.pad(values, ((0, 0), (1, 1), (1, 1)))
        result = np.empty((len(self.weight), columns, rows), dtype=np.float32)
        step = max(1, _COLUMN_BYTES // (4 * 9 * channels * rows))
        for start in range(0, columns, step):
            stop = min(start + step, columns)
            around = np.empty((9, channels, stop - start, rows), dtype=np.float32)
            for shift in range(9):
                i, j = divmod(shift, 3)
                around[shift] = padded[:, start + i : stop + i, j : j + rows]
            with np.errstate(over="ignore", invalid="ignore"):  # what is no number is refused where it ends
                product = self.weight @ around.reshape(9 * channels, -1)
                product += self.bias
            result[:, start:stop] = np.maximum(product, 0.0).reshape(-1, stop - start, rows)
        return result


@dataclass(frozen=True)
class PlainUNet:
    """A ``relief_looks.ReliefNetwork``; ``head`` are weight (3, channels) and bias (3, 1) of the last layer."""

    configuration: UNetConfiguration
    down: tuple[tuple[_Convolution, ...], ...]
    up: tuple[tuple[_Convolution, ...], ...]
    head: tuple[Float32, Float32]

    @property
    def chosen(self) -> list[int]:
        """The numbers of its channels among all ``CHANNELS``."""
        return [CHANNELS.index(name) for name in self.configuration.channels]

    def answer(self, values: Float32) -> Float32:
        """Logits (3, columns, rows) of its channels (k, columns, rows), whose sides are multiples of ``multiple``."""
        kept: list[Float32] = []
        for number, block in enumerate(self.down):
            values = _through(block, halved(values) if number else values)
            kept.append(values)
        for block, fine in zip(self.up, kept[-2::-1], strict=True):
            values = _through(block, np.concatenate([doubled(values), fine]))
        weight, bias = self.head
        logits = weight @ values.reshape(len(values), -1) + bias
        return np.asarray(logits.reshape(len(CLASSES), *values.shape[1:]), dtype=np.float32)


def halved(values: Float32) -> Float32:
    """The largest of each 2 x 2 cells of values (k, columns, rows)."""
    across = np.maximum(values[:, ::2], values[:, 1::2])
    return np.maximum(across[:, :, ::2], across[:, :, 1::2])


def doubled(values: Float32) -> Float32:
    """Values (k, columns, rows) at cells of half the side: linear between the cells' middles, level beyond them."""
    for axis in (1, 2):
        place = np.arange(values.shape[axis])
        before = values.take(np.maximum(place - 1, 0), axis)
        after = values.take(np.minimum(place + 1, place[-1]), axis)
        near = np.float32(0.75) * values
        both = np.stack([near + np.float32(0.25) * before, near + np.float32(0.25) * after], axis + 1)
        values = both.reshape(*(2 * n if k == axis else n for k, n in enumerate(values.shape)))
    return values


def load_plain_unet(path: Path, sha256: str | None = None) -> tuple[PlainUNet, dict[str, Any]]:
    """A network and its description, as ``unet.load_unet`` reads them; nothing in either file is executed.

    Raises:
        InputError: as there.
    """
    from safetensors import SafetensorError
    from safetensors.numpy import load_file

    path = Path(path)
    description, _ = checked_description(path, sha256)
    configuration = configuration_of(path, description)
    try:
        arrays = load_file(str(path))
    except (SafetensorError, RuntimeError, ValueError, KeyError, TypeError) as error:
        raise misfit(path) from error
    if not all(np.isfinite(array).all() for array in arrays.values() if array.dtype.kind == "f"):
        raise InputError(f"The weights {path} hold what is no number; download or train them again.")
    return plain_unet(path, configuration, arrays), description


def plain_unet(path: Path, configuration: UNetConfiguration, arrays: Arrays) -> PlainUNet:
    """A network of the arrays that ``UNet.state_dict`` names.

    Raises:
        InputError: they are not those of this configuration.
    """
    widths = configuration.widths
    before = (len(configuration.channels), *widths[:-1])
    down = [(f"down.{n}", a, b) for n, (a, b) in enumerate(zip(before, widths, strict=True))]
    up = [(f"up.{n}", a + b, b) for n, (a, b) in enumerate(zip(widths[:0:-1], widths[-2::-1], strict=True))]
    try:
        network = PlainUNet(
            configuration,
            tuple(_block(arrays, *each) for each in down),
            tuple(_block(arrays, *each) for each in up),
            (
                _of_shape(arrays["head.weight"], (len(CLASSES), widths[0], 1, 1))[:, :, 0, 0],
                _of_shape(arrays["head.bias"], (len(CLASSES),))[:, None],
            ),
        )
    except (KeyError, ValueError) as error:
        raise misfit(path) from error
    # a block has two convolutions, and two normalisations of five arrays
    if len(arrays) != 12 * (len(down) + len(up)) + 2:
        raise misfit(path)
    return network


def _through(block: tuple[_Convolution, ...], values: Float32) -> Float32:
    for convolution in block:
        values = convolution(values)
    return values


def _block(arrays: Arrays, name: str, before: int, after: int) -> tuple[_Convolution, ...]:
    widths = (before, after)
    return tuple(_folded(arrays, name, layer, width, after) for layer, width in zip(_LAYERS, widths, strict=True))


def _folded(arrays: Arrays, name: str, layer: int, before: int, after: int) -> _Convolution:
    """A convolution and the batch normalisation behind it as one."""
    weight = _of_shape(arrays[f"{name}.{layer}.weight"], (after, before, 3, 3)).astype(np.float64)
    scale, shift, mean, variance = (
        _of_shape(arrays[f"{name}.{layer + 1}.{part}"], (after,)).astype(np.float64)
        for part in ("weight", "bias", "running_mean", "running_var")
    )
    with np.errstate(all="ignore"):  # of damaged weights, refused below
        factor = scale / np.sqrt(variance + _EPSILON)
        # (out, in, i, j) to (out, shift, in)
        folded = (weight * factor[:, None, None, None]).transpose(0, 2, 3, 1).reshape(after, -1).astype(np.float32)
        moved = (shift - mean * factor)[:, None].astype(np.float32)
    if not (np.isfinite(folded).all() and np.isfinite(moved).all()):
        raise ValueError(f"{name}.{layer} and its normalisation give what is no number")
    return _Convolution(folded, moved)


def _of_shape(array: Float32, shape: tuple[int, ...]) -> Float32:
    if array.shape != shape or array.dtype != np.float32:
        raise ValueError(f"{array.dtype} {array.shape} instead of {shape}")
    return array
