"""A plan and the survey that was flown: lines, places and strips."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pyproj import CRS

from ..core.arrays import Float, Index
from ..grid.grid import Grid
from ..pointcloud.times import Flown
from .flown_lines import FLOWN_SHARE, SEEN_SHARE, FlownLine, flown_lines
from .flown_places import Reached, counts_of, reached_of
from .flown_tracks import Track, on_both_sides, strips_of, track_from_angles


@dataclass(frozen=True)
class Promised:
    """A plan as its file holds it: ``lines`` (k, 3) in the order flown, and densities (rows, columns) on ``grid``,
    returns and ground returns a m² of map, NaN outside of the places.
    """

    lines: list[Float]
    returns: Float
    ground: Float
    grid: Grid
    crs: CRS


@dataclass(frozen=True)
class Strip:
    """One strip of the survey flown: the file's ``number`` of it, its returns, how many ``places`` of the region it
    reaches and its ``density`` there (returns a m² of map, NaN where it reaches none), how many ``seconds`` it took
    (NaN where times are not known), and whether its angles show where it was flown.
    """

    number: int
    returns: int
    places: int
    density: float
    seconds: float
    placed: bool


@dataclass(frozen=True)
class Comparison:
    """What was flown of a plan. ``how`` the carrier's way is known: trajectory, angles, or none, when ``lines`` is
    empty; ``ground`` is None where no ground is known.
    """

    promised: Promised
    tracks: list[Track]
    how: str
    lines: list[FlownLine]
    returns: Reached
    ground: Reached | None
    strips: list[Strip]


def compared(
    promised: Promised, points: Float, ground: Float | None, flown: Flown, trajectory: Track | None
) -> Comparison:
    """Compare a survey's returns ``points`` (n, 3) and ``ground`` returns (m, 3), metres, with its plan.

    Without a trajectory the carrier's way is that which the scan angles show, strip by strip.
    """
    strip = strips_of(flown.source, flown.seconds)
    by_strip: dict[int, Track] = {}
    if trajectory is None:
        by_strip = _by_strip(points, strip, flown, flown.angle)
        # some programs count angles to the left, against the format, and put the carrier under the ground
        if not by_strip and on_both_sides(flown.angle):
            by_strip = _by_strip(points, strip, flown, -flown.angle)
    tracks, placed = list(by_strip.values()) if trajectory is None else [trajectory], set(by_strip)
    how = "none" if not tracks else "angles" if trajectory is None else "trajectory"
    return Comparison(
        promised,
        tracks,
        how,
        flown_lines(promised.lines, tracks, ground, SEEN_SHARE if trajectory is None else FLOWN_SHARE)
        if tracks
        else [],
        reached_of(points, promised.returns, promised.grid),
        None if ground is None else reached_of(ground, promised.ground, promised.grid),
        _strips(promised, points, strip, flown, placed),
    )


def _by_strip(points: Float, strip: Index, flown: Flown, angle: Float) -> dict[int, Track]:
    """The way of each strip whose angles (n,) show it."""
    found: dict[int, Track] = {}
    if flown.seconds is None:
        return found
    for number in range(int(strip.max()) + 1):
        own = strip == number
        track = track_from_angles(points[own], flown.seconds[own], angle[own])
        if track is not None:
            found[number] = track
    return found


def _strips(promised: Promised, points: Float, strip: Index, flown: Flown, placed: set[int]) -> list[Strip]:
    inside = np.isfinite(promised.returns)
    found = []
    for number in range(int(strip.max()) + 1 if len(strip) else 0):
        own = strip == number
        counts, _ = counts_of(points[own], promised.grid)
        hit = inside & (counts > 0)
        density = float(counts[hit].mean() / promised.grid.cell**2) if hit.any() else float("nan")
        seconds = float("nan") if flown.seconds is None else float(np.ptp(flown.seconds[own]))
        name = int(flown.source[own][0])
        found.append(Strip(name, int(own.sum()), int(hit.sum()), density, seconds, number in placed))
    return found
