"""The ranges that scenes are drawn from, one set of ranges a kind of scene.

Ranges follow what cut slopes along roads and surveys of them show: benches of 6 to 10 m with berms of 1.5 to 3 m at
1:0.5 to 1:1.5, a roughness of 2 to 10 cm with a power spectrum k^-3, 30 to 400 points a square metre, 2 cm of range
noise and strips that lie 1 to 4 cm apart.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ...engine.core.errors import InputError

Range = tuple[float, float]

SIMULATOR_VERSION = 1
"""Raised whenever the same seed gives another scene; kept with every model's weights."""

THRESHOLD = 0.03
"""Smallest displacement (m) that is ever labelled."""

_CUT_NEGATIVES = {
    "lattice": 0.35,
    "drains": 0.6,
    "ditches": 0.7,
    "stairs": 0.25,
    "rills": 0.5,
    "gullies": 0.35,
    "steps": 0.4,
    "boulders": 0.45,
    "spoil": 0.35,
    "stumps": 0.4,
}
_CUT_HAZARDS = {
    "bulge": 3.0,
    "toe_bulge": 1.5,
    "cracked_bulge": 1.2,
    "bowl": 2.5,
    "slump": 1.5,
    "trough": 1.0,
    "collapsed_cell": 1.0,
    "scarp_and_bulge": 1.3,
}
_OTHER_NEGATIVES = {
    "facets": 0.5,
    "terracettes": 0.5,
    "pipes": 0.5,
    "drains": 0.3,
    "lattice": 0.2,
    "boulders": 0.5,
    "gullies": 0.4,
    "spoil": 0.4,
}
_OTHER_HAZARDS = {
    "cone": 1.5,
    "blob": 2.0,
    "block": 1.5,
    "lobes": 1.2,
    "sinkhole": 1.5,
    "graben": 1.2,
    "pit_blob": 2.0,
}


@dataclass(frozen=True)
class Style:
    """Ranges of one kind of scene. Pairs are (from, to), uniform; those marked log are uniform in the logarithm.

    ``shares`` are the mean shares of uplift and subsidence among the points; in a scene both differ by up to
    ``share_spread`` of these, and one from the other by up to ``split_spread``; ``without_hazard`` is the share of
    scenes that have none. ``hazards`` weighs the kinds of hazard, ``negatives`` gives the probability that a scene
    has each kind of hard negative. Lengths in metres.
    """

    name: str
    code: int
    shares: tuple[float, float]
    share_spread: float = 0.1
    split_spread: float = 0.3
    without_hazard: float = 0.0
    area: Range = (2000.0, 11_000.0)  # m² of the mean plane, log
    density: Range = (30.0, 400.0)  # points a m² of the mean plane, log
    hazard_size: Range = (1.0, 8.0)  # diameter, log
    bulge_height: Range = (0.05, 0.60)
    depression_depth: Range = (0.05, 0.80)
    hazards: Mapping[str, float] = field(default_factory=lambda: _CUT_HAZARDS)
    negatives: Mapping[str, float] = field(default_factory=lambda: _CUT_NEGATIVES)
    benched: float = 0.6
    dip: Range = (28.0, 60.0)  # degrees, where the slope is planar
    curvature: float = 0.3
    roughness: Range = (0.02, 0.10)  # log
    exponent: Range = (2.8, 3.2)
    range_noise: Range = (0.018, 0.022)
    strip_offset: Range = (0.01, 0.04)
    random_pattern: float = 0.3
    spikes: Range = (0.01, 0.05)
    vegetation: Range = (0.0, 0.6)


STYLES: dict[str, Style] = {
    style.name: style
    for style in (
        Style("published", 1, shares=(0.2259, 0.2261), hazard_size=(1.5, 8.0)),
        Style("realistic", 2, shares=(0.025, 0.025), without_hazard=0.2, share_spread=0.8),
        Style(
            "shifted",
            3,
            shares=(0.025, 0.025),
            without_hazard=0.2,
            share_spread=0.6,
            split_spread=0.5,
            density=(20.0, 60.0),
            hazards=_OTHER_HAZARDS,
            negatives=_OTHER_NEGATIVES,
            benched=0.0,
            dip=(20.0, 50.0),
            curvature=0.8,
            exponent=(2.2, 2.6),
            range_noise=(0.025, 0.035),
            strip_offset=(0.02, 0.05),
            random_pattern=1.0,
            vegetation=(0.2, 0.8),
        ),
    )
}


def style_of(kind: str) -> Style:
    """The style named ``kind``.

    Raises:
        InputError: there is none of that name.
    """
    try:
        return STYLES[kind]
    except KeyError:
        raise InputError(f"The kind of scene {kind!r} is not known; give one of {', '.join(STYLES)}.") from None


@dataclass(frozen=True)
class SceneSpec:
    """All that makes a scene: the same specification gives the same points, byte for byte.

    ``area`` is that of the mean plane (m²), ``density`` its points a m², ``uplift`` and ``subsidence`` the shares of
    the area that the labelled displacements are to cover.
    """

    kind: str
    seed: int
    area: float
    density: float
    uplift: float
    subsidence: float

    @property
    def points(self) -> int:
        """The expected number of points; a scene has a few per cent more or less."""
        return round(self.area * self.density)

    def generator(self, part: int) -> np.random.Generator:
        """A random generator of this scene's own for one part of its making."""
        return np.random.default_rng([SIMULATOR_VERSION, style_of(self.kind).code, self.seed, part])


def log_uniform(bounds: Range, rng: np.random.Generator) -> float:
    """A number within ``bounds`` whose logarithm is uniform."""
    return math.exp(rng.uniform(math.log(bounds[0]), math.log(bounds[1])))


def draw_spec(
    seed: int, kind: str = "published", *, area: float | None = None, density: float | None = None
) -> SceneSpec:
    """A specification drawn from the kind's ranges; ``area`` and ``density`` may be given instead."""
    style = style_of(kind)
    if seed < 0:
        raise InputError(f"The scene's seed is {seed}; give 0 or more.")
    spec = SceneSpec(kind, seed, 0.0, 0.0, 0.0, 0.0)
    rng = spec.generator(0)
    drawn_area, drawn_density = log_uniform(style.area, rng), log_uniform(style.density, rng)
    both, apart = rng.uniform(-1, 1, 2) * (style.share_spread, style.split_spread)
    uplift, subsidence = style.shares[0] * (1 + both) * (1 + apart), style.shares[1] * (1 + both) * (1 - apart)
    if rng.random() < style.without_hazard:
        uplift = subsidence = 0.0
    else:
        uplift, subsidence = uplift / (1 - style.without_hazard), subsidence / (1 - style.without_hazard)
    return replace(
        spec,
        area=drawn_area if area is None else area,
        density=drawn_density if density is None else density,
        uplift=float(uplift),
        subsidence=float(subsidence),
    )
