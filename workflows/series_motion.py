"""Motion along the surface through the surveys of a series: measured pair by pair, kept and reused, put together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from shapely import contains_xy
from shapely.geometry.base import BaseGeometry

from ..engine.core import cancellation
from ..engine.core.arrays import Bool, Float
from ..engine.core.errors import InputError
from ..engine.core.progress import Progress
from ..engine.core.staged_outputs import Stage
from ..engine.displacement.displacement import StablePlaces
from ..engine.displacement.stored_ground import Ground, StoredGround
from ..engine.displacement.vectors import CommonMotion
from ..engine.series.comparisons import GriddedEpoch
from ..engine.series.motion.field import Field, Surveys, motion_field
from ..engine.series.motion.windows import Layout, PairMotion, layout_of, measure_pair
from ..engine.series.motion.zones import MovingGround, moving_ground
from ..interface.parameters import DisplacementParameters
from .motion_memory import MotionMemory, stored_ground
from .pair import is_large
from .series_store import Store, key_of

_MEASURED, _FITTED = 0.85, 0.95  # shares of the time
_SURE, _LEAST_PULL_M = 11.3, 0.005  # 99 % of chi-squared with 3 degrees of freedom
_POINTS = "motion_points"  # folder of a run, while it measures, for points on the disk


@dataclass(frozen=True)
class SeriesMotion:
    """What was measured, see ``Field`` and ``MovingGround``; ``made`` are the pairs that were not reused."""

    field: Field
    ground: tuple[MovingGround, ...]
    parameters: DisplacementParameters
    made: tuple[tuple[int, int], ...]

    @property
    def layout(self) -> Layout:
        return self.field.layout

    def sentence(self) -> str:
        """What motion along the surface needs to be seen, and where that is."""
        facts = self.facts()
        if facts["smallest_motion_median_m"] is None:
            return "The ground shows nowhere relief that holds it, so that motion along the surface stays unseen."
        return (
            f"Motion along the surface is measured on {100 * facts['measured_share']:.0f} % of the ground; half of the "
            f"windows there show {100 * facts['smallest_motion_median_m']:.1f} cm until the last survey, and elsewhere "
            "it stays unseen."
        )

    def facts(self) -> dict[str, Any]:
        """For the run record; lengths in metres, shares from 0 to 1."""
        vectors, field = self.field.looks[-1], self.field
        smallest = field.vectors(field.motion[:, -1], field.covariance[:, -1]).smallest
        known = smallest[np.isfinite(smallest)]
        return {
            "windows": len(field.layout.cell),
            "measured_share": float(vectors.measured.mean()),
            "significant_share": float(field.significant[-1].mean()),
            "smallest_motion_median_m": float(np.median(known)) if len(known) else None,
            "own_error_share": [float(noise.own[0]) for noise in field.noise],
            "noise_of_surveys": [float(w) for w in field.noise[0].weights / field.noise[0].weights.mean()],
            "common_motion": [_common(motion) for motion in field.references.common],
            "taken_off_m": field.references.taken_off.tolist(),
            "registration_known": [r.known for r in field.surveys.registered],
            "pairs_made": [list(pair) for pair in self.made],
        }


def _common(motion: CommonMotion | None) -> dict[str, Any] | None:
    if motion is None:
        return None
    error = np.sqrt(np.diag(motion.covariance))
    return {"motion_m": motion.motion.tolist(), "error_m": error.tolist(), "share": motion.share}


class _Held:
    """The ground of the surveys in the frame of the series, of which two are in memory at a time.

    ``threads`` are the tiles at a time that leave the memory as it is allowed; None: as it is by default.
    """

    threads: int | None = None

    def __init__(self, gridded: Sequence[GriddedEpoch]) -> None:
        self._gridded = gridded
        self._held: dict[int, Ground] = {}

    def __call__(self, earlier: int, later: int) -> tuple[Ground, Ground]:
        for survey in set(self._held) - {earlier, later}:
            self._let_go(survey)
        for survey in sorted({earlier, later} - set(self._held)):
            self._held[survey] = self._taken(survey)
        return self._held[earlier], self._held[later]

    def _let_go(self, survey: int) -> None:
        del self._held[survey]

    def _taken(self, survey: int) -> Ground:
        return self._gridded[survey].points()


class _OnDisk(_Held):
    """The same where two surveys are on the disk at a time, in a folder of their own."""

    def __init__(self, gridded: Sequence[GriddedEpoch], folder: Path, memory: MotionMemory, spacing: float) -> None:
        super().__init__(gridded)
        self._folder, self._memory, self._spacing = folder, memory, spacing
        self.threads = memory.threads

    def _let_go(self, survey: int) -> None:
        ground = self._held.pop(survey)
        assert isinstance(ground, StoredGround)
        ground.cloud.file.unlink()
        ground.squares.file.unlink()

    def _taken(self, survey: int) -> Ground:
        self._folder.mkdir(parents=True, exist_ok=True)
        return stored_ground(self._gridded[survey].stored(self._folder), self._memory, self._spacing)


def measure_motion(
    gridded: Sequence[GriddedEpoch],
    days: Float,
    stage: Stage,
    stable: BaseGeometry | None,
    memory: MotionMemory,
    progress: Progress,
) -> SeriesMotion | None:
    """Motion along the surface of all surveys, with a note and None where the ground does not allow it.

    Args:
        days: of the surveys since the first one.
        stage: of the run; what is measured of a pair is kept in its folder ``work``.
        stable: ground that is known to be stable; its motion is taken off.
        memory: that may be taken where surveys stay on the disk.
    """
    parameters = DisplacementParameters()
    with cancellation.temporary(stage.folder / _POINTS) as folder:
        held = _Held(gridded)
        if any(is_large([g.ground, g.ground]) for g in gridded):
            held = _OnDisk(gridded, folder, memory, parameters.spacing)
        return _measured(gridded, days, stage, stable, held, parameters, progress)


def _measured(
    gridded: Sequence[GriddedEpoch],
    days: Float,
    stage: Stage,
    stable: BaseGeometry | None,
    held: _Held,
    parameters: DisplacementParameters,
    progress: Progress,
) -> SeriesMotion | None:
    try:
        layout = layout_of(held(0, 0)[0], parameters)
        surveys = Surveys(days, tuple(g.registered for g in gridded))
        with progress.stage(0.0, _MEASURED):
            pairs, made = _pairs(gridded, surveys, layout, parameters, held, Store(stage), progress)
    except InputError as wrong:
        progress.info(f"Motion along the surface is not measured in this series: {wrong}")
        return None
    with progress.stage(_MEASURED, _FITTED):
        field = motion_field(pairs, layout, surveys, parameters, _places(stable), progress)
    with progress.stage(_FITTED, 1.0):
        ground = moving_ground(field, pairs, held, parameters, progress)
    if not all(g.registered.known for g in gridded[1:]):
        progress.info(
            "The registration's error along the surface is not known here and taken as 0: the errors of motions along "
            "the surface are those of the relief alone."
        )
    _say_what_was_pulled(field, progress)
    return SeriesMotion(field, ground, parameters, made)


def _say_what_was_pulled(field: Field, progress: Progress) -> None:
    """Where most of the slope seems to move as one by more than chance, and by a length that is read on a map."""
    references = field.references
    error = references.error_at(references.centre[None], field.surveys.registered)[0]
    pulled = [
        float(np.linalg.norm(way))
        for way, own, of_slope in zip(references.taken_off, error, references.of_slope, strict=True)
        if of_slope and way @ np.linalg.solve(own, way) > _SURE
    ]
    if pulled and max(pulled) >= _LEAST_PULL_M:
        progress.info(
            f"Most of the slope seems to move as one by up to {100 * max(pulled):.1f} cm: what slid has pulled the "
            "registration, and that is taken off all vectors. If most of the slope itself moves, give polygons of "
            "stable ground."
        )


def _pairs(
    gridded: Sequence[GriddedEpoch],
    surveys: Surveys,
    layout: Layout,
    parameters: DisplacementParameters,
    held: _Held,
    store: Store,
    progress: Progress,
) -> tuple[list[PairMotion], tuple[tuple[int, int], ...]]:
    """The motion of each pair, measured or as an earlier run kept it, and the pairs that were measured."""
    found, made = [], []
    links = surveys.links.pairs
    for number, (earlier, later) in enumerate(links):
        names = f"{gridded[earlier].epoch.name} to {gridded[later].epoch.name}"
        with progress.stage(number / len(links), (number + 1) / len(links), names) as share:

            def make(path: Path, earlier: int = earlier, later: int = later, share: Progress = share) -> dict[str, Any]:
                measure_pair(*held(earlier, later), layout, parameters, share, held.threads).save(path)
                return {}

            key = key_of(
                first=gridded[0].key,
                earlier=gridded[earlier].key,
                later=gridded[later].key,
                displacement=asdict(parameters),
            )
            entry = store.entry("motion.npz", key, make, share)
            found.append(PairMotion.load(entry.path))
            made += [] if entry.reused else [(earlier, later)]
    return found, tuple(made)


def _places(stable: BaseGeometry | None) -> StablePlaces | None:
    if stable is None:
        return None

    def inside(xy: Float) -> Bool:
        return np.asarray(contains_xy(stable, xy[:, 0], xy[:, 1]), dtype=bool)

    return inside
