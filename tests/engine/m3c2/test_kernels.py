"""Compiled sums over cylinders and balls: numpy's to the last bit, with numpy's way held to a search elsewhere."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.m3c2 import distances, kernels, normals
from slopewatch.engine.m3c2.distances import Cylinder, cylinder_statistics
from slopewatch.engine.m3c2.kernels import tree_sum
from slopewatch.engine.m3c2.lattice import Lattice, LatticeFrame
from slopewatch.engine.m3c2.normals import fit_planes

RNG = np.random.default_rng(5)
FAR = np.array([512_345.0, 4_812_345.0, 812.0])


def _wall() -> np.ndarray:
    """A bench and a wall that hangs over it, with twins and stray points: far from thin in any plane."""
    bench = RNG.uniform(0, [20, 10, 0.1], (6_000, 3))
    height = RNG.uniform(0, 6, 4_000)
    wall = np.column_stack([RNG.uniform(0, 20, 4_000), 9 - 0.3 * height, height])
    return np.vstack([bench, wall, wall[:50], RNG.uniform(-3, 25, (40, 3))]) + FAR


def _ways(monkeypatch: pytest.MonkeyPatch, of):
    """What ``of()`` gives by numpy and by loops, which Python runs where numba is not installed."""
    results = []
    for compiled in (False, True):
        for module in (distances, normals):
            monkeypatch.setattr(module, "pays", lambda work, least, answer=compiled: answer)
        results.append(of())
    return results


@pytest.fixture(autouse=True)
def _loops(monkeypatch):
    for loop in (kernels.CYLINDER_SUMS, kernels.BALL_SUMS):
        monkeypatch.setattr(loop, "_ready", [loop.ready() or loop.loop])
    monkeypatch.setattr(kernels, "PLACES_PER_CALL", 97)
    monkeypatch.setattr(distances, "PLACES_PER_CALL", 97)
    monkeypatch.setattr(normals, "PLACES_PER_CALL", 97)


@pytest.mark.parametrize("count", [*range(1, 20), 127, 128, 129, 130, 137, 257, 1000, 4321])
def test_sums_are_added_as_numpy_adds_them(count):
    values = RNG.normal(0, 1, count) * 10.0 ** RNG.integers(-6, 6, count)
    assert tree_sum(values, count) == np.add.reduceat(values, [0])[0]


@pytest.mark.parametrize(("radius", "half_length"), [(0.05, 0.2), (0.4, 0.3), (0.3, 2.5), (6.0, 6.0)])
@pytest.mark.parametrize("with_values", [False, True])
def test_cylinders_have_the_bits_of_numpy(radius, half_length, with_values, monkeypatch):
    xyz = _wall()
    values = RNG.uniform(0, 1, len(xyz)).astype(np.float32) if with_values else None
    core = np.vstack([xyz[RNG.integers(0, len(xyz), 150)] + RNG.normal(0, 0.1, (150, 3)), FAR - 100, FAR + [5, 50, 0]])
    unit = RNG.normal(0, 1, core.shape)
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    unit[:20] = [0, 0, 1]
    unit[20:25] = 0
    cloud = Lattice(xyz, radius, values)
    cylinder = Cylinder(radius, half_length)
    plain, loop = _ways(monkeypatch, lambda: cylinder_statistics(cloud, core, unit, cylinder, spread=with_values))
    assert plain.count.max() > (0 if radius < 0.1 else 5)
    for name in ("count", "mean", "std"):
        np.testing.assert_array_equal(getattr(loop, name), getattr(plain, name))
    if with_values:
        np.testing.assert_array_equal(loop.value, plain.value)
        np.testing.assert_array_equal(loop.spread.place, plain.spread.place)
        np.testing.assert_array_equal(loop.spread.products, plain.spread.products)
    else:
        assert loop.value is None
        assert loop.spread is None


@pytest.mark.parametrize("diameter", [0.1, 0.8, 14.0])
def test_planes_have_the_bits_of_numpy(diameter, monkeypatch):
    xyz = _wall()
    places = np.vstack([xyz[RNG.integers(0, len(xyz), 200)], FAR - 100])
    cloud = Lattice(xyz, diameter / 2)
    plain, loop = _ways(monkeypatch, lambda: fit_planes(cloud, places, diameter))
    assert plain.count.max() > 1
    for name in ("count", "normal", "roughness"):
        np.testing.assert_array_equal(getattr(loop, name), getattr(plain, name))


def test_counts_are_those_of_a_look_at_every_point(monkeypatch):
    xyz = _wall()
    core, radius, half_length = xyz[::101], 0.35, 1.7
    unit = RNG.normal(0, 1, core.shape)
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    _, loop = _ways(
        monkeypatch, lambda: cylinder_statistics(Lattice(xyz, 0.2), core, unit, Cylinder(radius, half_length))
    )
    offset = xyz[None] - core[:, None]
    along = np.einsum("mnk,mk->mn", offset, unit)
    across = np.sqrt(np.maximum(np.sum(offset**2, axis=2) - along**2, 0))
    assert np.array_equal(loop.count, ((np.abs(along) <= half_length) & (across <= radius)).sum(axis=1))


def test_a_cloud_without_points_gives_none(monkeypatch):
    xyz = _wall()
    empty = Lattice(np.zeros((0, 3)), 0.5, None, LatticeFrame.of(xyz))
    unit = np.tile([0.0, 0.0, 1.0], (4, 1))
    _, cylinders = _ways(monkeypatch, lambda: cylinder_statistics(empty, xyz[:4], unit, Cylinder(0.5, 1.0)))
    _, planes = _ways(monkeypatch, lambda: fit_planes(empty, xyz[:4], 1.0))
    assert not cylinders.count.any()
    assert np.isnan(cylinders.mean).all()
    assert not planes.found.any()
