"""Levels of a detector for numbers of accepted false zones, by conformal risk control."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ...engine.core.arrays import Float32
from ...models.preparation import even_scores, point_scores, relative_scores
from ...models.preparation.raster_zones import PER_M2, Scores, common_levels, conformal_level, zone_counts
from .screening_ground import ELEVATION
from .screening_levels import SEEN_M
from .screening_networks import POINT_ZONES, RANDLA, RELATIVE, UNET, relative
from .screening_trials import PlaceResult
from .table import Row

EVEN = "filter, even t"


def budget_levels(results: Sequence[PlaceResult]) -> list[Row]:
    """Levels of the filter and, where they took part, of the network on relief and of that on points."""
    rows = detector_levels(results, EVEN, lambda one: one.answers[EVEN][0], even_scores.LEVELS)
    if all(weights_of(one) for one in results):
        rows += detector_levels(
            results,
            RELATIVE,
            lambda one: relative(one.answers[weights_of(one)[0]], one.lattice.cell)[0],
            relative_scores.LEVELS,
        )
    shipped = [name for name in results[0].answers if name.startswith(f"{RANDLA} ")] if results else []
    for name in shipped[:1]:
        rows += detector_levels(
            results,
            POINT_ZONES,
            lambda one, name=name: relative(one.answers[name][:1], one.lattice.cell, point_scores.odds_scores)[0],  # type: ignore[misc]
            point_scores.LEVELS,
            point_scores.OUTLINE,
        )
    return rows


def weights_of(result: PlaceResult) -> list[str]:
    """Names of the weights of the network on relief that judged a place."""
    return [name for name in result.answers if name.startswith(f"{UNET} ")]


def detector_levels(
    results: Sequence[PlaceResult],
    name: str,
    answer: Callable[[PlaceResult], Float32],
    in_use: Mapping[float, float],
    outline: float = np.inf,
) -> list[Row]:
    """The level of a detector for each number of accepted false zones, by conformal risk control on all clouds and
    simulated slopes on which something can be seen; and what is then false on a survey that took no part.
    """
    used = [one for one in results if one.place.kind != ELEVATION and one.needed <= SEEN_M]
    if not used:
        return []
    answers = [answer(one) for one in used]
    scores = [Scores(both[0], both[1], one.lattice.cell, outline) for one, both in zip(used, answers, strict=True)]
    tail = common_levels(scores)
    levels = np.linspace(float(tail[0]), float(tail[-1]), 400)
    area = np.array([one.area for one in used])
    rates = PER_M2 * np.array([zone_counts(one, levels) for one in scores]) / area[:, None]
    groups = np.array([one.place.group for one in used])
    rows = []
    for wanted in in_use:
        cap = max(3.0, 2.0 * wanted)
        level = conformal_level(levels, rates, wanted, cap)
        false = {}
        for group in dict.fromkeys(groups):
            mine = groups == group
            others = conformal_level(levels, rates[~mine], wanted, cap)
            if math.isfinite(others):
                at = np.array([np.interp(others, levels, one) for one in rates[mine]])
                false[group] = float((at * area[mine]).sum() / area[mine].sum())
        measured = f"{level:.2f}" if math.isfinite(level) else f"none of {len(used)} places"
        shown = ", ".join(f"{group} {value:.1f}" for group, value in false.items())
        title = f"level of {name} for {wanted:g} false zones per 1,000 m²"
        rows.append(Row(title, measured, f"{in_use[wanted]:g} in use", shown))
    return rows
