"""The result of screening a cloud."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float
from ...engine.geometry.dominant_plane import Plane
from ..inference.calibration import apply_temperature
from ..inference.interpolation import VoxelInterpolation
from ..preparation.suitability import Suitability
from ..preparation.voxel_sums import SparseVoxels, flat_axis
from .detectability import Detectability
from .labels import BACKGROUND, Decision

_MIN_PROBABILITY = np.float32(1e-6)
"""Of a point that was screened: 0 says that it was not."""


class GroundPoints(Protocol):
    """Points to be screened, wherever they are.

    ``name`` is the cloud's, for messages. ``classified`` (are there points of class 2?) and ``bare`` (are all these
    known to be ground?) are asked for after the first reading.
    """

    @property
    def name(self) -> str: ...

    @property
    def classified(self) -> bool: ...

    @property
    def bare(self) -> bool: ...

    def parts(self) -> Iterable[Float]:
        """The points (n, 3) in map coordinates, m, part by part; the same at each call."""
        ...


@dataclass(frozen=True)
class Screening:
    """What was found, voxel by voxel.

    ``points`` (m, 3) are the voxels' averages in map coordinates, m, and ``count`` (m,) their points; ``probabilities``
    (m, 3) of background, uplift and subsidence; ``labels`` (m,); ``heights`` (m,) over the trend, m, square to the
    slope's plane. A point has its voxel's probabilities, or those ``between`` the voxels about it; the ``raw`` ones are
    those before they were calibrated with the model's ``temperature``, which changes no label. ``decision`` tells the
    classes of voxels, points and cells; ``labels`` (m,) are the voxels'. ``method`` labelled them, and ``model`` are
    facts about it; ``ground_points`` is how many points were screened. ``detectable`` says what could have been found.
    Ground between voxels up to ``bridged`` m apart was judged with them.
    """

    points: Float
    count: NDArray[np.int64]
    probabilities: NDArray[np.float32]
    raw: NDArray[np.float32]
    temperature: float
    labels: NDArray[np.uint8]
    heights: NDArray[np.float32]
    voxels: SparseVoxels
    between: VoxelInterpolation | None
    decision: Decision
    plane: Plane
    suitability: Suitability
    method: str
    model: dict[str, Any]
    ground_points: int
    detectable: Detectability
    bridged: float

    @property
    def hidden(self) -> bool:
        """Whether no hazard is shown, because none could be found."""
        return self.decision.hidden

    def at(self, xyz: Float) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Label and its probability of points (n, 3) in map coordinates; both 0 where nothing was screened."""
        place = self.voxels.lookup(xyz)
        if self.between is None:
            probabilities = self.raw[place]
        else:
            flat = np.stack([flat_axis(self.voxels.matrix, xyz, axis) for axis in range(3)], axis=1)
            probabilities = self.between.at(flat, self.raw, self.model.get("threads", 1))
        probabilities = calibrated(probabilities, self.temperature)
        labels = self.decision.of_points(place, probabilities)
        own = np.take_along_axis(probabilities, labels[:, np.newaxis].astype(np.int64), axis=1)[:, 0]
        own = np.maximum(own, _MIN_PROBABILITY)
        labels[place < 0], own[place < 0] = BACKGROUND, 0.0
        return labels, own


def calibrated(probabilities: NDArray[np.float32], temperature: float) -> NDArray[np.float32]:
    """(n, 3) probabilities at the model's ``temperature``."""
    if temperature == 1.0 or not len(probabilities):
        return probabilities
    return apply_temperature(probabilities, temperature).astype(np.float32)
