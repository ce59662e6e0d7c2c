"""Known changes against brute-force integration and the volumes of textbook solids."""

from __future__ import annotations

import math

import numpy as np
import pytest
from slopewatch.engine.grid.grid import snapped_grid
from slopewatch.simulation.frame import Frame
from slopewatch.simulation.surveys.change import Bump, Cone, Plateau, Slump, total_dz, true_change_raster

SHAPES = [
    Plateau(3.1, 2.2, side=1.0, height=0.16, rotation=25.0),
    Cone(3.1, 2.2),
    Bump(3.1, 2.2, 1.7, 1.1, 0.3),
    Bump(3.1, 2.2, 0.9, 1.3, -0.4),
    Slump(3.1, 2.2, half_width=1.2, length=3.0, depth=0.25, bulking=1.2),
]


@pytest.mark.parametrize("change", SHAPES, ids=lambda c: c.kind)
def test_volumes_are_the_integral_of_dz(change):
    step = 0.004
    u, v = np.meshgrid(np.arange(0, 6.4, step) + step / 2, np.arange(-0.5, 5.0, step) + step / 2)
    dz = change.dz(u, v)
    raised, lowered = change.volumes
    assert dz[dz > 0].sum() * step**2 == pytest.approx(raised, rel=3e-3, abs=1e-9)
    assert -dz[dz < 0].sum() * step**2 == pytest.approx(lowered, rel=3e-3, abs=1e-9)


def test_published_bodies_have_their_volumes():
    assert Plateau(0, 0).volumes == pytest.approx((1.0 * 1.0 * 0.16, 0.0))
    assert Cone(0, 0).volumes == pytest.approx((math.pi * 0.53**2 * 0.36 / 3, 0.0))


@pytest.mark.parametrize("change", SHAPES, ids=lambda c: c.kind)
def test_change_ends_at_its_bounds(change):
    west, south, east, north = change.bounds
    rng = np.random.default_rng(1)
    u, v = rng.uniform(west - 2, east + 2, 200_000), rng.uniform(south - 2, north + 2, 200_000)
    outside = (u < west) | (u > east) | (v < south) | (v > north)
    dz = change.dz(u, v)
    assert not dz[outside].any()
    touched_u, touched_v = u[np.abs(dz) > 1e-6], v[np.abs(dz) > 1e-6]
    assert touched_u.min() - west < 0.15
    assert east - touched_u.max() < 0.15
    assert touched_v.min() - south < 0.15
    assert north - touched_v.max() < 0.15


def test_overlapping_changes_add_up():
    u, v = np.random.default_rng(2).uniform(-1, 6, (2, 5000))
    assert total_dz(SHAPES, u, v) == pytest.approx(sum(change.dz(u, v) for change in SHAPES))


def test_true_raster_is_the_mean_over_each_cell():
    frame = Frame(dip_azimuth=205.0)
    changes = (Plateau(1.0, 1.0), Cone(3.03, 1.27), Bump(2.0, 3.0, 1.4, 0.8, -0.3))
    corners = frame.to_world(np.array([[-1.0, -1, 0], [5, -1, 0], [5, 5, 0], [-1, 5, 0]]))
    grid = snapped_grid((*corners[:, :2].min(axis=0), *corners[:, :2].max(axis=0)), 0.1)
    raster = true_change_raster(changes, frame, grid)
    # Another way: many random places of the world, sorted into cells.
    rng = np.random.default_rng(3)
    picked = np.argwhere(raster != 0)
    picked = picked[rng.choice(len(picked), 400, replace=False)]
    for row, column in picked:
        places = np.zeros((20_000, 3))
        places[:, 0] = grid.west + (column + rng.random(len(places))) * 0.1
        places[:, 1] = grid.north - (row + rng.random(len(places))) * 0.1
        local = frame.to_local(places)
        expected = sum(change.dz(local[:, 0], local[:, 1]) for change in changes).mean()
        assert raster[row, column] == pytest.approx(expected, abs=2.5e-3)
    volume = sum(change.volumes[0] - change.volumes[1] for change in changes)
    assert raster.sum() * 0.01 == pytest.approx(volume, abs=1e-3)


def test_true_raster_keeps_to_the_grid():
    frame = Frame()
    grid = snapped_grid((frame.east - 1, frame.north - 1, frame.east + 1, frame.north + 1), 0.1)
    near = true_change_raster((Plateau(0.9, 0.9, side=2.0),), frame, grid)
    assert near.max() == pytest.approx(0.16)
    assert near.min() == 0.0
    assert not true_change_raster((Plateau(50.0, 50.0), Plateau(-50.0, -50.0)), frame, grid).any()


def test_largest_cell_of_the_cone():
    """With the apex in a cell's middle, the mean distance to the centre of a square of side a is 0.3826 a."""
    frame = Frame(east=500_000.05, north=3_500_000.05, dip_azimuth=180.0)
    grid = snapped_grid((499_999.0, 3_499_999.0, 500_001.0, 3_500_001.0), 0.1)
    largest = true_change_raster((Cone(0.0, 0.0),), frame, grid).max()
    assert largest == pytest.approx(0.36 * (1 - 0.382598 * 0.1 / 0.53), abs=1e-4)
