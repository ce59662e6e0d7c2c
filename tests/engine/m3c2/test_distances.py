"""M3C2 against a search through all points, against values worked out by hand, and against CloudCompare."""

from __future__ import annotations

import laspy
import numpy as np
import pytest
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.m3c2 import lattice as m3c2_search
from slopewatch.engine.m3c2.distances import (
    Cylinder,
    Cylinders,
    LevelTerms,
    Status,
    cylinder_statistics,
    level_of_detection,
    m3c2_distances,
)
from slopewatch.engine.m3c2.lattice import Lattice, dominant_frame
from slopewatch.engine.m3c2.normals import fit_planes
from slopewatch.engine.m3c2.scales import overlap_bounds, spread_cores

UTM = np.array([512_345.678, 4_234_567.891, 1234.5])


def brute_force(cloud, core, normal, radius, half_length):
    """Count, mean and sample standard deviation by looking at every point."""
    rows = []
    for place, axis in zip(core, normal, strict=True):
        offset = cloud - place
        along = offset @ axis
        across = np.linalg.norm(offset - along[:, None] * axis, axis=1)
        t = along[(np.abs(along) <= half_length) & (across <= radius)]
        rows.append((len(t), t.mean() if len(t) else np.nan, t.std(ddof=1) if len(t) > 1 else np.nan))
    count, mean, std = map(np.array, zip(*rows, strict=True))
    return count, mean, std


def slope(points, seed, *, noise=0.03, offset=UTM):
    """A rolling slope of 39 degrees, 20 x 20 m."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(0, 20, (points, 3))
    xyz[:, 2] = 0.8 * xyz[:, 1] + np.sin(xyz[:, 0]) + rng.normal(0, noise, points)
    return xyz + offset


def box(points, seed):
    """Points all through a cube of 10 m: no surface at all."""
    return np.random.default_rng(seed).uniform(0, 10, (points, 3)) + UTM


def directions(count, frame, seed):
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    # along the axes, and along those of the search's own plane, where a divisor is zero
    normal[:6] = [[0, 0, 1], [1, 0, 0], [0, -1, 0], *frame]
    return normal


@pytest.mark.parametrize("cloud", [slope(8000, 1), slope(8000, 2, offset=np.zeros(3)), box(8000, 3)])
@pytest.mark.parametrize(
    ("radius", "half_length"), [(0.5, 1.0), (0.5, 0.5), (0.5, 1.5), (0.5, 2.0), (0.2, 3.0), (2.0, 0.1), (0.3, 0.7)]
)
def test_equals_a_search_through_all_points(cloud, radius, half_length):
    rng = np.random.default_rng(4)
    core = cloud[rng.choice(len(cloud), 80, replace=False)] + rng.normal(0, 0.1, (80, 3))
    core[6] += 1000.0  # far outside
    core[7] = cloud.min(axis=0)
    normal = directions(len(core), dominant_frame(cloud), 5)
    found = cylinder_statistics(Lattice(cloud, radius), core, normal, Cylinder(radius, half_length))
    count, mean, std = brute_force(cloud, core, normal, radius, half_length)
    assert np.array_equal(found.count, count)
    assert count[6] == 0
    assert count.max() > 5
    np.testing.assert_allclose(found.mean, mean, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.std, std, rtol=0, atol=1e-12)


@pytest.mark.parametrize("half_length", [1, 2, 3, 4, 10])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_points_on_the_wall_the_ends_and_the_core_plane_count_once(half_length, axis):
    # whole numbers: every comparison is exact, and a circle of radius 5 passes through points such as (3, 4)
    steps = np.arange(-11.0, 12.0)
    cloud = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3) + [500_000, 4_000_000, 100]
    disc = sum(1 for i in range(-5, 6) for j in range(-5, 6) if i * i + j * j <= 25)
    core = np.array([[500_000.0, 4_000_000, 100]])
    found = cylinder_statistics(Lattice(cloud, 5.0), core, np.eye(3)[[axis]], Cylinder(5.0, float(half_length)))
    assert disc == 81
    assert found.count.tolist() == [disc * (2 * half_length + 1)]
    assert found.mean.tolist() == [0.0]
    layers = np.repeat(np.arange(-half_length, half_length + 1), disc)
    assert found.std[0] == pytest.approx(layers.std(ddof=1), rel=1e-12)


def test_the_parts_that_the_work_is_cut_into_change_nothing(monkeypatch):
    cloud = slope(5000, 1)
    core = cloud[::50]
    whole = cylinder_statistics(Lattice(cloud, 0.5), core, directions(len(core), np.eye(3), 1), Cylinder(0.5, 2.0))
    monkeypatch.setattr(m3c2_search, "_CHUNK_PAIRS", 100)
    monkeypatch.setattr(m3c2_search, "_CHUNK_ROWS", 30)
    cut = cylinder_statistics(Lattice(cloud, 0.5), core, directions(len(core), np.eye(3), 1), Cylinder(0.5, 2.0))
    for name in ("count", "mean", "std"):
        assert getattr(whole, name).tobytes() == getattr(cut, name).tobytes()


def test_a_stray_point_costs_no_memory_and_no_exactness():
    cloud = np.vstack([slope(3000, 1), [[9e9, -9e9, 0.0]]])
    core = cloud[:3000:60]
    normal = directions(len(core), np.eye(3), 1)
    found = cylinder_statistics(Lattice(cloud, 1e-4), core, normal, Cylinder(0.5, 1.0))
    assert np.array_equal(found.count, brute_force(cloud, core, normal, 0.5, 1.0)[0])


def test_few_points_are_looked_into_that_are_not_in_the_cylinder():
    # a steep hollow: seen from above, long cylinders across its walls cover much ground that they never come near
    rng = np.random.default_rng(1)
    place, angle = rng.uniform(-20, 20, (120_000, 2)), np.pi / 4
    cloud = np.column_stack([place, np.hypot(*place.T) + rng.normal(0, 0.02, len(place))])
    core = cloud[(np.abs(np.hypot(*place.T) - 12) < 1)][:300]
    across = -core[:, :2] / np.hypot(*core[:, :2].T)[:, None] * np.sin(angle)
    normal = np.column_stack([across, np.full(len(core), np.cos(angle))])
    inside, _, _ = brute_force(cloud, core, normal, 0.4, 1.5)
    looked = sum(len(point) for _, point in Lattice(cloud, 0.4).candidates(core, 1.5 * normal, 0.4))
    assert inside.sum() > 5_000
    assert inside.sum() <= looked < 2.5 * inside.sum()


def test_normals_and_roughness_are_those_of_principal_components():
    cloud = slope(8000, 1)
    core = cloud[::200]
    fits = fit_planes(Lattice(cloud, 0.5), core, 1.0)
    for number, place in enumerate(core):
        ball = cloud[np.linalg.norm(cloud - place, axis=1) <= 0.5]
        _, values, vectors = np.linalg.svd(ball - ball.mean(axis=0))
        assert fits.count[number] == len(ball)
        assert fits.normal[number] == pytest.approx(vectors[2] * np.sign(vectors[2, 2]), abs=1e-7)
        assert fits.roughness[number] == pytest.approx(values[2] / np.sqrt(len(ball) - 3), rel=1e-6)
    down = fit_planes(Lattice(cloud, 0.5), core, 1.0, orientation=np.array([0.0, 0.0, -1.0]))
    assert np.array_equal(down.normal, -fits.normal)


def test_points_on_a_line_or_too_few_have_no_normal():
    line = np.column_stack([np.linspace(0, 1, 50), np.zeros(50), np.zeros(50)]) + UTM
    lonely = UTM + [[100.0, 0, 0], [100.1, 0, 0], [100, 0.1, 0]]
    fits = fit_planes(Lattice(np.vstack([line, lonely]), 0.5), np.vstack([line[25], lonely[0], UTM - 50]), 1.2)
    assert fits.count.tolist() == [50, 3, 0]
    assert not fits.found.any()
    assert not fits.normal.any()


def test_the_level_of_detection_is_the_papers():
    first = Cylinders(np.array([25]), np.array([0.0]), np.array([0.05]))
    second = Cylinders(np.array([16]), np.array([0.1]), np.array([0.08]))
    # 1.959964 * (sqrt(0.0025 / 25 + 0.0064 / 16) + 0.01) = 1.959964 * (0.0223607 + 0.01)
    assert level_of_detection(first, second, 0.95, 0.01)[0] == pytest.approx(0.0634258, abs=1e-6)
    # 0.674490 at 50 %
    assert level_of_detection(first, second, 0.5, 0.01)[0] == pytest.approx(0.0218270, abs=1e-6)


def plane_pair(lowered=0.4):
    rng = np.random.default_rng(1)
    first, second = (np.column_stack([rng.uniform(0, 10, (9000, 2)), rng.normal(0, 0.02, 9000)]) for _ in range(2))
    second[:, 2] -= lowered * (second[:, 0] > 5)
    return first, second


def test_a_known_change_is_measured_and_what_cannot_be_is_said():
    first, second = plane_pair()
    second = second[second[:, 1] < 8]
    few = np.array([[20.0, 20, 0.0], [20.1, 20, 0.0], [20, 20.1, 0.0]])
    first = np.vstack([first, few])
    second = np.vstack([second, few + [0, 0, 0.1]])
    core = np.array([[2.0, 4, 0], [8.0, 4, 0], [8.0, 9.5, 0], [20, 20, 0], [30, 30, 0], [2.0, 4, 0]])
    normal = np.tile([0.0, 0.0, 2.0], (6, 1))  # of any length
    normal[5] = 0.0
    found = m3c2_distances((Lattice(first, 0.5), Lattice(second, 0.5)), core, normal, Cylinder(0.5, 1.0))
    assert found.distance[:2] == pytest.approx([0.0, -0.4], abs=0.01)
    assert found.significant.tolist() == [False, True, False, False, False, False]
    expected = [Status.MEASURED, Status.MEASURED, Status.NO_POINTS, Status.FEW_POINTS, Status.NO_POINTS]
    assert found.status.tolist() == [*expected, Status.NO_NORMAL]
    assert np.isnan(found.distance).tolist() == [False, False, True, False, True, True]
    assert found.distance[3] == pytest.approx(0.1)
    assert np.isnan(found.level).tolist() == [False, False, True, True, True, True]
    assert np.linalg.norm(found.normal, axis=1).tolist() == [1, 1, 1, 1, 1, 0]
    lattices = Lattice(first, 0.5), Lattice(second, 0.5)
    wide = m3c2_distances(lattices, core, normal, Cylinder(0.5, 1.0), LevelTerms(registration_error=0.25))
    assert wide.level[1] == pytest.approx(found.level[1] + 1.959964 * 0.25)
    assert not wide.significant[1]


def test_change_beyond_the_cylinder_is_not_taken_for_none():
    first, second = plane_pair(lowered=0.4)
    core = np.array([[8.0, 4, 0]])
    up = np.array([[0.0, 0, 1]])
    found = m3c2_distances((Lattice(first, 0.5), Lattice(second, 0.5)), core, up, Cylinder(0.5, 0.3))
    assert found.status.tolist() == [Status.NO_POINTS]


def test_unchanged_ground_stays_below_its_level_as_often_as_the_level_says():
    first, second = slope(60_000, 1), slope(50_000, 2)
    core = first[spread_cores(first, 0.5, overlap_bounds(first, second))]
    # where the two surveys sample relief alike; at the borders the cylinders are cut
    core = core[(np.abs(core - UTM - [10, 10, 0])[:, :2] < 9).all(axis=1)]
    normal = fit_planes(Lattice(first, 0.3), core, 0.6).normal
    found = m3c2_distances((Lattice(first, 0.4), Lattice(second, 0.4)), core, normal, Cylinder(0.4, 0.5))
    assert found.measured.mean() > 0.99
    assert 0.03 < found.significant[found.measured].mean() < 0.07


def test_what_slides_along_the_surface_is_not_seen():
    rng = np.random.default_rng(1)
    first = np.column_stack([rng.uniform(0, 10, (9000, 2)), np.zeros(9000)])
    first[:, 2] = first[:, 1] + rng.normal(0, 0.01, 9000)
    second = first + [0, 0.5, 0.5]
    core = first[(np.abs(first[:, :2] - 5) < 2).all(axis=1)][:50]
    normal = np.tile([0.0, -np.sqrt(0.5), np.sqrt(0.5)], (50, 1))
    found = m3c2_distances((Lattice(first, 0.5), Lattice(second, 0.5)), core, normal, Cylinder(0.5, 2.0))
    assert np.abs(found.distance).max() < 0.01


def test_progress_rises_to_the_end():
    class Recorder(Progress):
        def emit(self, percent, message):
            percents.append(percent)

    percents: list[float] = []
    cloud = slope(20_000, 1)
    core = cloud[::10]
    normal = np.tile([0.0, 0.0, 1.0], (len(core), 1))
    lattice = Lattice(cloud, 0.5)
    m3c2_distances((lattice, lattice), core, normal, Cylinder(0.5, 3.0), progress=Recorder())
    assert percents == sorted(percents)
    assert len(percents) > 5
    assert percents[-1] == 100.0


@pytest.fixture(scope="module")
def cloudcompare(shared_data):
    """CloudCompare's table and what is found with its normals, in the files' own coordinates."""
    folder = shared_data / "real" / "autzen_bmx"
    clouds = [np.asarray(laspy.read(folder / f"autzen-bmx-{year}.las").xyz) for year in (2010, 2023)]
    table = np.genfromtxt(folder / "autzen-bmx-cc.txt", delimiter=",", names=True)
    core, normal = (np.column_stack([table[f"{kind}{a}"] for a in "XYZ"]) for kind in ("", "Normal"))
    radius = 2.890432
    found = m3c2_distances(
        (Lattice(clouds[0], radius), Lattice(clouds[1], radius)), core, normal, Cylinder(radius, 5.5)
    )
    return table, found


class TestCloudCompare:
    """Six of the normals have no length: CloudCompare counts a ball there and tells a distance of 0."""

    def test_counts_are_equal_at_all_cores(self, cloudcompare):
        table, found = cloudcompare
        assert len(table) == 103
        assert np.array_equal(found.reference.count, table["Npoints_cloud1"])
        assert np.array_equal(found.moving.count, table["Npoints_cloud2"])

    def test_distances_are_equal_within_3_mm(self, cloudcompare):
        table, found = cloudcompare
        directed = found.status != Status.NO_NORMAL
        assert directed.sum() == 97
        assert np.array_equal(np.isnan(found.distance[directed]), np.isnan(table["M3C2_distance"][directed]))
        apart = np.abs(found.distance - table["M3C2_distance"])[directed]
        assert np.nanmax(apart) < 0.003
        assert np.nanmax(apart) < 0.001  # normals of three decimals, brought to length 1
        assert not table["M3C2_distance"][~directed].any()

    def test_scatter_and_level_are_equal_but_for_the_divisor(self, cloudcompare):
        table, found = cloudcompare
        measured = found.measured
        for cylinders, name in ((found.reference, "STD_cloud1"), (found.moving, "STD_cloud2")):
            n = cylinders.count[measured]
            # CloudCompare divides by n, the sample's variance by n - 1
            np.testing.assert_allclose(
                cylinders.std[measured] * np.sqrt((n - 1) / n), table[name][measured], rtol=0, atol=0.002
            )
        population = [
            Cylinders(c.count, c.mean, c.std * np.sqrt(np.maximum(c.count - 1, 0) / np.maximum(c.count, 1)))
            for c in (found.reference, found.moving)
        ]
        level = level_of_detection(*population, 0.95, 0.0)[measured]
        np.testing.assert_allclose(level, table["distance_uncertainty"][measured], rtol=0, atol=0.002)
        # both tell a level from five points on
        undirected = found.status == Status.NO_NORMAL
        assert np.array_equal(measured | undirected, np.isfinite(table["distance_uncertainty"]))
