"""The ground of a cloud in memory: without outliers, near the cloth, refined, judged; ``extraction`` reads files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...interface.parameters import GroundParameters
from ..core.arrays import Bool, Float
from ..geometry.dominant_plane import apply_matrix, flattening_matrix
from ..geometry.point_spacing import point_spacing
from ..pointcloud import plant_cover
from ..pointcloud.returns import Returns
from . import pdal_pipelines
from .cloth import cloth_ground, refuse_large_cloth
from .cover import GroundCover, cover_facts, cover_warnings
from .doubts import Found, ground_doubts
from .filtering import Filtered, cloth_threshold, dominant_plane, refined, require_points
from .findings import refuse_implausible, returns_warning, spacing_warning
from .labelled_clouds import Dimensions, plant_dimensions
from .outliers import outliers
from .result import HEIGHT_OVER_GROUND
from .survey import Clipped

Warn = Callable[[str], None]


@dataclass(frozen=True)
class Rules:
    """What a cloud is called in messages, its ``parameters``, and what receives the warnings."""

    name: str
    parameters: GroundParameters
    warn: Warn

    def say(self, sentence: str) -> None:
        """A warning, unless it is empty."""
        if sentence:
            self.warn(sentence)


@dataclass(frozen=True)
class GroundOfPoints:
    """Ground among points (n, 3).

    Attributes:
        mask: (n,) which of them are ground.
        survey: the points without their outliers, and the slope's plane.
        filtered: scatter and threshold of the refinement, metres, and which of these points are ground.
        dimensions: of the ground's points, metres; empty without the refinement.
        cover: what covers the ground, None where that is not known.
    """

    mask: Bool
    survey: Clipped
    filtered: Filtered
    dimensions: Dimensions
    cover: GroundCover | None


def ground_of_points(
    name: str, xyz: Float, returns: Returns, labels: NDArray[np.uint8], parameters: GroundParameters, warn: Warn
) -> GroundOfPoints:
    """The ground by our own cloth simulation.

    Args:
        name: of the cloud, for messages.
        xyz: (n, 3) all returns, metres.
        labels: (n,) classes, of which those of noise are outliers.

    Raises:
        InputError: too few points, no ground or too little to be true, or a cloth too large.
    """
    rules = Rules(name, parameters, warn)
    survey = without_outliers(rules, xyz, returns, labels)
    taken = taking_part(rules, survey.returns)
    filtered = refined(survey.flat, near_cloth(survey, taken, parameters), taken, parameters)
    judge(rules, filtered, survey, taken)
    every = plant_dimensions(filtered, survey.plane.dip)
    mask = survey.keep.copy()
    mask[survey.keep] = filtered.ground
    of_ground = {name: values[filtered.ground] for name, values in every.items()}
    return GroundOfPoints(mask, survey, filtered, of_ground, cover_of(rules, survey, filtered.ground, every))


def without_outliers(rules: Rules, xyz: Float, returns: Returns, labels: NDArray[np.uint8]) -> Clipped:
    """The points in the slope's frame without those that are far from all others, or of a class of noise."""
    parameters = rules.parameters
    plane = dominant_plane(xyz)
    flat = apply_matrix(flattening_matrix(plane), xyz)
    keep, removed = np.ones(len(xyz), dtype=bool), np.empty((0, 3))
    if parameters.denoise:
        noise = outliers(flat, parameters.denoise_radius, parameters.denoise_group)
        keep = ~(noise | np.isin(labels, pdal_pipelines.NOISE))
    if not keep.all():
        removed, xyz, flat = flat[~keep], xyz[keep], flat[keep]
        returns = replace(returns, last=returns.last[keep])
    require_points(f"{rules.name} without its outliers", len(xyz))
    spacing = point_spacing(xyz)
    rules.say(spacing_warning(rules.name, spacing, parameters))
    return Clipped(keep, xyz, flat, removed, returns, plane, spacing)


def taking_part(rules: Rules, returns: Returns) -> Bool:
    """(n,) the points that may be ground."""
    if not rules.parameters.last_returns:
        return np.ones(len(returns.last), dtype=bool)
    rules.say(returns_warning(rules.name, returns, rules.parameters))
    return returns.last


def cloth_frame(survey: Clipped, taken: Bool, parameters: GroundParameters) -> Float:
    """(m, 3) the points that the cloth is laid over, in the frame that it falls in; one too large is refused."""
    aligned = (survey.flat if parameters.slope_aligned else survey.xyz)[taken]
    refuse_large_cloth(aligned, parameters.cloth_resolution)
    return aligned


def near_cloth(survey: Clipped, taken: Bool, parameters: GroundParameters) -> Bool:
    """(n,) points near our own cloth."""
    near = np.zeros(len(taken), dtype=bool)
    aligned = cloth_frame(survey, taken, parameters)
    near[taken] = cloth_ground(aligned, parameters, threshold=cloth_threshold(parameters))
    return near


def judge(rules: Rules, filtered: Filtered, survey: Clipped, taken: Bool) -> None:
    """Refuse what cannot be the ground, and warn of what may not be."""
    found = int(np.count_nonzero(filtered.ground))
    refuse_implausible(rules.name, found, len(survey.flat), rules.parameters)
    height, error = filtered.height, filtered.plant_error
    doubted = Found(survey.flat, filtered.ground, taken, height, error, survey.removed, filtered.threshold)
    for sentence in ground_doubts(rules.name, doubted, survey.returns.lost):
        rules.say(sentence)


def cover_of(rules: Rules, survey: Clipped, ground: Bool, dimensions: Dimensions) -> GroundCover | None:
    """What covers the ground, where its heights are known; and the warnings about it."""
    if not dimensions:
        return None
    lengths = (
        dimensions[name].astype(np.float64) for name in (HEIGHT_OVER_GROUND, plant_cover.ERROR, plant_cover.HEIGHT)
    )
    cover = cover_facts(survey.xyz, ground, *lengths, dip=survey.plane.dip)
    for sentence in cover_warnings(cover, rules.name):
        rules.say(sentence)
    return cover
