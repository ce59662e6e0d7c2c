"""What comes back of a pulse on its way through leaves and grass to the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float
from ..sources import GROUND, LEAVES, TURF
from ..trace import Rays
from .layers import Crossing, Landscape
from .vegetation import ENVELOPE, Canopy

MARCH = 0.15
"""Step along a ray within the canopy, m."""
SEPARATION = 0.25
"""Echoes closer than this along the beam cannot be distinguished; the first stands for them, m."""
CLOSED_LITTER = 0.03
"""Thickness from which on litter leaves hardly a gap, m."""
MIN_ENERGY = 0.2
"""Share of the pulse's energy below which nothing more is detected."""


@dataclass(frozen=True)
class Echoes:
    """Echoes sorted by ray, then distance: index of the ray, distance (m), share of the energy, what it is of."""

    ray: NDArray[np.int64]
    distance: Float
    energy: Float
    source: NDArray[np.uint8]


NOTHING = Echoes(np.empty(0, np.int64), np.empty(0), np.empty(0), np.empty(0, np.uint8))


def echoes(
    landscape: Landscape, rays: Rays, start: Float, ground: Float, maximum: int, rng: np.random.Generator
) -> Echoes:
    """The echoes of each ray, of which ``ground`` (n,) is the distance to the ground.

    At ``start`` (n,) the rays are still above all leaves. At most ``maximum`` echoes a ray.

    Within leaves, the optical depth to the next echo is exponentially distributed (Beer-Lambert); each echo takes
    a random part of the energy, and a pulse with less than MIN_ENERGY left ends there. Where layers cover the ground,
    the rays are above them and all leaves at ``start``.
    """
    scene, cover = landscape.scene, landscape.cover
    if cover is not None and cover.layers:
        crossing = Crossing(landscape, rays, start, ground, rng)
        plants, left, last, count = _through_layers(crossing, maximum, rng)
    else:
        plants, left, last, count = _through_leaves(landscape, rays, start, ground, maximum, rng)
    reached = np.flatnonzero((left >= MIN_ENERGY) & (ground - last >= SEPARATION) & (count < maximum))
    place = rays.take(reached).at(ground[reached])
    grass = scene.grass(place[0], place[1])
    caught = rng.random(len(reached)) < np.minimum(grass / 0.06, 0.8)
    height = np.where(caught, grass * rng.beta(1.5, 2.0, len(reached)), 0.0)
    if cover is not None and cover.litter is not None:
        # Dead leaves hide what is beneath sooner than turf does, and most pulses end near their top.
        litter = cover.litter(place[0], place[1])
        on_top = rng.random(len(reached)) < np.minimum(litter / CLOSED_LITTER, 0.95)
        height = np.where(on_top, litter * rng.beta(3.0, 1.5, len(reached)), height)
        caught |= on_top
    final = ground[reached] + height / rays.direction[2, reached]
    all_rays = np.concatenate([plants.ray, reached])
    all_distances = np.concatenate([plants.distance, final])
    energy = np.concatenate([plants.energy, left[reached]])
    source = np.concatenate([plants.source, np.where(caught, TURF, GROUND).astype(np.uint8)])
    order = np.lexsort((all_distances, all_rays))
    return Echoes(all_rays[order], all_distances[order], energy[order], source[order])


def _through_layers(
    crossing: Crossing, maximum: int, rng: np.random.Generator
) -> tuple[Echoes, Float, Float, NDArray[np.int64]]:
    """Echoes of all plants, not sorted; energy left, last echo's distance and count of every ray."""
    n = len(crossing.rays)
    left, last, count = np.ones(n), np.full(n, -np.inf), np.zeros(n, dtype=np.int64)
    ray, threshold = np.arange(n), rng.standard_exponential(n)
    found: list[tuple[NDArray[np.intp], Float, Float, NDArray[np.uint8]]] = []
    while len(ray):
        hits = crossing.hits(ray, threshold, rng)
        taken = rng.uniform(0.35, 1.0, len(hits.ray)) * left[hits.ray]
        left[hits.ray] -= taken
        apart = hits.distance - last[hits.ray] >= SEPARATION
        struck = hits.ray[apart]
        found.append((struck, hits.distance[apart], taken[apart], hits.source[apart]))
        last[struck] = hits.distance[apart]
        count[struck] += 1
        going = (left[hits.ray] >= MIN_ENERGY) & (count[hits.ray] < maximum)
        ray = hits.ray[going]
        threshold = hits.optical[going] + rng.standard_exponential(len(ray))
    if not found:
        return NOTHING, left, last, count
    return Echoes(*(np.concatenate(parts) for parts in zip(*found, strict=True))), left, last, count


def _through_leaves(
    landscape: Landscape, rays: Rays, start: Float, ground: Float, maximum: int, rng: np.random.Generator
) -> tuple[Echoes, Float, Float, NDArray[np.int64]]:
    """Echoes of the leaves, not sorted; energy left, last echo's distance and count of every ray."""
    scene, canopy, n = landscape.scene, landscape.canopy, len(rays)
    left, last, count = np.ones(n), np.full(n, -np.inf), np.zeros(n, dtype=np.int64)
    found: list[tuple[NDArray[np.int64], Float, Float]] = []
    if canopy.covered.any():
        enter = _enter(canopy, rays, start, ground)
        # What follows is of the rays under way, ``active``; a ray that has ended waits with threshold inf.
        active = np.flatnonzero(enter < ground)
        t = (enter + MARCH * (rng.random(n) - 1.0))[active]
        threshold = rng.standard_exponential(n)[active]
        under_way, end, depth = rays.take(active), ground[active] - 0.05, np.zeros(len(active))
        while len(active):
            depth += canopy.density_at(*under_way.at(t)) * MARCH
            hit = np.flatnonzero(depth >= threshold)
            if len(hit):
                at = t[hit] + MARCH * (rng.random(len(hit)) - 0.5)
                u, v, z = under_way.take(hit).at(at)
                # Voxels are coarser than the gap under the leaves, above all on a steep face.
                clear = z - scene.height(u, v) >= canopy.clearance
                hit, at = hit[clear], at[clear]
                struck = active[hit]
                taken = rng.uniform(0.35, 1.0, len(struck)) * left[struck]
                left[struck] -= taken
                apart = at - last[struck] >= SEPARATION
                found.append((struck[apart], at[apart], taken[apart]))
                last[struck[apart]] = at[apart]
                count[struck[apart]] += 1
                ended = (left[struck] < MIN_ENERGY) | (count[struck] >= maximum)
                following = depth[hit] + rng.standard_exponential(len(hit))
                threshold[hit] = np.where(ended, np.inf, following)
            t += MARCH
            threshold[t >= end] = np.inf
            going = np.isfinite(threshold)
            if np.count_nonzero(going) < 0.8 * len(active):
                active, t, threshold, end, depth = active[going], t[going], threshold[going], end[going], depth[going]
                under_way = under_way.take(going)
    if not found:
        return NOTHING, left, last, count
    ray, distance, energy = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return Echoes(ray, distance, energy, np.full(len(ray), LEAVES, np.uint8)), left, last, count


def _enter(canopy: Canopy, rays: Rays, start: Float, ground: Float) -> Float:
    """Distance (n,) at which each ray may first touch leaves; at least ``ground`` where it touches none.

    The envelope holds for ENVELOPE m around, so a ray is free until it has gone so far sideways or has sunk to it.
    """
    enter = start.copy()
    active = np.flatnonzero(start < ground)
    while len(active):
        origin, direction, t = rays.origin[:, active], rays.direction[:, active], enter[active]
        place = origin + direction * t
        above = place[2] - canopy.top_at(place[0], place[1])
        sideways = np.maximum(np.abs(direction[0]), np.abs(direction[1]))
        step = np.minimum(above / -direction[2], ENVELOPE / np.maximum(sideways, 1e-6))
        t = t + np.maximum(step, 0.0) + 1e-3
        free = above > 0
        enter[active[free]] = t[free]
        active = active[free & (t < ground[active])]
    return enter
