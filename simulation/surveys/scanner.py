"""A UAV survey of a scene: pulses, echoes, range noise, colours."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float
from ...engine.core.progress import Progress
from ..sources import LEAVES, MULTIPATH, STRAY
from ..trace import Steepness, approach, first_hit
from .appearance import colours, intensities
from .layers import Landscape
from .pattern import Flight, Pulses, WaypointFlight, emit, flown
from .returns import Echoes, echoes
from .scene import Scene
from .stray import disturbed

Area = tuple[float, float, float, float]
CHUNK = 1 << 16
TURF_GROUND = 0.03
"""Echoes from grass up to this height above the ground, m, count as ground in the truth: nobody can distinguish
them."""


@dataclass(frozen=True)
class SurveyCloud:
    """One epoch: ``xyz`` (n, 3) projected coordinates in metres and what was recorded or is known of each point.

    ``truth_ground`` is 1 for echoes of the ground and of grass up to TURF_GROUND, else 0. ``gps_time`` is seconds
    since the flight's start; ``scan_angle`` is in degrees.
    """

    xyz: Float
    rgb: NDArray[np.uint8]
    intensity: NDArray[np.uint16]
    return_number: NDArray[np.uint8]
    number_of_returns: NDArray[np.uint8]
    gps_time: Float
    scan_angle: NDArray[np.float32]
    line: NDArray[np.uint16]
    truth_ground: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.xyz)


def scan(
    landscape: Landscape,
    flight: Flight | WaypointFlight,
    area: Area,
    pulses: int,
    range_noise: float,
    seed: tuple[int, ...],
    progress: Progress | None = None,
    workers: int = 2,
) -> SurveyCloud:
    """Scan ``area`` (u and v from, u and v to) of a landscape with ``pulses`` pulses spread evenly over the flight.

    The result depends on ``seed`` alone, not on ``workers``. ``range_noise`` is the standard deviation along the
    beam, m.
    """
    progress = progress or Progress()
    starts = range(0, pulses, CHUNK)
    ceiling = landscape.scene.lift + 0.2
    interval = flight.seconds / pulses

    def one(number: int) -> SurveyCloud:
        index = np.arange(starts[number], min(starts[number] + CHUNK, pulses), dtype=np.float64)
        rng = np.random.default_rng([*seed, number])
        seconds: Float = (index + 0.5) * interval
        return _scan_chunk(landscape, flight, area, ceiling, seconds, range_noise, rng)

    parts: list[SurveyCloud] = []
    with ThreadPoolExecutor(workers) as pool:
        for part in _in_order(pool, one, len(starts), workers):
            parts.append(part)
            progress.update(len(parts) / len(starts), "scanning")
    return SurveyCloud(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(SurveyCloud)))


def survey(
    landscape: Landscape,
    plan: Flight,
    area: Area,
    pulses: int,
    range_noise: float,
    seed: tuple[int, int],
    progress: Progress | None = None,
) -> SurveyCloud:
    """One epoch as it is flown, see ``scan``: ``seed`` is the scene's and 11 plus the epoch's number."""
    flight = flown(plan, np.random.default_rng([*seed, 0]))
    return scan(landscape, flight, area, pulses, range_noise, (*seed, 1), progress)


def _in_order(
    pool: ThreadPoolExecutor, task: Callable[[int], SurveyCloud], count: int, ahead: int
) -> Iterator[SurveyCloud]:
    """Results of ``task(0..count-1)`` in order, with few of them in flight, so that a cancel takes effect soon."""
    waiting = [pool.submit(task, number) for number in range(min(ahead, count))]
    following = len(waiting)
    while waiting:
        result = waiting.pop(0).result()
        if following < count:
            waiting.append(pool.submit(task, following))
            following += 1
        yield result


def _scan_chunk(
    landscape: Landscape,
    flight: Flight | WaypointFlight,
    area: Area,
    ceiling: float,
    seconds: Float,
    noise: float,
    rng: np.random.Generator,
) -> SurveyCloud:
    """Points of the pulses sent at ``seconds``; the ground lies lower than ``ceiling`` m above the plain profile."""
    scene, canopy, cover = landscape.scene, landscape.canopy, landscape.cover
    sent = emit(flight, seconds)
    rays, reach = sent.rays, 12 * flight.scanner.altitude
    low, high = scene.profile.slopes
    # The plain profile first, a table in v only: most pulses of a small area fall outside it.
    rough = Steepness(0.05, low - 0.05, high + 0.05)
    leaves = max(canopy.depth, ceiling)
    if cover is not None:
        leaves = max(canopy.depth if canopy.covered.any() else 0.0, ceiling + cover.tallest)
    start = approach(lambda u, v: scene.profile(v) + leaves, rays, np.zeros(len(rays)), rough, 0.5, reach)
    near = approach(lambda u, v: scene.profile(v) + ceiling, rays, start, rough, 0.3, reach)
    place = rays.at(near)
    wide = 6.0 + 2.0 * (high > 1.0)
    useful = (
        (place[0] > area[0] - wide)
        & (place[0] < area[2] + wide)
        & (place[1] > area[1] - wide)
        & (place[1] < area[3] + wide)
        & (near < reach)
    )
    chosen = np.flatnonzero(useful)
    rays = rays.take(chosen)
    steep = Steepness(0.3, low - 0.3, high + 0.3)
    ground = first_hit(scene.height, rays, near[chosen], steep, reach)
    landed = np.isfinite(ground)
    chosen, rays, ground = chosen[landed], rays.take(landed), ground[landed]
    found = echoes(landscape, rays, start[chosen], ground, flight.scanner.maximum_returns, rng)
    if cover is not None and (cover.multipath or cover.stray):
        found = disturbed(found, rays, ground, cover.multipath, cover.stray, rng)
    kept = Pulses(rays, sent.line[chosen], seconds[chosen], sent.scan_angle[chosen])
    return _points(scene, area, kept, found, noise, rng)


def _points(
    scene: Scene, area: Area, pulses: Pulses, found: Echoes, noise: float, rng: np.random.Generator
) -> SurveyCloud:
    """Records of the echoes that fall into the area."""
    rays = pulses.rays
    count = np.bincount(found.ray, minlength=len(rays))
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    number = np.arange(len(found.ray)) - first[found.ray] + 1
    direction = rays.direction[:, found.ray]
    true = rays.origin[:, found.ray] + direction * found.distance
    keep = (true[0] >= area[0]) & (true[0] <= area[2]) & (true[1] >= area[1]) & (true[1] <= area[3])
    true, direction, ray = true[:, keep], direction[:, keep], found.ray[keep]
    source, energy, number = found.source[keep], found.energy[keep], number[keep]
    above = true[2] - scene.height(true[0], true[1])
    is_ground = ~np.isin(source, (LEAVES, MULTIPATH, STRAY)) & (above <= TURF_GROUND)
    measured = true + direction * (noise * rng.standard_normal(true.shape[1]))
    rgb, incidence = colours(scene, true, direction, source, above, rng)
    return SurveyCloud(
        xyz=scene.frame.to_world(np.ascontiguousarray(measured.T)),
        rgb=rgb,
        intensity=intensities(source, energy, incidence, rng),
        return_number=number.astype(np.uint8),
        number_of_returns=count[ray].astype(np.uint8),
        gps_time=pulses.seconds[ray],
        scan_angle=pulses.scan_angle[ray].astype(np.float32),
        line=(pulses.line[ray] + 1).astype(np.uint16),
        truth_ground=is_ground.astype(np.uint8),
    )
