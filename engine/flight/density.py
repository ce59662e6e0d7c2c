"""Pulses that a flight puts on the ground, in closed form: lines, beams, the ground's inclination and what hides it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ...interface.parameters import FlightParameters
from ..core.arrays import Float, Index
from .lines import Line
from .terrain import Terrain

ROSETTE_SHARES = (0.46, 0.38, 0.16)
"""Shares of half the field of view by which the three prisms of the rosette deflect a beam."""
_BINS = 200  # of the angle from the vertical, in which a cone's pulses are counted
_TRACK_STEPS = 25  # places on a line, an altitude long, from which a cone's pulses are summed
_SIGHT_FROM, _SIGHT_TO = 0.02, 0.7  # shares of the way to the carrier between which ground may hide a place
_MIN_HIDING_M = 0.3  # by which ground must reach over a beam to hide what is behind it
_AT_ONCE = 2_000_000  # pairs of places and track


@dataclass(frozen=True)
class Places:
    """Ground that is looked at: ``xyz`` (n, 3) metres and the upward unit ``normal`` (n, 3) there."""

    xyz: Float
    normal: Float

    def take(self, chosen: Index) -> Places:
        return Places(self.xyz[chosen], self.normal[chosen])


@dataclass(frozen=True)
class Pulses:
    """Expected pulses of each place: ``surface`` (n,) a m² of the inclined ground; ``incidence`` (n,) their mean angle
    to its normal, degrees, NaN where none comes; ``lines`` (n,) how many lines see it.
    """

    surface: Float
    incidence: Float
    lines: Index


def expected_pulses(lines: Iterable[Line], places: Places, terrain: Terrain, parameters: FlightParameters) -> Pulses:
    """Pulses of all lines on places of the ground.

    A sheet of beams across the flight, alike over the angle of view F, that moves with the horizontal speed v puts
    f cos(i) / (F v R) pulses on a m² of ground at the distance R, whose normal makes the angle i with the beam; f is
    the pulse rate. (A beam's sheet widens by R dF, the carrier moves by v dt, and the ground's area square to the beam
    is its cosine.) A cone of beams with p pulses a steradian, as a share of all, puts the integral of
    f p cos(i) / R^2 dt over the track. A place behind other ground, seen from the line's nearest point, gets none.
    """
    count = len(places.xyz)
    surface, leaning, seen = np.zeros(count), np.zeros(count), np.zeros(count, dtype=np.int64)
    pattern = None if parameters.scan_pattern == "line" else cone_density(parameters)
    for line in lines:
        near, foot = _within_reach(line, places, parameters)
        if not len(near):
            continue
        clear = _in_sight(places.xyz[near], foot, terrain)
        near = near[clear]
        part = places.take(near)
        if pattern is None:
            found, angle = _of_sheet(line, part, parameters)
        else:
            found, angle = _of_cone(line, part, parameters, pattern)
        surface[near] += found
        leaning[near] += found * angle
        seen[near] += found > 0
    with np.errstate(invalid="ignore", divide="ignore"):
        incidence = np.where(surface > 0, leaning / surface, np.nan)
    return Pulses(surface, incidence, seen)


def cone_density(parameters: FlightParameters) -> Float:
    """(_BINS,) share of a cone's pulses per steradian at the middles of equal steps of the angle from the vertical."""
    half = math.radians(parameters.field_of_view / 2)
    middle = (np.arange(_BINS) + 0.5) / _BINS
    if parameters.scan_pattern == "disc":
        share = 2 * middle / _BINS
    else:
        phases = 2 * math.pi * (np.arange(720) + 0.5) / 720
        first, second, third = ROSETTE_SHARES
        beams = first + second * np.exp(1j * phases)[:, None] + third * np.exp(1j * phases)[None, :]
        share = np.histogram(np.abs(beams), bins=_BINS, range=(0.0, 1.0))[0] / beams.size
    solid = 2 * math.pi * np.sin(half * middle) * half / _BINS
    return np.asarray(share / solid)


def _within_reach(line: Line, places: Places, parameters: FlightParameters) -> tuple[Index, Float]:
    """The places that beams of a line may reach, and the nearest point (n, 3) of the line to each, in plan."""
    tangent = math.tan(math.radians(parameters.field_of_view / 2))
    start, end = line.track[0], line.track[-1]
    way = end[:2] - start[:2]
    length = float(np.hypot(*way))
    along = way / length
    relative = places.xyz[:, :2] - start[:2]
    s = relative @ along
    index = np.clip(np.rint(s / length * (len(line.track) - 1)), 0, len(line.track) - 1).astype(np.int64)
    foot = line.track[index]
    below = foot[:, 2] - places.xyz[:, 2]
    apart = np.hypot(*(foot[:, :2] - places.xyz[:, :2]).T)
    near = np.flatnonzero((below > 0) & (apart <= tangent * below + 1.0))
    return near, foot[near]


def _in_sight(xyz: Float, foot: Float, terrain: Terrain) -> np.ndarray:
    clear = np.ones(len(xyz), dtype=bool)
    farthest = float(np.hypot(*(foot[:, :2] - xyz[:, :2]).T).max())
    for share in np.linspace(_SIGHT_FROM, _SIGHT_TO, 8 + math.ceil(2 * farthest / terrain.grid.cell)):
        beam = xyz + share * (foot - xyz)
        with np.errstate(invalid="ignore"):
            clear &= ~(terrain.at(beam[:, :2]) > beam[:, 2] + _MIN_HIDING_M)
    return clear


def _of_sheet(line: Line, places: Places, parameters: FlightParameters) -> tuple[Float, Float]:
    """Pulses (n,) a m² of the ground and their angles of incidence (degrees), of beams across the flight."""
    half = math.radians(parameters.field_of_view / 2)
    total, leaning = np.zeros(len(places.xyz)), np.zeros(len(places.xyz))
    for start, end in zip(line.xyz[:-1], line.xyz[1:], strict=True):
        way = end - start
        plan = float(np.hypot(way[0], way[1]))
        if plan == 0:
            continue
        along = way[:2] / plan
        s = (places.xyz[:, :2] - start[:2]) @ along
        beam = places.xyz - (start + (s / plan)[:, None] * way)
        distance = np.linalg.norm(beam, axis=1)
        cosine = -np.einsum("ni,ni->n", beam, places.normal) / distance
        angle = np.arctan2(np.hypot(beam[:, 0], beam[:, 1]), -beam[:, 2])
        speed = parameters.flying_speed * plan / float(np.linalg.norm(way))
        hit = (s >= 0) & (s < plan) & (angle <= half) & (cosine > 0)
        found = np.where(hit, parameters.pulse_rate * cosine / (2 * half * speed * distance), 0.0)
        total += found
        leaning += found * np.degrees(np.arccos(np.clip(cosine, 0.0, 1.0)))
    with np.errstate(invalid="ignore"):
        return total, np.where(total > 0, leaning / np.maximum(total, 1e-300), 0.0)


def _of_cone(line: Line, places: Places, parameters: FlightParameters, pattern: Float) -> tuple[Float, Float]:
    """As ``_of_sheet``, of beams in a cone with ``pattern`` (``cone_density``)."""
    half = math.radians(parameters.field_of_view / 2)
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line.track, axis=0), axis=1))])
    count = max(2, math.ceil(lengths[-1] * _TRACK_STEPS / parameters.altitude))
    at = (np.arange(count) + 0.5) / count * lengths[-1]
    track = np.column_stack([np.interp(at, lengths, line.track[:, axis]) for axis in range(3)])
    pulses = parameters.pulse_rate * lengths[-1] / count / parameters.flying_speed
    total, leaning = np.zeros(len(places.xyz)), np.zeros(len(places.xyz))
    step = max(1, _AT_ONCE // count)
    for first in range(0, len(places.xyz), step):
        part = slice(first, first + step)
        beam = places.xyz[part][:, None, :] - track[None, :, :]
        distance = np.linalg.norm(beam, axis=2)
        cosine = -np.einsum("nki,ni->nk", beam, places.normal[part]) / distance
        angle = np.arccos(np.clip(-beam[:, :, 2] / distance, -1.0, 1.0)) / half * _BINS
        inside = (angle < _BINS) & (cosine > 0)
        shares = pattern[np.minimum(angle, _BINS - 1).astype(np.int64)]
        found = np.where(inside, pulses * shares * cosine / distance**2, 0.0)
        total[part] = found.sum(axis=1)
        leaning[part] = (found * np.degrees(np.arccos(np.clip(cosine, 0.0, 1.0)))).sum(axis=1)
    return total, np.where(total > 0, leaning / np.maximum(total, 1e-300), 0.0)
