"""The ground that motion along the surface is measured on: in memory or on the disk, as the memory allows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ..engine.core.errors import InputError
from ..engine.core.machine_memory import machine_memory
from ..engine.core.messages import shown
from ..engine.displacement.stored_ground import Ground, StoredGround
from ..engine.displacement.windows import TILE_BYTES, tile_threads
from ..engine.pointcloud.cloud import PointCloud
from ..engine.pointcloud.header import preflight
from ..engine.pointcloud.in_parts import SpooledCloud
from ..interface.parameters import given
from . import pair
from .pair import Cloud

_BASE_BYTES = 350_000_000
"""Memory of the program itself and of the rasters that are written, reckoned."""
_HELD_BYTES, _READ_BYTES, _WINDOW_BYTES = 120, 200, 13_000
"""Memory of a point that is in memory from the beginning (measured: 80 to 92 bytes with 1, 2 and 4 M points), of one
that is read for a tile (at most 100), and of what was found in a window of both widths (12 kB, while the map is put
together)."""
_FEWEST_POINTS, _MOST_POINTS = 50_000, 3_000_000  # of a survey that are in memory at a time


@dataclass(frozen=True)
class MotionMemory:
    """How much may be taken, bytes."""

    allowed: float

    @classmethod
    def of(cls, limit: float | str) -> MotionMemory:
        """As ``memory_limit`` says (GB); half of the machine's where it says nothing."""
        known = given(limit)
        return cls(known * 1e9 if known is not None else machine_memory() / 2)

    @property
    def threads(self) -> int:
        """Tiles that are worked on at a time."""
        return tile_threads((self.allowed - _BASE_BYTES) / 2)

    def holds(self, points: int) -> bool:
        """Whether both surveys, of so many points, are held in memory."""
        return points <= pair.MAX_HELD_POINTS and self._needed(points) <= self.allowed

    def _needed(self, points: int) -> float:
        return _BASE_BYTES + self.threads * TILE_BYTES + points * _HELD_BYTES

    def refuse_held(self, points: int) -> None:
        """Raise InputError where so many points, which are in memory already, need more than this machine has to give,
        whatever is allowed.
        """
        needed, allowed = self._needed(points), max(self.allowed, machine_memory() / 2)
        if needed > allowed:
            raise InputError(
                f"The {points:,} ground points of both surveys, which are held in memory, need about "
                f"{needed / 1e9:.2g} GB where {allowed / 1e9:.2g} GB, half of this machine's memory, may be taken; "
                "clip the surveys to the slope or thin them."
            )

    def refuse_less_than_parts(self, what: str) -> None:
        """Raise InputError where not even parts of the surveys fit; ``what`` is measured."""
        least = _BASE_BYTES + TILE_BYTES + 2 * _FEWEST_POINTS * _READ_BYTES
        if least > self.allowed:
            raise InputError(
                f"{what} need at least {least / 1e9:.2f} GB, even in parts, and {self.allowed / 1e9:.3g} GB are "
                "allowed; raise --memory-limit, or clip the clouds to the slope."
            )

    def at_once(self, area: float, spacing: float) -> int:
        """Points of a survey on the disk that are in memory at a time, next to the windows of an ``area`` (m²).

        Raises:
            InputError: the windows leave no room for points.
        """
        windows = area / spacing**2
        left = self.allowed - _BASE_BYTES - self.threads * TILE_BYTES - windows * _WINDOW_BYTES
        points = int(left / (2 * self.threads * _READ_BYTES))
        if points < _FEWEST_POINTS:
            raise InputError(
                f"About {windows:,.0f} windows, every {spacing:g} m, need more than the {self.allowed / 1e9:.3g} GB "
                "allowed; raise --memory-limit, or give a larger --spacing."
            )
        return min(points, _MOST_POINTS)


def refuse_motion_early(clouds: Sequence[Path], memory: MotionMemory) -> None:
    """Raise InputError where clouds do not fit by their headers, not even in parts."""
    points = sum(preflight(path).count for path in clouds)
    if not memory.holds(points):
        memory.refuse_less_than_parts(f"The {points:,} points of {' and '.join(shown(path) for path in clouds)}")


@contextmanager
def measurable(clouds: tuple[Cloud, Cloud], memory: MotionMemory, spacing: float) -> Iterator[tuple[Ground, Ground]]:
    """Both surveys' ground for ``measure_displacement``; those on the disk are sorted there while they are in use.

    Args:
        spacing: of the windows, metres.

    Raises:
        InputError: they need more memory than is allowed.
    """
    stored: list[StoredGround] = []
    try:
        for cloud in clouds:
            if isinstance(cloud, SpooledCloud):
                stored.append(stored_ground(cloud, memory, spacing))
        if not stored:
            memory.refuse_held(sum(len(cloud.xyz) for cloud in clouds if isinstance(cloud, PointCloud)))
        left = iter(stored)
        first, later = (cloud.xyz if isinstance(cloud, PointCloud) else next(left) for cloud in clouds)
        yield first, later
    finally:
        for ground in stored:
            ground.squares.file.unlink(missing_ok=True)


def stored_ground(cloud: SpooledCloud, memory: MotionMemory, spacing: float) -> StoredGround:
    """A survey on the disk, sorted into a file next to its own, of which as much is read at a time as is allowed.

    Args:
        spacing: of the windows, metres.

    Raises:
        InputError: it needs more memory than is allowed.
    """
    memory.refuse_less_than_parts(f"The {len(cloud):,} ground points of {shown(cloud.path)}")
    ground = StoredGround.of(cloud, _FEWEST_POINTS)
    return ground.holding(memory.at_once(ground.area, spacing))
