"""A line scanner flown along the slope: which places of the surface it sees, strip by strip, with its errors.

Rays lie in planes across the flight line. For each node of u the tangents of the angles at which the sensor sees the
nodes of w, turned into a running maximum, say which node a ray meets first; whatever a ridge hides is never met.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float
from .styles import Style
from .surface import Surface

HALF_VIEW = math.radians(36.0)
"""Half of the scanner's field of view."""
WIDEST = 5.0
"""Largest tangent of the angle between a ray and the mean plane's normal; beyond, echoes are too weak."""
SEAM = 0.5
"""Points this close (m) to the edge of another strip's swath lie on a seam."""


@dataclass(frozen=True)
class Strip:
    """A flight line: where its sensor is over the mean plane (w and n, m), its rays' angles, its height error (m)."""

    w: float
    n: float
    lowest: float
    highest: float
    offset: float


@dataclass(frozen=True)
class Hits:
    """Echoes: place on the mean plane (u, w), the ray's tangent to the plane's normal, its strip, whether on a seam."""

    u: Float
    w: Float
    tangent: Float
    strip: NDArray[np.uint8]
    seam: NDArray[np.bool_]


def plan_strips(surface: Surface, dip: float, style: Style, rng: np.random.Generator) -> list[Strip]:
    """Flight lines along u whose swaths cover the slope with about 50 % overlap."""
    distance = rng.uniform(30.0, 60.0)
    # The scanner looks between straight down and straight at the slope.
    middle = -dip * rng.uniform(0.15, 0.9)
    lowest = max(middle - HALF_VIEW, -math.atan(WIDEST))
    highest = min(middle + HALF_VIEW, math.atan(WIDEST))
    swath = distance * math.cos(middle) * (math.tan(highest) - math.tan(lowest))
    length = surface.extent[1]
    count = max(2, math.ceil(length / (0.5 * min(swath, 100.0))))
    centres = (np.arange(count) + 0.5 + rng.uniform(-0.25, 0.25, count)) * length / count
    offsets = rng.uniform(*style.strip_offset, count) * rng.choice((-1.0, 1.0), count) / 2
    n = distance * math.cos(middle)
    return [
        Strip(float(centre - n * math.tan(middle)), n, lowest, highest, float(offset))
        for centre, offset in zip(centres, offsets)
    ]


def scan(surface: Surface, strips: list[Strip], rays: int, style: Style, rng: np.random.Generator) -> Hits:
    """Echoes of about ``rays`` rays on the surveyed part of the surface, in the order of flight."""
    spans = [_angles(surface, strip) for strip in strips]
    total = sum(high - low for low, high in spans)
    parts: list[tuple[Float, Float, Float, NDArray[np.uint8]]] = []
    repeating = rng.random() >= style.random_pattern
    numbers = np.arange(surface.height.size, dtype=np.float64)
    for number, (strip, (low, high)) in enumerate(zip(strips, spans)):
        count = round(rays * (high - low) / total) if high > low else 0
        if count < 2:
            continue
        u, angle = (_lines if repeating else _scattered)(surface, count, low, high, rng)
        w, tangent, seen = _first_hits(surface, strip, u, np.tan(angle), numbers)
        where = np.flatnonzero(seen & (u >= 0) & (u <= surface.extent[0]) & (w >= 0) & (w <= surface.extent[1]))
        parts.append((u[where], w[where], tangent[where], np.full(len(where), number, dtype=np.uint8)))
    u, w, tangent = (np.concatenate([part[i] for part in parts]) for i in range(3))
    owner = np.concatenate([part[3] for part in parts])
    return Hits(u, w, tangent, owner, _on_seam(strips, w))


def _angles(surface: Surface, strip: Strip) -> tuple[float, float]:
    """The strip's angles that meet the surveyed part of the mean plane."""
    low, high = (math.atan((w - strip.w) / strip.n) for w in (-0.5, surface.extent[1] + 0.5))
    return max(low, strip.lowest), min(high, strip.highest)


def _lines(surface: Surface, count: int, low: float, high: float, rng: np.random.Generator) -> tuple[Float, Float]:
    """Scan lines across the slope: u and angle of each ray. Lines lie 0.5 to 2 times as far apart as their points."""
    length = surface.extent[0]
    width = (high - low) * 50.0  # close enough to the swath's width to set the spacing
    lines = max(2, round(math.sqrt(count * length / width) * math.exp(rng.uniform(-0.7, 0.7))))
    each = max(2, round(count / lines))
    u = ((np.arange(lines) + 0.5 + rng.normal(0, 0.15, lines)) * (length / lines))[:, None]
    u = u + rng.normal(0.0, 0.01, (lines, each))
    phase = rng.random((lines, 1)) + rng.normal(0.0, 0.1, (lines, each))
    angle = low + (np.arange(each) + phase) * ((high - low) / each)
    return u.ravel(), angle.ravel()


def _scattered(surface: Surface, count: int, low: float, high: float, rng: np.random.Generator) -> tuple[Float, Float]:
    """A pattern that never repeats: u and angle of each ray, independent, in the order of u."""
    u = (np.arange(count) + rng.random(count)) * (surface.extent[0] / count)
    return u, rng.uniform(low, high, count)


def _first_hits(
    surface: Surface, strip: Strip, u: Float, tangent: Float, numbers: Float
) -> tuple[Float, Float, NDArray[np.bool_]]:
    """w of the first place that each ray meets, its tangent, and whether it meets any; ``numbers`` are the nodes'."""
    rows, columns = surface.shape
    w = surface.w
    seen_at = (w[None, :] - np.float32(strip.w)) / (np.float32(strip.n) - surface.height)
    np.clip(seen_at, -2 * WIDEST, 2 * WIDEST, out=seen_at)
    foot = int(np.clip(np.searchsorted(w, strip.w), 0, columns))
    np.maximum.accumulate(seen_at[:, foot:], axis=1, out=seen_at[:, foot:])
    left = seen_at[:, :foot][:, ::-1]
    np.minimum.accumulate(left, axis=1, out=left)
    # One rising sequence for all nodes of u, so that one interpolation serves all rays.
    apart = 5.0 * WIDEST
    sequence = seen_at.astype(np.float64)
    sequence += apart * np.arange(rows, dtype=np.float64)[:, None]
    row = u - surface.low
    row /= surface.step
    np.clip(np.rint(row, out=row), 0, rows - 1, out=row)
    place = np.interp(tangent + apart * row, sequence.ravel(), numbers)
    row *= columns
    place -= row
    seen = (place > 0) & (place < columns - 1)
    place *= surface.step
    place += surface.low
    return place, tangent, seen


def _on_seam(strips: list[Strip], w: Float) -> NDArray[np.bool_]:
    """Points near the edge of any strip's swath, where the number of strips and their mean error changes."""
    seam, apart = np.zeros(len(w), dtype=bool), np.empty_like(w)
    for strip in strips:
        for angle in (strip.lowest, strip.highest):
            np.subtract(w, strip.w + strip.n * math.tan(angle), out=apart)
            seam |= np.abs(apart, out=apart) < SEAM
    return seam
