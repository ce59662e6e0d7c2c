"""Zones of changes near their level of detection: what share of them is real, and whether a confidence says so.

Ground points of two epochs, registered but for a known standard error, on rolling slopes: scatter from point to point
and errors that near points share. Changes are 0.8 to 2 times the level where they lie; each map with changes has a
counterpart without. Only change and zones are measured, not the ground or the registration.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...engine.change.difference import difference
from ...engine.change.result import Change
from ...engine.core.arrays import Float
from ...engine.zones.change_zones import change_zones
from ...interface.parameters import ChangeParameters, ZoneParameters
from ...simulation.fields import HeightField, power_law_field
from .table import Row, counted, say

MAPS = range(9101, 9261)
SIDE, DENSITY = 40.0, (10.0, 60.0)
"""Of a map, m, and its points a m², the same in both epochs."""
CHANGES, RATIO, AREA = 8, (0.8, 2.0), (1.0, 20.0)
"""On a map: number, height in levels of detection, and area, m²."""
SCATTER, REGISTRATION = 0.02, 0.003
COHERENT = ((0.0, 1.0), (0.15, 1.0), (0.15, 4.0), (0.3, 2.0))
"""Errors that near points of an epoch share: standard deviation over the scatter of a point, and length, m."""
SURE, RIGHT = 0.95, (0.93, 0.97)
CLASSES = (0.0, 0.5, 0.8, *RIGHT, 0.99, 1.0)
CHANCE_SD = 2.0
"""Standard errors by which a share of few groups may by chance lie below their mean confidence."""
RATIOS = (0.8, 1.2, 1.6, 2.0)


@dataclass(frozen=True)
class Patch:
    """A change on a disc at (x, y) of ``radius`` m, flat but for its rim or a bulge, ``height`` m at its middle."""

    x: float
    y: float
    radius: float
    height: float
    flat: bool

    def dz(self, x: Float, y: Float) -> Float:
        away = np.hypot(x - self.x, y - self.y) / self.radius
        rim = 0.8 if self.flat else 0.0
        inner = np.clip((away - rim) / (1.0 - rim), 0.0, 1.0)
        return self.height * np.cos(0.5 * np.pi * inner) ** 2 * (away < 1.0)


@dataclass(frozen=True)
class MapOutcome:
    """Of one map: confidence of every group that is large enough and whether it is right; whether those that come out
    as zones at the defaults are; and of each change its height in levels and whether a zone of its sign touches it.
    """

    confidence: tuple[float, ...]
    right: tuple[bool, ...]
    reported: tuple[bool, ...]
    changes: tuple[tuple[float, bool], ...]


def measured(seed: int) -> tuple[MapOutcome, MapOutcome]:
    """Map ``seed`` without change, and drawn anew with changes that are set by the levels of the first."""
    rng = np.random.default_rng([seed, 32])
    density = math.exp(rng.uniform(*np.log(DENSITY)))
    size, length = COHERENT[seed % len(COHERENT)]
    nodes = round(SIDE / 0.25) + 1
    slope = math.tan(math.radians(rng.uniform(10.0, 45.0)))
    relief = HeightField(0.0, 0.0, 0.25, 0.3 * power_law_field((nodes, nodes), 0.25, 3.0, 2.0, 30.0, rng))
    uneven = np.exp(0.3 * _smooth((nodes, nodes), 16.0, rng))

    def epoch(changes: Sequence[Patch] = ()) -> Float:
        x, y = rng.uniform(0.0, SIDE, (2, rng.poisson(density * SIDE**2)))
        shared = HeightField(0.0, 0.0, 0.25, _smooth((nodes, nodes), length / 0.25, rng))
        scatter = SCATTER * HeightField(0.0, 0.0, 0.25, uneven)(x, y)
        z = slope * y + relief(x, y) + scatter * (rng.standard_normal(len(x)) + size * shared(x, y))
        for change in changes:
            z += change.dz(x, y)
        return np.column_stack([x, y, z])

    def compared(changes: Sequence[Patch] = ()) -> Change:
        later = epoch(changes)
        later[:, 2] += REGISTRATION * rng.standard_normal()
        return difference(epoch(), later, ChangeParameters(), registration_error=REGISTRATION)

    still = compared()
    changes = _drawn(still, rng)
    return outcome(still, ()), outcome(compared(changes), changes)


def _smooth(shape: tuple[int, int], width: float, rng: np.random.Generator) -> Float:
    """A random field of mean 0 and standard deviation 1, alike over ``width`` nodes."""
    field: Float = ndimage.gaussian_filter(rng.standard_normal(shape), width / 2, mode="wrap")
    return (field - field.mean()) / field.std()


def _drawn(still: Change, rng: np.random.Generator) -> tuple[Patch, ...]:
    """Changes apart from each other, as high as the level around them times ``RATIO``."""
    found: list[Patch] = []
    while len(found) < CHANGES:
        radius = math.sqrt(math.exp(rng.uniform(*np.log(AREA))) / math.pi)
        x, y = rng.uniform(radius + 1.0, SIDE - radius - 1.0, 2)
        if any(math.hypot(x - o.x, y - o.y) < radius + o.radius + 2.0 for o in found):
            continue
        east, north = _centres(still)
        level = float(np.nanmedian(still.level[np.hypot(east - x, north - y) < max(radius, 1.0)]))
        height = level * rng.uniform(*RATIO) * float(rng.choice((-1.0, 1.0)))
        found.append(Patch(float(x), float(y), radius, height, bool(rng.random() < 0.5)))
    return tuple(found)


def _centres(change: Change) -> tuple[Float, Float]:
    grid = change.grid
    x = grid.west + (np.arange(grid.columns) + 0.5) * grid.cell
    y = grid.north - (np.arange(grid.rows) + 0.5) * grid.cell
    east, north = np.meshgrid(x, y)
    return east, north


def outcome(change: Change, changes: Sequence[Patch]) -> MapOutcome:
    """The zones of a map against its changes."""
    every = change_zones(change, parameters=ZoneParameters(minimum_confidence=0.0))
    zones = change_zones(change)
    east, north = _centres(change)
    truth = np.sum([c.dz(east, north) for c in changes], axis=0) if changes else np.zeros(east.shape)

    def signed(labels: NDArray[np.int32], volumes: Float) -> Float:
        return np.concatenate([[0.0], np.sign(volumes)])[labels]

    def right(labels: NDArray[np.int32], volumes: Float) -> tuple[bool, ...]:
        real = np.bincount(labels.ravel(), ((signed(labels, volumes) * truth) > 0).ravel(), minlength=len(volumes) + 1)
        return tuple((real[1:] > 0).tolist())

    sign = signed(zones.labels, zones.volumes.net)
    levels = []
    for one in changes:
        own = one.dz(east, north)
        inside = own != 0
        level = float(np.nanmedian(change.level[inside])) if np.isfinite(change.level[inside]).any() else math.inf
        levels.append((abs(one.height) / level, bool((own * sign > 0).any())))
    return MapOutcome(
        tuple(every.frame["confidence"].astype(float)),
        right(every.labels, every.volumes.net),
        right(zones.labels, zones.volumes.net),
        tuple(levels),
    )


def rows() -> list[Row]:
    """Right ones among the zones reported, in classes of confidence, maps without change that have one, and recall."""
    still, moved = [], []
    for seed in MAPS:
        one, other = measured(seed)
        still.append(one)
        moved.append(other)
        say(
            f"map {seed}: unchanged {len(one.reported)} zones; {sum(c[1] for c in other.changes)} of "
            f"{len(other.changes)} found, {len(other.reported) - sum(other.reported)} false"
        )
    return table(still, moved)


def table(still: Sequence[MapOutcome], moved: Sequence[MapOutcome]) -> list[Row]:
    """The figures of unchanged and changed maps."""
    reported = [right for one in (*still, *moved) for right in one.reported]
    share = float(np.mean(reported)) if reported else math.nan
    on_moved = [right for one in moved for right in one.reported]
    over = max(share - RIGHT[1], 0.0)
    some = sum(bool(one.reported) for one in still)
    lines = [
        Row(
            f"zones with a confidence of {100 * SURE:g} % and more that are right, {len(still)} unchanged maps and "
            f"{len(moved)} with {CHANGES} changes each",
            counted(reported),
            f"at least {100 * SURE:g} %",
            f"on the changed maps alone {sum(on_moved)} of {len(on_moved)}; {100 * over:.1f} points above "
            f"{100 * RIGHT[1]:g} %",
            share >= SURE,
        ),
        Row(
            "unchanged maps with such a zone",
            f"{some} of {len(still)}",
            "5 %",
            "what the confidence promises: noise alone makes one on at most one map in twenty",
            some <= 0.05 * len(still) + 1,
        ),
    ]
    pairs = [pair for one in (*still, *moved) for pair in zip(one.confidence, one.right, strict=True)]
    for low, high in pairwise(CLASSES):
        own = [right for p, right in pairs if low <= p < high or (high == 1.0 and p == 1.0)]
        mean = [p for p, _ in pairs if low <= p < high or (high == 1.0 and p == 1.0)]
        lines.append(_class_row(low, high, own, mean))
    every = [right for p, right in pairs if p >= SURE]
    lines.append(
        Row(
            f"groups with a confidence of {SURE:g} and more that are right, no minimum of the confidence",
            counted(every),
            f"at least {100 * SURE:g} %",
            "",
            bool(np.mean(every) >= SURE) if every else None,
        )
    )
    changes = [c for one in moved for c in one.changes]
    for low, high in pairwise(RATIOS):
        own = [found for ratio, found in changes if low <= ratio < high]
        lines.append(Row(f"changes reported, height {low:g} to {high:g} times the level", f"{sum(own)} of {len(own)}"))
    return lines


def _class_row(low: float, high: float, right: Sequence[bool], confidence: Sequence[float]) -> Row:
    """A class of confidence: what is right in it against what it promises, but for chance."""
    name = f"groups with a confidence of {low:g} to {high:g} that are right"
    if not right:
        return Row(name, "0 of 0", "their mean confidence")
    share, promised = float(np.mean(right)), float(np.mean(confidence))
    if (low, high) == RIGHT:
        target = f"{100 * low:g} to {100 * high:g} %"
        return Row(name, counted(right, 0), target, "", low <= share <= high)
    by_chance = CHANCE_SD * math.sqrt(promised * (1.0 - promised) / len(right))
    return Row(
        name,
        counted(right, 0),
        f"their mean confidence, {100 * promised:.0f} %, or more",
        f"less by chance: {100 * by_chance:.0f} points",
        share >= promised - by_chance,
    )
