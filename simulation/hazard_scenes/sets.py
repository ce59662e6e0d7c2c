"""The benchmark sets: scenes named by seed, so that everyone scores the same points without a file changing hands.

The published set has the number of scenes and points and the class shares of the published simulation; the realistic
set has hazards as rare as slopes have, and slopes without any; the shifted set has other landforms, hazards,
densities and noise, none of which training sees. Training takes its seeds from ``FIRST_TRAINING_SEED`` on, the sets
theirs from below.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from .scenes import SimulatedScene, build_scene
from .styles import SceneSpec, draw_spec, style_of

PUBLISHED_SCENES = 92
PUBLISHED_POINTS = 86_500_000
PUBLISHED_SHARES = (0.5480, 0.2259, 0.2261)
"""Background, bulge, depression among the points of the published simulated scenes."""
REALISTIC_SCENES = 40
SHIFTED_SCENES = 40
FIRST_TRAINING_SEED = 1_000_000
_AIM = {"published": (0.9935, 0.9840), "realistic": (0.92, 0.935), "shifted": (1.0, 0.96)}
"""What the aimed shares are multiplied by so that the points' shares come out right, measured on the sets themselves:
the region's ragged outline cuts off more background than hazards, and the last hazard placed overshoots."""


@dataclass(frozen=True)
class BenchmarkSet:
    """A named list of scenes; ``specs`` is cheap, ``scenes`` simulates one after the other."""

    name: str
    specs: tuple[SceneSpec, ...]

    def scenes(self) -> Iterator[SimulatedScene]:
        """The scenes in order, each simulated when it is asked for."""
        return (build_scene(spec) for spec in self.specs)

    def __len__(self) -> int:
        return len(self.specs)

    @property
    def points(self) -> int:
        """Expected number of points of all scenes."""
        return sum(spec.points for spec in self.specs)


def published_set() -> BenchmarkSet:
    """92 scenes of about 86.5 million points, 54.80 / 22.59 / 22.61 % background, uplift and subsidence."""
    return BenchmarkSet("published", tuple(_balanced("published", PUBLISHED_SCENES, PUBLISHED_POINTS)))


def realistic_set() -> BenchmarkSet:
    """40 scenes, 95 / 2.5 / 2.5 %, a fifth of them without hazards."""
    return BenchmarkSet("realistic", tuple(_balanced("realistic", REALISTIC_SCENES)))


def shifted_set() -> BenchmarkSet:
    """40 scenes as rare in hazards as the realistic ones, from morphologies, densities and noise that training never
    sees.
    """
    return BenchmarkSet("shifted", tuple(_balanced("shifted", SHIFTED_SCENES)))


SETS = {"published": published_set, "realistic": realistic_set, "shifted": shifted_set}


def training_specs(kind: str, count: int, *, first: int = 0, area: float | None = None) -> Iterator[SceneSpec]:
    """``count`` specifications that no benchmark set holds, from the ``first`` training seed on; ``area`` in m²."""
    return (draw_spec(FIRST_TRAINING_SEED + first + k, kind, area=area) for k in range(count))


def _balanced(kind: str, count: int, points: int | None = None) -> list[SceneSpec]:
    """Drawn specifications whose areas are scaled to ``points`` and whose shares are scaled to the style's means.

    Every so many-th scene is without hazards rather than a random number of them.
    """
    style = style_of(kind)
    specs = [draw_spec(seed, kind) for seed in range(count)]
    if points is not None:
        scale = points / sum(spec.points for spec in specs)
        specs = [replace(spec, area=spec.area * scale) for spec in specs]
    if style.without_hazard:
        every = round(1 / style.without_hazard)
        drawn = [spec for spec in specs if spec.uplift > 0]
        specs = [
            replace(spec, uplift=0.0, subsidence=0.0)
            if number % every == every - 1
            else (spec if spec.uplift > 0 else replace(spec, uplift=drawn[0].uplift, subsidence=drawn[0].subsidence))
            for number, spec in enumerate(specs)
        ]
    weight = np.array([spec.points for spec in specs], dtype=np.float64)
    aim = style.shares[0] * _AIM[kind][0], style.shares[1] * _AIM[kind][1]
    up = aim[0] / np.average([spec.uplift for spec in specs], weights=weight)
    down = aim[1] / np.average([spec.subsidence for spec in specs], weights=weight)
    return [replace(s, uplift=float(s.uplift * up), subsidence=float(s.subsidence * down)) for s in specs]
