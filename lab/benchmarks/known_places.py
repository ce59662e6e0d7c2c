"""How many of a set's hazards stand out by height at all, even to one who knows their place, size and shape.

Each hazard's own shape is fitted to the ground with it, and to the untouched ground at other places of the same slope:
it stands out where its fitted height exceeds that of most places. What slopes have anyhow in that shape, no
screening of one survey can distinguish by height.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...engine.core.arrays import Float
from ...simulation.hazard_scenes.scenes import SimulatedScene
from ...simulation.hazard_scenes.sets import realistic_set, shifted_set
from .own_relief import AROUND, fitted_height
from .table import Row, say

DENSITY = 60.0
"""Points a m² that suffice for the fits; denser scenes are thinned."""
MAX_HAZARDS, PLACES, MIN_PLACES = 6, 40, 25
"""Hazards of a scene, and places that each is compared with; a hazard with fewer than ``MIN_PLACES`` is left out."""
FALSE = 0.05
"""Share of untouched places at which a hazard seems to be."""
SHAPE_REACH = 0.5
"""A point takes the shape of the hazard's nearest point within this distance, m."""


@dataclass(frozen=True)
class KnownPlace:
    """Fitted height of a hazard, m, and those of its shape at untouched ``places`` (k,) of its slope."""

    amplitude: float
    size: float
    height: float
    places: Float

    def stands_out(self, false: float) -> bool:
        """Whether it exceeds all but a share ``false`` of the places."""
        return abs(self.height) > float(np.quantile(np.abs(self.places), 1.0 - false))


def fitted_hazards(scene: SimulatedScene, amplitude: float = 0.15, size: float = 2.0) -> list[KnownPlace]:
    """Up to ``MAX_HAZARDS`` hazards of a scene with at least this amplitude and size, m, and untouched places."""
    rng = np.random.default_rng([scene.spec.seed, 8])
    large = [row for row in scene.hazards if row["amplitude"] >= amplitude and row["size"] >= size]
    if not large:
        return []
    keep = rng.random(len(scene)) < min(1.0, DENSITY * scene.spec.area / len(scene))
    plane, moved = scene.to_plane(scene.xyz[keep]), scene.displacement[keep].astype(np.float64)
    untouched = plane.copy()
    untouched[:, 2] -= moved
    tree = cKDTree(plane[:, :2])
    found = []
    for number in rng.permutation(len(large))[:MAX_HAZARDS]:
        row = large[number]
        own = np.where(scene.hazard[keep] == row["id"], moved, 0.0)
        mine = np.flatnonzero((own != 0.0) & (scene.label[keep] > 0))
        if len(mine) < 20:
            continue
        centre = plane[mine, :2].mean(axis=0)
        reach = float(np.hypot(*(plane[mine, :2] - centre).T).max()) + AROUND
        near = np.array(tree.query_ball_point(centre, reach))
        highest = float(np.abs(own[near]).max())
        shape, where = own[near] / highest, plane[near, :2] - centre
        height = fitted_height(untouched[near] - [*centre, 0.0] + np.outer(own[near], [0.0, 0.0, 1.0]), shape)
        places = _elsewhere(untouched, tree, where, shape, reach, rng)
        if len(places) >= MIN_PLACES:
            found.append(KnownPlace(float(row["amplitude"]), float(row["size"]), height, places))
    return found


def standing_share(scenes: Iterable[SimulatedScene]) -> tuple[float, int]:
    """Share of the hazards >= 15 cm and >= 2 m of these scenes that stand out, and how many were looked at."""
    found: list[bool] = []
    for number, scene in enumerate(scenes):
        found += [hazard.stands_out(FALSE) for hazard in fitted_hazards(scene)]
        say(f"scene {number + 1}: {sum(found)} of {len(found)}")
    return (float(np.mean(found)) if found else float("nan")), len(found)


def rows() -> list[Row]:
    """The share for the realistic and the shifted set."""
    lines = []
    for chosen in (realistic_set(), shifted_set()):
        share, count = standing_share(chosen.scenes())
        lines.append(
            Row(
                f"{chosen.name} set: hazards >= 15 cm, >= 2 m that stand out by height at known place, size and shape",
                f"{100 * share:.1f} % of {count}",
                "",
                f"where {100 * FALSE:g} % of the untouched places do, too",
            )
        )
    return lines


def _elsewhere(
    untouched: Float, tree: cKDTree, where: Float, shape: Float, reach: float, rng: np.random.Generator
) -> Float:
    """Fitted heights of a shape (n,), known at ``where`` (n, 2), at random places that are wholly on the slope."""
    nearest = cKDTree(where)
    heights: list[float] = []
    for _ in range(5 * PLACES):
        place = untouched[rng.integers(len(untouched)), :2]
        near = tree.query_ball_point(place, reach)
        if len(near) < 0.7 * len(where):
            continue
        points = untouched[near] - [*place, 0.0]
        distance, index = nearest.query(points[:, :2])
        heights.append(fitted_height(points, np.where(distance < SHAPE_REACH, shape[index], 0.0)))
        if len(heights) == PLACES:
            break
    return np.array(heights)
