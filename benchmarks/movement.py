"""What zones did: ground that slides, slumps, sinks, bulges, is worn off or covered, as the zones name it.

Simulated: surveys of a slope under vegetation, their ground extracted and registered. On each, one patch of ground
moves along its surface, one sinks or bulges with its relief, and one loses or gains material, so that its relief is
another.
Real: two random halves of a dense cloud, on which patches are moved along the surface or straight down, or replaced.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely

from ..engine.change.difference import difference
from ..engine.core.arrays import Float
from ..engine.core.progress import Progress
from ..engine.displacement.displacement import measure_displacement
from ..engine.displacement.registered import Registered
from ..engine.zones.change_movements import moved_zones
from ..engine.zones.change_zones import change_zones
from ..engine.zones.extraction import Zones
from ..engine.zones.movement import BULGED, GAINED, LOST, SANK, SLID
from ..interface.parameters import ChangeParameters, DisplacementParameters, SurveyParameters, ZoneParameters
from ..simulation.fields import HeightField
from ..simulation.frame import Frame
from ..simulation.motion.placing import motions_on
from ..simulation.surveys.change import Bounds, Bump, Change
from ..simulation.surveys.scene import Relief, cut_profile
from ..simulation.surveys.survey import built_slope, simulate_pair, slope_of
from ..simulation.surveys.true_motion import outline
from ..simulation.surveys.weathering import eroded
from .chain import registered

SEEDS = range(1, 5)
SLIDES = ("translation", "creep", "rotation", "slump")
WAYS_M = (0.1, 0.2, 0.4)
HEIGHTS_M = (0.15, 0.3)
_WORN_M = 2.0  # wavelength of which half the relief is another where material left or came


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
    return moved_zones(found, change, vectors, (first, later), errors, ZoneParameters())


def named(zones: Zones, case: Case) -> str:
    """What the zone that has most in common with a patch is said to have done; ``none`` without one."""
    common = zones.frame.geometry.intersection(case.place).area.to_numpy()
    if not len(common) or common.max() < 0.5:
        return "none"
    return str(zones.frame["movement"].iloc[int(np.argmax(common))])
