"""Flights through waypoints, compared with the parallel lines of the simulation's own flights."""

from __future__ import annotations

import numpy as np
from slopewatch.simulation.surveys.pattern import Flight, Scanner, WaypointFlight, emit


def test_straight_waypoints_are_the_parallel_lines() -> None:
    scanner = Scanner(speed=4.0)
    flight = Flight(np.array([0.0, 12.0, 24.0]), np.array([40.0, 44.0, 48.0]), -5.0, 35.0, scanner, phase=3.0)
    lines = []
    for number, (v, z) in enumerate(zip(flight.v, flight.z, strict=True)):
        ends = np.array([[-5.0, v, z], [15.0, v, z], [35.0, v, z]])
        lines.append(ends if number % 2 == 0 else ends[::-1])
    same = WaypointFlight(tuple(lines), scanner, phase=3.0)
    assert same.seconds == flight.seconds
    assert same.pulses == flight.pulses
    seconds = np.linspace(0.01, flight.seconds - 0.01, 5000)
    a, b = emit(flight, seconds), emit(same, seconds)
    np.testing.assert_allclose(a.rays.origin, b.rays.origin, atol=1e-9)
    np.testing.assert_allclose(a.rays.direction, b.rays.direction)
    np.testing.assert_array_equal(a.line, b.line)
    np.testing.assert_allclose(a.scan_angle, b.scan_angle)


def test_a_sweeping_mirror_spreads_evenly_across_the_flight() -> None:
    line = np.array([[0.0, 0.0, 40.0], [30.0, 40.0, 50.0]])
    flight = WaypointFlight((line,), Scanner(sweeps=50.0))
    pulses = emit(flight, np.sort(np.random.default_rng(1).uniform(0, flight.seconds, 40_000)))
    along = np.array([0.6, 0.8])
    assert np.abs(along @ pulses.rays.direction[:2]).max() < 1e-12
    counts = np.histogram(pulses.scan_angle, bins=10, range=(-35, 35))[0]
    assert np.abs(counts / 4000 - 1).max() < 0.05
    right = np.array([0.8, -0.6]) @ pulses.rays.direction[:2]
    assert (np.sign(right) == np.sign(pulses.scan_angle)).all()
