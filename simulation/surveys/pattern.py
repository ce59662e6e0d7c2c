"""Flight lines over the slope and the scanner's non-repetitive pattern: where each pulse starts and points."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float
from ..trace import Rays
from .scene import Profile


@dataclass(frozen=True)
class Scanner:
    """The carrier and its scanner.

    ``deflections`` are the shares of half the field of view by which the rotating prisms deflect the beam, and
    ``turns`` their revolutions a second: incommensurate, so that the rosette never repeats. With ``sweeps`` a second,
    beams sweep across the flight instead, alike over the field of view, as a turning mirror's do.
    """

    altitude: float = 40.0
    speed: float = 3.0
    pulse_rate: float = 240_000.0
    field_of_view: float = 70.0
    side_overlap: float = 0.5
    overshoot: float = 8.0
    maximum_returns: int = 5
    deflections: tuple[float, float, float] = (0.46, 0.38, 0.16)
    turns: tuple[float, float, float] = (121.57, -77.73, 41.31)
    sweeps: float = 0.0

    @property
    def half_angle(self) -> float:
        return math.radians(self.field_of_view / 2)

    @property
    def swath(self) -> float:
        """Width of a strip on flat ground, m."""
        return 2 * self.altitude * math.tan(self.half_angle)


@dataclass(frozen=True)
class Flight:
    """Parallel lines along u: ``v`` and ``z`` of each (m), all from ``u0`` to ``u1``, flown to and fro.

    ``phase``: how long the scanner has been turning when the first line starts, s.
    """

    v: Float
    z: Float
    u0: float
    u1: float
    scanner: Scanner
    phase: float = 0.0

    @property
    def line_seconds(self) -> float:
        return (self.u1 - self.u0) / self.scanner.speed

    @property
    def seconds(self) -> float:
        """Time over all lines."""
        return len(self.v) * self.line_seconds

    @property
    def pulses(self) -> float:
        """Number of pulses at the scanner's full rate."""
        return self.seconds * self.scanner.pulse_rate

    def place(self, seconds: Float) -> tuple[Float, Float, NDArray[np.int64]]:
        """Where the carrier is at ``seconds`` (n,): (3, n), its direction of flight in plan (2, n), its line (n,)."""
        line = np.minimum((seconds / self.line_seconds).astype(np.int64), len(self.v) - 1)
        along = (seconds - line * self.line_seconds) * self.scanner.speed
        forth = line % 2 == 0
        origin = np.stack([np.where(forth, self.u0 + along, self.u1 - along), self.v[line], self.z[line]])
        return origin, np.stack([np.where(forth, 1.0, -1.0), np.zeros(len(seconds))]), line


@dataclass(frozen=True)
class WaypointFlight:
    """Lines through waypoints, each (k, 3) in the local frame (m), flown one after the other at the scanner's speed.

    ``phase``: as of ``Flight``. The turns between lines take no time.
    """

    lines: tuple[Float, ...]
    scanner: Scanner
    phase: float = 0.0

    @property
    def _ends(self) -> Float:
        """Seconds at which each line ends (lines,)."""
        lengths = [np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in self.lines]
        return np.cumsum(lengths) / self.scanner.speed

    @property
    def seconds(self) -> float:
        """Time over all lines."""
        return float(self._ends[-1])

    @property
    def pulses(self) -> float:
        """Number of pulses at the scanner's full rate."""
        return self.seconds * self.scanner.pulse_rate

    def place(self, seconds: Float) -> tuple[Float, Float, NDArray[np.int64]]:
        """As ``Flight.place``."""
        ends = self._ends
        line = np.minimum(np.searchsorted(ends, seconds, side="right"), len(self.lines) - 1)
        origin, way = np.empty((3, len(seconds))), np.empty((2, len(seconds)))
        for number, waypoints in enumerate(self.lines):
            here = np.flatnonzero(line == number)
            steps = np.diff(waypoints, axis=0)
            at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1))])
            gone = (seconds[here] - (ends[number - 1] if number else 0.0)) * self.scanner.speed
            leg = np.clip(np.searchsorted(at, gone, side="right") - 1, 0, len(steps) - 1)
            for axis in range(3):
                origin[axis, here] = np.interp(gone, at, waypoints[:, axis])
            plan = steps[:, :2] / np.linalg.norm(steps[:, :2], axis=1)[:, None]
            way[:, here] = plan[leg].T
        return origin, way, line.astype(np.int64)


@dataclass(frozen=True)
class Pulses:
    """Rays with the flight line (n,), seconds since the start (n,) and signed scan angle (n,) in degrees of each."""

    rays: Rays
    line: NDArray[np.int64]
    seconds: Float
    scan_angle: Float


def plan_flight(area: tuple[float, float, float, float], profile: Profile, scanner: Scanner) -> Flight:
    """Lines over ``area`` (u and v from, u and v to), at the altitude above the ground under each line.

    Every place of the area is seen from two lines; along the lines the density falls off beyond ``overshoot``.
    """
    u0, v0, u1, v1 = area
    spacing = scanner.swath * (1 - scanner.side_overlap)
    count = math.ceil((v1 - v0) / spacing) + 1
    v: Float = (v0 + v1) / 2 + spacing * (np.arange(count, dtype=np.float64) - (count - 1) / 2)
    return Flight(v, profile(v) + scanner.altitude, u0 - scanner.overshoot, u1 + scanner.overshoot, scanner)


def flown(plan: Flight, rng: np.random.Generator) -> Flight:
    """The plan as one survey flies it: lines off by 0.3 m (standard deviation), the scanner at any phase."""
    v = plan.v + rng.normal(0.0, 0.3, plan.v.shape)
    z = plan.z + rng.normal(0.0, 0.3, plan.z.shape)
    return replace(plan, v=v, z=z, phase=float(rng.uniform(0.0, 3600.0)))


def emit(flight: Flight | WaypointFlight, seconds: Float) -> Pulses:
    """The pulses sent at ``seconds`` (n,) of flight time; the turns between lines take no time."""
    scanner = flight.scanner
    origin, way, line = flight.place(seconds)
    if scanner.sweeps:
        # to and fro: the pulses are alike over the angle
        share = 2 * np.abs(2 * ((seconds + flight.phase) * scanner.sweeps % 1.0) - 1) - 1
        across = share * scanner.half_angle
        direction = np.stack([way[1] * np.sin(across), -way[0] * np.sin(across), -np.cos(across)])
        return Pulses(Rays(origin, direction), line, seconds, np.degrees(across))
    a, b = np.zeros(len(seconds)), np.zeros(len(seconds))
    for part, turns in zip(scanner.deflections, scanner.turns, strict=True):
        phase = 2 * math.pi * turns * (seconds + flight.phase)
        a += part * np.cos(phase)
        b += part * np.sin(phase)
    radius = np.hypot(a, b)
    off_nadir = radius * scanner.half_angle
    scale = np.sin(off_nadir) / np.maximum(radius, 1e-12)
    direction = np.stack([a * scale, b * scale, -np.cos(off_nadir)])
    # LAS counts scan angles from nadir, positive to the right of the flight direction.
    right = way[1] * direction[0] - way[0] * direction[1]
    return Pulses(Rays(origin, direction), line, seconds, np.degrees(np.arctan2(right, -direction[2])))
