"""Real ground in two random halves, of which one is moved along the surface by a known shift.

Halves share their position and their strips: what is measured is what the relief allows, and no accuracy in the field.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np

from ...engine.core.arrays import Float
from ...engine.displacement.facets import find_facets
from ...engine.displacement.windows import density
from ...engine.ground.filtering import known_ground
from .real_data import DATA, DENSE, DENSE_HALVES, TILES, dense_cloud, split

SHIFTS_M = (0.0, 0.0, 0.05, 0.2)
_PATCH_M = 40.0
_GROUND = 2  # class


@dataclass(frozen=True)
class RealGround:
    """A cloud: ``maps`` measured of it; ``extract`` whether its ground must be found first, else that of class 2, or
    all points where none has it; in ``patches`` of 40 x 40 m, those with the most points, or as a whole.
    """

    name: str
    path: Path
    maps: int
    extract: bool = False
    patches: bool = False


@dataclass(frozen=True)
class RealPair:
    """Two grounds (n, 3), the later one moved by ``motion`` (3,), metres; points a m² of map of the sparser one."""

    first: Float
    later: Float
    motion: Float
    points_per_m2: float


REAL = (
    RealGround(f"ground of a {DENSE_HALVES}", DENSE, len(SHIFTS_M), extract=True),
    RealGround("airborne gullies in halves", DATA / "terrain" / "santa_cruz_gullies.laz", 6, patches=True),
    RealGround("airborne alpine slope in halves", TILES / "alpine_slope.laz", len(SHIFTS_M)),
    RealGround("airborne level ground in halves", TILES / "test_data_77050_627760_LA93_IGN69.laz", len(SHIFTS_M)),
)


def real_pair(ground: RealGround, number: int) -> RealPair:
    """Pair ``number`` of a cloud: another split each, the shifts in turn, and another patch for each of them."""
    whole = dense_cloud() if ground.path == DENSE else _ground(ground.path)
    assert whole is not None
    cloud = _patch(whole, number) if ground.patches else whole
    # a point that is there twice would have the same noise in both halves
    cloud = cloud[np.sort(np.unique(cloud, axis=0, return_index=True)[1])]
    halves = split(cloud, number)
    first, later = (part[known_ground(part).mask] for part in halves) if ground.extract else halves
    motion = SHIFTS_M[number % len(SHIFTS_M)] * find_facets(first).frames[0].axes[0]
    return RealPair(first, later + motion, motion, density((first, later)))


def _ground(path: Path) -> Float:
    cloud = laspy.read(path)
    xyz, ground = np.asarray(cloud.xyz, dtype=np.float64), np.asarray(cloud.classification) == _GROUND
    return xyz[ground] if ground.any() else xyz


def _patch(cloud: Float, number: int) -> Float:
    """The points of the square that is the ``number``-th by its points."""
    square = np.floor(cloud[:, :2] / _PATCH_M).astype(np.int64)
    _, place, count = np.unique(square, axis=0, return_inverse=True, return_counts=True)
    chosen = np.argsort(-count, kind="stable")[number]
    return np.asarray(cloud[place.reshape(-1) == chosen])
