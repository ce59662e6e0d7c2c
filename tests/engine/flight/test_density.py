"""Expected pulses compared with beams that are drawn one by one and met with the ground."""

from __future__ import annotations

import math

import numpy as np
import pytest
from slopewatch.engine.flight.density import ROSETTE_SHARES, Places, expected_pulses
from slopewatch.engine.flight.lines import Line, plan_lines
from slopewatch.interface.parameters import FlightParameters
from slopewatch.simulation.surveys.pattern import Scanner
from slopewatch.tests.builders.flights import NORTH, WEST, flight, inclined, square


def _beams(line: Line, parameters: FlightParameters, count: int, rng: np.random.Generator) -> tuple:
    """Origins and directions (n, 3) of ``count`` pulses, spread evenly over the line."""
    half = math.radians(parameters.field_of_view / 2)
    share = rng.uniform(0, 1, count)
    origin = line.xyz[0] + share[:, None] * (line.xyz[-1] - line.xyz[0])
    if parameters.scan_pattern == "line":
        angle = rng.uniform(-half, half, count)
        return origin, np.column_stack([np.zeros(count), np.sin(angle), -np.cos(angle)])
    if parameters.scan_pattern == "disc":
        radius = np.sqrt(rng.uniform(0, 1, count))
        turn = rng.uniform(0, 2 * np.pi, count)
    else:
        beams = sum(s * np.exp(1j * rng.uniform(0, 2 * np.pi, count)) for s in ROSETTE_SHARES)
        radius, turn = np.abs(beams), np.angle(beams)
    angle = half * radius
    return origin, np.column_stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), -np.cos(angle)])


@pytest.mark.parametrize("pattern", ["line", "disc", "rosette"])
@pytest.mark.parametrize("slope", [0.0, 0.8])
def test_pulses_are_those_of_single_beams(pattern: str, slope: float) -> None:
    terrain, parameters = inclined(slope=slope), flight(scan_pattern=pattern, azimuth=90.0)
    lines = plan_lines(square(), terrain, parameters)
    rng = np.random.default_rng(5)
    x, y = np.meshgrid(WEST + np.arange(62.0, 80.0, 4.0), NORTH - np.arange(42.0, 80.0, 4.0))
    xy = np.column_stack([x.ravel(), y.ravel()])
    normal = np.array([0.0, -slope, 1.0]) / math.hypot(1, slope)
    # 64 points of each place of 4 m, as strips end within some
    inner = (np.arange(8) - 3.5) / 2.0
    steps = np.column_stack([a.ravel() for a in np.meshgrid(inner, inner)])
    points = (xy[:, None, :] + steps[None]).reshape(-1, 2)
    places = Places(np.column_stack([points, terrain.at(points)]), np.tile(normal, (len(points), 1)))
    counts, drawn = np.zeros(len(xy)), 500_000
    for line in lines:
        origin, direction = _beams(line, parameters, drawn, rng)
        base = np.array([WEST, NORTH - 120.0, 100.0])
        far = ((base - origin) @ normal) / (direction @ normal)
        hit = (origin + far[:, None] * direction)[far > 0]
        column, row = np.rint((hit[:, 0] - xy[0, 0]) / 4.0), np.rint((xy[0, 1] - hit[:, 1]) / 4.0)
        inside = (column >= 0) & (column < x.shape[1]) & (row >= 0) & (row < x.shape[0])
        place = (row[inside] * x.shape[1] + column[inside]).astype(int)
        pulses = line.length / parameters.flying_speed * parameters.pulse_rate
        counts += np.bincount(place, minlength=len(xy)) * pulses / drawn
    found = expected_pulses(lines, places, terrain, parameters).surface / normal[2]
    expected = found.reshape(len(xy), -1).mean(axis=1)
    assert expected.min() > 5
    relative = counts / 16.0 / expected
    assert np.median(np.abs(relative - 1)) < 0.03
    assert counts.sum() / 16.0 == pytest.approx(expected.sum(), rel=0.02)


def test_the_rosette_is_that_of_the_simulated_scanner() -> None:
    assert Scanner().deflections == ROSETTE_SHARES


def test_ground_that_is_hidden_gets_nothing() -> None:
    """Behind a wall of 30 m along the lines, the strip that it hides from each line is known by the straight beam."""
    terrain, parameters = inclined(slope=0.0), flight(azimuth=90.0, clearance=1.0)
    line = plan_lines(square(side=40.0), terrain, parameters)[0]
    wall = terrain.heights.copy()
    south = float(line.xyz[0, 1])
    row = int(NORTH - (south + 10.0))
    wall[row] += 30.0
    walled = type(terrain)(wall, terrain.known, wall, terrain.grid, terrain.crs, terrain.path)
    y = south + np.arange(12.0, 28.0)
    xyz = np.column_stack([np.full(len(y), WEST + 70.0), y, np.full(len(y), 100.0)])
    places = Places(xyz, np.tile([0.0, 0.0, 1.0], (len(y), 1)))
    seen = expected_pulses([line], places, terrain, parameters).surface
    hidden = expected_pulses([line], places, walled, parameters).surface
    assert (seen > 0).all()
    assert (hidden == 0).all()
