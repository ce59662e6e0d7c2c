"""Flight lines: where they run, how high, and what is refused."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
import shapely
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.flight.effort import effort_of
from slopewatch.engine.flight.lines import line_azimuth, lines_along, lowest_flyable, plan_lines, simplified
from slopewatch.tests.builders.flights import NORTH, WEST, flight, inclined, square


def test_the_lowest_heights_are_those_of_the_definition() -> None:
    rng = np.random.default_rng(1)
    way, least = np.sort(rng.uniform(0, 100, 80)), rng.uniform(50, 70, 80)
    for steepest in (0.05, 0.3, 2.0):
        brute = [max(least[t] - steepest * abs(way[s] - way[t]) for t in range(80)) for s in range(80)]
        np.testing.assert_allclose(lowest_flyable(way, least, steepest), brute)


def test_simplified_lines_stay_within_the_tolerance_and_keep_a_straight_one() -> None:
    way = np.arange(200.0)
    height = 3 * np.sin(way / 15)
    for tolerance in (0.1, 0.5, 2.0):
        kept = simplified(way, height, tolerance)
        assert np.abs(np.interp(way, way[kept], height[kept]) - height).max() <= tolerance
        assert 2 < len(kept) < 100
    assert list(simplified(way, 0.2 * way, 0.01)) == [0, 199]


@pytest.mark.parametrize("slope", [0.2, 0.7, 1.3])
def test_lines_run_along_the_contour(slope: float) -> None:
    azimuth, found = line_azimuth(square(), inclined(slope=slope))
    assert azimuth == pytest.approx(90.0, abs=1e-6)
    assert np.tan(np.radians(found)) == pytest.approx(slope)


def test_lines_cover_the_region_at_the_spacing_and_height_asked_for() -> None:
    terrain, parameters = inclined(relief=3.0), flight(climb_rate=1.0)
    lines = plan_lines(square(), terrain, parameters)
    north = np.array([line.xyz[0, 1] for line in lines])
    spacing = 2 * 40 * np.tan(np.radians(35)) * 0.5
    assert north[0] == pytest.approx(NORTH - 90)
    assert north[-1] == pytest.approx(NORTH - 30)
    assert np.diff(north).max() <= spacing
    assert np.ptp(np.diff(north)) < 1e-6
    assert [np.sign(line.xyz[-1, 0] - line.xyz[0, 0]) for line in lines] == [1, -1, 1, -1][: len(lines)]
    for line in lines:
        east = np.sort(line.xyz[[0, -1], 0])
        np.testing.assert_allclose(east, [WEST + 40, WEST + 100])
        over = line.track[:, 2] - terrain.at(line.track[:, :2])
        assert over.min() >= 40 - 1e-9
        steep = np.abs(np.diff(line.track[:, 2])) / np.linalg.norm(np.diff(line.track[:, :2], axis=0), axis=1)
        assert steep.max() <= 1.0 / 3.0 + 1e-9


def test_an_azimuth_that_is_given_is_flown() -> None:
    lines = plan_lines(square(), inclined(), flight(azimuth=0.0, climb_rate=5.0))
    way = lines[0].xyz[-1] - lines[0].xyz[0]
    assert abs(way[0]) < 1e-6 < abs(way[1])
    over = np.concatenate([line.over_ground for line in lines])
    assert over.min() == pytest.approx(40.0)
    assert over.max() < 41.0


def test_the_same_lines_are_flown_again_over_another_terrain() -> None:
    first = plan_lines(square(), inclined(), flight())
    again = lines_along([line.xyz[:, :2] for line in first], inclined(slope=0.2), flight())
    for a, b in zip(first, again, strict=True):
        np.testing.assert_allclose(a.xyz[[0, -1], :2], b.xyz[[0, -1], :2])
        assert b.over_ground.min() >= 40 - 1e-9
    assert again[-1].xyz[0, 2] < first[-1].xyz[0, 2]


def test_batteries_are_changed_between_lines() -> None:
    lines, parameters = plan_lines(square(), inclined(), flight()), flight(battery_time=1.0, turn_time=6.0)
    effort = effort_of(lines, parameters)
    seconds = [line.length / 3 for line in lines]
    turns = [np.linalg.norm(b.xyz[0] - a.xyz[-1]) / 3 + 6 for a, b in itertools.pairwise(lines)]
    assert effort.seconds == pytest.approx(sum(seconds) + sum(turns))
    assert len(lines) == 4
    assert 50 < seconds[0] + turns[0] + seconds[1] < 60
    assert effort.battery == (1, 1, 2, 2)
    with pytest.raises(InputError, match=r"Line 1 takes .* longer than a battery"):
        effort_of(lines, flight(battery_time=1.0, flying_speed=0.2))


def test_what_cannot_be_flown_is_refused() -> None:
    terrain = inclined()
    with pytest.raises(InputError, match="lies outside of the terrain"):
        plan_lines(shapely.transform(square(), lambda xy: xy + 5000.0), terrain, flight())
    with pytest.raises(InputError, match=r"leaves 0\.\d+ m from line to line"):
        plan_lines(square(), terrain, flight(field_of_view=10.0, altitude=20.0, side_overlap=0.9))
    holes = terrain.heights.copy()
    holes[40:50, 60:80] = np.nan
    with pytest.raises(InputError, match=r"has no height under .* first at x 5000"):
        plan_lines(square(), replace(terrain, heights=holes), flight(side_overlap=0.9))
    with pytest.raises(InputError, match="has no height under"):
        plan_lines(square(), terrain, flight(margin=200.0))
    x, y = WEST + 70.0, NORTH - 60.0
    tree = np.array([[x, y, float(terrain.at(np.array([[x, y]]))[0]) + 45.0]])
    with pytest.raises(InputError, match=r"comes within .* ground or plants .* raise --altitude"):
        plan_lines(square(), terrain.with_tops(tree), flight(side_overlap=0.9))
    with pytest.raises(InputError, match="comes within"):
        plan_lines(square(), terrain, flight(altitude=9.0))
