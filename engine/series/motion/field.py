"""Motion of each window of a series through time: against the first survey, step by step, and its velocity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ....interface.parameters import DisplacementParameters
from ...core.arrays import Bool, Float, Index
from ...core.progress import Progress
from ...displacement.displacement import StablePlaces
from ...displacement.measure import Windows
from ...displacement.registered import Registered
from ...displacement.status import Status
from ...displacement.vectors import (
    CommonMotion,
    Vectors,
    chosen,
    common_motion,
    confidence_of_each,
    in_the_map,
    squared_length,
    where,
)
from .network import AXES, Adjusted, Links, Measured, Noise, adjust, batches, noise_of
from .widths import narrower_tells
from .windows import Layout, PairMotion


@dataclass(frozen=True)
class Surveys:
    """What is known of the surveys: ``days`` (n,) since the first one, and each one's ``registered`` error."""

    days: Float
    registered: tuple[Registered, ...]

    @property
    def links(self) -> Links:
        return Links.of(len(self.days))


_MIN_SHARE, _MIN_WINDOWS = 0.5, 20  # that agree, of a motion that most of the slope shares


@dataclass(frozen=True)
class References:
    """What each survey is seen from.

    Attributes:
        taken_off: (surveys, 3) motion of stable ground, or of most of a slope, that is taken off, metres; zero where
            none is known.
        covariance: (surveys, 3, 3) of it where it is known, else NaN: the registration's error counts then.
        of_slope: (surveys,) where it is that of most of a slope: the registration's turn about ``centre`` (3,) counts,
            too.
        common: the motion that most windows share in each survey from the second on, before any is taken off.
    """

    taken_off: Float
    covariance: Float
    of_slope: Bool
    centre: Float
    common: tuple[CommonMotion | None, ...]

    def error_at(self, places: Float, registered: Sequence[Registered]) -> Float:
        """(n, surveys, 3, 3) covariance of each survey's motion against the first that nothing but error feigns."""
        found = np.stack([r.at(places) for r in registered], axis=1)
        known = np.isfinite(self.covariance).all(axis=(1, 2))
        found[:, known] = self.covariance[known]
        for survey in np.flatnonzero(self.of_slope).tolist():
            found[:, survey] += registered[survey].turned_about(self.centre).at(places)
        found[:, 0] = 0.0
        return found


@dataclass(frozen=True)
class Field:
    """Windows through time, in the map's coordinates (east, north, up); NaN where not known.

    Attributes:
        motion: (n, surveys, 3) against the first survey, metres; ``covariance`` (n, surveys, 3, 3) of it, m².
        step: (n, surveys, 3) against the survey before, and ``step_covariance`` of it.
        velocity: (n, 3) metres a day, and ``velocity_covariance`` (n, 3, 3).
        looks: for each survey from the second on what was known after it: the vectors with most evidence of motion,
            of the velocity until then or of the last survey.
        significant: of the same, (n,) those that still ground hardly shows.
        noise: of the windows of each width.
        independent: number of measured windows that do not overlap.
    """

    layout: Layout
    surveys: Surveys
    motion: Float
    covariance: Float
    step: Float
    step_covariance: Float
    velocity: Float
    velocity_covariance: Float
    looks: tuple[Vectors, ...]
    significant: tuple[Bool, ...]
    noise: tuple[Noise, ...]
    references: References
    independent: float

    @property
    def widths(self) -> int:
        """How many widths of windows were tried."""
        return len(self.noise)

    def vectors(self, motion: Float, covariance: Float) -> Vectors:
        """Motions (n, 3) of the windows with their covariances as vectors."""
        last = self.looks[-1]
        known = np.isfinite(motion).all(axis=1)
        status = np.where(known, int(Status.MEASURED), np.where(last.measured, int(Status.LITTLE_SEEN), last.status))
        return Vectors(last.places, last.axes, motion, covariance, status, last.seen, last.width)


@dataclass(frozen=True)
class _Size:
    """Windows of one width after each survey, in the map's coordinates; see ``Field``.

    ``looks`` have one entry a survey from the second on; the arrays are what is known after the last one.
    """

    arrays: dict[str, Float]
    looks: list[Vectors]
    noise: Noise


def tests_of(look: int) -> int:
    """How many statistics show motion after survey ``look``: with the second one the velocity is the motion."""
    return 1 if look == 1 else 2


def confidence_of(look: int, confidence: float) -> float:
    """Of each of the statistics, so that still ground shows motion by any of them as seldom as by one alone."""
    return 1.0 - (1.0 - confidence) / tests_of(look)


def motion_field(
    pairs: Sequence[PairMotion],
    layout: Layout,
    surveys: Surveys,
    parameters: DisplacementParameters,
    stable: StablePlaces | None = None,
    progress: Progress | None = None,
) -> Field:
    """All pairs of ``surveys.links`` put together.

    Args:
        stable: which of places (n, 2) are on ground that is known to be stable; its motion is taken off.
    """
    progress = progress or Progress()
    widths = range(len(pairs[0].sizes))
    overlap = parameters.spacing**2 / (np.pi * np.array([w.radius for w in pairs[0].sizes]) ** 2)
    references = _references(pairs, layout, surveys, float(overlap[-1]), stable)
    sizes = []
    for number in widths:
        with progress.stage(number / len(widths), (number + 1) / len(widths), "adjusting motions") as share:
            sizes.append(_size([pair.sizes[number] for pair in pairs], layout, surveys, references, share))
    looks, significant = [], []
    arrays = sizes[-1].arrays
    for last in range(1, len(surveys.days)):
        confidence = confidence_of_each(confidence_of(last, parameters.vector_confidence), len(sizes))
        joined = sizes[-1].looks[last - 1]
        for narrower in reversed(sizes[:-1]):
            own = narrower.looks[last - 1]
            take = narrower_tells(own, joined, confidence)
            joined = chosen(take, own, joined)
            if last == len(surveys.days) - 1:
                arrays = {name: where(take, narrower.arrays[name], value) for name, value in arrays.items()}
        looks.append(joined)
        significant.append(joined.significant(confidence))
    measured = np.count_nonzero(np.any([size.looks[-1].measured for size in sizes], axis=0))
    return Field(
        layout, surveys, looks=tuple(looks), significant=tuple(significant), noise=tuple(s.noise for s in sizes),
        references=references, independent=float(measured * overlap[0]), **arrays,
    )  # fmt: skip


def _references(
    pairs: Sequence[PairMotion], layout: Layout, surveys: Surveys, independent: float, stable: StablePlaces | None
) -> References:
    """Motion of stable ground where that is known, else of most of the slope on which a survey was registered.

    A part that slides pulls the registration of the whole along, by more than it states. The rest then seems to move
    the other way as one, which shows by how much.
    """
    count = len(surveys.days)
    taken_off, covariance = np.zeros((count, 3)), np.full((count, 3, 3), np.nan)
    of_slope = np.zeros(count, dtype=bool)
    common = []
    among = None if stable is None else stable(layout.places[:, :2])
    for survey in range(1, count):
        vectors = in_the_map(pairs[survey - 1].sizes[-1], layout.facets, layout.places, layout.facet)
        common.append(common_motion(vectors, independent))
        still = common[-1] if among is None else common_motion(vectors, independent, among)
        if among is None and not (surveys.registered[survey].known and _of_most(still)):
            continue
        if still is not None:
            of_slope[survey] = among is None
            factor = max(still.factor, 1.0) if among is None else 1.0
            taken_off[survey], covariance[survey] = still.motion, factor * still.covariance
    return References(taken_off, covariance, of_slope, layout.places.mean(axis=0), tuple(common))


def _of_most(motion: CommonMotion | None) -> bool:
    return motion is not None and motion.windows >= _MIN_WINDOWS and motion.share >= _MIN_SHARE


def _size(
    windows: Sequence[Windows], layout: Layout, surveys: Surveys, references: References, progress: Progress
) -> _Size:
    links, axes, count = surveys.links, layout.axes, len(layout.cell)
    found = [in_the_map(w, layout.facets, layout.places, layout.facet) for w in windows]
    begin, end = np.array(links.pairs).T
    off = references.taken_off[end] - references.taken_off[begin]
    motion = np.stack([_in_plane(axes, v.motion - d) for v, d in zip(found, off, strict=True)])
    covariance = np.stack([v.in_plane_covariance for v in found])
    registration = references.error_at(layout.places, surveys.registered)
    registration = axes[:, None] @ registration @ np.swapaxes(axes, 1, 2)[:, None]
    measured = Measured(links, motion, covariance, registration)
    noise = noise_of(measured)
    surveyed = len(surveys.days)
    arrays = {name: np.full((count, surveyed, AXES), np.nan) for name in ("motion", "step")}
    arrays |= {f"{name}covariance": np.full((count, surveyed, AXES, AXES), np.nan) for name in ("", "step_")}
    arrays |= {"velocity": np.full((count, AXES), np.nan), "velocity_covariance": np.full((count, AXES, AXES), np.nan)}
    looks: list[Vectors] = []
    parts = batches(measured)
    for last in range(1, surveyed):
        shown, error = np.full((count, AXES), np.nan), np.full((count, AXES, AXES), np.nan)
        for number, places in enumerate(parts):
            progress.update((last - 1 + number / len(parts)) / (surveyed - 1))
            done = adjust(measured.part(places), noise, surveys.days, last)
            shown[places], error[places] = evidence(done.motion[:, last], done, surveys.days, last)
            if last == surveyed - 1:
                _keep(arrays, places, done, axes[places])
        back = np.swapaxes(axes, 1, 2)
        whole = found[last - 1]
        status = np.where(
            np.isfinite(shown).all(axis=1),
            int(Status.MEASURED),
            np.where(whole.measured, int(Status.LITTLE_SEEN), whole.status),
        )
        looks.append(
            Vectors(
                layout.places, axes, _in_plane(back, shown), back @ error @ axes, status, whole.seen, whole.width
            )
        )  # fmt: skip
    return _Size(arrays, looks, noise)


def _in_plane(axes: Float, vectors: Float) -> Float:
    return np.einsum("nij,nj->ni", axes, vectors)


def evidence(motion: Float, done: Adjusted, days: Float, last: int) -> tuple[Float, Float]:
    """Motions (n, 3) until survey ``last`` and their covariances: by the velocity or of that survey, whichever has
    more evidence of motion along the surface. That of the last survey is less sure where those before it scatter.
    """
    covariance = done.covariance[:, last, :, last] * done.scatter[:, None, None]
    way, error = days[last] * done.velocity, days[last] ** 2 * done.velocity_covariance
    by_line, by_last = (
        np.nan_to_num(squared_length(v[:, :2], c[:, :2, :2]), nan=-1.0) for v, c in ((way, error), (motion, covariance))
    )
    take = by_line > by_last
    return np.where(take[:, None], way, motion), np.where(take[:, None, None], error, covariance)


def _keep(arrays: dict[str, Float], places: Index, done: Adjusted, axes: Float) -> None:
    """Put a batch into the arrays, in the map's coordinates."""
    back = np.swapaxes(axes, 1, 2)
    surveys = done.motion.shape[1]
    arrays["velocity"][places] = _in_plane(back, done.velocity)
    arrays["velocity_covariance"][places] = back @ done.velocity_covariance @ axes
    for k in range(surveys):
        own = done.covariance[:, k, :, k]
        arrays["motion"][places, k] = _in_plane(back, done.motion[:, k])
        arrays["covariance"][places, k] = back @ own @ axes
        if k:
            cross, before = done.covariance[:, k, :, k - 1], done.covariance[:, k - 1, :, k - 1]
            step = own + before - cross - np.swapaxes(cross, 1, 2)
            arrays["step"][places, k] = _in_plane(back, done.motion[:, k] - done.motion[:, k - 1])
            arrays["step_covariance"][places, k] = back @ step @ axes
