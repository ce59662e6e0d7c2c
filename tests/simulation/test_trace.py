"""Rays against surfaces whose intersection is known or found by small steps."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from slopewatch.simulation.fields import HeightField, power_law_field
from slopewatch.simulation.surveys.change import Plateau
from slopewatch.simulation.trace import Rays, Steepness, approach, first_hit


def downward_rays(n: int, seed: int = 0, height: float = 40.0) -> Rays:
    rng = np.random.default_rng(seed)
    angle, turn = np.radians(rng.uniform(0, 35, n)), rng.uniform(0, 2 * np.pi, n)
    direction = np.stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), -np.cos(angle)])
    origin = np.stack([rng.uniform(-10, 10, n), rng.uniform(-10, 10, n), np.full(n, height)])
    return Rays(origin, direction)


def test_inclined_plane():
    gradient = (0.1, 0.8)
    rays = downward_rays(5000)
    hit = first_hit(lambda u, v: gradient[0] * u + gradient[1] * v, rays, np.zeros(5000), Steepness(0.1, 0.8, 0.8), 500)
    (u, v, z), (du, dv, dz) = rays.origin, rays.direction
    assert hit == pytest.approx((z - gradient[0] * u - gradient[1] * v) / (gradient[0] * du + gradient[1] * dv - dz))


def test_first_crossing_of_a_surface_that_hides_parts_of_itself():
    def waves(u, v):
        return 2.0 * np.sin(2.1 * u) + 2.5 * np.sin(1.3 * v)

    rays = downward_rays(300, height=15.0)
    hit = first_hit(waves, rays, np.zeros(300), Steepness(4.2, -3.3, 3.3), 100)
    several = 0
    for i in range(300):
        t = np.arange(0, 25, 0.002)
        place = rays.origin[:, i, None] + rays.direction[:, i, None] * t
        below = place[2] < waves(place[0], place[1])
        assert hit[i] == pytest.approx(t[np.argmax(below)], abs=0.004)
        several += np.count_nonzero(np.diff(below)) > 1
    assert several > 20


def test_vertical_edge_is_hit_on_its_face_or_its_top():
    block = Plateau(0.0, 0.0, side=2.0, height=0.5)
    rays = downward_rays(200_000, seed=3)
    hit = first_hit(block.dz, rays, np.zeros(200_000), Steepness(0.1, -0.1, 0.1), 100)
    u, v, z = rays.at(hit)
    outside = np.maximum(np.abs(u), np.abs(v)) > 1.0 + 1e-3
    inside = np.maximum(np.abs(u), np.abs(v)) < 1.0 - 0.02
    assert z[outside] == pytest.approx(0.0, abs=1e-6)
    assert z[inside] == pytest.approx(0.5, abs=1e-6)
    face = ~outside & ~inside
    assert ((z[face] > -1e-6) & (z[face] < 0.5 + 1e-6)).all()
    assert ((z[face] > 0.05) & (z[face] < 0.45)).sum() > 30


def test_no_ground_within_reach():
    hit = first_hit(lambda u, v: np.full_like(u, -1000.0), downward_rays(10), np.zeros(10), Steepness(0, 0, 0), 100)
    assert np.isinf(hit).all()


def test_approach_stays_above():
    def surface(u, v):
        return 0.3 * np.sin(u) + 0.8 * v

    rays = downward_rays(3000)
    near = approach(surface, rays, np.zeros(3000), Steepness(0.3, 0.8, 0.8), 0.4, 200)
    u, v, z = rays.at(near)
    above = z - surface(u, v)
    assert above.min() > 0
    assert above.max() <= 0.4


def test_height_field_is_bilinear():
    values = np.random.default_rng(0).normal(size=(8, 11))
    field = HeightField(2.0, -3.0, 0.5, values)
    u, v = np.random.default_rng(1).uniform((2.0, -3.0), (7.0, 0.5), (500, 2)).T
    for a, b, value in zip(u, v, field(u, v), strict=True):
        j, i = int((a - 2.0) / 0.5), int((b + 3.0) / 0.5)
        s, t = (a - 2.0) / 0.5 - j, (b + 3.0) / 0.5 - i
        corner = values[i : i + 2, j : j + 2]
        assert value == pytest.approx(np.array([1 - t, t]) @ corner @ np.array([1 - s, s]))
    assert field(np.array([2.0, 7.0]), np.array([-3.0, 0.5])) == pytest.approx([values[0, 0], values[-1, -1]], abs=1e-5)


def test_power_spectrum_of_roughness():
    """Radially averaged power falls with the exponent asked for, within the band."""
    step, n = 0.1, 512
    spectra = []
    for seed in range(4):
        field = power_law_field((n, n), step, 3.0, 0.2, 20.0, np.random.default_rng(seed))
        assert field.std() == pytest.approx(1.0)
        window = np.hanning(n)[:, None] * np.hanning(n)[None, :]
        spectra.append(np.abs(np.fft.fft2(field * window)) ** 2)
    frequency = np.hypot(np.fft.fftfreq(n, step)[:, None], np.fft.fftfreq(n, step)[None, :])
    edges = np.geomspace(0.15, 1.5, 9)
    power = [np.mean(spectra, axis=0)[(frequency >= a) & (frequency < b)].mean() for a, b in itertools.pairwise(edges)]
    slope = np.polyfit(np.log(np.sqrt(edges[1:] * edges[:-1])), np.log(power), 1)[0]
    assert slope == pytest.approx(-3.0, abs=0.35)
