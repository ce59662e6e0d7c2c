"""Long structures: the strip of nodes along a line that runs up the slope or along it, and how they are set into the
ground.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from ...engine.core.arrays import Float32
from .surface import Surface, smooth_line


@dataclass(frozen=True)
class Band:
    """Nodes near a line. ``across`` is each node's signed distance to it, ``along`` its place on it (both m).

    ``along`` has length 1 in the axis that the line crosses; ``axis`` is the axis it runs along (0: u, 1: w).
    """

    surface: Surface
    rows: slice
    columns: slice
    across: Float32
    along: Float32
    axis: int

    @property
    def height(self) -> Float32:
        """The surface's heights in the band, a view that may be changed."""
        return self.surface.height[self.rows, self.columns]

    def line(self, values: Float32) -> Float32:
        """Values along the line, shaped to broadcast over the band."""
        return values[None, :] if self.axis else values[:, None]

    @property
    def stations(self) -> int:
        """Nodes along the line."""
        return int(self.across.shape[self.axis])

    def mean_height(self, half: float, worn: float) -> Float32:
        """Mean height within ``half`` m of the line, smoothed over ``worn`` m along it: what a built channel
        follows.
        """
        near = np.abs(self.across) <= max(half, self.surface.step)
        count = np.maximum(near.sum(axis=1 - self.axis), 1)
        mean = np.where(near, self.height, 0.0).sum(axis=1 - self.axis) / count
        width = max(1, round(worn / self.surface.step))
        return self.line(uniform_filter1d(mean.astype(np.float32), width, mode="nearest"))

    def build(self, profile: Float32, inside: Float32, base: Float32) -> None:
        """Replace the ground by ``base + profile`` where ``inside`` is 1, keep it where it is 0."""
        self.height[...] += inside * (base + profile - self.height)

    def mark(self, where: NDArray[np.bool_], kind: int) -> None:
        """Set the negative type at the nodes ``where``."""
        self.surface.mark(self.rows, self.columns, where, kind)


def band(surface: Surface, axis: int, start: float, end: float, centre: Float32 | float, reach: float) -> Band | None:
    """The nodes within ``reach`` m of a line from ``start`` to ``end`` along ``axis``; None where it misses the grid.

    ``centre`` is where the line lies in the other axis: a number, or one for each of the grid's nodes along ``axis``.
    """
    nodes = surface.shape[axis]
    lines = np.broadcast_to(np.asarray(centre, dtype=np.float32), (nodes,))
    first, last = (round((x - surface.low) / surface.step) for x in (start, end))
    run = slice(max(0, first), min(nodes, last + 1))
    lines = lines[run]
    if run.stop <= run.start:
        return None
    low, high = float(lines.min()) - reach, float(lines.max()) + reach
    far = surface.low + surface.step * max(surface.shape)
    if axis == 1:
        rows, columns = surface.window(low, -far, high, far)[0], run
        across = surface.u[rows, None] - lines[None, :]
        along = surface.w[None, columns]
    else:
        rows, columns = run, surface.window(-far, low, far, high)[1]
        across = surface.w[None, columns] - lines[:, None]
        along = surface.u[rows, None]
    return Band(surface, rows, columns, across, along, axis) if across.size else None


def wander(surface: Surface, axis: int, wavelength: float, size: float, rng: np.random.Generator) -> Float32:
    """A random lateral offset of ``size`` m for each node along ``axis``."""
    return smooth_line(surface.shape[axis], surface.step, wavelength, rng) * np.float32(size)


def ramp(distance: Float32, width: float) -> Float32:
    """1 where ``distance`` is negative, falling to 0 over ``width`` m."""
    return np.clip(1.0 - distance * np.float32(1 / width), 0.0, 1.0)
