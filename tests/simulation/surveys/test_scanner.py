"""What a scan records against the surface that was scanned."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from slopewatch.simulation.frame import Frame
from slopewatch.simulation.surveys.change import Plateau
from slopewatch.simulation.surveys.layers import Landscape
from slopewatch.simulation.surveys.pattern import Scanner, emit, flown, plan_flight
from slopewatch.simulation.surveys.scanner import TURF_GROUND, SurveyCloud, scan
from slopewatch.simulation.surveys.scene import Relief, build_scene, cut_profile
from slopewatch.simulation.surveys.vegetation import grow

AREA = (-6.0, -6.0, 36.0, 22.0)
PROFILE = cut_profile(12.0, 39.0, 0)


@pytest.fixture(scope="module")
def scene():
    rng = np.random.default_rng(11)
    bare = build_scene(PROFILE, (0.0, 0.0, 30.0, 15.0), 16.0, Frame(), Relief(), rng)
    return bare.with_changes((Plateau(15.0, 8.0, side=3.0, height=0.4),))


@pytest.fixture(scope="module")
def canopy(scene):
    return grow(scene, 0.6, np.random.default_rng(12))


@pytest.fixture(scope="module")
def flight():
    return plan_flight((0.0, 0.0, 30.0, 15.0), PROFILE, Scanner())


def scan_once(scene, canopy, flight, noise: float = 0.0, pulses: int = 60_000, workers: int = 2) -> SurveyCloud:
    return scan(Landscape(scene, canopy), flight, AREA, pulses, noise, (13,), workers=workers)


@pytest.fixture(scope="module")
def exact(scene, canopy, flight):
    return scan_once(scene, canopy, flight)


def test_ground_echoes_lie_on_the_surface(scene, flight):
    bald = grow(scene, 0.0, np.random.default_rng(1))
    without_turf = replace(scene, turf=replace(scene.turf, values=np.zeros_like(scene.turf.values)))
    cloud = scan_once(without_turf, bald, flight)
    assert len(cloud) > 5000
    above = cloud.xyz[:, 2] - scene.height_at(cloud.xyz)
    local = scene.frame.to_local(cloud.xyz)
    # The plateau's upright faces have every height at one place.
    on_face = np.abs(np.maximum(np.abs(local[:, 0] - 15.0), np.abs(local[:, 1] - 8.0)) - 1.5) < 0.02
    assert np.abs(above[~on_face]).max() < 1e-4
    assert cloud.truth_ground[~on_face].all()
    assert (cloud.number_of_returns == 1).all()


def test_truth_flag_is_the_height_above_the_ground(scene, exact):
    above = exact.xyz[:, 2] - scene.height_at(exact.xyz)
    ground = exact.truth_ground == 1
    assert above[ground].max() <= TURF_GROUND + 1e-6
    assert above[~ground].min() > TURF_GROUND - 1e-6
    assert 0.25 < ground.mean() < 0.75
    # Low grass is some of what counts as ground, tall leaves are most of what does not.
    assert (above[ground] > 0.005).mean() > 0.05
    assert np.median(above[~ground]) > 0.4


def test_range_noise_is_along_the_beam_with_its_deviation(scene, canopy, flight, exact):
    noisy = scan_once(scene, canopy, flight, noise=0.02)
    error = noisy.xyz - exact.xyz
    sent = emit(flight, exact.gps_time)
    direction = scene.frame.to_world(sent.rays.direction.T.copy()) - scene.frame.to_world(np.zeros((1, 3)))
    along = (error * direction).sum(axis=1)
    assert along.std() == pytest.approx(0.02, rel=0.03)
    assert abs(along.mean()) < 0.001
    assert np.abs(error - along[:, None] * direction).max() < 1e-6


def test_points_lie_on_their_beams(scene, flight, exact):
    sent = emit(flight, exact.gps_time)
    origin = scene.frame.to_world(sent.rays.origin.T.copy())
    direction = scene.frame.to_world(sent.rays.direction.T.copy()) - scene.frame.to_world(np.zeros((1, 3)))
    assert np.linalg.norm(np.cross(exact.xyz - origin, direction), axis=1).max() < 1e-5
    assert np.array_equal(exact.line, sent.line + 1)


def test_returns_of_a_pulse_are_consistent(exact):
    assert exact.number_of_returns.max() <= 5
    assert (exact.number_of_returns >= 3).sum() > 100
    assert (exact.return_number >= 1).all()
    assert (exact.return_number <= exact.number_of_returns).all()
    time, order = exact.gps_time, np.lexsort((exact.return_number, exact.gps_time))
    assert (np.diff(time) >= 0).all()
    same = np.diff(time[order]) == 0
    number, z = exact.return_number[order], exact.xyz[order, 2]
    assert (np.diff(number.astype(int))[same] >= 1).all()
    assert (np.diff(z)[same] < 0).all()
    # The ground, where it is seen, is the last echo.
    ground = exact.truth_ground == 1
    assert (exact.return_number[ground] == exact.number_of_returns[ground]).all()


def test_result_does_not_depend_on_the_number_of_workers(scene, canopy, flight):
    one = scan_once(scene, canopy, flight, noise=0.02, pulses=150_000, workers=1)
    three = scan_once(scene, canopy, flight, noise=0.02, pulses=150_000, workers=3)
    for field in fields(SurveyCloud):
        assert np.array_equal(getattr(one, field.name), getattr(three, field.name)), field.name


def test_density_falls_off_at_the_ends_of_the_lines(scene, flight):
    bald = grow(scene, 0.0, np.random.default_rng(1))
    u = scene.frame.to_local(scan_once(scene, bald, flight, pulses=120_000).xyz)[:, 0]
    middle, ends = ((u > 12) & (u < 18)).sum() / 6, ((u < -3) | (u > 33)).sum() / 6
    assert 0.2 * middle < ends < 0.8 * middle


def test_leaves_are_greener_than_the_ground(exact):
    red, green, blue = exact.rgb.T.astype(float)
    leaves = exact.truth_ground == 0
    assert (green - red)[leaves].mean() > 15 > (green - red)[~leaves].mean()
    assert (green - blue)[leaves].mean() > 15
    assert len(np.unique(exact.intensity)) > 1000


def test_flight_plan_and_pattern():
    scanner = Scanner()
    plan = plan_flight((0.0, 0.0, 100.0, 60.0), PROFILE, scanner)
    spacing = np.diff(plan.v)
    assert spacing == pytest.approx(2 * 40.0 * np.tan(np.radians(35.0)) * 0.5)
    assert plan.z - PROFILE(plan.v) == pytest.approx(40.0)
    assert plan.v[0] <= 0.0
    assert plan.v[-1] >= 60.0
    seconds = np.arange(0, plan.line_seconds * len(plan.v), 1 / 5000)
    sent = emit(plan, seconds)
    off_nadir = np.degrees(np.arccos(-sent.rays.direction[2]))
    assert 34.0 < off_nadir.max() <= 35.0 + 1e-9
    assert np.linalg.norm(sent.rays.direction, axis=0) == pytest.approx(1.0)
    # 3 m/s along u on every line.
    first = sent.line == 0
    assert np.ptp(sent.rays.origin[0, first]) / np.ptp(seconds[first]) == pytest.approx(3.0)
    # Not repetitive: no shift up to two seconds brings the same directions again.
    a, b = sent.rays.direction[0], sent.rays.direction[1]
    distance = [np.hypot(a[:2000] - a[k : 2000 + k], b[:2000] - b[k : 2000 + k]).mean() for k in range(100, 10_000)]
    assert min(distance) > 0.02
    again = flown(plan, np.random.default_rng(1))
    assert np.abs(again.v - plan.v).max() > 0.01
    assert not np.allclose(emit(again, seconds[:50]).rays.direction, sent.rays.direction[:, :50])
