"""Where grass, ferns and forest stand on a slope, and how high and dense they are from place to place."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float
from ...interface.parameters import SurveyParameters
from ..fields import HeightField, power_law_field
from ..sources import LEAVES, TURF
from .layers import Cover, Layer
from .scene import Scene
from .vegetation import ROAD_EDGE

STEP = 0.1
MAX_NODES = 4_000_000
"""Nodes of a field at most; a larger slope gets coarser ones."""
EDGE = 0.04
"""Ranks over which plants thin out at the edge of their part."""
LASTING = 0.6
"""Share of the variance of grass between places that is the same in another season: tussocks stay, blades do not."""


@dataclass(frozen=True)
class Kind:
    """How one kind of plant varies between places.

    ``spread`` and ``depth_spread`` are standard deviations of the logarithms of height and optical depth, ``depth``
    the median optical depth of a vertical ray. ``tufts`` and ``places`` are wavelengths (m) of the pattern: of single
    plants, and of places where they grow well or badly; ``tuft_share`` is the tufts' share of the variance. Tall
    plants are dense ones with a correlation of ``together``. ``exponents`` shape the profile: density over the
    relative height r goes like r^a (1 - r)^b.
    """

    depth: float
    spread: float
    depth_spread: float
    tufts: tuple[float, float]
    places: tuple[float, float]
    tuft_share: float
    together: float
    exponents: tuple[float, float]
    source: int


GROWN = Kind(4.1, 0.25, 0.35, (0.4, 2.0), (1.5, 12.0), 0.5, 0.5, (0.0, 3.0), TURF)
MOWN = Kind(1.9, 0.20, 0.30, (0.4, 2.0), (1.5, 12.0), 0.3, 0.5, (0.3, 0.0), TURF)
FERNS = Kind(5.6, 0.25, 0.30, (0.8, 3.0), (3.0, 15.0), 0.5, 0.3, (1.0, 0.6), LEAVES)
UNDERSTOREY = Kind(2.7, 0.50, 0.40, (1.0, 4.0), (4.0, 20.0), 0.5, 0.3, (0.0, 0.8), LEAVES)
CANOPY = Kind(3.0, 0.23, 0.45, (3.0, 10.0), (10.0, 40.0), 0.6, 0.3, (0.6, 0.5), LEAVES)
STUBBLE = 0.055
FERN_HEIGHT = 0.9
UNDERSTOREY_HEIGHT = 1.3
CANOPY_HEIGHT = 8.4
LIMITS = (0.45, 1.9)
"""Heights stay within these multiples of the mean."""
CUTTINGS = 0.02


class Ground:
    """Fields on one grid over a scene, drawn one after the other from seeds of their own."""

    def __init__(self, scene: Scene, seed: int) -> None:
        self.scene, self.seed = scene, seed
        u0, v0, u1, v1 = scene.extent
        self.step = max(STEP, math.sqrt((u1 - u0) * (v1 - v0) / MAX_NODES))
        self.shape = (math.ceil((v1 - v0) / self.step) + 1, math.ceil((u1 - u0) / self.step) + 1)
        self.origin = (u0, v0)
        self.v: Float = v0 + self.step * np.arange(self.shape[0], dtype=np.float64)
        self.u: Float = u0 + self.step * np.arange(self.shape[1], dtype=np.float64)
        self.off_road = (self.v > ROAD_EDGE)[:, None]

    def noise(self, wavelengths: tuple[float, float], *seed: int) -> Float:
        """A random field of mean 0 and standard deviation 1."""
        rng = np.random.default_rng([self.seed, *seed])
        return power_law_field(self.shape, self.step, 1.5, max(wavelengths[0], 2 * self.step), wavelengths[1], rng)

    def field(self, values: Float) -> HeightField:
        return HeightField(*self.origin, self.step, np.ascontiguousarray(values))

    def rank(self, left: bool, *seed: int) -> Float:
        """Which share of the slope comes before each node: by patches of some metres, or from the left."""
        values = np.broadcast_to(self.u, self.shape) if left else self.noise((5.0, 30.0), *seed)
        u0, v0, u1, v1 = self.scene.slope
        inside = ((self.v >= v0) & (self.v <= v1))[:, None] & ((self.u >= u0) & (self.u <= u1))[None, :]
        ordered = np.sort(values[inside])
        return np.interp(values, ordered, np.linspace(0.0, 1.0, len(ordered)))

    def part(self, share: float, left: bool, *seed: int) -> Float:
        """1 within the part that holds ``share`` of the slope, 0 outside, falling off at its edge."""
        if share >= 1:
            return np.where(self.off_road, 1.0, 0.0) * np.ones(self.shape)
        rank = self.rank(left, *seed)
        return np.where(self.off_road, np.clip((share - rank) / EDGE + 0.5, 0.0, 1.0), 0.0)

    def layer(self, kind: Kind, height: float, part: Float, epoch: int, *seed: int) -> Layer:
        """``kind`` with a mean height of ``height`` m where ``part`` is 1; ``epoch`` -1: the same in all."""
        tall, dense = self._pattern(kind, epoch, *seed, 1), self._pattern(kind, epoch, *seed, 2)
        dense = kind.together * tall + math.sqrt(1 - kind.together**2) * dense
        heights = height * np.clip(np.exp(kind.spread * tall - kind.spread**2 / 2), *LIMITS) * part
        depths = kind.depth * np.exp(kind.depth_spread * dense)
        return Layer(
            self.origin,
            self.step,
            heights.astype(np.float32),
            depths.astype(np.float32),
            profile(*kind.exponents),
            kind.source,
        )

    def _pattern(self, kind: Kind, epoch: int, *seed: int) -> Float:
        lasting = self._waves(kind, *seed, 0)
        if epoch < 0:
            return lasting
        return math.sqrt(LASTING) * lasting + math.sqrt(1 - LASTING) * self._waves(kind, *seed, 1 + epoch)

    def _waves(self, kind: Kind, *seed: int) -> Float:
        tufts, places = self.noise(kind.tufts, *seed, 1), self.noise(kind.places, *seed, 2)
        return math.sqrt(kind.tuft_share) * tufts + math.sqrt(1 - kind.tuft_share) * places


def profile(low: float, high: float, count: int = 65) -> NDArray[np.float32]:
    """Density r^low (1 - r)^high at ``count`` relative heights, of mean 1."""
    r = np.linspace(0.0, 1.0, count)
    values = r**low * (1.0 - r) ** high
    mean = float(((values[1:] + values[:-1]) / 2).mean())
    return (values / mean).astype(np.float32)


def cover_of(parameters: SurveyParameters, scene: Scene, epoch: int) -> Cover | None:
    """What covers the ground in an epoch (0: the first), by the parameters; None where nothing is asked for."""
    asked = (parameters.grass, parameters.ferns, parameters.forest, parameters.litter)
    if not any((*asked, parameters.multipath, parameters.stray)):
        return None
    cover = Cover(multipath=parameters.multipath, stray=parameters.stray)
    if not any(asked):
        return cover
    ground = Ground(scene, parameters.seed)
    left = parameters.layout == "left"
    layers: list[Layer] = []
    litter = np.full(ground.shape, parameters.litter) * ground.off_road
    forest = np.zeros(ground.shape)
    if parameters.forest:
        forest = ground.part(parameters.forest, left, 21)
        layers.append(ground.layer(UNDERSTOREY, UNDERSTOREY_HEIGHT, forest, -1, 22))
        layers.append(ground.layer(CANOPY, CANOPY_HEIGHT, forest, -1, 23))
    if parameters.grass:
        part = ground.part(parameters.grass, left, 24) * (1.0 - forest)
        if mown_in(parameters.mown, epoch):
            layers.append(ground.layer(MOWN, STUBBLE, part, epoch, 25))
            litter = np.maximum(litter, CUTTINGS * part)
        else:
            layers.append(ground.layer(GROWN, parameters.grass_height, part, epoch, 26))
    if parameters.ferns:
        # Ferns take the other end: next to the grass where both have room.
        part = (1.0 - ground.part(1.0 - parameters.ferns, left, 24)) * ground.off_road * (1.0 - forest)
        layers.append(ground.layer(FERNS, FERN_HEIGHT, part, -1, 27))
    thickness = None
    if litter.any():
        thickness = ground.field(litter * np.clip(1.0 + 0.6 * ground.noise((0.4, 3.0), 28, epoch), 0.0, 2.0))
    return replace(cover, layers=tuple(layers), litter=thickness)


def mown_in(mown: str, epoch: int) -> bool:
    """Whether ``mown`` (never, first, later, both) holds for an epoch; all but the first are later."""
    return mown == "both" or mown == ("first" if epoch == 0 else "later")
