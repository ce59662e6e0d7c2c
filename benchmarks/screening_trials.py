"""Hazards put into the ground of a place, and how strongly each detector answers at them and at untouched ground.

For each hazard the highest level at which it is found is kept, and for untouched ground the number of zones above each
of many levels, so that recall and false zones at any threshold follow without another run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from ..engine.core.arrays import Float
from ..engine.geometry.dominant_plane import apply_matrix
from ..engine.geometry.hazard_shapes import Hazard, smooth_hazard
from ..models.preparation.bump_filter import cell_heights
from ..models.preparation.even_scores import even_scores
from ..models.preparation.inserted_hazards import UPLIFT, Inserted, footprint, insert_hazards
from ..models.preparation.raster_zones import Scores, strength_at
from ..models.preparation.relief_channels import bump_scores
from ..models.preparation.relief_raster import ReliefRaster, laplacian_score, relief_raster
from ..models.preparation.smallest_hazard import SmallestHazard, smallest_hazard
from ..models.preparation.smallest_hazard import filter_scores as matched_filter
from .screening_ground import ELEVATION, Place

HEIGHTS_M = (0.15, 0.3, 0.5, 0.8, 1.2)
DIAMETERS_M = (2.0, 3.0, 5.0, 8.0)
ELEVATION_DIAMETERS_M = (5.0, 8.0)
NOTHING_M = 1e-6
"""Height of places that are named like hazards but hold nothing: how many are found says what the finds are worth among
true hazards, where a detector may see more than on untouched ground."""
_NOTHING_AS_M = 0.3
"""Their footprint is that of a hazard of this height."""
FILLED = 0.12
"""Share of the ground that is displaced at a time: more would be the ground rather than lie on it."""
_MAX_LOOKS = 60

Detector = Callable[[Place, ReliefRaster], dict[str, Scores]]
"""From ground points and their raster to score rasters of uplift and subsidence on the raster's cells, by name."""


@dataclass(frozen=True)
class Trial:
    """A hazard put in: height (m, signed), nominal diameter (m), where (m, flat frame), the A70 (m) of the place as the
    untouched ground predicts it, and the highest level at which each detector finds it.
    """

    place: str
    height: float
    diameter: float
    where: tuple[float, float]
    needed: float
    strength: dict[str, float]


@dataclass(frozen=True)
class PlaceResult:
    """Untouched scores by detector and the trials of one place; ``area`` in m². ``needed`` (m) is the median A70 of the
    place at the width that is found most easily.
    """

    place: Place
    area: float
    needed: float
    scores: dict[str, Scores]
    trials: list[Trial] = field(default_factory=list)


def filter_scores(place: Place, raster: ReliefRaster) -> dict[str, Scores]:
    """The detectors that learn nothing: residual, Laplacian of Gaussian over roughness, and the matched filter by
    heights, by t at one width, by the strongest t of plain least squares, of robust fits, and by that over its scatter.
    """
    cell = raster.cell
    laplacians = [laplacian_score(raster, fit.diameter) for fit in raster.bumps]
    cells = cell_heights(place.flat, cell, raster.origin, raster.shape)
    three = min(raster.bumps, key=lambda fit: abs(fit.diameter - (5.0 if place.kind == ELEVATION else 3.0)))
    return {
        "residual 4 m": Scores.signed(raster.height, cell),
        "LoG": Scores.strongest(laplacians, cell),
        "filter, heights": Scores.signed(three.amplitude, cell),
        "filter, t of one width": Scores.signed(three.t, cell),
        "filter, linear t": Scores.strongest(list(bump_scores(cells)), cell),
        "filter, t": matched_filter(raster),
        "filter, even t": even_scores(raster),
    }


def network_scores(predict: Callable[[Float], NDArray[np.floating]]) -> Detector:
    """A network's probabilities (n, 3) of the points in map coordinates, averaged in the cells of the raster."""

    def scores(place: Place, raster: ReliefRaster) -> dict[str, Scores]:
        xyz = apply_matrix(np.asarray(np.linalg.inv(place.matrix), dtype=np.float64), place.flat)
        probability = predict(xyz)
        up, down = (cell_means(place.flat, probability[:, k], raster) for k in (1, 2))
        return {"RandLA-Net, shipped": Scores(up, down, raster.cell)}

    return scores


def cell_means(flat: Float, values: NDArray[np.floating], raster: ReliefRaster) -> Float:
    """Means (columns, rows) of values (n,) of the points in each cell; empty cells take the nearest one's within the
    covered ground, NaN beyond.
    """
    i, j = raster.index(flat)
    key = i * raster.shape[1] + j
    cells = raster.shape[0] * raster.shape[1]
    count = np.bincount(key, minlength=cells).reshape(raster.shape)
    total = np.bincount(key, weights=values, minlength=cells).reshape(raster.shape)
    near = distance_transform_edt(count == 0, return_distances=False, return_indices=True)
    mean = (total / np.maximum(count, 1))[near[0], near[1]]
    return np.where(raster.covered, mean, np.nan)


def try_place(place: Place, detectors: Sequence[Detector], count: int, seed: int = 0) -> PlaceResult:
    """Put ``count`` hazards of each height and diameter into a place, some at a time, half of them bulges, and let the
    detectors score untouched and changed ground.
    """
    raster = relief_raster(place.flat)
    needed = smallest_hazard(raster)
    result = PlaceResult(place, raster.area, easiest(needed), _scores(place, raster, detectors))
    rng = np.random.default_rng([seed, len(place.flat)])
    waiting = _wanted(place, count, rng)
    for _ in range(_MAX_LOOKS):
        if not waiting:
            break
        now, rest = _that_fit(waiting, FILLED * raster.area)
        scene = insert_hazards(place.flat, now, rng)
        if not scene.hazards:
            break
        result.trials.extend(_trials(place, scene, now, needed, detectors))
        taken = {one.number for one in scene.hazards}
        left = [hazard for number, hazard in enumerate(now) if number not in taken]
        # Those that found no room wait for the next look, behind the others.
        waiting = rest + left
    return result


def easiest(needed: SmallestHazard) -> float:
    """The lowest of the widths' median A70, m; infinite where no width could be fitted."""
    known = [values[np.isfinite(values)] for values in needed.heights]
    return min((float(np.median(values)) for values in known if len(values)), default=math.inf)


def _scores(place: Place, raster: ReliefRaster, detectors: Sequence[Detector]) -> dict[str, Scores]:
    found: dict[str, Scores] = {}
    for detector in detectors:
        found |= detector(place, raster)
    return found


def _wanted(place: Place, count: int, rng: np.random.Generator) -> list[Hazard]:
    diameters = ELEVATION_DIAMETERS_M if place.kind == ELEVATION else DIAMETERS_M
    drawn = [
        smooth_hazard((-1) ** k * height, diameter, rng)
        for k in range(count)
        for height in (NOTHING_M, *HEIGHTS_M)
        for diameter in diameters
    ]
    return [drawn[k] for k in rng.permutation(len(drawn))]


def _that_fit(waiting: list[Hazard], area: float) -> tuple[list[Hazard], list[Hazard]]:
    """The first hazards that together are not larger than ``area`` (m²), at least one, and the rest."""
    sizes = np.cumsum([np.pi * hazard.half_u * hazard.half_w for hazard in waiting])
    number = max(1, int(np.searchsorted(sizes, area, side="right")))
    return waiting[:number], waiting[number:]


def _trials(
    place: Place, scene: Inserted, wanted: list[Hazard], needed: SmallestHazard, detectors: Sequence[Detector]
) -> list[Trial]:
    changed = Place(place.name, place.group, place.kind, scene.flat, place.matrix)
    raster = relief_raster(scene.flat)
    scores = _scores(changed, raster, detectors)
    found = []
    for one in scene.hazards:
        height, diameter = wanted[one.number].height, round(one.diameter, 3)
        nothing = abs(height) <= NOTHING_M
        shape = replace(one.shape, height=math.copysign(_NOTHING_AS_M, height)) if nothing else one.shape
        up, down = footprint(shape, raster.origin, raster.cell, raster.shape)
        mine = (up if one.label == UPLIFT else down) & raster.covered
        strengths = {
            name: strength_at(score.uplift if one.label == UPLIFT else score.subsidence, mine, raster.cell)
            for name, score in scores.items()
        }
        i, j = raster.index(np.array([[one.shape.u, one.shape.w]]))
        here = needed.at(int(i[0]), int(j[0]), diameter)
        found.append(Trial(place.name, height, diameter, (one.shape.u, one.shape.w), here, strengths))
    return found
