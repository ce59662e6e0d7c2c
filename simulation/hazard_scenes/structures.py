"""Built things on a slope that a screening must not take for hazards: chutes, berm ditches, lattice beams, stairs,
pipes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter

from ...engine.core.arrays import Float32
from .bands import band, ramp, wander
from .negatives import Negative
from .surface import Surface, smooth_line
from .terrain import Terrain


@dataclass(frozen=True)
class Cell:
    """The soil between four beams: centre, half-axes (m) and turn (rad) of a rectangle."""

    u: float
    w: float
    half_u: float
    half_w: float
    turn: float


def drains(terrain: Terrain, rng: np.random.Generator) -> None:
    """One to four lined chutes down the slope, 0.3 to 1 m wide, part silted."""
    surface = terrain.surface
    length_u, length_w = surface.extent
    for _ in range(rng.integers(1, 2 + min(4, round(length_u / 20)))):
        start = 0.0 if rng.random() < 0.7 else rng.uniform(0, 0.4) * length_w
        end = length_w if rng.random() < 0.7 else rng.uniform(0.6, 1.0) * length_w
        tilt = np.float32(rng.normal(0, 0.06)) * (surface.w - surface.w[0])
        _channel(surface, 1, start - 2, end + 2, rng.uniform(0.05, 0.95) * length_u + tilt, Negative.DRAIN, rng)


def ditches(terrain: Terrain, rng: np.random.Generator) -> None:
    """Lined ditches along the berms' inner corners, or one across a planar slope."""
    surface = terrain.surface
    length_u, length_w = surface.extent
    places = [bench.inner for bench in terrain.benches if rng.random() < 0.8]
    if not terrain.benches:
        places = [rng.uniform(0.2, 0.95) * length_w]
    for place in places:
        start = -2.0 if rng.random() < 0.7 else rng.uniform(0, 0.5) * length_u
        end = length_u + 2 if rng.random() < 0.7 else rng.uniform(0.5, 1.0) * length_u
        line = (place - rng.uniform(0.35, 0.7)) + terrain.shift + wander(surface, 0, 15.0, 0.05, rng)
        _channel(surface, 0, start, end, line, Negative.DITCH, rng)


def _channel(
    surface: Surface, axis: int, start: float, end: float, line: Float32, kind: Negative, rng: np.random.Generator
) -> None:
    """A lined channel: a trapezoid with kerbs, its bed smooth, silt or debris in parts of it."""
    half, depth = rng.uniform(0.15, 0.5), rng.uniform(0.15, 0.55)
    wall, kerb_width, kerb = rng.uniform(0.03, 0.25), rng.uniform(0.08, 0.2), rng.choice((0.0, rng.uniform(0.03, 0.15)))
    strip = band(surface, axis, start, end, line, half + wall + kerb_width + 0.3)
    if strip is None:
        return
    base = strip.mean_height(half + kerb_width, 0.6)
    distance = np.abs(strip.across)
    bed = ramp(distance - np.float32(half), wall)
    silt = np.clip(rng.uniform(-1.2, 0.8) + smooth_line(strip.stations, surface.step, 6.0, rng), 0.0, 0.9)
    rough = 0.3 * surface.texture(surface.bumps, strip.rows, strip.columns) * strip.line(silt)
    profile = -np.float32(depth) * bed * (1.0 - strip.line(silt) * (1.0 + 0.3 * rough)) + np.float32(kerb) * (
        (distance > half + wall) & (distance <= half + wall + kerb_width)
    )
    inside = ramp(distance - np.float32(half + wall + kerb_width), 0.1)
    strip.build(profile, inside, base)
    strip.mark(inside > 0.5, kind)


def lattice(terrain: Terrain, rng: np.random.Generator) -> list[Cell]:
    """Concrete lattice beams every 2.5 to 4 m, 0.3 to 0.6 m wide, 0.1 to 0.4 m proud, on one or more faces.

    Returns:
        The cells between the beams.
    """
    surface = terrain.surface
    spacing_u, spacing_w = rng.uniform(2.5, 4.0, 2)
    half, proud = rng.uniform(0.15, 0.30), rng.uniform(0.1, 0.4)
    turn = math.pi / 4 if rng.random() < 0.3 else 0.0
    worn, settled = rng.uniform(0.04, 0.1), rng.uniform(0.0, 0.04)
    cells: list[Cell] = []
    chosen = [face for face in terrain.faces if rng.random() < 0.7] or [terrain.faces[0]]
    from_u, to_u = 0.0, surface.extent[0]
    if rng.random() < 0.4:
        from_u, to_u = np.sort(rng.uniform(0, surface.extent[0], 2))
    for low, high in chosen:
        low, high = low + 0.5, high - 0.5
        if high - low < 3.0 or to_u - from_u < 5.0:
            continue
        rows, columns = surface.window(from_u, low, to_u, high)
        u, w = surface.nodes(rows, columns)
        c, s = np.float32(math.cos(turn)), np.float32(math.sin(turn))
        p, q = u * c + w * s, w * c - u * s
        near_p = np.abs((p + np.float32(0.5 * spacing_u)) % np.float32(spacing_u) - np.float32(0.5 * spacing_u))
        near_q = np.abs((q + np.float32(0.5 * spacing_w)) % np.float32(spacing_w) - np.float32(0.5 * spacing_w))
        border = np.minimum(w - np.float32(low), np.float32(high) - w)
        beam = ramp(np.minimum(np.minimum(near_p, near_q), border) - np.float32(half), worn)
        height = surface.height[rows, columns]
        # The fill of the cells lies unevenly, the beams' tops are even.
        fill = np.float32(settled) * surface.texture(surface.folds, rows, columns)
        top = uniform_filter(height, max(3, round(1.5 / surface.step)), mode="nearest") + np.float32(proud)
        height += fill * (1 - beam) + beam * (top - height)
        surface.mark(rows, columns, beam > 0.5, Negative.BEAM)
        cells += _cells((from_u, low, to_u, high), (spacing_u, spacing_w), half, turn)
    return cells


def _cells(
    area: tuple[float, float, float, float], spacing: tuple[float, float], half: float, turn: float
) -> list[Cell]:
    """The whole cells of a lattice within ``area`` (u and w from, u and w to)."""
    c, s = math.cos(turn), math.sin(turn)
    corners = np.array([(area[i], area[j]) for i in (0, 2) for j in (1, 3)])
    p, q = corners @ (c, s), corners @ (-s, c)
    centre_p = (np.arange(math.floor(p.min() / spacing[0]), math.ceil(p.max() / spacing[0])) + 0.5) * spacing[0]
    centre_q = (np.arange(math.floor(q.min() / spacing[1]), math.ceil(q.max() / spacing[1])) + 0.5) * spacing[1]
    grid_p, grid_q = (x.ravel() for x in np.meshgrid(centre_p, centre_q))
    u, w = grid_p * c - grid_q * s, grid_p * s + grid_q * c
    half_u, half_w = spacing[0] / 2 - half, spacing[1] / 2 - half
    reach = max(half_u, half_w) * (1.4 if turn else 1.0)
    inside = (u > area[0] + reach) & (u < area[2] - reach) & (w > area[1] + reach) & (w < area[3] - reach)
    return [Cell(float(a), float(b), half_u, half_w, turn) for a, b in zip(u[inside], w[inside])]


def stairs(terrain: Terrain, rng: np.random.Generator) -> None:
    """A maintenance stairway up the slope, 0.8 to 1.2 m wide."""
    surface = terrain.surface
    half, riser = rng.uniform(0.4, 0.6), rng.uniform(0.16, 0.2)
    period = riser / max(0.35, math.sin(terrain.dip))
    line = rng.uniform(0.05, 0.95) * surface.extent[0]
    strip = band(surface, 1, -2.0, surface.extent[1] + 2, line, half + 0.4)
    if strip is None:
        return
    base = strip.mean_height(half, 0.8) + np.float32(rng.uniform(0.0, 0.15))
    tread = np.float32(riser * math.cos(terrain.dip)) * (0.5 - (strip.along / np.float32(period)) % 1.0)
    inside = ramp(np.abs(strip.across) - np.float32(half), 0.08)
    strip.build(np.broadcast_to(tread, strip.across.shape), inside, base)
    strip.mark(inside > 0.5, Negative.STAIRS)


def pipes(terrain: Terrain, rng: np.random.Generator) -> None:
    """One to three pipes on the ground, down or across the slope, 0.3 to 0.7 m thick."""
    surface = terrain.surface
    for _ in range(rng.integers(1, 4)):
        axis, radius = int(rng.integers(0, 2)), rng.uniform(0.15, 0.35)
        line = rng.uniform(0.05, 0.95) * surface.extent[1 - axis] + wander(surface, axis, 20.0, 0.2, rng)
        strip = band(surface, axis, -2.0, surface.extent[axis] + 2, line, radius + 0.2)
        if strip is None:
            continue
        base = strip.mean_height(radius, 1.5)
        round_top = np.sqrt(np.maximum(np.float32(radius) ** 2 - strip.across**2, 0.0)) + np.float32(0.4 * radius)
        inside = (np.abs(strip.across) < radius).astype(np.float32)
        strip.build(round_top, inside, base)
        strip.mark(inside > 0, Negative.PIPE)
