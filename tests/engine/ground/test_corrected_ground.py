"""Ground forced and forbidden by hand, against clouds whose ground is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS
from shapely import MultiPolygon, Point, Polygon, box
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.ground.corrected_ground import correct_ground, lowest_layer
from slopewatch.engine.pointcloud.cloud import PointCloud
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.engine.pointcloud.writing import write_cloud
from slopewatch.engine.vector.corrections import Correction, Corrections

WEST, SOUTH = 500_000.0, 3_500_000.0
BUSH, CAR = Point(WEST + 10, SOUTH + 10).buffer(5.0), box(WEST + 20, SOUTH + 8, WEST + 24, SOUTH + 10)


def slope(seed: int = 1):
    """Points (n, 3) of 30 by 20 m at 27 degrees; which are ground; which a filter took for it: no ground under a closed
    bush, and a car 1.5 m high.
    """
    rng = np.random.default_rng(seed)
    x, y = rng.uniform([[0], [0]], [[30], [20]], (2, 60_000))
    true = 50 + 0.5 * y + 0.1 * np.sin(x)
    bush = (x - 10) ** 2 + (y - 10) ** 2 < 16
    car = (x > 20.2) & (x < 23.8) & (y > 8.2) & (y < 9.8)
    reached = rng.uniform(size=x.size) < 0.1  # of the pulses into the bush
    over = np.where(bush & ~reached, rng.uniform(0.3, 1.4, x.size), rng.normal(0, 0.02, x.size))
    over = np.where(car, 1.5, over)
    ground = ~car & ~(bush & ~reached)
    taken = ~bush
    ground[0] = taken[0] = False  # becomes a stray return
    return np.column_stack([WEST + x, SOUTH + y, true + over]), ground, taken


@pytest.fixture
def cloud(tmp_path):
    xyz, ground, taken = slope()
    labels = np.where(taken, 2, 1).astype(np.uint8)
    paths = tmp_path / "clipped.laz", tmp_path / "classified.laz"
    noise = np.zeros(len(xyz), np.uint8)
    xyz[0] = WEST + 10, SOUTH + 10, 30.0  # a stray return 25 m below the bush
    noise[0] = 7
    for path, classes in zip(paths, (noise, labels), strict=True):
        write_cloud(path, PointCloud(xyz, CRS.from_epsg(32651), path), classification=classes)
    return paths, xyz, ground, taken


def done(cloud, *areas: tuple[str, Polygon]):
    (clipped, classified), xyz, _, _ = cloud
    outputs = clipped.with_name("labels.laz"), clipped.with_name("ground.laz")
    given = Corrections(Path("c.gpkg"), tuple(Correction(action, MultiPolygon([p])) for action, p in areas))
    count = correct_ground((clipped, classified), outputs, given, scatter=0.02, threshold=0.1)
    labels = np.asarray(read_cloud(outputs[0]).classification)
    kept = read_cloud(outputs[1]).xyz
    np.testing.assert_allclose(kept, xyz[labels == 2], atol=0.001)
    assert len(kept) == count
    return labels == 2


def within(xyz, polygon) -> np.ndarray:
    west, south, east, north = polygon.bounds
    box_ = (xyz[:, 0] > west) & (xyz[:, 0] < east) & (xyz[:, 1] > south) & (xyz[:, 1] < north)
    if polygon is BUSH:
        return np.hypot(xyz[:, 0] - WEST - 10, xyz[:, 1] - SOUTH - 10) < 3.9
    return box_


def test_the_lowest_layer_under_a_closed_bush_is_ground(cloud):
    _, xyz, ground, taken = cloud
    found = done(cloud, ("ground", BUSH))
    inside = within(xyz, BUSH)
    assert not taken[inside].any()
    assert found[inside & ground].mean() > 0.7
    # a tenth of what was taken may be of the bush; the height of the ground is right
    assert ground[inside & found].mean() > 0.9
    height = xyz[:, 2] - (50 + 0.5 * (xyz[:, 1] - SOUTH) + 0.1 * np.sin(xyz[:, 0] - WEST))
    assert abs(np.median(height[inside & found])) < 0.01
    assert not found[0]  # noise of the survey
    outside = np.hypot(xyz[:, 0] - WEST - 10, xyz[:, 1] - SOUTH - 10) > 5.1
    np.testing.assert_array_equal(found[outside], taken[outside])


def test_nothing_is_ground_where_it_is_forbidden_or_excluded(cloud):
    _, xyz, _, taken = cloud
    car = within(xyz, CAR)
    assert taken[car].all()
    for action in ("not_ground", "exclude"):
        found = done(cloud, (action, CAR))
        assert not found[car].any()
        np.testing.assert_array_equal(found[~car], taken[~car])


def test_excluding_wins_over_forced_ground(cloud):
    _, xyz, _, _ = cloud
    found = done(cloud, ("ground", CAR), ("exclude", CAR))
    assert not found[within(xyz, CAR)].any()


def test_corrections_that_leave_no_ground_are_refused(cloud):
    with pytest.raises(InputError, match=r"'c.gpkg' leave no ground; make their areas smaller\.$"):
        done(cloud, ("not_ground", box(WEST - 1, SOUTH - 1, WEST + 40, SOUTH + 40)))


@pytest.mark.parametrize("count", [1, 3, 5])
def test_few_returns_are_their_own_lowest_layer(count):
    line = np.column_stack([np.arange(count) * 3.0, np.zeros(count), np.zeros(count)])
    assert lowest_layer(line, 0.02, 0.1).any()
