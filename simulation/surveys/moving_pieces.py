"""A series of planes, boxes and bowls of which more and more move: a test of registration without stable areas given.

Made after the simulated series with which piecewise registration is published (Yang and Schwieger 2023, Yang and Holst
2025), which holds such shapes. Every survey samples the surfaces anew, so that no point is measured twice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ...engine.core.arrays import Bool, Float
from ...engine.geometry.rigid_transform import RigidTransform

POINTS = 165_000
EPOCHS = 19
MIN_SHARE, MAX_SHARE = 0.19, 0.96
NOISE = 0.003  # metres, along the surface's normal
OFFSET, TURN = 0.15, 2e-3  # metres and rad of a survey as delivered
_PANELS, _SIDE = 6, 4.0  # panels a row, and metres of each
_BLOCKS = 8


@dataclass(frozen=True)
class Piece:
    """A plane, box or bowl that moves as one.

    ``axes`` (3, 3) has its own directions in columns, the last one upwards; lengths of ``size`` are metres: sides and
    height of a box, sides of a plane, and the radius of a bowl. ``hole`` is the centre and half the side of the square
    that something on a plane stands on.
    """

    kind: str
    origin: Float
    axes: Float
    size: tuple[float, float, float]
    hole: tuple[float, float, float] | None = None

    @property
    def area(self) -> float:
        a, b, h = self.size
        if self.kind == "box":
            return a * b + 2 * h * (a + b)
        if self.kind == "bowl":
            return 2 * np.pi * a**2
        return a * b - (0.0 if self.hole is None else 4 * self.hole[2] ** 2)

    def sampled(self, count: int, noise: float, rng: np.random.Generator) -> Float:
        """``count`` points (count, 3), evenly spread, with ``noise`` (m) along the normal."""
        places, normals = {"box": self._box, "bowl": self._bowl, "plane": self._plane}[self.kind](count, rng)
        places = places + normals * rng.normal(0, noise, count)[:, None]
        return np.asarray(self.origin + places @ self.axes.T)

    def _plane(self, count: int, rng: np.random.Generator) -> tuple[Float, Float]:
        found = np.empty((0, 2))
        while len(found) < count:
            more = rng.uniform(-0.5, 0.5, (2 * count, 2)) * self.size[:2]
            if self.hole is not None:
                more = more[np.abs(more - self.hole[:2]).max(axis=1) > self.hole[2]]
            found = np.concatenate([found, more])
        return np.column_stack([found[:count], np.zeros(count)]), np.tile([0.0, 0.0, 1.0], (count, 1))

    def _bowl(self, count: int, rng: np.random.Generator) -> tuple[Float, Float]:
        up, around = rng.uniform(0, 1, count), rng.uniform(0, 2 * np.pi, count)
        flat = np.sqrt(1 - up**2)
        normals = np.column_stack([flat * np.cos(around), flat * np.sin(around), up])
        return self.size[0] * normals, normals

    def _box(self, count: int, rng: np.random.Generator) -> tuple[Float, Float]:
        a, b, h = self.size
        areas = np.array([a * b, a * h, a * h, b * h, b * h])
        face = rng.choice(5, count, p=areas / areas.sum())
        place = (rng.uniform(0, 1, (count, 3)) - [0.5, 0.5, 0.0]) * self.size
        normal = np.array([[0, 0, 1], [0, -1, 0], [0, 1, 0], [-1, 0, 0], [1, 0, 0]], dtype=float)[face]
        place = np.where(face[:, None] == 0, place * [1, 1, 0] + [0, 0, h], place)
        side = face > 0
        across = np.abs(normal) > 0
        place[side] = np.where(across[side], normal[side] * np.array(self.size) / 2, place[side])
        return place, normal


@dataclass(frozen=True)
class MovedEpoch:
    """A survey ``xyz`` (n, 3) as delivered; ``transform`` moves it to the first one's frame, ``stable`` (n,) is true.

    ``share``: of the points, has moved.
    """

    xyz: Float
    stable: Bool
    transform: RigidTransform
    share: float


def build_pieces(seed: int) -> tuple[Piece, ...]:
    """Panels side by side, each tilted its own way; on two of three stands a box or a bowl."""
    rng = np.random.default_rng([seed, 1])
    pieces: list[Piece] = []
    for number in range(_PANELS**2):
        row, column = divmod(number, _PANELS)
        tilt = Rotation.from_euler("xy", rng.normal(0, 0.12, 2)).as_matrix()
        origin = np.array([(column + 0.5) * _SIDE, (row + 0.5) * _SIDE, 0.3 * row]) + rng.normal(0, [0, 0, 0.1])
        hole: tuple[float, float, float] | None = None
        if number % 3 < 2:
            kind = ("box", "bowl")[number % 3]
            half = float(rng.uniform(0.4, 0.7))
            u, v = rng.uniform(-1.0, 1.0, 2)
            hole = (float(u), float(v), half)
            turn = tilt @ Rotation.from_euler("z", rng.uniform(0, np.pi)).as_matrix()
            side = 2 * half / np.sqrt(2)
            size = (half, half, half) if kind == "bowl" else (side, side, float(rng.uniform(0.6, 1.6)))
            pieces.append(Piece(kind, origin + tilt @ [u, v, 0.0], turn, size))
        pieces.append(Piece("plane", origin, tilt, (_SIDE - 0.1, _SIDE - 0.1, 0.0), hole))
    return tuple(pieces)


def shares_moved() -> tuple[float, ...]:
    """Share that has moved at each of the later epochs."""
    return (0.0, *(float(v) for v in np.linspace(MIN_SHARE, MAX_SHARE, EPOCHS - 1)))


def first_epoch(seed: int, points: int = POINTS) -> Float:
    """The survey (n, 3) that the later ones are compared with."""
    pieces = build_pieces(seed)
    rng = np.random.default_rng([seed, 2])
    clouds = [p.sampled(n, NOISE, rng) for p, n in zip(pieces, _counts(pieces, points), strict=True)]
    return np.concatenate(clouds)


def moved_epoch(seed: int, share: float, *, together: bool = False, points: int = POINTS) -> MovedEpoch:
    """A later survey of which ``share`` has moved.

    Args:
        together: neighbours move as one block, as landslides do; else every piece goes its own way.
    """
    pieces = build_pieces(seed)
    rng = np.random.default_rng([seed, 3, round(1000 * share), together])
    counts = _counts(pieces, points)
    moved = _chosen(pieces, counts, share, np.random.default_rng([seed, 4]))
    groups = _blocks(pieces, np.random.default_rng([seed, 5])) if together else np.arange(len(pieces))
    motions = {int(group): _motion(pieces, groups == group, rng) for group in np.unique(groups)}
    clouds = []
    for piece, count, changed, group in zip(pieces, counts, moved, groups, strict=True):
        cloud = piece.sampled(count, NOISE, rng)
        clouds.append(motions[int(group)].apply(cloud) if changed else cloud)
    xyz, stable = np.concatenate(clouds), np.repeat(~moved, counts)
    direction, axis = rng.normal(size=(2, 3))
    truth = RigidTransform(
        Rotation.from_rotvec(TURN * axis / np.linalg.norm(axis)).as_matrix(),
        OFFSET * direction / np.linalg.norm(direction),
        xyz.mean(axis=0),
    )
    return MovedEpoch(truth.inverse().apply(xyz), stable, truth, float(1 - stable.mean()))


def _counts(pieces: tuple[Piece, ...], points: int) -> NDArray[np.int64]:
    areas = np.array([piece.area for piece in pieces])
    return np.asarray(np.round(points * areas / areas.sum()), dtype=np.int64)


def _chosen(pieces: tuple[Piece, ...], counts: NDArray[np.int64], share: float, rng: np.random.Generator) -> Bool:
    """Which pieces move: from one corner on, more or less, until ``share`` of the points does."""
    distance = np.array([np.linalg.norm(p.origin[:2]) for p in pieces]) + rng.normal(0, 5.0, len(pieces))
    order = np.argsort(distance)
    together = np.cumsum(counts[order])
    moved = np.zeros(len(pieces), dtype=bool)
    moved[order[together <= share * counts.sum()]] = True
    return moved


def _blocks(pieces: tuple[Piece, ...], rng: np.random.Generator) -> NDArray[np.int64]:
    """Number of the nearest of some places, by piece."""
    places = np.array([piece.origin[:2] for piece in pieces])
    middles = rng.uniform(0, _PANELS * _SIDE, (_BLOCKS, 2))
    return np.asarray(np.argmin(np.linalg.norm(places[:, None] - middles, axis=2), axis=1), dtype=np.int64)


def _motion(pieces: tuple[Piece, ...], which: Bool, rng: np.random.Generator) -> RigidTransform:
    """20 to 300 mm in any direction, with a turn of up to half a degree about the middle of the pieces."""
    direction, axis = rng.normal(size=(2, 3))
    return RigidTransform(
        Rotation.from_rotvec(rng.uniform(0, 0.009) * axis / np.linalg.norm(axis)).as_matrix(),
        rng.uniform(0.02, 0.3) * direction / np.linalg.norm(direction),
        np.mean([piece.origin for piece, chosen in zip(pieces, which, strict=True) if chosen], axis=0),
    )
