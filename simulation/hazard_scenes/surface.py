"""The height field over a slope's mean plane, and the textures that it is made of."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from ...engine.core.arrays import Float32
from ..fields import power_law_field

TILE = 512
"""Nodes of a texture's side; textures are periodic, so that they can be laid side by side."""


@dataclass
class Surface:
    """Height normal to the mean plane at the nodes of a regular grid: u along the strike, w up the dip, both from
    ``low``.

    Arrays are (nodes in u, nodes in w), so that a scan line across the slope runs through adjacent memory. ``height``
    (m) and ``negative`` are changed in place while the scene is built. ``extent`` is the length in u and w of the
    part that is surveyed, which starts at 0; the grid is wider by a margin. ``bumps`` and ``folds`` are unit textures
    (wavelengths of 0.5 to 2.5 m and 2 to 8 m) that make shapes irregular.
    """

    low: float
    step: float
    extent: tuple[float, float]
    shape: tuple[int, int]
    bumps: Float32
    folds: Float32
    height: Float32 = field(init=False)
    negative: NDArray[np.uint8] = field(init=False)

    def __post_init__(self) -> None:
        self.height = np.zeros(self.shape, dtype=np.float32)
        self.negative = np.zeros(self.shape, dtype=np.uint8)

    @cached_property
    def u(self) -> Float32:
        """u of the nodes of the first axis, m."""
        return (self.low + self.step * np.arange(self.shape[0])).astype(np.float32)

    @cached_property
    def w(self) -> Float32:
        """w of the nodes of the second axis, m."""
        return (self.low + self.step * np.arange(self.shape[1])).astype(np.float32)

    def window(self, west: float, south: float, east: float, north: float, stride: int = 1) -> tuple[slice, slice]:
        """Slices of the nodes within u from ``west`` to ``east``, w from ``south`` to ``north``; nodes of one stride
        agree.
        """
        spans = []
        for low, high, nodes in ((west, east, self.shape[0]), (south, north, self.shape[1])):
            first = max(0, math.ceil((low - self.low) / self.step))
            last = min(nodes, math.floor((high - self.low) / self.step) + 1)
            first = math.ceil(first / stride) * stride
            spans.append(slice(first, max(first, last), stride))
        return spans[0], spans[1]

    def nodes(self, rows: slice, columns: slice) -> tuple[Float32, Float32]:
        """u as a column and w as a row of the nodes in the slices, for broadcasting."""
        return self.u[rows, None], self.w[None, columns]

    def texture(self, tile: Float32, rows: slice, columns: slice, shift: int = 0) -> Float32:
        """The part of a tiled texture that lies on the slices; ``shift`` (nodes) takes it from elsewhere in the
        tile. It may be a view of the tile: not to be changed.
        """
        i = _tiled(range(*rows.indices(self.shape[0])), shift)
        j = _tiled(range(*columns.indices(self.shape[1])), 3 * shift)
        part = tile[i]
        return part[:, j] if isinstance(j, slice) else part.take(j, axis=1)

    def mark(self, rows: slice, columns: slice, where: NDArray[np.bool_], kind: int) -> None:
        """Set the negative type at the nodes ``where`` of the slices."""
        self.negative[rows, columns][where] = kind


def _tiled(nodes: range, shift: int) -> slice | NDArray[np.intp]:
    """Where ``nodes`` lie in a tile that repeats: a slice where they do not reach over its edge."""
    first = (nodes.start + shift) % TILE
    last = first + (len(nodes) - 1) * nodes.step
    if nodes and last < TILE:
        return slice(first, last + 1, nodes.step)
    return (np.arange(nodes.start, nodes.stop, nodes.step, dtype=np.intp) + shift) % TILE


def new_surface(extent: tuple[float, float], step: float, rng: np.random.Generator) -> Surface:
    """A flat surface for a survey of ``extent`` m along u and w with nodes ``step`` m apart."""
    margin = 1.5
    nodes = [math.ceil((length + 2 * margin) / step) + 1 for length in extent]
    bumps = periodic_texture(step, 2.0, 0.5, 2.5, rng)
    folds = periodic_texture(step, 2.0, 2.0, 8.0, rng)
    return Surface(-margin, step, extent, (nodes[0], nodes[1]), bumps, folds)


def periodic_texture(
    step: float, exponent: float, shortest: float, longest: float, rng: np.random.Generator
) -> Float32:
    """(TILE, TILE) Gaussian field, mean 0, deviation 1, power spectrum k^-exponent between two wavelengths (m),
    periodic.
    """
    spectrum = fft.rfft2(rng.standard_normal((TILE, TILE), dtype=np.float32))
    k = np.hypot(np.fft.fftfreq(TILE, step)[:, None], np.fft.rfftfreq(TILE, step)[None, :]).astype(np.float32)
    k[0, 0] = 1.0
    gain = k ** np.float32(-exponent / 2) * np.exp(-((k * shortest) ** 4)) * (1.0 - np.exp(-((k * longest) ** 4)))
    gain[0, 0] = 0.0
    tile = fft.irfft2(spectrum * gain, s=(TILE, TILE))
    deviation = float(tile.std())
    return (tile / (deviation or 1.0)).astype(np.float32)


def roughen(surface: Surface, rms: float, exponent: float, rng: np.random.Generator) -> float:
    """Add natural roughness of ``rms`` m with power spectrum k^-exponent up to wavelengths of 8 m.

    Wavelengths above 1 m come from a coarse field that covers the scene, shorter ones from a periodic texture.

    Returns:
        rms of the wavelengths below 1 m: what blurs a displacement at the scale of neighbouring points.
    """
    split, longest, shortest = 1.0, 8.0, max(0.1, 2 * surface.step)
    fine_part = _band_variance(exponent, shortest, split)
    total = fine_part + _band_variance(exponent, split, longest)
    fine = rms * math.sqrt(fine_part / total)
    coarse = rms * math.sqrt(1 - fine_part / total)
    texture = periodic_texture(surface.step, exponent, shortest, split, rng) * np.float32(fine)
    everything = slice(None)
    surface.height += surface.texture(texture, everything, everything)
    add_coarse(surface, coarse, 0.25, exponent, split, longest, rng)
    return fine


def add_coarse(
    surface: Surface,
    rms: float,
    spacing: float,
    exponent: float,
    shortest: float,
    longest: float,
    rng: np.random.Generator,
) -> None:
    """Add a random field of ``rms`` m made at nodes ``spacing`` m apart and interpolated linearly."""
    shape = [math.ceil(nodes * surface.step / spacing) + 2 for nodes in surface.shape]
    values = (rms * power_law_field((shape[0], shape[1]), spacing, exponent, shortest, longest, rng)).astype(np.float32)
    surface.height += resample(values, surface.step / spacing, surface.shape)


def resample(values: Float32, ratio: float, shape: tuple[int, int]) -> Float32:
    """Linear interpolation of ``values`` at (i ratio, j ratio) for i, j of ``shape``."""
    for axis in (0, 1):
        place = np.minimum(np.arange(shape[axis]) * ratio, values.shape[axis] - 1.000001)
        first = place.astype(np.intp)
        part = (place - first).astype(np.float32)
        part = part[:, None] if axis == 0 else part[None, :]
        low = values.take(first, axis=axis)
        values = low + part * (values.take(first + 1, axis=axis) - low)
    return values


def smooth_line(count: int, step: float, wavelength: float, rng: np.random.Generator) -> Float32:
    """A random line of ``count`` nodes ``step`` m apart, deviation about 1, that wanders over ``wavelength`` m."""
    knots = max(4, math.ceil(count * step / wavelength * 2) + 3)
    values = rng.standard_normal(knots)
    place = np.linspace(1.0, knots - 2.001, count)
    first = place.astype(np.intp)
    t = place - first
    # Cubic B-spline weights, scaled back to unit deviation.
    weights = ((1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3)
    line = sum(weight / 6 * values[np.clip(first + k - 1, 0, knots - 1)] for k, weight in enumerate(weights))
    return np.asarray(line / 0.66, dtype=np.float32)


def _band_variance(exponent: float, shortest: float, longest: float) -> float:
    """Variance of a 2-D field k^-exponent between two wavelengths, up to a factor."""
    power = exponent - 2.0
    if abs(power) < 1e-6:
        return math.log(longest / shortest)
    return (longest**power - shortest**power) / power
