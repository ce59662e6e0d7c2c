"""Hazards put into the ground of a place, and how strongly each detector answers at them and at untouched ground.

The scores of untouched and of changed ground are kept, so that recall and false zones at any threshold, and scores made
of several detectors' follow without another run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Bool, Float, Float32, Index
from ...engine.geometry.dominant_plane import apply_matrix
from ...engine.geometry.hazard_shapes import Hazard, smooth_hazard
from ...models.preparation.bump_filter import cell_heights
from ...models.preparation.even_scores import even_scores
from ...models.preparation.inserted_hazards import UPLIFT, Inserted, footprint, insert_hazards
from ...models.preparation.point_scores import cell_means, point_odds
from ...models.preparation.raster_zones import Scores, strength_at
from ...models.preparation.relief_channels import bump_scores
from ...models.preparation.relief_raster import ReliefRaster, laplacian_score, relief_raster
from ...models.preparation.smallest_hazard import SmallestHazard, smallest_hazard
from ...models.preparation.smallest_hazard import filter_scores as matched_filter
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
FILTERS = {
    "residual": "residual 4 m",
    "LoG": "LoG",
    "filter, heights": "filter, heights",
    "filter, t": "filter, t",
    "filter, even t": "filter, even t",
}
"""Columns of the detectors that learn nothing, and their names among the answers."""


class Cells(Protocol):
    """What detectors need of a raster: where its cells lie and which have ground."""

    @property
    def origin(self) -> Float: ...
    @property
    def cell(self) -> float: ...
    @property
    def covered(self) -> Bool: ...
    @property
    def shape(self) -> tuple[int, int]: ...
    def index(self, flat: Float) -> tuple[Index, Index]: ...


Detector = Callable[[Place, Cells], dict[str, Scores]]
"""From ground points and their cells to score rasters of uplift and subsidence on these cells, by name."""


@dataclass(frozen=True)
class Lattice:
    """Cells (columns, rows) of ``cell`` m from ``origin`` (2,) on, and which of them are ``covered`` by ground. Hazards
    move points square to the slope, so that ground with and without them has the same cells.
    """

    origin: Float
    cell: float
    covered: Bool

    @property
    def shape(self) -> tuple[int, int]:
        return self.covered.shape[0], self.covered.shape[1]

    def index(self, flat: Float) -> tuple[Index, Index]:
        """Column and row (n,) of points (n, 2 or 3); at the rim for points beyond it."""
        place = np.floor((flat[:, :2] - self.origin) / self.cell).astype(np.int64)
        return np.clip(place[:, 0], 0, self.shape[0] - 1), np.clip(place[:, 1], 0, self.shape[1] - 1)


@dataclass(frozen=True)
class Trial:
    """A hazard put in: height (m, signed), nominal diameter (m), where (m, flat frame), and the A70 (m) of the place as
    the untouched ground predicts it. It lies in ``scene`` (from 0 on) as ``label`` (1 uplift, 2 subsidence) on
    ``cells``, numbers in the raster row by row.
    """

    height: float
    diameter: float
    where: tuple[float, float]
    needed: float
    scene: int
    label: int
    cells: NDArray[np.int64]

    @property
    def empty(self) -> bool:
        """Whether nothing was put in."""
        return abs(self.height) <= NOTHING_M


@dataclass(frozen=True)
class PlaceResult:
    """The trials of one place and what detectors answer there. ``needed`` (m) is the median A70 of the place at the
    width that is found most easily; ``scenes`` is how many times hazards were put in.

    ``answers`` has for each detector scores (1 + scenes, 2, columns, rows): of the untouched ground and of each scene,
    of uplift and of subsidence. ``key`` names the place and all that made its scenes.
    """

    place: Place
    lattice: Lattice
    needed: float
    scenes: int
    trials: list[Trial]
    answers: Mapping[str, Float32]
    key: str = ""

    @property
    def area(self) -> float:
        """Area with ground, m²."""
        return float(np.count_nonzero(self.lattice.covered)) * self.lattice.cell**2


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


def network_scores(predict: Callable[[Float], NDArray[np.floating]], name: str) -> Detector:
    """Log odds of a network's probabilities (n, 3) of the points in map coordinates, averaged in the cells of a raster.

    Their order is that of the probabilities.
    """

    def scores(place: Place, raster: Cells) -> dict[str, Scores]:
        xyz = apply_matrix(np.asarray(np.linalg.inv(place.matrix), dtype=np.float64), place.flat)
        mean = cell_means(predict(xyz), raster.index(place.flat), np.ones(len(xyz)), raster.covered)
        up, down = point_odds(mean)
        return {name: Scores(up, down, raster.cell)}

    return scores


def try_place(place: Place, detectors: Sequence[Detector], count: int, seed: int = 0) -> PlaceResult:
    """Put ``count`` hazards of each height and diameter into a place, some at a time, half of them bulges, and let
    ``detectors`` and those of ``filter_scores`` score untouched and changed ground.
    """
    raster = relief_raster(place.flat)
    needed = smallest_hazard(raster)
    lattice = Lattice(raster.origin, raster.cell, raster.covered)
    answers: dict[str, list[Float32]] = {}
    _add(answers, filter_scores(place, raster))
    trials: list[Trial] = []
    number = -1
    for number, (wanted, scene) in enumerate(looks(place, raster.area, count, seed)):
        changed = replace(place, flat=scene.flat)
        _add(answers, filter_scores(changed, relief_raster(scene.flat)))
        trials.extend(_trials(scene, wanted, number, lattice, needed))
    result = PlaceResult(place, lattice, easiest(needed), number + 1, trials, _stacked(answers))
    for detector in detectors:
        result = replace(result, answers={**result.answers, **answer(result, detector, count, seed)})
    return result


def answer(result: PlaceResult, detector: Detector, count: int, seed: int = 0) -> dict[str, Float32]:
    """What a further detector says to the same ground, untouched and in each scene (see ``PlaceResult.answers``)."""
    answers: dict[str, list[Float32]] = {}
    _add(answers, detector(result.place, result.lattice))
    for _, scene in looks(result.place, result.area, count, seed):
        _add(answers, detector(replace(result.place, flat=scene.flat), result.lattice))
    return _stacked(answers)


def looks(place: Place, area: float, count: int, seed: int = 0) -> Iterator[tuple[list[Hazard], Inserted]]:
    """The hazards that are wanted and the ground with those that found room, until all of them have been in; the same
    each time.
    """
    rng = np.random.default_rng([seed, len(place.flat)])
    waiting = _wanted(place, count, rng)
    for _ in range(_MAX_LOOKS):
        if not waiting:
            break
        now, rest = _that_fit(waiting, FILLED * area)
        scene = insert_hazards(place.flat, now, rng)
        if not scene.hazards:
            break
        yield now, scene
        taken = {one.number for one in scene.hazards}
        left = [hazard for number, hazard in enumerate(now) if number not in taken]
        # Those that found no room wait for the next look, behind the others.
        waiting = rest + left


def strengths(trials: Sequence[Trial], answers: Float32, cell: float, outline: float = np.inf) -> Float:
    """(trials,) highest level at which each is found in the scores (1 + scenes, 2, columns, rows); ``outline`` as of
    ``raster_zones.zones_above``.
    """
    found = []
    for one in trials:
        mine = np.zeros(answers.shape[2:], dtype=bool)
        mine.ravel()[one.cells] = True
        found.append(strength_at(answers[1 + one.scene, one.label - 1], mine, cell, outline))
    return np.array(found, dtype=np.float64)


def easiest(needed: SmallestHazard) -> float:
    """The lowest of the widths' median A70, m; infinite where no width could be fitted."""
    known = [values[np.isfinite(values)] for values in needed.heights]
    return min((float(np.median(values)) for values in known if len(values)), default=math.inf)


def _add(answers: dict[str, list[Float32]], found: Mapping[str, Scores]) -> None:
    for name, scores in found.items():
        both = np.stack([scores.uplift, scores.subsidence]).astype(np.float32)
        answers.setdefault(name, []).append(both)


def _stacked(answers: Mapping[str, Sequence[Float32]]) -> dict[str, Float32]:
    return {name: np.stack(list(values)) for name, values in answers.items()}


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
    scene: Inserted, wanted: Sequence[Hazard], number: int, lattice: Lattice, needed: SmallestHazard
) -> list[Trial]:
    found = []
    for one in scene.hazards:
        height, diameter = wanted[one.number].height, round(one.diameter, 3)
        nothing = abs(height) <= NOTHING_M
        shape = replace(one.shape, height=math.copysign(_NOTHING_AS_M, height)) if nothing else one.shape
        up, down = footprint(shape, lattice.origin, lattice.cell, lattice.shape)
        mine = (up if one.label == UPLIFT else down) & lattice.covered
        i, j = lattice.index(np.array([[one.shape.u, one.shape.w]]))
        here = needed.at(int(i[0]), int(j[0]), diameter)
        where = one.shape.u, one.shape.w
        found.append(Trial(height, diameter, where, here, number, one.label, np.flatnonzero(mine)))
    return found
