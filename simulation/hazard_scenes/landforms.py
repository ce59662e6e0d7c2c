"""Natural things on a slope that a screening must not take for hazards: rills, gullies, steps, boulders, spoil,
stumps.
"""

from __future__ import annotations

import math

import numpy as np

from ...engine.core.arrays import Float32
from .bands import band, ramp, wander
from .negatives import Negative
from .surface import Surface
from .terrain import Terrain

WORTH = 0.02
"""Nodes that a landform changes by less (m) are not marked."""


def rills(terrain: Terrain, rng: np.random.Generator) -> None:
    """Groups of rills down the slope, up to 0.3 m wide and deep."""
    surface = terrain.surface
    length_u, length_w = surface.extent
    for _ in range(rng.integers(1, 4)):
        group, spread, top = rng.uniform(0, length_u), rng.uniform(1.0, 5.0), rng.uniform(0.3, 1.0) * length_w
        for _ in range(rng.integers(3, 12)):
            end = top + rng.normal(0, 1.5)
            length = rng.uniform(0.2, 0.8) * length_w
            line = group + rng.normal(0, spread) + wander(surface, 1, 3.0, 0.15, rng)
            _cut(surface, line, end - length, end, rng.uniform(0.05, 0.15), rng.uniform(0.05, 0.3), 1.0, Negative.RILL)


def gullies(terrain: Terrain, rng: np.random.Generator) -> None:
    """One or two gullies that branch up the slope."""
    surface = terrain.surface
    length_u, length_w = surface.extent
    for _ in range(rng.integers(1, 3)):
        head, foot = rng.uniform(0.6, 1.0) * length_w, rng.uniform(-0.1, 0.2) * length_w
        half, depth, shape = rng.uniform(0.3, 0.9), rng.uniform(0.2, 0.7), rng.uniform(1.0, 2.0)
        main = rng.uniform(0.1, 0.9) * length_u + wander(surface, 1, 8.0, 0.6, rng)
        _cut(surface, main, foot, head, half, depth, shape, Negative.GULLY)
        for _ in range(rng.integers(2, 7)):
            joint = rng.uniform(foot, head - 0.1 * length_w)
            share = rng.uniform(0.3, 0.7) * max(0.3, (head - joint) / (head - foot))
            above = np.maximum(surface.w - np.float32(joint), 0.0)
            apart = rng.choice((-1, 1)) * rng.uniform(2.0, 6.0)
            branch = main + np.float32(apart) * (1.0 - np.exp(-above / np.float32(abs(apart))))
            branch += wander(surface, 1, 4.0, 0.25, rng) * np.minimum(above, 1.0)
            tip = joint + rng.uniform(0.3, 0.9) * (head - joint)
            _cut(surface, branch, joint, tip, half * share, depth * share, shape, Negative.GULLY)


def _cut(
    surface: Surface,
    line: Float32,
    foot: float,
    head: float,
    half: float,
    depth: float,
    shape: float,
    kind: Negative,
) -> None:
    """Erode a channel that narrows and shallows towards its head: V (shape 1) to U (shape 2)."""
    strip = band(surface, 1, foot, head, line, 1.3 * half + 0.1)
    if strip is None:
        return
    upward = np.clip((strip.along - np.float32(foot)) / np.float32(max(head - foot, 0.1)), 0.0, 1.0)
    size = np.sqrt(1.0 - upward) * np.clip((strip.along - np.float32(foot)) + 0.2, 0.0, 1.0)
    rough = 1.0 + 0.2 * surface.texture(surface.bumps, strip.rows, strip.columns)
    r = np.abs(strip.across) / (np.float32(half) * np.maximum(size * rough, 0.15))
    cut = np.float32(depth) * size * np.maximum(1.0 - r ** np.float32(shape), 0.0)
    strip.height[...] -= cut
    strip.mark(cut > WORTH, kind)


def steps(terrain: Terrain, rng: np.random.Generator) -> None:
    """One to four ledges along the slope, 0.1 to 0.4 m high, that run out into the ground above them."""
    surface = terrain.surface
    length_u, length_w = surface.extent
    for _ in range(rng.integers(1, 5)):
        start = rng.uniform(-5, length_u)
        end = start + rng.uniform(4.0, 20.0)
        high, out, edge = rng.uniform(0.1, 0.4), rng.uniform(1.5, 5.0), rng.uniform(0.08, 0.3)
        line = rng.uniform(0.05, 0.95) * length_w + wander(surface, 0, 6.0, 0.5, rng)
        strip = band(surface, 0, start, end, line, 2.5 * out)
        if strip is None:
            continue
        ends = np.clip(np.minimum(strip.along - np.float32(start), np.float32(end) - strip.along) / 2.0, 0.0, 1.0)
        above = strip.across
        rise = np.float32(high) * ends * ramp(-above - np.float32(edge), edge) * np.exp(-np.maximum(above, 0) / out)
        strip.height[...] += rise
        strip.mark((np.abs(above) < 2 * edge + 0.15) & (ends > 0.2), Negative.STEP)


def terracettes(terrain: Terrain, rng: np.random.Generator) -> None:
    """Treads that cattle and creep leave across a natural slope, 0.4 to 1 m apart, in patches."""
    surface = terrain.surface
    apart, high = rng.uniform(0.4, 1.0), rng.uniform(0.05, 0.15)
    line = wander(surface, 0, 10.0, 0.4, rng)
    place = (surface.w[None, :] + line[:, None]) * np.float32(1 / apart)
    everything = slice(None)
    patch = np.clip(surface.texture(surface.folds, everything, everything), 0.0, 1.0)
    surface.height += np.float32(high) * (0.5 - place % 1.0) * patch
    surface.mark(everything, everything, patch > 0.3, Negative.TERRACETTE)


def facets(terrain: Terrain, rng: np.random.Generator) -> None:
    """Jointed rock: saw teeth in two or three directions, in patches."""
    surface = terrain.surface
    everything = slice(None)
    u, w = surface.nodes(everything, everything)
    rock = np.zeros(surface.shape, dtype=np.float32)
    for _ in range(rng.integers(2, 4)):
        angle, apart, high = rng.uniform(0, math.pi), rng.uniform(1.0, 4.0), rng.uniform(0.05, 0.25)
        place = (u * np.float32(math.cos(angle)) + w * np.float32(math.sin(angle))) * np.float32(1 / apart)
        place += 0.15 * surface.texture(surface.folds, everything, everything, int(rng.integers(0, 512)))
        rock += np.float32(high) * (0.5 - place % 1.0)
    patch = np.clip(1.5 * surface.texture(surface.folds, everything, everything, 77) + 0.3, 0.0, 1.0)
    surface.height += rock * patch
    surface.mark(everything, everything, patch > 0.3, Negative.FACET)


def boulders(terrain: Terrain, rng: np.random.Generator) -> None:
    """Fallen blocks of 0.3 to 1.5 m, alone and in groups, more of them near the toe and on berms."""
    surface = terrain.surface
    length_u, length_w = surface.extent
    shelves = [0.5 * (bench.outer + bench.inner) for bench in terrain.benches] + [0.05 * length_w]
    for _ in range(rng.integers(1, 7)):
        centre_u = rng.uniform(0, length_u)
        centre_w = rng.choice(shelves) if rng.random() < 0.5 else rng.uniform(0, length_w)
        for _ in range(rng.integers(1, 9)):
            size = 0.3 * (1.5 / 0.3) ** rng.beta(1.0, 2.5)
            u, w = centre_u + rng.normal(0, 1.5), centre_w + rng.normal(0, 0.8)
            high, turn = size * rng.uniform(0.3, 0.7), rng.uniform(0, math.pi)
            _mound(
                surface, (u, w), (size / 2, size / 2 * rng.uniform(0.6, 1.0)), high, turn, 4.0, 0.5, Negative.BOULDER
            )


def spoil(terrain: Terrain, rng: np.random.Generator) -> None:
    """One to three heaps of spoil or talus, 1.5 to 5 m across and 0.3 to 1.2 m high, at the toe, on berms or on a
    face.
    """
    surface = terrain.surface
    length_u, length_w = surface.extent
    shelves = [0.5 * (bench.outer + bench.inner) for bench in terrain.benches] + [0.03 * length_w] * 2
    for _ in range(rng.integers(1, 4)):
        u = rng.uniform(0, length_u)
        w = rng.choice(shelves) if rng.random() < 0.75 else rng.uniform(0, length_w)
        half = rng.uniform(0.75, 2.5)
        high = half * rng.uniform(0.35, 0.6) * math.cos(terrain.dip * 0.5)
        _mound(surface, (u, w), (half, half * rng.uniform(0.6, 1.2)), high, 0.0, 1.0, 1.0, Negative.SPOIL, loose=0.08)


def stumps(terrain: Terrain, rng: np.random.Generator) -> None:
    """Five to forty tree stumps, 0.2 to 0.6 m thick, up to 0.4 m high, with flared roots."""
    surface = terrain.surface
    places = rng.uniform(0, 1, (rng.integers(5, 40), 2)) * surface.extent
    for u, w in places:
        half = rng.uniform(0.1, 0.3)
        _mound(surface, (u, w), (1.3 * half, 1.3 * half), rng.uniform(0.1, 0.4), 0.0, 2.0, 0.4, Negative.STUMP)


def _mound(
    surface: Surface,
    place: tuple[float, float],
    half: tuple[float, float],
    high: float,
    turn: float,
    exponent: float,
    fall: float,
    kind: Negative,
    loose: float = 0.0,
) -> None:
    """Something that lies on the ground: height (1 - r^exponent)^fall, rough by ``loose`` m."""
    reach = 1.2 * max(half)
    rows, columns = surface.window(place[0] - reach, place[1] - reach, place[0] + reach, place[1] + reach)
    u, w = surface.nodes(rows, columns)
    du, dw = u - np.float32(place[0]), w - np.float32(place[1])
    if not (du.size and dw.size):
        return
    c, s = np.float32(math.cos(turn)), np.float32(math.sin(turn))
    x, y = (du * c + dw * s) / np.float32(half[0]), (dw * c - du * s) / np.float32(half[1])
    bumps = surface.texture(surface.bumps, rows, columns, int(1000 * abs(place[0])) % 512)
    r = np.sqrt(x * x + y * y) * (1.0 + 0.12 * bumps)
    body = np.maximum(1.0 - r ** np.float32(exponent), 0.0) ** np.float32(fall)
    rise = np.float32(high) * body
    if loose:
        rise += np.float32(loose) * bumps * np.minimum(3.0 * body, 1.0)
    surface.height[rows, columns] += rise
    surface.mark(rows, columns, rise > WORTH, kind)
