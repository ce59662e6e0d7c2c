"""A small plot of grass, quickly simulated, for measurements of ground extraction."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...engine.core.arrays import Float
from ...interface.parameters import SurveyParameters
from ..frame import Frame
from .layers import Cover, Landscape
from .pattern import Scanner, flown, plan_flight
from .plants import cover_of
from .scanner import SurveyCloud, scan, survey
from .scene import Profile, Relief, Scene, build_scene
from .vegetation import grow

UPHILL = 50.0
"""Where the plot begins, m behind the road: the ground is as natural as slopes are."""
MARGIN = 3.0
PILOT = 40_000
OVERSHOOT, FIELD = 4.0, 50.0
"""Of the flight over a plot: shorter and narrower than over a slope, so that few pulses miss it."""


@dataclass(frozen=True)
class Plot:
    """The points of a square plot, and its ground.

    ``cloud`` is one survey; ``true_height`` takes x and y (n,) of projected coordinates to the height of the ground
    (n,), m.
    """

    cloud: SurveyCloud
    scene: Scene
    cover: Cover | None

    @property
    def true_height(self) -> Callable[[Float, Float], Float]:
        return lambda x, y: self.scene.height_at(np.column_stack([x, y]))

    @property
    def above(self) -> Float:
        """Height of each point over the true ground, m."""
        return self.cloud.xyz[:, 2] - self.scene.height_at(self.cloud.xyz)


def plot(
    parameters: SurveyParameters,
    side: float = 10.0,
    density: float = 700.0,
    slope: float = 25.0,
    epoch: int = 0,
    relief: Relief | None = None,
) -> Plot:
    """A square plot of ``side`` m (in the horizontal) under what ``parameters`` ask for, all but ``points`` and shape.

    The same seed has the same ground in all epochs.

    Args:
        density: returns a m² in the horizontal.
        slope: inclination of the ground, degrees.
        epoch: 0 is the first; later ones see other grass.
    """
    grade = math.tan(math.radians(slope))
    plane = Profile(np.array([-1000.0, 1000.0]), np.array([-1000.0, 1000.0]) * grade)
    area = (0.0, UPHILL, side, UPHILL + side)
    seed = parameters.seed
    scene = build_scene(plane, area, MARGIN, Frame(), relief or Relief(), np.random.default_rng([seed, 1]))
    canopy = grow(scene, parameters.vegetation, np.random.default_rng([seed, 2]))
    landscape = Landscape(scene, canopy, cover_of(parameters, scene, epoch))
    scanner = Scanner(overshoot=OVERSHOOT, field_of_view=FIELD)
    plan, own = plan_flight(area, plane, scanner), (seed, 11 + epoch)
    pilot = scan(landscape, flown(plan, np.random.default_rng([*own, 0])), area, PILOT, 0.0, (seed, 10))
    pulses = math.ceil(density * side**2 * PILOT / max(len(pilot), 1))
    return Plot(survey(landscape, plan, area, pulses, parameters.range_noise, own), scene, landscape.cover)


def grass_plot(
    seed: int,
    side: float = 10.0,
    density: float = 700.0,
    state: str = "grown",
    slope: float = 25.0,
) -> Plot:
    """A plot of closed grass, ``state`` grown or mown; a seed has the same ground in both states.

    Args:
        side, density, slope: as in ``plot``.

    Raises:
        ValueError: ``state`` is neither.
    """
    if state not in ("grown", "mown"):
        raise ValueError(f"state is {state!r}; give grown or mown")
    parameters = SurveyParameters(
        seed=seed, grass=1.0, grass_height=0.7, vegetation=0.0, mown="never" if state == "grown" else "both"
    )
    return plot(parameters, side, density, slope, epoch=0 if state == "grown" else 1)
