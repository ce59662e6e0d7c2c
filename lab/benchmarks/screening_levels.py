"""Levels of a detector's scores by ground without hazards, and what is found and false at them.

There are two pools, elevation models and all other ground: one level must hold on real clouds and on simulated slopes.
Each survey is left out in turn. A level is set by untouched ground; another one by changed ground, that is by zones of
the scenes with hazards that do not come near any of them, which a detector that sees hazards everywhere in a scene that
holds some does not pass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from ...engine.core.arrays import Bool, Float, Float32
from ...models.preparation.raster_zones import (
    PER_M2,
    Scores,
    common_levels,
    level_for_rate,
    zone_counts,
    zones_above,
)
from .screening_ground import ELEVATION
from .screening_trials import PlaceResult, strengths

SEEN_M = 1.0
"""A70 of the most easily found width beyond which a place sets no threshold."""
NEAR_M = 2.0
"""Zones of changed ground that come as near to a hazard's footprint are not counted as false."""


@dataclass(frozen=True)
class SiteFigures:
    """Levels of a detector at a place: from untouched ground of the ``others`` and of its ``own``, and the same from
    changed ground. ``false_others`` and ``false_own`` are zones per 1,000 m² of its untouched ground at the first two,
    ``false_changed`` those of its changed ground at ``others``. Areas in m².
    """

    others: float
    own: float
    changed_others: float
    changed_own: float
    false_others: float
    false_own: float
    false_changed: float
    area: float
    changed_area: float


@dataclass(frozen=True)
class Measured:
    """One run of a detector: its figures and, for each trial, the highest level at which it is found, by place."""

    figures: dict[str, SiteFigures]
    strength: dict[str, Float]

    def found(self, place: str, level: str = "others") -> Bool:
        """(trials,) whether those of a place are found at one of the levels of ``SiteFigures``."""
        return np.asarray(self.strength[place] > getattr(self.figures[place], level), dtype=np.bool_)


def measure(results: Sequence[PlaceResult], answers: Sequence[Float32], outline: float = np.inf) -> Measured:
    """Levels, false zones and strengths of a detector.

    Args:
        answers: its scores (1 + scenes, 2, columns, rows) at each of the places.
        outline: of its zones, see ``raster_zones.Scores``.
    """
    figures: dict[str, SiteFigures] = {}
    for elevation in (False, True):
        mine = [k for k, one in enumerate(results) if (one.place.kind == ELEVATION) is elevation]
        if mine:
            figures |= _pool([results[k] for k in mine], [answers[k] for k in mine], outline)
    found = {
        one.place.name: strengths(one.trials, scores, one.lattice.cell, outline)
        for one, scores in zip(results, answers, strict=True)
    }
    return Measured(figures, found)


def _pool(results: Sequence[PlaceResult], answers: Sequence[Float32], outline: float) -> dict[str, SiteFigures]:
    """Figures of places whose levels are set together."""
    untouched = [
        Scores(scores[0, 0], scores[0, 1], one.lattice.cell, outline)
        for one, scores in zip(results, answers, strict=True)
    ]
    levels = common_levels(untouched)
    area = np.array([max(scores.area, 1e-9) for scores in untouched])
    counts = np.array([zone_counts(scores, levels) for scores in untouched])
    far = [far_from_hazards(one) for one in results]
    scenes = [scores[1:] for scores in answers]
    cells = [one.lattice.cell for one in results]
    far_area = np.array([float(mask.sum()) * cell**2 for mask, cell in zip(far, cells, strict=True)])
    most = max(far_area.sum() / PER_M2, 20.0)
    masked = [
        Scores(np.where(mask, both[:, 0], np.nan), np.where(mask, both[:, 1], np.nan), cell)
        for both, mask, cell in zip(scenes, far, cells, strict=True)
    ]
    far_levels = common_levels(masked) if far_area.sum() > 0 else levels
    far_counts = np.array(
        [far_zones(s, f, far_levels, c, most, outline) for s, f, c in zip(scenes, far, cells, strict=True)]
    )
    groups = np.array([one.place.group for one in results])
    seen = np.array([one.needed <= SEEN_M for one in results])
    found = {}
    for k, one in enumerate(results):
        others = seen & (groups != groups[k])
        mine = np.arange(len(results)) == k
        own, changed_own = _level(levels, counts, area, mine), _level(far_levels, far_counts, far_area, mine)
        foreign = _level(levels, counts, area, others) if others.any() else own
        changed = _level(far_levels, far_counts, far_area, others) if far_area[others].sum() > 0 else changed_own
        false = PER_M2 * zone_counts(untouched[k], np.array([foreign, own])) / area[k]
        at = np.array([foreign])
        near = far_zones(scenes[k], far[k], at, cells[k], outline=outline)[0] if far_area[k] else np.nan
        found[one.place.name] = SiteFigures(
            foreign,
            own,
            changed,
            changed_own,
            float(false[0]),
            float(false[1]),
            PER_M2 * float(near) / max(far_area[k], 1e-9),
            float(area[k]),
            float(far_area[k]),
        )
    return found


def _level(levels: Float, counts: Float, area: Float, chosen: Bool) -> float:
    """The level for one zone per 1,000 m² on the ``chosen`` places together; infinite where they have no area."""
    total = float(area[chosen].sum())
    if total <= 0:
        return float("inf")
    return level_for_rate(levels, PER_M2 * counts[chosen].sum(axis=0) / total, total)


def far_from_hazards(result: PlaceResult) -> Bool:
    """(scenes, columns, rows) cells with ground that are more than ``NEAR_M`` from any hazard of their scene. Places
    with nothing put in are no hazards.
    """
    far = np.zeros((result.scenes, *result.lattice.shape), dtype=bool)
    for scene in range(result.scenes):
        hazards = np.zeros(result.lattice.shape, dtype=bool)
        for one in result.trials:
            if one.scene == scene and not one.empty:
                hazards.ravel()[one.cells] = True
        far[scene] = result.lattice.covered
        if hazards.any():
            far[scene] &= distance_transform_edt(~hazards) * result.lattice.cell > NEAR_M
    return far


def far_zones(
    scenes: Float32, far: Bool, levels: Float, cell: float, most: float = np.inf, outline: float = np.inf
) -> Float:
    """(k,) zones of both signs above each of the rising ``levels`` (k,) in all scenes (scenes, 2, columns, rows) all of
    whose cells are ``far`` (scenes, columns, rows). ``outline`` is that of ``zones_above``.

    Below the first level from above at which there are more than ``most`` their number is not counted on: it stays.
    """
    counts = np.zeros(len(levels))
    for k in range(len(levels) - 1, -1, -1):
        for both, allowed in zip(scenes, far, strict=True):
            for score in both:
                zones, number = zones_above(score, levels[k], cell, outline)
                counts[k] += number - len(np.setdiff1d(zones[~allowed], [0]))
        if counts[k] > most:
            counts[:k] = counts[k]
            break
    return counts
