"""Ground of a series that moves as one: followed from survey to survey, with one fit over it for each pair."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import chdtrc

from ....interface.parameters import DisplacementParameters
from ...core.arrays import Float, Index
from ...core.progress import Progress
from ...displacement import zones as pair_zones
from ...displacement.stored_ground import Ground
from ...displacement.vectors import Vectors, squared_length
from ...displacement.zones import MAX_PROBABILITY, MAX_TURN_DEG, groups
from ..tracking import Alike, Sighting, Track, track_zones
from .field import Field, evidence, tests_of
from .network import Adjusted, Measured, adjust, own_variances
from .windows import PairMotion, search_of

Clouds = Callable[[int, int], tuple[Ground, Ground]]
"""Ground points (n, 3) of two surveys in the frame of the series, metres."""
_REACH = 1  # windows by which a zone may lie elsewhere from survey to survey
_SHORTEST_M = 1e-12
_MIN_LOOKS = 2  # after which a zone stood out, where the last one does not show it


@dataclass(frozen=True)
class MovingGround:
    """Ground that moves as one, in the map's coordinates (east, north, up).

    Attributes:
        zone_id: M and its number, which later surveys do not change.
        windows: (k,) numbers of its windows after the last survey that showed it.
        area: of the windows' cells on the map, m²; ``fitted_area`` of the part that was fitted, along the surface.
        place: (3,) middle of the windows; ``axes`` (3, 3) along the dip, across and normal, row by row.
        motion: (surveys, 3) against the first survey, metres; NaN where not known; ``covariance`` (surveys, 3,
            surveys, 3) of it, m².
        velocity: (3,) metres a day, of a straight line through time; ``velocity_covariance`` (3, 3) of it as the mean
            of ground that does not move evenly.
        unevenness: standard error of the mean for that reason, as a share of the motion.
        probability: that still ground shows such a zone anywhere on the map.
        found: the first survey after which that was at most ``MAX_PROBABILITY``.
        direction: (3,) unit vector along the surface in which it moves.
        sightings: surveys after which its windows stood out, and what happened to it.
        parent: the zone that it came out of.
    """

    zone_id: str
    windows: Index
    area: float
    fitted_area: float
    place: Float
    axes: Float
    motion: Float
    covariance: Float
    velocity: Float
    velocity_covariance: Float
    unevenness: float
    probability: float
    found: int
    direction: Float
    sightings: tuple[Sighting, ...]
    parent: str

    @property
    def along(self) -> Float:
        """(surveys,) motion in its direction against the first survey, metres."""
        return np.asarray(self.motion @ self.direction)

    @property
    def along_error(self) -> Float:
        """(surveys,) standard error of ``along``; 0 for the first."""
        return np.sqrt(np.diag(self._along_covariance))

    @property
    def along_variance(self) -> Float:
        """(surveys,) each survey's own variance of ``along`` (see ``network.own_variances``), m²; NaN where unknown."""
        known = np.flatnonzero(np.isfinite(self.along))
        found = np.full(len(self.motion), np.nan)
        found[known] = own_variances(self._along_covariance[np.ix_(known, known)])
        return found

    @property
    def _along_covariance(self) -> Float:
        return np.asarray(np.einsum("a,iajb,b->ij", self.direction, self.covariance, self.direction))

    @property
    def off_dip(self) -> float:
        """Angle of its direction to that of the dip, degrees from -180 to 180, left positive."""
        plane = self.axes @ self.direction
        return float(np.degrees(np.arctan2(plane[1], plane[0])))

    def step(self, survey: int) -> tuple[Float, Float]:
        """Motion (3,) since the survey before, metres, and its covariance (3, 3)."""
        cross = self.covariance[survey, :, survey - 1]
        own = self.covariance[survey, :, survey] + self.covariance[survey - 1, :, survey - 1]
        return self.motion[survey] - self.motion[survey - 1], own - cross - cross.T


def moving_ground(
    field: Field,
    pairs: Sequence[PairMotion],
    clouds: Clouds,
    parameters: DisplacementParameters,
    progress: Progress | None = None,
) -> tuple[MovingGround, ...]:
    """What moves as one, in the order of the ids.

    Adjoining windows of like direction that stood out after a survey are followed through the surveys like zones of
    change. The windows that stood out last are fitted as one, without their margin, for every pair of surveys, and the
    zone counts where still ground hardly shows such a motion.

    Args:
        pairs: as for ``motion_field``.
        clouds: the points of two surveys; each pair that is asked for has one in common with the pair before.
    """
    tracks = _tracks(field, parameters)
    if not tracks:
        return ()
    windows = [field.layout.number[track.sightings[-1].cells] for track in tracks]
    motion, covariance, area = _fits(field, pairs, windows, clouds, parameters, progress or Progress())
    facets = [field.layout.facets.frames[int(field.layout.facet[w[0]])] for w in windows]
    axes = np.stack([frame.axes for frame in facets])
    places = np.stack([field.layout.places[w].mean(axis=0) for w in windows])
    registration = field.references.error_at(places, field.surveys.registered)
    measured = Measured(
        field.surveys.links,
        np.einsum("zij,mzj->mzi", axes, motion),
        axes @ covariance @ np.swapaxes(axes, 1, 2),
        axes[:, None] @ registration @ np.swapaxes(axes, 1, 2)[:, None],
    )
    looks = [adjust(measured, field.noise[0], field.surveys.days, last) for last in range(1, len(field.surveys.days))]
    chances = np.stack([_chances(done, field, last) for last, done in enumerate(looks, 1)])
    found = []
    # a zone that stood out before stays, as often as the number of looks allows
    chance = np.fmin(chances[-1], len(looks) * np.nanmin(np.where(np.isnan(chances), 1.0, chances), axis=0))
    for number, track in enumerate(tracks):
        if not chance[number] <= MAX_PROBABILITY:
            continue
        first = int(np.nanargmin(np.where(chances[:, number] <= MAX_PROBABILITY, 0, 1))) + 1
        found.append(
            _assembled(track, windows[number], number, looks[-1], field, axes[number], places[number])
            | {"probability": float(chance[number]), "found": max(first, track.sightings[0].epoch)}
            | {"area": len(windows[number]) * parameters.spacing**2, "fitted_area": float(area[number])}
        )
    return tuple(MovingGround(**zone) for zone in found)


def _tracks(field: Field, parameters: DisplacementParameters) -> list[Track]:
    """Groups of windows that stand out, followed through the surveys, and still there or there more than once."""
    layout, seen = field.layout, []
    for last, (vectors, significant) in enumerate(zip(field.looks, field.significant, strict=True), 1):
        labels = np.zeros(layout.grid.shape, dtype=np.int32)
        usable = significant & np.isfinite(vectors.in_plane).all(axis=1)
        for number, group in enumerate(groups(vectors, usable, layout.columns, layout.facet), 1):
            if len(group) * parameters.spacing**2 >= parameters.slide_area:
                labels.ravel()[layout.cell[group]] = number
        seen.append((last, labels, np.ones(layout.grid.shape, dtype=np.int8)))
    tracks = (t for t in track_zones(seen, _REACH, _alike(field)) if not t.merged_into)
    end = len(field.looks)
    return [t for t in tracks if t.sightings[-1].epoch == end or len(t.sightings) >= _MIN_LOOKS]


def _alike(field: Field) -> Alike:
    """Whether cells of windows lie on one facet and move on the whole in like directions."""
    layout = field.layout
    directions = []
    for vectors in field.looks:
        plane = vectors.in_plane[:, :2]
        directions.append(plane / np.maximum(np.linalg.norm(plane, axis=1, keepdims=True), _SHORTEST_M))

    def alike(survey: int, cells: Index, other: int, others: Index) -> bool:
        one, two = layout.number[cells], layout.number[others]
        if layout.facet[one[0]] != layout.facet[two[0]]:
            return False
        a, b = directions[survey - 1][one].sum(axis=0), directions[other - 1][two].sum(axis=0)
        return bool(a @ b > np.cos(np.radians(MAX_TURN_DEG)) * np.linalg.norm(a) * np.linalg.norm(b))

    return alike


def _order(pairs: Sequence[tuple[int, int]]) -> Iterator[int]:
    """Rows of the pairs such that each has a survey in common with the one before."""
    cumulative = [row for row, (earlier, _) in enumerate(pairs) if earlier == 0]
    steps = [row for row, (earlier, _) in enumerate(pairs) if earlier != 0]
    return iter((*cumulative, *reversed(steps)))


def _fits(
    field: Field,
    pairs: Sequence[PairMotion],
    windows: Sequence[Index],
    clouds: Clouds,
    parameters: DisplacementParameters,
    progress: Progress,
) -> tuple[Float, Float, Float]:
    """Motion (pairs, zones, 3) of one fit over each zone, its covariance, and the zones' fitted areas."""
    links, taken_off = field.surveys.links, field.references.taken_off
    motion = np.full((len(pairs), len(windows), 3), np.nan)
    covariance = np.full((len(pairs), len(windows), 3, 3), np.nan)
    area = np.zeros(len(windows))
    for done, row in enumerate(_order(links.pairs)):
        progress.update(done / len(pairs), "measuring zones that move as one")
        earlier, later = links.pairs[row]
        measured = pair_zones.Measured(
            clouds(earlier, later),
            field.layout.facets,
            field.layout.facet,
            search_of(parameters, pairs[row].kernel),
            field.layout.columns,
            parameters.spacing,
            pairs[row].sizes[-1].common,
            taken_off[later] - taken_off[earlier],
        )
        start = _between(field, earlier, later)
        for number, group in enumerate(windows):
            fit = pair_zones.fit_group(group, start, measured, _no_error)
            if fit is not None:
                motion[row, number], covariance[row, number], area[number] = fit
    return motion, covariance, area


def _between(field: Field, earlier: int, later: int) -> Vectors:
    """The windows' motion between two surveys, to begin with; none where it is not known."""
    motion = np.nan_to_num(field.motion[:, later] - field.motion[:, earlier])
    return field.vectors(motion, field.covariance[:, later])


def _no_error(places: Float) -> Float:
    return np.zeros((len(places), 3, 3))


def _chances(done: Adjusted, field: Field, last: int) -> Float:
    """(zones,) probability that still ground shows such a motion anywhere on the map; NaN where none was measured."""
    motion, covariance = evidence(done.motion[:, last], done, field.surveys.days, last)
    statistic = squared_length(motion[:, :2], covariance[:, :2, :2])
    tests = tests_of(last) * max(field.independent, 1.0)
    return np.minimum(np.asarray(chdtrc(2, statistic)) * tests, 1.0)


def unevenness(way: Float, error: Float, independent: float) -> float:
    """Standard error of a zone's mean motion because its parts move differently, as a share of it.

    One fit over ground that creeps unevenly gives a motion that most of it has, which is not its mean.

    Args:
        way: (n,) motion of the zone's windows in its direction, and the standard ``error`` of each.
        independent: number of windows that do not overlap.
    """
    known = np.isfinite(way) & np.isfinite(error)
    if np.count_nonzero(known) < 2:
        return 0.0
    mean = float(way[known].mean())
    excess = float(way[known].var(ddof=1) - (error[known] ** 2).mean())
    return float(np.sqrt(max(excess, 0.0) / max(independent, 1.0)) / abs(mean)) if mean else 0.0


def _assembled(
    track: Track, windows: Index, number: int, done: Adjusted, field: Field, axes: Float, place: Float
) -> dict[str, Any]:
    """What is known of a zone after the last survey, in the map's coordinates."""
    last = len(field.surveys.days) - 1
    way = evidence(done.motion[:, last], done, field.surveys.days, last)[0][number, :2]
    direction = axes[:2].T @ (way / np.hypot(*way))
    each = field.velocity[windows] @ direction
    errors = np.sqrt(np.einsum("a,nab,b->n", direction, field.velocity_covariance[windows], direction))
    width = float(np.min(field.looks[-1].width[windows]))
    independent = len(windows) * field.layout.grid.cell**2 / (np.pi * (width / 2) ** 2)
    uneven = unevenness(each, errors, independent)
    velocity = done.velocity[number] @ axes
    return {
        "zone_id": f"M{track.zone_id[1:]}",
        "windows": windows,
        "place": place,
        "axes": axes,
        "motion": done.motion[number] @ axes,
        "covariance": np.einsum("ac,iajb,bd->icjd", axes, done.covariance[number], axes),
        "velocity": velocity,
        "velocity_covariance": axes.T @ done.velocity_covariance[number] @ axes
        + uneven**2 * np.outer(velocity, velocity),
        "unevenness": uneven,
        "direction": direction,
        "sightings": track.sightings,
        "parent": f"M{track.parent[1:]}" if track.parent else "",
    }
