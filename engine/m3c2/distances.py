"""M3C2: the distance of two clouds along the surface's normal, and its level of detection (Lague et al. 2013).

Around each core point a cylinder along the normal gathers the points of both clouds. The distance is the difference
of their mean positions along the axis, and their scatter gives its uncertainty (doi:10.1016/j.isprsjprs.2013.04.009).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..change.slope_calibration import ErrorModel, uncalibrated
from ..core.arrays import Float, Index
from ..core.compiled import pays
from ..core.progress import Progress
from ..statistics.normal import quantile
from .kernels import CYLINDER_SUMS, MIN_COMPILED_PLACES, PLACES_PER_CALL
from .lattice import Lattice, runs
from .spread import Spread, SpreadSums, across


class Status(IntEnum):
    """What became of a core point."""

    MEASURED = 0
    FEW_POINTS = 1  # a distance, but too few points for a level of detection
    NO_POINTS = 2  # a cylinder of one cloud or of both is empty
    NO_NORMAL = 3  # no direction to measure in


@dataclass(frozen=True)
class Cylinders:
    """Points of one cloud in m cylinders: ``count`` (m,); ``mean`` and ``std`` (m,) of their positions along the axis
    from the core point, metres, NaN without points. ``std`` is the sample's (n - 1), NaN for one point. ``value`` (m,)
    is the mean of the points' own values, None where the cloud has none, and ``spread`` how the points lie across the
    axis, where that was asked for.
    """

    count: Index
    mean: Float
    std: Float
    value: Float | None = None
    spread: Spread | None = None


@dataclass(frozen=True)
class Cylinder:
    """Its ``radius`` and how far it reaches to both sides of its core point, ``half_length``, metres.

    Its wall and its ends belong to it.
    """

    radius: float
    half_length: float


@dataclass(frozen=True)
class LevelTerms:
    """What a level of detection needs in addition to the points' scatter.

    Attributes:
        minimum_points: of each cloud in a cylinder.
        registration_error: standard error of the registration, metres; added as in eq. 1 of the paper.
    """

    minimum_points: int = 5
    confidence: float = 0.95
    registration_error: float = 0.0


@dataclass(frozen=True)
class Distances:
    """M3C2 at m core points, metres; the moving cloud minus the reference, positive to the side of the normal.

    ``level`` is the level of detection at ``confidence``, NaN unless the ``status`` is MEASURED; ``distance`` is NaN
    where it is NO_POINTS or NO_NORMAL. Without a normal the counts are those of a ball. The level is the published one
    unless stable ground calibrated it (``m3c2_level``), as ``model`` then states; ``plants_factor`` is the
    factor of the stated errors by plants.
    """

    core: Float
    normal: Float
    distance: Float
    level: Float
    significant: NDArray[np.bool_]
    reference: Cylinders
    moving: Cylinders
    status: NDArray[np.uint8]
    confidence: float
    registration_error: float
    model: ErrorModel = field(default_factory=uncalibrated)
    plants_factor: float = 1.0

    @property
    def measured(self) -> NDArray[np.bool_]:
        return self.status == Status.MEASURED


def m3c2_distances(
    clouds: tuple[Lattice, Lattice],
    core: Float,
    normal: Float,
    cylinder: Cylinder,
    terms: LevelTerms | None = None,
    *,
    spread: bool = False,
    progress: Progress | None = None,
) -> Distances:
    """Distance and level of detection at each core point.

    Args:
        clouds: the reference and the later survey.
        core: (m, 3) where to measure.
        normal: (m, 3) in which direction; brought to length 1 here, zeros where there is none.
        spread: also return how the points of each cylinder lie across its axis, which calibrating the level needs.
    """
    progress, terms = progress or Progress(), terms or LevelTerms()
    length = np.linalg.norm(normal, axis=1)
    directed = length > 0
    unit = np.divide(normal, length[:, None], out=np.zeros_like(normal), where=directed[:, None])
    with progress.stage(0.0, 0.5, "measuring the reference"):
        first = cylinder_statistics(clouds[0], core, unit, cylinder, progress, spread=spread)
    with progress.stage(0.5, 1.0, "measuring the later survey"):
        second = cylinder_statistics(clouds[1], core, unit, cylinder, progress, spread=spread)
    fewest = np.minimum(first.count, second.count)
    status = np.full(len(core), Status.MEASURED, dtype=np.uint8)
    status[fewest < terms.minimum_points] = Status.FEW_POINTS
    status[fewest == 0] = Status.NO_POINTS
    status[~directed] = Status.NO_NORMAL
    distance = np.where(status <= Status.FEW_POINTS, second.mean - first.mean, np.nan)
    level = np.full(len(core), np.nan)
    sure = status == Status.MEASURED
    level[sure] = level_of_detection(first, second, terms.confidence, terms.registration_error)[sure]
    with np.errstate(invalid="ignore"):
        significant = np.abs(distance) > level
    return Distances(
        core=core,
        normal=unit,
        distance=distance,
        level=level,
        significant=significant,
        reference=first,
        moving=second,
        status=status,
        confidence=terms.confidence,
        registration_error=terms.registration_error,
    )


def joined(parts: Sequence[tuple[Index, Distances]]) -> Distances:
    """Those of all core points from all their parts, each with the numbers (k,) of its core points."""
    if len(parts) == 1:
        return parts[0][1]
    place = np.argsort(np.concatenate([here for here, _ in parts]))

    def of(values: Callable[[Distances], NDArray]) -> NDArray:
        return np.concatenate([values(found) for _, found in parts])[place]

    def cylinders(which: Callable[[Distances], Cylinders]) -> Cylinders:
        one = which(parts[0][1])
        return Cylinders(
            count=of(lambda d: which(d).count),
            mean=of(lambda d: which(d).mean),
            std=of(lambda d: which(d).std),
            value=None if one.value is None else of(lambda d: _known(which(d).value)),
            spread=None
            if one.spread is None
            else Spread(of(lambda d: _known(which(d).spread).place), of(lambda d: _known(which(d).spread).products)),
        )

    return replace(
        parts[0][1],
        core=of(lambda d: d.core),
        normal=of(lambda d: d.normal),
        distance=of(lambda d: d.distance),
        level=of(lambda d: d.level),
        significant=of(lambda d: d.significant),
        reference=cylinders(lambda d: d.reference),
        moving=cylinders(lambda d: d.moving),
        status=of(lambda d: d.status),
    )


_Any = TypeVar("_Any")


def _known(value: _Any | None) -> _Any:
    assert value is not None
    return value


def level_of_detection(first: Cylinders, second: Cylinders, confidence: float, registration_error: float) -> Float:
    """Lague et al. 2013, eq. 1: quantile times (sqrt(s1^2 / n1 + s2^2 / n2) + registration error), metres (m,)."""
    sampling = np.sqrt(sum(squared_errors(first, second)))
    return quantile(confidence) * (sampling + registration_error)


def squared_errors(first: Cylinders, second: Cylinders) -> tuple[Float, Float]:
    """s^2 / n of both clouds' means, m² (m,); NaN for less than two points."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return first.std**2 / first.count, second.std**2 / second.count


def cylinder_statistics(
    cloud: Lattice,
    core: Float,
    unit: Float,
    cylinder: Cylinder,
    progress: Progress | None = None,
    *,
    spread: bool = False,
) -> Cylinders:
    """Count, mean and standard deviation along the axis of a cloud's points in each core point's cylinder, mean value.

    The test is made in double precision on the points' offsets from the core point itself, so that large coordinates
    cost no digits; a point on the wall or on an end is inside.

    Args:
        core: (m, 3).
        unit: (m, 3) axes of length 1. One of length 0 makes a ball.
        spread: also return how the points lie across the axis.
    """
    progress = progress or Progress()
    sums = SpreadSums(unit) if spread else None
    mean, std, value = np.full((3, len(core)), np.nan)
    found = Cylinders(
        count=np.zeros(len(core), dtype=np.int64),
        mean=mean,
        std=std,
        value=None if cloud.values is None else value,
        spread=None if sums is None else sums.spread,
    )
    loop = CYLINDER_SUMS.ready() if pays(len(core), MIN_COMPILED_PLACES) else None
    if loop is not None:
        _compiled_statistics(loop, found, cloud, core, unit, cylinder, progress)
        return found
    places, axes = (np.ascontiguousarray(rows.T) for rows in (core, unit))
    done = 0
    for number, point in cloud.candidates(core, cylinder.half_length * unit, cylinder.radius):
        done += int(np.count_nonzero(number[1:] != number[:-1])) + 1
        offset = cloud.offsets(places, number, point)
        axis = [component.take(number) for component in axes]
        along = offset[0] * axis[0] + offset[1] * axis[1] + offset[2] * axis[2]
        across = np.zeros_like(along)
        for component, share in zip(offset, axis, strict=True):
            share *= along
            component -= share
            component *= component
            across += component
        inside = np.flatnonzero((np.abs(along) <= cylinder.half_length) & (across <= cylinder.radius**2))
        if len(inside):
            number, point = number.take(inside), point.take(inside)
            _fill(found, cloud, number, point, along.take(inside))
            if sums is not None:
                sums.add(number, cloud.offsets(places, number, point), along.take(inside))
        progress.update(done / max(len(core), 1))
    return found


def _compiled_statistics(
    loop: Callable[..., None],
    found: Cylinders,
    cloud: Lattice,
    core: Float,
    unit: Float,
    cylinder: Cylinder,
    progress: Progress,
) -> None:
    searched, half_axes, nothing = cloud.searched(), cylinder.half_length * unit, np.zeros((0, 5))
    if searched is None:
        return
    moments = np.full((2, len(core)), np.nan)
    directions = (nothing[:, :3], nothing[:, :3]) if found.spread is None else across(unit)
    spread = (nothing[:, :2], nothing) if found.spread is None else (found.spread.place, found.spread.products)
    values = nothing[:, 0] if cloud.values is None else cloud.values.astype(np.float64)
    value = nothing[:, 0] if found.value is None else found.value
    lengths = cylinder.radius, cylinder.half_length, cloud.reach(half_axes, cylinder.radius)
    core, unit = (np.require(rows, np.float64, ["C", "W"]) for rows in (core, unit))
    order = cloud.along_rows(core)
    for start in range(0, len(order), PLACES_PER_CALL):
        places = order[start : start + PLACES_PER_CALL], core, unit
        loop(searched, values, places, directions, lengths, (found.count, moments, value, *spread))
        progress.update((start + len(places[0])) / len(order))
    found.mean[:], found.std[:] = moments


def _fill(found: Cylinders, cloud: Lattice, number: Index, point: Index, along: Float) -> None:
    """Enter the cylinders ``number`` (k,), all points of which are given: ``point`` (k,), ``along`` (k,) the axis."""
    which, starts, members = runs(number)
    found.count[which] = members
    found.mean[which] = np.add.reduceat(along, starts) / members
    squares = np.add.reduceat((along - found.mean.take(number)) ** 2, starts)
    several = members > 1
    found.std[which[several]] = np.sqrt(squares[several] / (members[several] - 1))
    if found.value is not None and cloud.values is not None:
        found.value[which] = np.add.reduceat(cloud.values.take(point).astype(np.float64), starts) / members
