"""Scores of the raster network and of the network on points together, and which way of joining them is chosen.

Both as log odds relative to most of the slope. A survey is judged by the way that finds most on the others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...engine.core.arrays import Float, Float32
from .screening_ground import ELEVATION
from .screening_levels import Measured
from .screening_trials import PlaceResult

WEIGHTS = (0.25, 0.5, 1.0)
"""Of the network on points in the sum of both."""
LARGER = "the larger, each over its level"
COMBINED = "combined"


def added(first: Float32, second: Float32, weight: float) -> Float32:
    """``first`` plus ``weight`` times ``second``."""
    return np.asarray(first + weight * second, dtype=np.float32)


def larger(first: Float32, second: Float32, levels: tuple[float, float]) -> Float32:
    """The larger of both, each over its level (of other surveys: ``SiteFigures.others``), which must be above 0."""
    above = [max(level, 1e-3) for level in levels]
    return np.asarray(np.fmax(first / above[0], second / above[1]), dtype=np.float32)


def recall(result: PlaceResult, runs: Sequence[Measured]) -> float:
    """Share of the hazards of a place found at its own level, at which all ways have one false zone per 1,000 m², as
    the mean over the runs.
    """
    hazards = np.array([not one.empty for one in result.trials], dtype=bool)
    return float(np.mean([one.found(result.place.name, "own")[hazards].mean() for one in runs]))


def chosen_ways(results: Sequence[PlaceResult], ways: Mapping[str, Sequence[Measured]]) -> tuple[dict[str, str], str]:
    """For each survey the way with the highest mean recall on the other surveys (all but elevation models, unless there
    is nothing else), and the way that is best on all.
    """
    used = [one for one in results if one.place.kind != ELEVATION] or list(results)
    used = [one for one in used if any(not trial.empty for trial in one.trials)]
    groups = list(dict.fromkeys(one.place.group for one in used))
    by_group: dict[str, Float] = {
        group: np.mean([[recall(one, runs) for runs in ways.values()] for one in used if one.place.group == group], 0)
        for group in groups
    }
    names = list(ways)

    def best(left_out: str | None) -> str:
        others = [values for group, values in by_group.items() if group != left_out] or list(by_group.values())
        return names[int(np.argmax(np.mean(others, axis=0)))]

    return {one.place.group: best(one.place.group) for one in results}, best(None)


def combined(results: Sequence[PlaceResult], ways: Mapping[str, Sequence[Measured]]) -> list[Measured]:
    """The runs by the way that is chosen for each survey on the others."""
    chosen = chosen_ways(results, ways)[0]
    group = {one.place.name: one.place.group for one in results}
    number = len(next(iter(ways.values())))
    return [
        Measured(
            {name: ways[chosen[group[name]]][k].figures[name] for name in group},
            {name: ways[chosen[group[name]]][k].strength[name] for name in group},
        )
        for k in range(number)
    ]
