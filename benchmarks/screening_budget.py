"""Levels of a detector for numbers of accepted false zones, by conformal risk control."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..models.preparation.even_scores import LEVELS
from ..models.preparation.raster_zones import PER_M2, Scores, common_levels, conformal_level, zone_counts
from .screening_ground import ELEVATION
from .screening_levels import SEEN_M
from .screening_trials import PlaceResult
from .table import Row


def budget_levels(results: Sequence[PlaceResult], name: str = "filter, even t") -> list[Row]:
    """The level of a detector for each number of accepted false zones, by conformal risk control on all clouds and
    simulated slopes on which something can be seen; and what is then false on a survey that took no part.
    """
    used = [one for one in results if one.place.kind != ELEVATION and one.needed <= SEEN_M]
    if not used:
        return []
    answers = [one.answers[name][0] for one in used]
    scores = [Scores(both[0], both[1], one.lattice.cell) for one, both in zip(used, answers, strict=True)]
    tail = common_levels(scores)
    levels = np.linspace(float(tail[0]), float(tail[-1]), 400)
    area = np.array([one.area for one in used])
    rates = PER_M2 * np.array([zone_counts(one, levels) for one in scores]) / area[:, None]
    groups = np.array([one.place.group for one in used])
    rows = []
    for wanted in LEVELS:
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
        rows.append(Row(title, measured, f"{LEVELS[wanted]:g} in use", shown))
    return rows
