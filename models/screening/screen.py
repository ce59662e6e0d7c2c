"""Screening of one survey: which ground is raised or lowered against the slope around it.

The cloud is averaged in voxels, which is all that is held of it (see ``preparation.streaming``); the network, or a
threshold without learning, gives each voxel its probabilities, and a point has those of its voxel or of the few about
it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float
from ...engine.core.progress import Progress
from ...engine.geometry.dominant_plane import Plane, apply_matrix
from ...engine.ground.pdal_pipelines import GROUND, NOISE
from ...interface.parameters import ScreeningParameters
from ..inference.baseline import TREND, residual_configuration, residual_memberships
from ..preparation.even_scores import level_for
from ..preparation.relief_raster import MAX_GAP_M, ReliefRaster, relief_raster
from ..preparation.suitability import Suitability, measure, refuse_unsuitable
from .detectability import PART_M, Detectability, detectability, parts_raster
from .filter import FILTER_DENSITY, filter_memberships
from .labels import most_probable
from .much_marked import warn_if_much_stands_out
from .network import ScreeningModel, memory_reported
from .result import GroundPoints, Screening, calibrated

if TYPE_CHECKING:
    from ..configuration import ModelConfiguration
    from ..inference.interpolation import VoxelInterpolation
    from ..preparation.prepare import PreparedCloud


def chosen_by_class(labels: NDArray[np.uint8], ground: str) -> NDArray[np.bool_]:
    """Which points (n,) ``ScreeningParameters.ground`` takes: class_2 those of that class, auto all but known noise."""
    if ground == "class_2":
        return labels == GROUND
    if ground == "auto":
        return ~np.isin(labels, NOISE)
    return np.ones(len(labels), dtype=bool)


def screen_points(ground: GroundPoints, parameters: ScreeningParameters, progress: Progress | None = None) -> Screening:
    """Screen ground points that are read in parts, twice.

    Raises:
        InputError: too few points; coordinates that are not numbers; not one slope, or not its bare ground, or of
            another density than the network was made for; torch or the weights are missing.
        EngineError: memory ran out.
    """
    from ..preparation.streaming import prepare_parts, sample_parts
    from ..preparation.trends import residual_heights

    progress = progress or Progress()
    method = parameters.screening_method
    model = ScreeningModel(parameters) if method == "network" else None
    configuration = _configuration(method) if model is None else model.configuration
    with memory_reported():
        with progress.stage(0.0, 0.15, "reading"):
            sample = sample_parts(ground.parts, ground.name)
        with progress.stage(0.15, 0.2, "checking the slope"):
            suitability, plane = _measured(sample.xyz, sample.points / len(sample.xyz), configuration)
            refuse_unsuitable(
                suitability,
                parameters,
                ground.name,
                density=_densities(method, configuration),
                classified=ground.classified,
                bare=ground.bare,
                progress=progress,
            )
        with progress.stage(0.2, 0.35, "averaging in voxels"):
            cloud, voxels = prepare_parts(ground.parts, sample, configuration)
        with progress.stage(0.35, 0.4, "measuring what can be found"):
            # what the filter labels are the same averages
            raster = (
                relief_raster(cloud.voxels.points, number=cloud.voxels.count)
                if method == "filter"
                else parts_raster(ground.parts, cloud.matrix)
            )
            detectable = detectability(raster, cloud.voxels.points, parameters.false_zones)
        least = _least_probability(detectable, parameters, ground.name, progress)
        if TREND in configuration.trends and not configuration.own_roughness:
            heights = cloud.residuals[:, configuration.trends.index(TREND)]
        else:
            heights = residual_heights(cloud.voxels.points, *TREND).astype(np.float32)
        with progress.stage(0.4, 1.0, "screening"):
            raw, temperature, facts = _memberships(model, cloud, heights, raster, parameters, progress)
        probabilities = calibrated(raw, temperature)
        labels = most_probable(probabilities, least)
        warn_if_much_stands_out(labels, cloud.voxels.count, progress)
        return Screening(
            points=apply_matrix(np.asarray(np.linalg.inv(cloud.matrix), dtype=np.float64), cloud.voxels.points),
            count=cloud.voxels.count,
            probabilities=probabilities,
            raw=raw,
            temperature=temperature,
            labels=labels,
            heights=heights,
            voxels=voxels,
            between=None if model is None else _interpolation(cloud.voxels.points, configuration),
            least=least,
            plane=plane,
            suitability=suitability,
            model=facts,
            ground_points=sample.points,
            detectable=detectable,
            bridged=MAX_GAP_M if method == "filter" else configuration.voxel,
        )


def _configuration(method: str) -> ModelConfiguration:
    """How a cloud is prepared for a method that has learnt nothing."""
    if method == "filter":
        return replace(residual_configuration(PART_M), name="filter")
    return residual_configuration()


def _densities(method: str, configuration: ModelConfiguration) -> tuple[float, float] | None:
    """Least and most points a m² that a method is made for; None: any."""
    return {"network": configuration.density, "filter": FILTER_DENSITY}.get(method)


def _memberships(
    model: ScreeningModel | None,
    cloud: PreparedCloud,
    heights: NDArray[np.float32],
    raster: ReliefRaster,
    parameters: ScreeningParameters,
    progress: Progress,
) -> tuple[NDArray[np.float32], float, dict[str, Any]]:
    """(m, 3) of the voxels by the chosen method, their temperature, and facts about what gave them."""
    if model is not None:
        return model.probabilities(cloud, progress), model.temperature, model.facts()
    if parameters.screening_method == "filter":
        level = level_for(parameters.false_zones)
        found = filter_memberships(raster, level, cloud.voxels.points)
        return found, 1.0, {"name": "filter", "level": level}
    return residual_memberships(heights, parameters.residual_threshold), 1.0, {"name": "residual"}


def _least_probability(
    detectable: Detectability, parameters: ScreeningParameters, name: str, progress: Progress
) -> float:
    """What a hazard's probability must reach to be shown; nothing does where nothing can be found. Says what can be."""
    if detectable.shown(parameters.screening_method) or parameters.any_relief:
        if detectable.doubtful:
            progress.warning(detectable.doubt_sentence(name))
        progress.info(detectable.sentence(parameters.screening_method))
        return parameters.minimum_probability
    progress.warning(detectable.hidden_sentence(name))
    return float("inf")


def _interpolation(points: Float, configuration: ModelConfiguration) -> VoxelInterpolation | None:
    """As ``inference.prediction.predict`` does it."""
    from ..inference.interpolation import VoxelInterpolation

    if configuration.interpolation <= 1:
        return None
    return VoxelInterpolation(points, configuration.voxel, configuration.interpolation)


def _measured(xyz: Float, thinned: float, configuration: ModelConfiguration) -> tuple[Suitability, Plane]:
    from ..preparation.prepare import flat_frame

    plane, matrix = flat_frame(xyz, configuration)
    return measure(xyz, apply_matrix(matrix, xyz), plane, thinned), plane
