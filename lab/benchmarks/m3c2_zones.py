"""Zones of M3C2 and the ranges of their volumes on simulated walls with rocks, and on halves of a real cloud.

*Walls*: 75 degrees, 140 points/m² in each survey, rocks of several heights and widths; two changes whose volumes are
known from their shapes. *Real*: two random halves of a dense cloud, of which bumps of known volume are put into one;
they share their position, so that their registration has no error. A change is to be found if its height is 1.5 times
the median level of the core points in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from ...engine.core.arrays import Bool, Float
from ...engine.core.progress import Progress
from ...engine.grid.grid import cell_index
from ...engine.m3c2.distances import Distances
from ...engine.m3c2.level import calibrated
from ...engine.m3c2.measuring import Measuring, measure
from ...engine.m3c2.scales import choose_scales, overlap_bounds, spread_cores
from ...engine.m3c2.surveys import HeldSurvey
from ...engine.zones.face_zones import FaceZones, face_zones
from ...interface.parameters import DistanceParameters
from .real_data import dense_cloud, split
from .table import Row, counted, say

ROCKS_M = ((0.05, 0.1), (0.05, 0.4), (0.09, 0.2), (0.18, 0.2), (0.18, 0.4), (0.27, 0.4))
"""Standard deviation of the rocks' heights, and of the filter that makes them: they lie nine times as far apart."""
FIRST_SEED, WALLS, REAL_PAIRS = 40, 3, 3
WALL_CHANGES = ((4.5, 4.5, 2.5, -0.3), (10.8, 10.8, 2.8, 0.3))
"""Place along and up the wall, radius and height of a cosine bump, m."""
FOUND_FROM = 1.5  # levels of detection
_SIDE_M, _POINTS_M2, _DIP_DEG, _NOISE_M, _REGISTRATION_M = 16.0, 140.0, 75.0, 0.01, 0.003
_BUMPS, _BUMP_RADIUS_M, _BUMP_HEIGHTS_M = 8, 1.5, (0.05, 0.2)


@dataclass(frozen=True)
class Change:
    """A cosine bump: its ``middle`` and ``direction`` (3,), radius and height in metres."""

    middle: Float
    direction: Float
    radius: float
    height: float

    @property
    def volume(self) -> float:
        """m³: the integral of h cos²(pi r / 2 R) over its disc."""
        return float(self.height * np.pi * self.radius**2 * (0.5 - 2 / np.pi**2))

    def away(self, xyz: Float) -> Float:
        """(n,) distance of points (n, 3) from its axis; inf for those that lie before or behind it."""
        offset = xyz - self.middle
        along = offset @ self.direction
        across = np.linalg.norm(offset - along[:, None] * self.direction, axis=1)
        return np.where(np.abs(along) < 2 * self.radius, across, np.inf)

    def put_into(self, xyz: Float) -> Float:
        """Points (n, 3) with the bump."""
        share = np.minimum(self.away(xyz) / self.radius, 1.0)
        return np.asarray(xyz + (self.height * np.cos(0.5 * np.pi * share) ** 2)[:, None] * self.direction)


@dataclass(frozen=True)
class Outcome:
    """Of the changes of a pair that are to be found: whether they are zones, whether the range of the volume holds the
    true one, and volume over truth. ``false`` zones lie on no change; ``low`` changes are below ``FOUND_FROM``.
    """

    found: tuple[bool, ...]
    held: tuple[bool, ...]
    ratio: tuple[float, ...]
    false: int
    low: int


def wall(seed: int, rocks: tuple[float, float]) -> tuple[Float, Float, tuple[Change, ...]]:
    """Two surveys of a wall, (n, 3) each, and what changed between them."""
    height, width = rocks
    rng = np.random.default_rng([seed, round(1000 * height), round(1000 * width)])
    relief = gaussian_filter(rng.normal(size=(320, 320)), 20 * width)
    dip = np.radians(_DIP_DEG)
    axes = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(dip), np.sin(dip)], [0.0, -np.sin(dip), np.cos(dip)]])
    changes = tuple(Change(np.array([a, u, 0.0]) @ axes, axes[2], r, h) for a, u, r, h in WALL_CHANGES)

    def survey() -> Float:
        along, up = rng.uniform(0, _SIDE_M, (2, int(_POINTS_M2 * _SIDE_M**2)))
        out = height / relief.std() * map_coordinates(relief, [20 * along, 20 * up], order=1, mode="nearest")
        return np.asarray(np.column_stack([along, up, out + rng.normal(0, _NOISE_M, len(along))]) @ axes)

    first, second = survey(), survey()
    for change in changes:
        second = change.put_into(second)
    return first, second, changes


def measured(first: Float, second: Float, registration_error: float) -> tuple[Distances, FaceZones]:
    """As the command measures with default settings."""
    parameters = DistanceParameters()
    scales = choose_scales(first, second, parameters)
    core = first[spread_cores(first, scales.core_spacing, overlap_bounds(first, second))]
    how = Measuring(parameters, scales, np.array([0.0, 0.0, 1.0]), registration_error)
    found, slope = measure((HeldSurvey(first), HeldSurvey(second)), core, how, Progress())
    found = calibrated(found, how.cylinder.radius, slope=slope)
    return found, face_zones(found, scales.core_spacing, None)


def outcome(found: Distances, zones: FaceZones, changes: Sequence[Change]) -> Outcome:
    """What became of each change."""
    face = zones.face
    zone = zones.zones.labels.ravel()[cell_index(face.local[:, :2], face.grid)]
    core, level = found.core[found.measured], found.level[found.measured]
    frame, near = zones.zones.frame, np.zeros(len(core), dtype=bool)
    seen, held, ratio, low = [], [], [], 0
    for change in changes:
        away = change.away(core)
        near |= away < change.radius + _BUMP_RADIUS_M
        inside = away < change.radius
        if abs(change.height) < FOUND_FROM * np.median(level[inside]):
            low += 1
            continue
        own = np.bincount(zone[inside & (zone > 0)], minlength=len(frame) + 1)
        seen.append(bool(own.any()))
        if own.any():
            row = frame.iloc[int(own.argmax()) - 1]
            side = np.sign(row["vol_net_m3"]) * np.sign(change.volume)  # a face's normal may point to either side
            held.append(bool(row["vol_low_m3"] <= side * change.volume <= row["vol_high_m3"]))
            ratio.append(float(abs(row["vol_net_m3"] / change.volume)))
    false = len(frame) - len(set(zone[near & (zone > 0)].tolist()))
    return Outcome(tuple(seen), tuple(held), tuple(ratio), false, low)


def bumps(seed: int, first: Float, found: Distances) -> tuple[Change, ...]:
    """Bumps along the normals of a real cloud (n, 3), anywhere but at its edge, apart from each other."""
    rng = np.random.default_rng(seed)
    low, high = first.min(axis=0)[:2] + 2 * _BUMP_RADIUS_M, first.max(axis=0)[:2] - 2 * _BUMP_RADIUS_M
    made: list[Change] = []
    for number in rng.permutation(np.flatnonzero(found.measured)):
        place = found.core[number]
        inner: Bool = (place[:2] > low) & (place[:2] < high)
        if inner.all() and all(np.linalg.norm(place - c.middle) > 5 * _BUMP_RADIUS_M for c in made):
            height = rng.choice((-1.0, 1.0)) * rng.uniform(*_BUMP_HEIGHTS_M)
            near = np.linalg.norm(found.core - place, axis=1) < _BUMP_RADIUS_M
            direction = np.mean(found.normal[near & found.measured], axis=0)
            made.append(Change(place, direction / np.linalg.norm(direction), _BUMP_RADIUS_M, float(height)))
        if len(made) == _BUMPS:
            break
    return tuple(made)


def real(seed: int, cloud: Float) -> tuple[Outcome, int]:
    """Bumps in halves of a cloud, and the number of zones in the halves without."""
    first, second = split(cloud, seed)
    still, none = measured(first, second, 0.0)
    changes = bumps(seed, first, still)
    for change in changes:
        second = change.put_into(second)
    return outcome(*measured(first, second, 0.0), changes), len(none.zones.frame)


def rows(seeds: range | None = None) -> list[Row]:
    """Changes found, false zones, and ranges that hold the truth; on walls by their rocks, then on the real cloud."""
    seeds = seeds or range(FIRST_SEED, FIRST_SEED + WALLS)
    made, everything = [], list[Outcome]()
    for rocks in ROCKS_M:
        cases = []
        for seed in seeds:
            first, second, changes = wall(seed, rocks)
            cases.append(outcome(*measured(first, second, _REGISTRATION_M), changes))
        say(f"rocks of {rocks[0]:g} m, {rocks[1]:g} m wide")
        everything += cases
        made.append(_row(f"walls, rocks of {rocks[0]:g} m, {9 * rocks[1]:.1f} m apart", cases))
    made.append(_row("all walls", everything))
    cloud = dense_cloud()
    if cloud is not None:
        found = [real(seed, cloud) for seed in range(seeds.start, seeds.start + REAL_PAIRS)]
        still = sum(zones > 0 for _, zones in found)
        made.append(_row(f"real cloud in halves, {_BUMPS} bumps each", [one for one, _ in found]))
        made.append(Row("real cloud in halves, nothing put in: pairs with a zone", f"{still} of {len(found)}", "0"))
    return made


def _row(name: str, cases: Sequence[Outcome]) -> Row:
    found, held, ratio = ([one for case in cases for one in getattr(case, kind)] for kind in ("found", "held", "ratio"))
    false, low = sum(case.false for case in cases), sum(case.low for case in cases)
    return Row(
        f"M3C2 zones, {name}: changes of {FOUND_FROM:g} levels found; false zones; ranges of volumes that hold",
        f"{counted(found, 0)}; {false}; {counted(held, 0)}",
        "all; 0; 9 of 10",
        f"volume over truth {np.mean(ratio):.3f} ± {np.std(ratio):.3f}; {low} lower changes" if ratio else "",
        all(found) and false == 0 and sum(held) >= 0.9 * len(held),
    )
