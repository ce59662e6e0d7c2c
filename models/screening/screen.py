"""Screening of one survey: which ground is raised or lowered against the slope around it.

The cloud is averaged in voxels, which is all that is held of it (see ``preparation.streaming``); a network, or a
method without learning, gives each voxel its probabilities, and a point has those of its voxel or of the few about it.
Methods on the slope's raster decide by zones, others by the most probable class (``labels.Decision``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float
from ...engine.core.errors import InputError
from ...engine.core.progress import Progress
from ...engine.geometry.columns import spans
from ...engine.geometry.dominant_plane import Plane, apply_matrix
from ...engine.ground.pdal_pipelines import GROUND, NOISE
from ...interface.parameters import AUTO, ScreeningParameters
from ..configuration import ZONES
from ..inference.baseline import TREND, residual_configuration, residual_memberships
from ..inference.interpolation import VoxelInterpolation
from ..preparation import even_scores, point_scores, relative_scores
from ..preparation.bump_filter import cell_heights
from ..preparation.relief_raster import MAX_GAP_M, ReliefRaster, relief_raster
from ..preparation.suitability import Suitability, measure, refuse_unsuitable
from .detectability import PART_M, Detectability, detectability
from .filter import FILTER_DENSITY, filter_memberships
from .labels import Decision, zone_labels
from .method import learned_model, with_method
from .much_marked import warn_if_much_stands_out
from .network import ScreeningModel, memory_reported
from .relief import RELIEF_DENSITY, ReliefModel
from .result import GroundPoints, Screening, calibrated

MAX_AREA_M2 = 100e6
"""Of the rectangle around a cloud: each square metre takes memory."""
BY_RASTER = ("relief", "filter")
"""Methods that screen the slope's raster, made of the same averages that are labelled."""

if TYPE_CHECKING:
    from ..configuration import ModelConfiguration
    from ..preparation.prepare import PreparedCloud
    from ..preparation.streaming import Sample
    from ..preparation.voxel_sums import SparseVoxels


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
            another density than the method was made for; torch or the weights are missing.
        EngineError: memory ran out.
    """
    from ..preparation.streaming import prepare_parts, sample_parts, sum_parts

    progress = progress or Progress()
    parameters = _settled(parameters, progress)
    method = parameters.screening_method
    model = learned_model(parameters)
    configuration = model.configuration if isinstance(model, ScreeningModel) else _configuration(method)
    by_zones = method in BY_RASTER or (method == "network" and configuration.decision == ZONES)
    with memory_reported():
        with progress.stage(0.0, 0.15, "reading"):
            sample = sample_parts(ground.parts, ground.name)
        with progress.stage(0.15, 0.2, "checking the slope"):
            suitability, frame = _suitable(ground, sample, parameters, configuration, progress)
        with progress.stage(0.2, 0.35, "averaging in voxels"):
            cloud, voxels = prepare_parts(ground.parts, sample, configuration, spread=method == "relief", frame=frame)
        with progress.stage(0.35, 0.4, "measuring what can be found"):
            parts = voxels if method in BY_RASTER else sum_parts(ground.parts, cloud.matrix, PART_M)
            raster = relief_raster(parts.grid.points, number=parts.grid.count)
            held = parts if by_zones else voxels
            detectable = detectability(raster, held.grid.points, parameters.false_zones, method)
        least = _least_probability(detectable, parameters, ground.name, progress)
        heights = _heights(held.grid.points, cloud, configuration)
        with progress.stage(0.4, 1.0, "screening"):
            if isinstance(model, ScreeningModel):
                found = _by_points(model, cloud, held if by_zones else None, raster, parameters, progress)
            elif method in BY_RASTER:
                found = _by_raster(model, cloud, voxels, raster, parameters, progress)
            else:
                found = _Found(residual_memberships(heights, parameters.residual_threshold), {"name": method})
        probabilities = calibrated(found.raw, found.temperature)
        decision = Decision(least, found.zones)
        labels = decision.of_voxels(probabilities)
        warn_if_much_stands_out(labels, held.grid.count, progress)
        return Screening(
            points=apply_matrix(np.asarray(np.linalg.inv(cloud.matrix), dtype=np.float64), held.grid.points),
            count=held.grid.count,
            probabilities=probabilities,
            raw=found.raw,
            temperature=found.temperature,
            labels=labels,
            heights=heights,
            voxels=held,
            between=_interpolation(cloud, configuration) if method == "network" and not by_zones else None,
            decision=decision,
            plane=cloud.plane,
            suitability=suitability,
            method=method,
            model=found.facts,
            ground_points=sample.points,
            detectable=detectable,
            bridged=MAX_GAP_M if by_zones else configuration.voxel,
        )


def _settled(parameters: ScreeningParameters, progress: Progress) -> ScreeningParameters:
    """The parameters with a method; says which, where it was left open."""
    settled = with_method(parameters)
    if parameters.screening_method == AUTO:
        progress.info(f"Screening by the method {settled.screening_method}.")
    return settled


def _heights(points: Float, cloud: PreparedCloud, configuration: ModelConfiguration) -> NDArray[np.float32]:
    """Heights (m,) of points (m, 3) in the flat frame over the trend, m."""
    from ..preparation.trends import residual_heights

    if points is cloud.voxels.points and TREND in configuration.trends and not configuration.own_roughness:
        return cloud.residuals[:, configuration.trends.index(TREND)]
    return residual_heights(points, *TREND).astype(np.float32)


@dataclass(frozen=True)
class _Found:
    """What a method says of the voxels: probabilities ``raw`` (m, 3) before ``temperature``, and their ``zones`` (m,)
    where it decides by such; ``facts`` about what said it.
    """

    raw: NDArray[np.float32]
    facts: dict[str, Any]
    temperature: float = 1.0
    zones: NDArray[np.uint8] | None = None


def _configuration(method: str) -> ModelConfiguration:
    """How a cloud is prepared for all methods but the network on points."""
    if method in BY_RASTER:
        return replace(residual_configuration(PART_M), name=method)
    return residual_configuration()


def _densities(method: str, configuration: ModelConfiguration) -> tuple[float, float] | None:
    """Least and most points a m² that a method is made for; None: any."""
    made_for = {"network": configuration.density, "relief": RELIEF_DENSITY, "filter": FILTER_DENSITY}
    return made_for.get(method)


def _by_raster(
    model: ScreeningModel | ReliefModel | None,
    cloud: PreparedCloud,
    voxels: SparseVoxels,
    raster: ReliefRaster,
    parameters: ScreeningParameters,
    progress: Progress,
) -> _Found:
    """What the network on relief, if that is the model, or the filter says of the slope's raster."""
    if isinstance(model, ReliefModel):
        points, count = cloud.voxels.points, cloud.voxels.count
        cells = cell_heights(points, raster.cell, raster.origin, raster.shape, count, voxels.spread)
        relief = model.found(cells, progress)
        scores, probabilities = relief.scores, relief.probabilities
        level, facts = relative_scores.level_for(parameters.false_zones), model.facts()
    else:
        level, facts = even_scores.level_for(parameters.false_zones), {"name": "filter"}
        scores = even_scores.even_scores(raster)
        probabilities = filter_memberships(scores, level)
    zones = zone_labels(scores, level, probabilities, parameters.minimum_probability)
    i, j = raster.index(cloud.voxels.points)
    return _Found(probabilities[:, i, j].T, facts | {"level": level}, zones=zones[i, j])


def _by_points(
    model: ScreeningModel,
    cloud: PreparedCloud,
    parts: SparseVoxels | None,
    raster: ReliefRaster,
    parameters: ScreeningParameters,
    progress: Progress,
) -> _Found:
    """What the network on points says: of its own voxels, or of the ``parts`` of the raster's cells by zones."""
    raw, facts = model.probabilities(cloud, progress), model.facts()
    if parts is None:
        return _Found(raw, facts, model.temperature)
    between = _interpolation(cloud, model.configuration) or VoxelInterpolation(cloud.voxels.points, 1.0, 1)
    raw = between.at(parts.grid.points, raw, model.threads)
    place = raster.index(parts.grid.points)

    def in_cells(values: NDArray[np.floating]) -> Float:
        return point_scores.cell_means(values, place, parts.grid.count, raster.covered)

    level = point_scores.level_for(parameters.false_zones)
    scores = point_scores.point_scores(in_cells(raw), raster.cell)
    told = in_cells(calibrated(raw, model.temperature))
    zones = zone_labels(scores, level, told, parameters.minimum_probability)
    return _Found(raw, facts | {"level": level}, model.temperature, zones[place])


def _least_probability(
    detectable: Detectability, parameters: ScreeningParameters, name: str, progress: Progress
) -> float:
    """What a hazard's probability must reach to be shown; nothing does where nothing can be found. Says what can be."""
    if detectable.shown or parameters.any_relief:
        if detectable.doubtful:
            progress.warning(detectable.doubt_sentence(name))
        progress.info(detectable.sentence())
        return parameters.minimum_probability
    progress.warning(detectable.hidden_sentence(name))
    return float("inf")


def _interpolation(cloud: PreparedCloud, configuration: ModelConfiguration) -> VoxelInterpolation | None:
    """As ``inference.prediction.predict`` does it."""
    if configuration.interpolation <= 1:
        return None
    return VoxelInterpolation(cloud.voxels.points, configuration.voxel, configuration.interpolation)


def _suitable(
    ground: GroundPoints,
    sample: Sample,
    parameters: ScreeningParameters,
    configuration: ModelConfiguration,
    progress: Progress,
) -> tuple[Suitability, tuple[Plane, Float]]:
    """What was measured of the slope, and its frame; InputError where it cannot be screened."""
    width, depth = spans(sample.xyz[:, :2]).tolist()
    if width * depth > MAX_AREA_M2:
        raise InputError(
            f"{ground.name} spans {width / 1000:.0f} x {depth / 1000:.0f} km, too much to screen at once; cut it with "
            "--roi."
        )
    suitability, frame = _measured(sample.xyz, sample.points / len(sample.xyz), configuration)
    refuse_unsuitable(
        suitability,
        parameters,
        ground.name,
        density=_densities(parameters.screening_method, configuration),
        classified=ground.classified,
        bare=ground.bare,
        progress=progress,
    )
    return suitability, frame


def _measured(xyz: Float, thinned: float, configuration: ModelConfiguration) -> tuple[Suitability, tuple[Plane, Float]]:
    from ..preparation.prepare import flat_frame

    plane, matrix = flat_frame(xyz, configuration)
    return measure(xyz, apply_matrix(matrix, xyz), plane, thinned), (plane, matrix)
