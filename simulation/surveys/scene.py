"""A road cut: strip of road at the toe, cut face with optional berms, crest shoulder, natural roughness, turf."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from ...engine.core.arrays import Float
from ..fields import HeightField, power_law_field
from ..frame import Frame
from ..motion.moved_ground import SurfaceMotion, arrived, moved_height, settled, within
from .change import Change, total_dz

BERM_WIDTH = 2.0
_BETWEEN_SAMPLES_M = 0.1
"""By which moved ground may be higher than the places at which it is looked at."""
TURF_STEP_M = 0.25
MAX_FIELD_NODES = 24_000_000
"""Nodes of the height field at most (192 MB); a larger scene gets a coarser field."""


@dataclass(frozen=True)
class Profile:
    """Cross-section: height over v, piecewise linear through ``v`` and ``z`` (equal lengths, v rising)."""

    v: Float
    z: Float

    def __call__(self, v: Float) -> Float:
        return np.interp(v, self.v, self.z)

    @property
    def slopes(self) -> tuple[float, float]:
        """Smallest and largest dz/dv."""
        gradients = np.diff(self.z) / np.diff(self.v)
        return float(gradients.min()), float(gradients.max())


@dataclass(frozen=True)
class Relief:
    """What is added to the plain profile. Lengths in metres; ``*_rms`` are standard deviations."""

    undulation_rms: float = 0.15
    undulation_wavelengths: tuple[float, float] = (8.0, 40.0)
    roughness_rms: float = 0.03
    roughness_wavelengths: tuple[float, float] = (0.4, 8.0)
    exponent: float = 3.0
    micro_rms: float = 0.008
    micro_wavelengths: tuple[float, float] = (0.12, 0.6)
    road_factor: float = 0.15
    turf_height: float = 0.022


@dataclass(frozen=True)
class Scene:
    """Ground of one epoch in its local frame. ``height`` is exact: bilinear field, moved, plus the changes' functions.

    ``base`` is the ground before it moved by ``motions``, whose bounds do not overlap.
    ``slope`` is the managed slope's rectangle (u and v from, u and v to); ``turf`` the height of the grass, m.
    """

    frame: Frame
    profile: Profile
    base: HeightField
    turf: HeightField
    slope: tuple[float, float, float, float]
    changes: tuple[Change, ...] = field(default=())
    motions: tuple[SurfaceMotion, ...] = field(default=())

    def height(self, u: Float, v: Float) -> Float:
        """Local height of the ground at (u, v), m."""
        z = self.base(u, v)
        for motion in self.motions:
            inside = within(motion, u, v)
            if inside.any():
                z[inside] = moved_height(motion, self.base, u[inside], v[inside])
        if self.changes:
            z += total_dz(self.changes, u, v)
        return z

    def height_at(self, world: Float) -> Float:
        """Height of the ground in the world under (n, 2+) projected coordinates, m."""
        u, v = self.frame.rotate_to_local(world[:, 0] - self.frame.east, world[:, 1] - self.frame.north)
        return self.height(u, v) + self.frame.up

    @property
    def lift(self) -> float:
        """Largest height of the ground above the plain profile, m; not less than 0."""
        _, v = self.base.nodes()
        highest = float((self.base.values - self.profile(v)[:, None]).max())
        for change in self.changes:
            west, south, east, north = change.bounds
            u, v = np.meshgrid(np.linspace(west, east, 65), np.linspace(south, north, 65))
            highest += max(float(change.dz(u, v).max()), 0.0)
        for motion in self.motions:
            west, south, east, north = motion.bounds
            places = np.meshgrid(np.linspace(west, east, 129), np.linspace(south, north, 129))
            across, along = (axis.ravel() for axis in places)
            risen = float((moved_height(motion, self.base, across, along) - self.profile(along)).max())
            highest = max(highest, risen + _BETWEEN_SAMPLES_M)
        return max(highest, 0.0)

    def with_changes(self, changes: tuple[Change, ...]) -> Scene:
        """The same ground with these changes in it."""
        return replace(self, changes=changes)

    def with_motions(self, motions: tuple[SurfaceMotion, ...]) -> Scene:
        """The same ground moved along itself; slumps settle so that their toe holds what their scarp has lost."""
        return replace(self, motions=tuple(settled(motion, self.base) for motion in motions))

    def grass(self, u: Float, v: Float) -> Float:
        """Height of the short grass at (u, v), which moves with the ground and is missing on a fresh scarp, m."""
        height = self.turf(u, v)
        for motion in self.motions:
            inside = within(motion, u, v)
            if inside.any():
                come = arrived(motion, self.base, u[inside], v[inside])
                height[inside] = np.where(come.fresh, 0.0, self.turf(come.u, come.v))
        return height

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """u and v from, u and v to of the modelled ground."""
        u, v = self.base.nodes()
        return float(u[0]), float(v[0]), float(u[-1]), float(v[-1])


def cut_profile(height: float, angle: float, benches: int) -> Profile:
    """Road (2.5 % crossfall), face of ``angle`` degrees from v = 0 with ``benches`` berms, shoulder of 6 degrees."""
    run, reach = height / math.tan(math.radians(angle)), 1000.0
    v, z = [-reach, 0.0], [-0.025 * reach, 0.0]
    for step in range(benches + 1):
        v.append(v[-1] + run / (benches + 1))
        z.append(z[-1] + height / (benches + 1))
        if step < benches:
            v.append(v[-1] + BERM_WIDTH)
            z.append(z[-1] - 0.03 * BERM_WIDTH)
    v.append(v[-1] + reach)
    z.append(z[-1] + math.tan(math.radians(6.0)) * reach)
    return Profile(np.array(v), np.array(z))


def relief_values(relief: Relief, shape: tuple[int, int], step: float, v: Float, rng: np.random.Generator) -> Float:
    """Heights (rows, columns) above the plain profile at nodes ``step`` m apart, whose rows lie at ``v``."""
    # Roads are laid even; roughness grows within the first half metre of the face.
    natural = relief.road_factor + (1 - relief.road_factor) * np.clip(v / 0.5 + 0.5, 0.0, 1.0)
    values = np.zeros(shape)
    for rms, (shortest, longest), exponent in (
        (relief.undulation_rms, relief.undulation_wavelengths, relief.exponent),
        (relief.roughness_rms, relief.roughness_wavelengths, relief.exponent),
        (relief.micro_rms, relief.micro_wavelengths, 1.0),
    ):
        if rms > 0:
            values += rms * power_law_field(shape, step, exponent, max(shortest, 2 * step), longest, rng)
    values *= natural[:, None]
    return values


def build_scene(
    profile: Profile,
    slope: tuple[float, float, float, float],
    margin: float,
    frame: Frame,
    relief: Relief,
    rng: np.random.Generator,
    step: float = 0.05,
) -> Scene:
    """A scene around the ``slope`` rectangle with ``margin`` m on every side; ground coarser than ``step`` if large."""
    u0, v0, u1, v1 = slope[0] - margin, slope[1] - margin, slope[2] + margin, slope[3] + margin
    step = max(step, math.sqrt((u1 - u0) * (v1 - v0) / MAX_FIELD_NODES))
    shape = (math.ceil((v1 - v0) / step) + 1, math.ceil((u1 - u0) / step) + 1)
    v: Float = v0 + step * np.arange(shape[0], dtype=np.float64)
    values = relief_values(relief, shape, step, v, rng)
    values += profile(v)[:, None]
    coarse = TURF_STEP_M
    turf_shape = (math.ceil((v1 - v0) / coarse) + 1, math.ceil((u1 - u0) / coarse) + 1)
    patches = power_law_field(turf_shape, coarse, 2.0, 1.0, 10.0, rng)
    turf = relief.turf_height * np.clip(1.0 + 0.5 * patches, 0.0, 2.0)
    turf *= (v0 + coarse * np.arange(turf_shape[0]) > 0.0)[:, None]
    return Scene(frame, profile, HeightField(u0, v0, step, values), HeightField(u0, v0, coarse, turf), slope)
