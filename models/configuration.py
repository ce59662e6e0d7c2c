"""What a screening model is made for: voxels, features, scales, windows and the network's size. Travels with its
weights.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, fields
from typing import Any

from ..engine.core.errors import InputError
from ..engine.core.json_shapes import MisfitError, number, rows, text, truth
from ..engine.core.json_shapes import fields as having
from ..engine.core.messages import quoted

CLASSES = ("background", "uplift", "subsidence")
FEATURES = ("x", "y", "z", "residuals")
SAMPLINGS = ("grid", "random")
ZONES, MOST_PROBABLE = "zones", "most_probable"
DECISIONS = (ZONES, MOST_PROBABLE)
_LATER: dict[str, Any] = {"sampling": "random", "thinnings": 1, "least_peak": 0.0, "decision": MOST_PROBABLE}
"""Settings that models of earlier versions do not name, and what held for them."""

_MAX_CHANNELS, _MAX_LEVELS = 1024, 8
_LENGTH_M, _SCALE = number(0.1, 10_000.0), number(1e-3, 1e6)
CONFIGURATION = having(
    {},
    {
        "name": text(),
        "voxel": number(0.005, 10.0),
        "plane_distance": number(0.001, 100.0),
        "plane_iterations": number(1, 100_000, whole=True),
        "features": rows(text(), 1, len(FEATURES)),
        "trends": rows(rows(_LENGTH_M, 2, 2), most=32),
        "residual_scale": _SCALE, "xy_scale": _SCALE, "z_scale": _SCALE,
        "window": number(1.0, 10_000.0), "step": number(0.5, 10_000.0),
        "minimum_points": number(0, 10_000_000, whole=True), "block_points": number(0, 10_000_000, whole=True),
        "interpolation": number(1, 64, whole=True), "thinnings": number(1, 64, whole=True),
        "least_peak": number(0.0, 1.0),
        "stem": number(1, _MAX_CHANNELS, whole=True),
        "widths": rows(number(2, _MAX_CHANNELS, whole=True), 1, _MAX_LEVELS),
        "neighbours": number(2, 256, whole=True), "decimation": number(2, 64, whole=True),
        "sampling": text(),
        "dropout": number(0.0, 1.0),
        "classes": rows(text(), len(CLASSES), len(CLASSES)),
        "density": rows(number(0.0), 2, 2),
        **dict.fromkeys(("align", "own_roughness", "level_scaling", "centre_weighting"), truth),
    },
)  # fmt: skip
"""Shape of a configuration in a file: it decides how much memory and time a network takes, so all of it has bounds."""


@dataclass(frozen=True)
class ModelConfiguration:
    """The settings of a model; everything is derived from x, y and z alone. Lengths in metres.

    Preparation: points are averaged in voxels of ``voxel``. The slope is laid flat on the plane that RANSAC finds
    with ``plane_distance`` and ``plane_iterations``; with ``align`` it is also turned so that y runs up the slope.

    Features: ``features`` among x, y, z and residuals (heights over robust ``trends``, each given by its reach along
    and up the slope, divided by ``residual_scale``). Coordinates are those about the window's middle, divided by
    ``xy_scale`` and ``z_scale``. With ``level_scaling`` the offsets to neighbours are also divided by the radius that
    the neighbours of the level are expected within.

    Windows of ``window`` every ``step``; those with fewer than ``minimum_points`` are left out. ``block_points`` is the
    fixed number of points a block is sampled to (0: every point once). ``centre_weighting``: where windows overlap,
    the one whose middle is nearer counts more. Each window is looked at ``thinnings`` times, its points thinned anew
    from level to level, and the probabilities are averaged. A point's probabilities lie between those of the
    ``interpolation`` voxels nearest to it; with 1 it has its own voxel's. Neighbouring voxels of one hazard class are
    background if none of them has a probability of ``least_peak`` (see ``groups``). ``decision`` is how screening
    tells classes: by ``zones`` above the level of the accepted false zones (see ``point_scores``), or by the
    ``most_probable`` class (published).

    Network: ``stem`` channels, encoder blocks of ``widths`` (half their output), ``neighbours`` and ``decimation``: one
    in so many points goes on to the next level, drawn ``random`` (published) or spread evenly (``grid``) by
    ``sampling``.
    ``density`` is the range of points a m² that the model was trained for.
    """

    name: str = "slopewatch"
    voxel: float = 0.12
    plane_distance: float = 1.0
    plane_iterations: int = 64
    align: bool = True
    features: tuple[str, ...] = FEATURES
    trends: tuple[tuple[float, float], ...] = ((1.5, 1.5), (4.0, 4.0), (10.0, 0.6))
    residual_scale: float = 0.2
    own_roughness: bool = False
    xy_scale: float = 10.0
    z_scale: float = 0.5
    level_scaling: bool = True
    window: float = 20.0
    step: float = 15.0
    minimum_points: int = 0
    block_points: int = 0
    centre_weighting: bool = True
    interpolation: int = 4
    thinnings: int = 1
    least_peak: float = 0.0
    decision: str = ZONES
    stem: int = 8
    widths: tuple[int, ...] = (16, 64, 128, 256)
    neighbours: int = 16
    decimation: int = 4
    sampling: str = "grid"
    dropout: float = 0.5
    classes: tuple[str, ...] = CLASSES
    density: tuple[float, float] = (20.0, 450.0)

    def __post_init__(self) -> None:
        unknown = set(self.features) - set(FEATURES)
        if unknown or not self.features:
            raise InputError(
                f"The model's features {self.features} are not all of {', '.join(FEATURES)}; correct them."
            )
        if self.inputs < 1:
            raise InputError("The model reads no channel; name features or trends.")
        if tuple(self.classes) != CLASSES:
            raise InputError(
                f"The model knows the classes {', '.join(map(str, self.classes))} where {', '.join(CLASSES)} are "
                "needed; take other weights."
            )
        if any(width % 2 for width in self.widths) or self.density[0] > self.density[1]:
            raise InputError("The model's widths are not all even, or its densities not in order; correct them.")
        if self.sampling not in SAMPLINGS:
            raise InputError(f"The model's sampling is {quoted(self.sampling)}; give {' or '.join(SAMPLINGS)}.")
        if self.decision not in DECISIONS:
            raise InputError(f"The model's decision is {quoted(self.decision)}; give {' or '.join(DECISIONS)}.")
        for name in ("voxel", "xy_scale", "z_scale", "residual_scale", "window", "step"):
            if not getattr(self, name) > 0:
                raise InputError(f"The model's {name} is {getattr(self, name)}; give a number above 0.")
        if self.thinnings < 1:
            raise InputError(f"The model's thinnings are {self.thinnings}; give at least 1.")
        if not 0 <= self.least_peak < 1:
            raise InputError(f"The model's least_peak is {self.least_peak}; give a probability from 0 to below 1.")
        if self.step > self.window:
            raise InputError(f"The model's step of {self.step} m is longer than its window; points would be left out.")

    @property
    def inputs(self) -> int:
        """Channels that the network reads at each point."""
        return sum(len(self.trends) if name == "residuals" else 1 for name in self.features)

    def radius(self, level: int) -> float:
        """Radius (m) within which a point of a fully covered plane has its neighbours, at a level of decimation."""
        spacing = self.voxel * math.sqrt(float(self.decimation) ** level)
        return spacing * math.sqrt(self.neighbours / math.pi)

    def offset_scales(self) -> tuple[float, ...]:
        """What the network multiplies scaled offsets by, a number for each level."""
        if not self.level_scaling:
            return (1.0,) * len(self.widths)
        return tuple(self.xy_scale / self.radius(level) for level in range(len(self.widths)))

    def to_json(self) -> str:
        return json.dumps(asdict(self), indent=2)

    @classmethod
    def from_mapping(cls, values: dict[str, Any]) -> ModelConfiguration:
        """The configuration that ``to_json`` wrote.

        Raises:
            InputError: a name is missing or not known, or a value cannot be used.
        """
        try:
            CONFIGURATION(values, "configuration")
        except MisfitError as error:
            raise InputError(f"The model's settings cannot be used ({error}); take weights made for it.") from error
        known = {f.name for f in fields(cls)}
        values = {**_LATER, **values}
        if set(values) != known:
            wrong = ", ".join(sorted(set(values) ^ known))
            raise InputError(f"The model's settings do not fit this version (see {wrong}); take weights made for it.")
        given: dict[str, Any] = {name: _frozen(value) for name, value in values.items()}
        return cls(**given)


def _frozen(value: Any) -> Any:
    """Lists of JSON as the tuples that they were."""
    return tuple(_frozen(item) for item in value) if isinstance(value, list) else value


PAPER = ModelConfiguration(
    name="paper",
    voxel=0.01,
    plane_distance=0.08,
    align=False,
    features=("x", "y", "z"),
    trends=(),
    xy_scale=10.0,
    z_scale=10.0,
    level_scaling=False,
    step=18.0,
    minimum_points=4096,
    block_points=131_072,
    centre_weighting=False,
    interpolation=1,
    decision=MOST_PROBABLE,
    sampling="random",
)
"""The published pipeline: 20 m windows every 18 m, divided by half their size, 131,072 points each."""

SMOKE = ModelConfiguration(name="smoke", voxel=0.5, neighbours=12, widths=(8, 16, 32), trends=((4.0, 4.0), (10.0, 0.6)))
"""A net of 24 thousand parameters that learns within seconds: for tests, not for use."""
