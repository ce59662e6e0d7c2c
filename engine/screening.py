"""Screening of one survey: which ground is raised or lowered against the slope around it.

The cloud is averaged in voxels, which is all that is held of it (see ``models.streaming``); the network, or a threshold
without learning, gives each voxel its probabilities, and a point has those of its voxel or of the few about it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .clouds import PointCloud
from .hazard_zones import BACKGROUND, Hazards, most_probable, outline_hazards
from .parameters import ScreeningParameters
from .pipelines import GROUND, NOISE
from .plane import Plane, apply_matrix
from .preflight import shown
from .progress import Progress
from .screening_checks import Suitability, measure, refuse_unsuitable, warn_if_much_stands_out
from .screening_model import ScreeningModel, memory_told

if TYPE_CHECKING:
    from ..models.configuration import ModelConfiguration
    from ..models.interpolation import VoxelInterpolation
    from ..models.voxel_sums import SparseVoxels

Float = NDArray[np.float64]
TREND = (4.0, 4.0)
"""Reach (m) along and up the slope of the trend that heights are told over."""

_LEAST_TOLD = np.float32(1e-6)
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
    those before they were calibrated with the model's ``temperature``, which changes no label. Hazards less probable
    than ``least`` are background. ``model`` are facts about what labelled them; ``ground_points`` how many
    points were screened.
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
    least: float
    plane: Plane
    suitability: Suitability
    model: dict[str, Any]
    ground_points: int

    def at(self, xyz: Float) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Label and its probability of points (n, 3) in map coordinates; both 0 where nothing was screened."""
        from ..models.voxel_sums import flat_axis

        place = self.voxels.lookup(xyz)
        if self.between is None:
            probabilities = self.raw[place]
        else:
            flat = np.stack([flat_axis(self.voxels.matrix, xyz, axis) for axis in range(3)], axis=1)
            probabilities = self.between.at(flat, self.raw, self.model.get("threads", 1))
        probabilities = _calibrated(probabilities, self.temperature)
        labels = most_probable(probabilities, self.least)
        own = np.take_along_axis(probabilities, labels[:, np.newaxis].astype(np.int64), axis=1)[:, 0]
        own = np.maximum(own, _LEAST_TOLD)
        labels[place < 0], own[place < 0] = BACKGROUND, 0.0
        return labels, own


def screen_cloud(
    cloud: PointCloud,
    parameters: ScreeningParameters | None = None,
    *,
    run_id: str = "",
    progress: Progress | None = None,
) -> tuple[Screening, Hazards]:
    """Screen a ground cloud in memory.

    Args:
        cloud: ground points; ``ground`` class_2 takes those of class 2, extract is not for here.

    Returns:
        The screening, and its rasters and zones (``Hazards.frame``).

    Raises:
        InputError: see ``screen_points``.
        EngineError: memory ran out.
    """
    parameters, progress = parameters or ScreeningParameters(), progress or Progress()
    with progress.stage(0.0, 0.95, "screening"):
        screening = screen_points(_InMemory(cloud, parameters.ground), parameters, progress)
    with progress.stage(0.95, 1.0, "outlining zones"):
        hazards = outline_hazards(screening, cloud.crs, parameters, run_id=run_id)
    return screening, hazards


def chosen_by_class(labels: NDArray[np.uint8], ground: str) -> NDArray[np.bool_]:
    """Which points (n,) ``ScreeningParameters.ground`` takes: class_2 those of that class, auto all but known noise."""
    if ground == "class_2":
        return labels == GROUND
    if ground == "auto":
        return ~np.isin(labels, NOISE)
    return np.ones(len(labels), dtype=bool)


class _InMemory:
    def __init__(self, cloud: PointCloud, ground: str) -> None:
        labels = np.zeros(len(cloud), np.uint8) if cloud.classification is None else cloud.classification
        chosen = chosen_by_class(labels, ground)
        self.name = shown(cloud.path)
        self.xyz = cloud.xyz if chosen.all() else cloud.xyz[chosen]
        self.classified = bool((labels == GROUND).any())
        self.bare = self.classified and bool((labels[chosen] == GROUND).all())

    def parts(self) -> Iterable[Float]:
        yield self.xyz


def screen_points(ground: GroundPoints, parameters: ScreeningParameters, progress: Progress | None = None) -> Screening:
    """Screen ground points that are read in parts, twice.

    Raises:
        InputError: too few points; coordinates that are not numbers; not one slope, or not its bare ground, or of
            another density than the network was made for; torch or the weights are missing.
        EngineError: memory ran out.
    """
    from ..models.baseline import residual_configuration, residual_memberships
    from ..models.streaming import prepare_parts, sample_parts
    from ..models.trends import residual_heights

    progress = progress or Progress()
    model = ScreeningModel(parameters) if parameters.screening_method == "network" else None
    configuration = residual_configuration(TREND) if model is None else model.configuration
    with memory_told():
        with progress.stage(0.0, 0.15, "reading"):
            sample = sample_parts(ground.parts, ground.name)
        with progress.stage(0.15, 0.2, "checking the slope"):
            suitability, plane = _measured(sample.xyz, sample.points / len(sample.xyz), configuration)
            refuse_unsuitable(
                suitability,
                parameters,
                ground.name,
                density=None if model is None else configuration.density,
                classified=ground.classified,
                bare=ground.bare,
                progress=progress,
            )
        with progress.stage(0.2, 0.4, "averaging in voxels"):
            cloud, voxels = prepare_parts(ground.parts, sample, configuration)
        if TREND in configuration.trends and not configuration.own_roughness:
            heights = cloud.residuals[:, configuration.trends.index(TREND)]
        else:
            heights = residual_heights(cloud.voxels.points, *TREND).astype(np.float32)
        with progress.stage(0.4, 1.0, "screening"):
            if model is None:
                raw, temperature = residual_memberships(heights, parameters.residual_threshold), 1.0
                facts: dict[str, Any] = {"name": "residual"}
            else:
                raw, temperature = model.probabilities(cloud, progress), model.temperature
                facts = model.facts()
        probabilities = _calibrated(raw, temperature)
        labels = most_probable(probabilities, parameters.minimum_probability)
        warn_if_much_stands_out(labels, cloud.voxels.count, progress)
        return Screening(
            points=apply_matrix(_inverse(cloud.matrix), cloud.voxels.points),
            count=cloud.voxels.count,
            probabilities=probabilities,
            raw=raw,
            temperature=temperature,
            labels=labels,
            heights=heights,
            voxels=voxels,
            between=None if model is None else _interpolation(cloud.voxels.points, configuration),
            least=parameters.minimum_probability,
            plane=plane,
            suitability=suitability,
            model=facts,
            ground_points=sample.points,
        )


def _calibrated(probabilities: NDArray[np.float32], temperature: float) -> NDArray[np.float32]:
    from ..models.calibration import apply_temperature

    if temperature == 1.0 or not len(probabilities):
        return probabilities
    return apply_temperature(probabilities, temperature).astype(np.float32)


def _interpolation(points: Float, configuration: ModelConfiguration) -> VoxelInterpolation | None:
    """As ``models.prediction.predict`` does it."""
    from ..models.interpolation import VoxelInterpolation

    if configuration.interpolation <= 1:
        return None
    return VoxelInterpolation(points, configuration.voxel, configuration.interpolation)


def _measured(xyz: Float, thinned: float, configuration: ModelConfiguration) -> tuple[Suitability, Plane]:
    from ..models.preparation import flat_frame

    plane, matrix = flat_frame(xyz, configuration)
    return measure(xyz, apply_matrix(matrix, xyz), plane, thinned), plane


def _inverse(matrix: Float) -> Float:
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)
