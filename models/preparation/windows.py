"""Square windows over the flat slope, and the points that go into a block together."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...engine.core.arrays import Float, Index


@dataclass(frozen=True)
class Window:
    """A window's middle (x, y) and the points within it, rising."""

    middle: tuple[float, float]
    points: Index


def windows(xy: Float, size: float, step: float, minimum_points: int = 0, *, spread: bool = False) -> list[Window]:
    """Windows of ``size`` m every ``step`` m from the lowest x and y on; those without points are left out.

    Args:
        xy: (n, 2 or more).
        minimum_points: windows with fewer are left out as well, so that some points may be in none.
        spread: move the windows together evenly so that the last ones end with the points, rather than beyond them.
    """
    low, high = xy[:, :2].min(axis=0), xy[:, :2].max(axis=0)
    starts = [_starts(float(a), float(b), size, step, spread) for a, b in zip(low, high)]
    by_x = np.argsort(xy[:, 0], kind="stable")
    x = xy[by_x, 0]
    found = []
    size_or_so = size + 1e-9  # the last window ends with the points, however that was rounded
    for left in starts[0]:
        first, last = np.searchsorted(x, left, "left"), np.searchsorted(x, left + size_or_so, "right")
        strip = np.sort(by_x[first:last])
        y = xy[strip, 1]
        for bottom in starts[1]:
            points = strip[(y >= bottom) & (y <= bottom + size_or_so)]
            if len(points) >= max(1, minimum_points):
                found.append(Window((left + size / 2, bottom + size / 2), points))
    return found


def _starts(low: float, high: float, size: float, step: float, spread: bool) -> list[float]:
    """Where windows start along one axis."""
    length = high - low
    if length <= size:
        # One window about the middle rather than one that begins at the edge.
        return [low + (length - size) / 2] if spread else [low]
    count = int(np.ceil((length - size) / step - 1e-9)) + 1
    if spread:
        return [low + (length - size) * k / (count - 1) for k in range(count)]
    return [low + step * k for k in range(count)]


def sample_fixed(points: Index, count: int, rng: np.random.Generator) -> Index:
    """Exactly ``count`` of the points: a random choice, or all of them and random ones once more where they are
    fewer.
    """
    if len(points) >= count:
        return np.sort(rng.choice(points, count, replace=False))
    return np.sort(np.concatenate([points, rng.choice(points, count - len(points), replace=True)]))


def cover_fixed(points: Index, count: int, rng: np.random.Generator) -> Iterator[Index]:
    """Blocks of exactly ``count`` points that together hold every point; the last one is filled up with random ones."""
    order = rng.permutation(points)
    for start in range(0, len(order), count):
        block = order[start : start + count]
        if len(block) < count and start:
            others = rng.choice(order[:start], count - len(block), replace=start < count - len(block))
            block = np.concatenate([block, others])
        yield sample_fixed(block, count, rng)


def centre_weight(xy: Float, middle: tuple[float, float], size: float) -> Float:
    """Weight (n,) of a window's vote: 1 in its middle, falling to 0.05 at its edge."""
    inside = 1.0 - np.abs(xy[:, :2] - middle) / (size / 2)
    return np.maximum(np.minimum(inside[:, 0], inside[:, 1]) * 2.0, 0.05).clip(max=1.0)
