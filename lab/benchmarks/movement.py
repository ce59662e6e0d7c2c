"""What zones did: ground that slides, slumps, sinks, bulges, is worn off or covered, as the zones name it.

Simulated: surveys of a slope under vegetation, their ground extracted and registered. On each, one patch of ground
moves along its surface, one sinks or bulges with its relief, and one loses or gains material, so that its relief is
another.
Real: two random halves of a dense cloud, on which patches are moved along the surface or straight down, or replaced.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from ...engine.change.difference import difference
from ...engine.core.arrays import Float
from ...engine.core.progress import Progress
from ...engine.displacement.displacement import measure_displacement
from ...engine.displacement.facets import find_facets
from ...engine.displacement.registered import Registered
from ...engine.ground.filtering import known_ground
from ...engine.zones.change_movements import Motion, moved_zones
from ...engine.zones.change_zones import change_zones
from ...engine.zones.extraction import Zones
from ...engine.zones.movement import BULGED, GAINED, LOST, MOVEMENTS, SANK, SLID
from ...interface.parameters import ChangeParameters, DisplacementParameters, SurveyParameters, ZoneParameters
from ...simulation.fields import HeightField
from ...simulation.frame import Frame
from ...simulation.motion.placing import motions_on
from ...simulation.surveys.change import Bounds, Bump, Change
from ...simulation.surveys.scene import Relief, cut_profile
from ...simulation.surveys.survey import built_slope, simulate_pair, slope_of
from ...simulation.surveys.true_motion import outline
from ...simulation.surveys.weathering import eroded
from .chain import registered
from .real_data import DENSE_HALVES, dense_cloud, split
from .table import Row, say

SEEDS = (1, 2, 3, 4)
SLIDES = ("translation", "creep", "rotation", "slump")
WAYS_M = (0.1, 0.2, 0.4)
HEIGHTS_M = (0.15, 0.3)
REAL_SEEDS = (1, 2, 3)
_WORN_M = 2.0  # wavelength of which half the relief is another where material left or came
_REAL_HALF_M, _REAL_APART_M = 3.0, 9.0
_MIN_COMMON_M2 = 0.5
_NONE = "none"


@dataclass(frozen=True)
class Replaced:
    """A bulge or bowl whose relief is another: ``old`` and ``new`` ground under the same smooth shape."""

    shape: Bump
    old: HeightField
    new: HeightField

    @property
    def kind(self) -> str:
        return "replaced"

    @property
    def bounds(self) -> Bounds:
        return self.shape.bounds

    @property
    def volumes(self) -> tuple[float, float]:
        return self.shape.volumes

    def dz(self, u: Float, v: Float) -> Float:
        smooth = self.shape.dz(u, v)
        share = np.clip(np.abs(smooth / self.shape.height) / 0.1, 0.0, 1.0)
        return smooth + share * (self.new(u, v) - self.old(u, v))


@dataclass(frozen=True)
class Case:
    """A patch with its truth: what it did, how, by how much (m), and where (polygon on the map)."""

    truth: str
    how: str
    amount: float
    place: shapely.Polygon


def simulated(seed: int, how: str, way: float, height: float) -> tuple[Zones, list[Case]]:
    """The zones of one simulated pair, and its three patches."""
    given = SurveyParameters(seed=seed, points=480_000, length=40.0, height=18.0, offset=0.2)
    relief, frame = Relief(), Frame()
    scene = built_slope(given, relief, frame, 0.0, Progress()).scene
    worn = eroded(scene, _WORN_M, relief, np.random.default_rng([seed, 61]))
    west, low, east, high = slope_of(given)
    third, middle = (east - west) / 3, (low + high) / 2
    sign = 1.0 if seed % 2 else -1.0
    smooth = Bump(west + 0.5 * third, middle, 3.5, 3.0, sign * height)
    other = Replaced(Bump(west + 2.5 * third, middle, 3.5, 3.0, -sign * height), scene.base, worn.base)
    profile = cut_profile(given.height, given.angle, given.benches)
    motion = motions_on((profile.v, profile.z), (west + third, low, west + 2 * third, high), (how,), way)[0]
    changes: tuple[Change, ...] = (smooth, other)
    pair = simulate_pair(given, changes=changes, motions=(motion,), frame=frame)
    found, first, second = registered(pair)
    stated = found.stated()
    errors = Registered(np.array(stated["covariance"]), np.asarray(found.transform.centre), known=True)
    zones = zones_of(first.xyz, second.xyz, errors, found.registration_error, (first.plants, second.plants))
    cases = [
        Case(SLID, how, way, outline(motion, frame)),
        Case(BULGED if sign > 0 else SANK, "bump" if sign > 0 else "hollow", height, _ellipse(smooth, frame)),
        Case(LOST if sign > 0 else GAINED, "worn" if sign > 0 else "covered", height, _ellipse(other.shape, frame)),
    ]
    return zones, cases


def _ellipse(shape: Bump, frame: Frame) -> shapely.Polygon:
    turn = np.linspace(0.0, 2 * math.pi, 65)[:-1]
    ring = np.column_stack([shape.u + shape.half_u * np.cos(turn), shape.v + shape.half_v * np.sin(turn), 0 * turn])
    return shapely.Polygon(frame.to_world(ring)[:, :2])


def zones_of(
    first: Float, later: Float, errors: Registered, height_error: float, plants: tuple = (None, None)
) -> Zones:  # fmt: skip
    """The zones of two registered surveys with what they did, at the default settings."""
    change = difference(first, later, ChangeParameters(), registration_error=height_error, plants=plants)
    found = change_zones(change)
    vectors = measure_displacement(first, later, DisplacementParameters(), errors)
    return moved_zones(found, change, Motion(vectors, (first, later), errors), ZoneParameters())


def named(zones: Zones, case: Case) -> str:
    """What the zone that has most in common with a patch is said to have done; ``none`` without one."""
    common = zones.frame.geometry.intersection(case.place).area.to_numpy()
    if not len(common) or common.max() < _MIN_COMMON_M2:
        return _NONE
    return str(zones.frame["movement"].iloc[int(np.argmax(common))])


def real(cloud: Float, seed: int) -> tuple[Zones, list[Case]]:
    """The zones of two random halves of a cloud's ground, on which patches slid, sank, bulged or were replaced.

    What replaces a patch is the ground of another place of the cloud, laid on the patch's own plane.
    """
    first, later = (part[known_ground(part).mask] for part in split(cloud, seed))
    frame = find_facets(first).frames[0]
    flat, of_first = frame.to_plane(later), frame.to_plane(first)
    rng = np.random.default_rng([seed, 8])
    low, high = np.quantile(of_first[:, :2], 0.1, axis=0), np.quantile(of_first[:, :2], 0.9, axis=0)
    patches: list[Float] = []
    while len(patches) < 4:
        middle = rng.uniform(low, high)
        near = np.hypot(*(of_first[:, :2] - middle).T) < _REAL_HALF_M
        enough = near.sum() > 60 * math.pi * _REAL_HALF_M**2
        if enough and all(np.hypot(*(middle - other)) > _REAL_APART_M for other in patches):
            patches.append(middle)
    how = ((SLID, 0.1), (SLID, 0.3), (SANK if seed % 2 else BULGED, 0.2), (LOST if seed % 2 else GAINED, 0.2))
    moved, cases = flat.copy(), []
    for middle, (truth, amount) in zip(patches, how, strict=True):
        radius = np.hypot(*(flat[:, :2] - middle).T) / _REAL_HALF_M
        share = np.clip((1 - radius) / 0.25, 0.0, 1.0)
        share = share * share * (3 - 2 * share)
        if truth == SLID:
            moved[:, 0] += amount * share
        elif truth in (SANK, BULGED):
            moved += (amount if truth == BULGED else -amount) * share[:, None] * frame.axes[:, 2]
        else:
            moved = _with_other_ground(moved, middle, amount if truth == GAINED else -amount, rng)
        cases.append(Case(truth, "real", amount, _disc(frame.axes, frame.origin, middle, of_first)))
    still = Registered.unknown()
    return zones_of(first, moved @ frame.axes + frame.origin, still, 0.0), cases


def _with_other_ground(flat: Float, middle: Float, height: float, rng: np.random.Generator) -> Float:
    """Points in a plane's frame, those of a disc replaced by those of another place, ``height`` m higher."""
    inside = np.hypot(*(flat[:, :2] - middle).T) < _REAL_HALF_M
    while True:
        other = flat[rng.integers(len(flat)), :2]
        taken = np.hypot(*(flat[:, :2] - other).T) < _REAL_HALF_M
        if np.hypot(*(other - middle)) > 2 * _REAL_HALF_M and taken.sum() > 0.7 * inside.sum():
            break
    put = flat[taken].copy()
    put[:, :2] -= other
    put[:, 2] -= _plane(put)
    own = flat[inside].copy()
    own[:, :2] -= middle
    design = np.column_stack([np.ones(len(own)), own[:, :2]])
    tilt = np.linalg.lstsq(design, own[:, 2], rcond=None)[0]
    put[:, 2] += np.column_stack([np.ones(len(put)), put[:, :2]]) @ tilt + height
    put[:, :2] += middle
    return np.concatenate([flat[~inside], put])


def _plane(points: Float) -> Float:
    design = np.column_stack([np.ones(len(points)), points[:, :2]])
    return np.asarray(design @ np.linalg.lstsq(design, points[:, 2], rcond=None)[0])


def _disc(axes: Float, origin: Float, middle: Float, ground: Float) -> shapely.Polygon:
    """A disc of the plane on the map, at the height of its ground (n, 3) in the plane's frame."""
    near = np.hypot(*(ground[:, :2] - middle).T) < _REAL_HALF_M
    turn = np.linspace(0.0, 2 * math.pi, 65)[:-1]
    ring = np.column_stack(
        [
            middle[0] + _REAL_HALF_M * np.cos(turn),
            middle[1] + _REAL_HALF_M * np.sin(turn),
            np.full(64, float(np.median(ground[near, 2]))),
        ]
    )
    return shapely.Polygon((ring @ axes + origin)[:, :2])


def rows() -> list[Row]:
    """The tables of what patches did by what they are said to have done."""
    said: list[tuple[Case, str]] = []
    for seed in SEEDS:
        for number, how in enumerate(SLIDES):
            way, height = WAYS_M[(seed + number) % 3], HEIGHTS_M[(seed // 2 + number) % 2]
            zones, cases = simulated(seed, how, way, height)
            said += [(case, named(zones, case)) for case in cases]
            say(f"pair {seed}, {how} by {way:g} m")
    found = list(_rows("simulated", said))
    cloud = dense_cloud()
    if cloud is None:
        return found
    said = []
    for seed in REAL_SEEDS:
        zones, cases = real(cloud, seed)
        said += [(case, named(zones, case)) for case in cases]
        say(f"real cloud, seed {seed}")
    return [*found, *_rows(DENSE_HALVES, said)]


def _rows(name: str, said: Sequence[tuple[Case, str]]) -> list[Row]:
    found = []
    for truth in MOVEMENTS:
        names = Counter(word for case, word in said if case.truth == truth)
        if not names:
            continue
        words = ", ".join(f"{count} {word}" for word, count in names.most_common())
        wrong = sum(count for word, count in names.items() if word not in (truth, "undecided", _NONE))
        found.append(Row(f"{name}: {sum(names.values())} patches that {truth}", words, "", f"{wrong} named wrongly"))
    return found
