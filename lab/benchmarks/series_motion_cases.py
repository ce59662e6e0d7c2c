"""Series whose ground creeps along its surface, as files of ground with a known velocity at every place.

Simulated: six raw surveys of a slope under 70 % vegetation in which nothing moves, their ground extracted; then the
ground points are carried by what creeps. Real: the ground of a dense cloud that is dealt out into six surveys, carried
in the same way. Surveys without motion are extracted once for all cases of a seed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import shapely
from pyproj import CRS

from ...engine.core.arrays import Float
from ...engine.displacement.facets import find_facets
from ...engine.displacement.frame import Frame
from ...engine.epochs.epoch import Epoch
from ...engine.geometry.rigid_transform import RigidTransform
from ...engine.ground.filtering import known_ground
from ...engine.pointcloud.cloud import PointCloud
from ...engine.pointcloud.writing import write_cloud
from ...interface.parameters import SurveyParameters
from ...simulation.surveys.scene import Scene
from ...simulation.surveys.series import simulate_series, survey_days
from ...simulation.surveys.survey import motions_of
from ...simulation.surveys.true_motion import ground_motion, outline
from .chain import ground_of
from .real_data import dense_cloud

DAYS = survey_days(6, 60)
_RETURNS_PER_M2, _LENGTH_M, _HEIGHT_M, _AREA_M2 = 540.0, 27.0, 18.0, 600.0
_OFFSET_M = 0.1
_UNIT_WAY_M = 0.01  # of the simulated motions before they are scaled to their rates; short, so that no edge folds
_REAL_CRS = "EPSG:32614"
_HALF_AXES_M, _SOFT = (4.5, 3.25), 0.75
_APART_M = (11.0, 8.5)  # middles of two ellipses, along the motion and across it
_MAX_TURN_DEG = 30.0  # of the motion against the dip
_COVER_CELL_M, _MIN_COVER_POINTS, _MIN_COVER = 1.0, 10, 0.9
_AROUND_M = 0.5  # an ellipse that must be covered, too
_MAX_DRAWS = 2000


@dataclass(frozen=True)
class Case:
    """A series as files of ground.

    ``velocity`` gives the true velocity (n, 3) at places (n, 2), metres a day; ``outlines`` are those of what moves,
    and ``rates`` (mm/day) how fast it does in the middle.
    """

    epochs: tuple[Epoch, ...]
    velocity: Callable[[Float], Float]
    outlines: tuple[shapely.Polygon, ...] = ()
    rates: tuple[float, ...] = ()


@dataclass(frozen=True)
class _Surveys:
    """Ground (n, 3) of surveys between which nothing moved, each in its own coordinates, and the way to the first's."""

    grounds: tuple[Float, ...]
    to_first: tuple[RigidTransform, ...]
    crs: str


@dataclass(frozen=True)
class Sliding:
    """An ellipse of 9 x 6.5 m on a plane, of which ground creeps at ``rate`` (m/day), less from its soft edge on.

    ``middle`` (2,) is along the dip and across it in the ``frame``; ``turn`` the motion's angle to the dip, radians.
    """

    frame: Frame
    middle: Float
    rate: float
    turn: float

    def velocity(self, places: Float) -> Float:
        """(n, 3) east, north, up of places (n, 3), metres a day."""
        along, across = self._turned(self.frame.to_plane(places)[:, :2])
        radius = np.hypot(along / _HALF_AXES_M[0], across / _HALF_AXES_M[1])
        share = np.clip((1 - radius) / (1 - _SOFT), 0.0, 1.0)
        way = np.cos(self.turn) * self.frame.axes[0] + np.sin(self.turn) * self.frame.axes[1]
        return (self.rate * share * share * (3 - 2 * share))[:, None] * way

    @property
    def outline(self) -> shapely.Polygon:
        """On the map."""
        angle = np.linspace(0.0, 2 * np.pi, 65)[:-1]
        along, across = _HALF_AXES_M[0] * np.cos(angle), _HALF_AXES_M[1] * np.sin(angle)
        cos, sin = np.cos(self.turn), np.sin(self.turn)
        flat = np.column_stack([cos * along - sin * across, sin * along + cos * across, np.zeros(64)])
        flat[:, :2] += self.middle
        return shapely.Polygon((self.frame.origin + self.frame.to_map(flat))[:, :2])

    def _turned(self, flat: Float) -> tuple[Float, Float]:
        off = flat - self.middle
        cos, sin = np.cos(self.turn), np.sin(self.turn)
        return cos * off[:, 0] + sin * off[:, 1], cos * off[:, 1] - sin * off[:, 0]


def simulated(seed: int, rates: Sequence[float], folder: Path) -> Case:
    """Surveys of a slope with places that creep at ``rates`` (mm/day) in their middle, fastest there."""
    surveys, scene = _simulated_surveys(seed)
    parameters = _parameters(seed, "creep")
    unit = motions_of(parameters, _UNIT_WAY_M, len(rates)) if rates else ()
    scaled = tuple(motion.scaled(rate / 1000 / _UNIT_WAY_M) for motion, rate in zip(unit, rates, strict=True))

    def way(places: Float, days: int) -> Float:
        moved = scene.with_motions(tuple(motion.scaled(float(days)) for motion in scaled))
        return np.nan_to_num(ground_motion(moved, scene, places))

    def velocity(places: Float) -> Float:
        """Mean of all surveys."""
        days = (DAYS[-1] - DAYS[0]).days
        return way(places, days) / days

    outlines = tuple(outline(motion, scene.frame) for motion in unit)
    return Case(_written(surveys, way if rates else None, folder), velocity, outlines, tuple(rates))


def real(seed: int, rates: Sequence[float], folder: Path) -> Case:
    """A dense cloud dealt out into surveys, with an ellipse for each of ``rates`` (mm/day) where ``seed`` puts it."""
    surveys = _real_surveys(seed)
    facets = find_facets(surveys.grounds[0])
    sliding = _places(surveys.grounds[0], facets.frames[0], rates, np.random.default_rng([seed, 1]))

    def way(places: Float, days: int) -> Float:
        return days * np.sum([one.velocity(places) for one in sliding], axis=0)

    def velocity(places: Float) -> Float:
        return way(facets.places(places)[1], 1) if sliding else np.zeros((len(places), 3))

    outlines, placed = tuple(one.outline for one in sliding), tuple(rates[: len(sliding)])
    return Case(_written(surveys, way if sliding else None, folder), velocity, outlines, placed)


def _written(surveys: _Surveys, way: Callable[[Float, int], Float] | None, folder: Path) -> tuple[Epoch, ...]:
    """The surveys as files; ``way`` is how far ground at places (n, 3) of the first survey goes in so many days."""
    epochs = []
    for ground, to_first, day in zip(surveys.grounds, surveys.to_first, DAYS, strict=True):
        epochs.append(Epoch(folder / f"{day.isoformat()}.laz", day))
        xyz = ground
        if way is not None and day > DAYS[0]:
            first = to_first.apply(ground)
            xyz = to_first.inverse().apply(first + way(first, (day - DAYS[0]).days))
        write_cloud(epochs[-1].path, PointCloud(xyz, CRS.from_user_input(surveys.crs), epochs[-1].path))
    return tuple(epochs)


def _parameters(seed: int, motion: str) -> SurveyParameters:
    return SurveyParameters(
        seed=seed, points=round(_RETURNS_PER_M2 * _AREA_M2), length=_LENGTH_M, height=_HEIGHT_M, offset=_OFFSET_M,
        motion=motion,
    )  # fmt: skip


@lru_cache(maxsize=1)
def _simulated_surveys(seed: int) -> tuple[_Surveys, Scene]:
    series = simulate_series(_parameters(seed, "none"), DAYS, ())
    grounds = tuple(ground_of(cloud, series).xyz for cloud in series.clouds)
    return _Surveys(grounds, series.transforms, series.crs), series.scene


@lru_cache(maxsize=1)
def _real_surveys(seed: int) -> _Surveys:
    cloud = dense_cloud()
    assert cloud is not None
    dealt = np.random.default_rng(seed).permutation(len(cloud)) % len(DAYS)
    parts = (cloud[dealt == number] for number in range(len(DAYS)))
    grounds = tuple(part[known_ground(part).mask] for part in parts)
    return _Surveys(grounds, (RigidTransform.identity(),) * len(DAYS), _REAL_CRS)


def _places(ground: Float, frame: Frame, rates: Sequence[float], rng: np.random.Generator) -> list[Sliding]:
    """Ellipses that ground covers, far enough from one another; fewer than ``rates`` where there is no room."""
    flat = frame.to_plane(ground)[:, :2]
    low = flat.min(axis=0)
    square, count = np.unique(np.floor((flat - low) / _COVER_CELL_M).astype(np.int64), axis=0, return_counts=True)
    covered = np.zeros(square.max(axis=0) + 1, dtype=bool)
    covered[tuple(square[count >= _MIN_COVER_POINTS].T)] = True
    middles = (np.argwhere(np.ones_like(covered)) + 0.5) * _COVER_CELL_M + low
    found: list[Sliding] = []
    for _ in range(_MAX_DRAWS):
        if len(found) == len(rates):
            break
        turn = np.radians(rng.uniform(-_MAX_TURN_DEG, _MAX_TURN_DEG))
        one = Sliding(frame, rng.uniform(low, flat.max(axis=0)), rates[len(found)] / 1000, float(turn))
        along, across = one._turned(middles)
        inside = np.hypot(along / (_HALF_AXES_M[0] + _AROUND_M), across / (_HALF_AXES_M[1] + _AROUND_M)) < 1.0
        whole = np.pi * (_HALF_AXES_M[0] + _AROUND_M) * (_HALF_AXES_M[1] + _AROUND_M) / _COVER_CELL_M**2
        if np.count_nonzero(covered.ravel()[inside]) < _MIN_COVER * whole:
            continue
        if all(np.hypot(*((one.middle - other.middle) / _APART_M)) > 1.0 for other in found):
            found.append(one)
    return found
