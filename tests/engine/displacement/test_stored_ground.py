"""Motion along the surface from ground on the disk: the same bytes as in memory, whatever is read at a time."""

from __future__ import annotations

from dataclasses import fields, is_dataclass

import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.displacement.displacement import Displacement, measure_displacement
from slopewatch.engine.displacement.facets import find_facets
from slopewatch.engine.displacement.ground_by_boxes import by_boxes
from slopewatch.engine.displacement.registered import Registered
from slopewatch.engine.displacement.stored_ground import StoredGround
from slopewatch.engine.displacement.windows import Search, density, tile_threads, tiles
from slopewatch.engine.pointcloud import in_parts, point_squares
from slopewatch.interface.parameters import DisplacementParameters
from slopewatch.tests.builders.rough_ground import axes, relief, sampled
from slopewatch.tests.builders.stored_clouds import on_disk

SIDE_M = 34.0  # wider than a tile of windows
AT_ONCE = 32_000


@pytest.fixture(scope="module")
def ground() -> tuple[np.ndarray, np.ndarray]:
    """Two faces that meet in a valley, in no order; of the later survey the western one slides by 20 cm."""
    heights, rng = relief(SIDE_M, 0.15, seed=5), np.random.default_rng(0)
    found = []
    for seed in (1, 2):
        xyz = sampled(heights, 30.0, 0.02, seed)
        east = xyz[:, 0] - xyz[:, 0].min()
        xyz[(east < 10) & (seed == 2)] += 0.2 * axes()[0]
        xyz[:, 2] += np.where(east > 14, 1.5 * (east - 14), 0.0)
        found.append(rng.permutation(xyz))
    return found[0], found[1]


@pytest.fixture
def stored(ground, tmp_path, monkeypatch) -> tuple[StoredGround, StoredGround]:
    monkeypatch.setattr(in_parts, "_PART_POINTS", 3_000)
    monkeypatch.setattr(point_squares, "_SQUARE_POINTS", 200)
    first, later = (on_disk(xyz, tmp_path / f"{n}.points", AT_ONCE) for n, xyz in enumerate(ground))
    return first, later


def measured(first, later, **how) -> Displacement:
    return measure_displacement(first, later, DisplacementParameters(spacing=4.0), Registered.unknown(), **how)


@pytest.fixture(scope="module")
def held(ground) -> Displacement:
    return measured(*ground, threads=1)


def same(found: object, want: object, name: str = "") -> None:
    if isinstance(want, np.ndarray):
        assert np.asarray(found).tobytes() == want.tobytes(), name
    elif isinstance(want, tuple):
        assert len(found) == len(want), name
        for one, other in zip(found, want, strict=True):
            same(one, other, name)
    elif is_dataclass(want):
        for field in fields(want):
            same(getattr(found, field.name), getattr(want, field.name), f"{name}.{field.name}")
    else:
        assert found == want, name


@pytest.mark.parametrize("threads", [1, 2])
def test_ground_on_the_disk_gives_the_same_bytes(held, stored, threads):
    assert len(held.facets.frames) == 2
    assert held.zones
    assert len(stored[0]) > AT_ONCE
    same(measured(*stored, threads=threads), held)


@pytest.mark.parametrize("threads", [2, 3])
def test_tiles_in_threads_give_the_same_bytes(ground, held, threads):
    same(measured(*ground, threads=threads), held)


def test_facets_and_density_of_parts(ground, stored):
    small = stored[0].holding(2_500)
    same(find_facets(small), find_facets(ground[0]))
    assert density(stored) == density(ground)
    cells = {tuple(cell) for cell in np.floor(ground[1][:, :2]).astype(int)}
    assert density([stored[1]]) == len(ground[1]) / len(cells)


def test_points_of_a_place_come_in_their_order(ground, stored):
    frame = find_facets(ground[0]).frames[0]
    low, high = np.array([-6.0, -3.0]), np.array([4.0, 9.5])
    flat = frame.to_plane(ground[0])[:, :2]
    want = ground[0][((flat >= low) & (flat <= high)).all(axis=1)]
    assert len(want) > 1000
    assert np.array_equal(stored[0].in_plane(frame, low, high), want)
    few = stored[0].holding(len(want))
    assert np.array_equal(few.in_plane(frame, low, high), want)
    with pytest.raises(InputError, match="more lie within the reach of one tile"):
        stored[0].holding(len(want) - 1).in_plane(frame, low, high)


def test_points_of_a_tile_come_by_rows_of_tiles_and_in_their_order(ground, stored):
    facets = find_facets(ground[0])
    places = np.array([ground[0][:, :3].mean(axis=0) + [step, step, 0.0] for step in (-12.0, 0.0, 12.0)])
    facet = facets.places(places[:, :2])[0]
    search = Search((4.0,), 1.0, 0.1)
    for clouds in (ground, stored):
        for plan in tiles(clouds, facets, places, facet, search, Progress()):
            frame = facets.frames[int(facet[plan.windows[0]])]
            flat = frame.to_plane(ground[1])
            low, high = plan.corner - 0.05, plan.corner + np.array(plan.shape) * 0.05
            inside = np.flatnonzero(((flat[:, :2] >= low) & (flat[:, :2] <= high)).all(axis=1))
            want = flat[inside[np.lexsort((inside, np.floor(flat[inside, 0] / 24.0)))]]
            found = plan.near[1].within(plan.corner, plan.shape)
            assert len(want) > 3000
            assert len(np.unique(np.floor(want[:, 0] / 24.0))) > 1
            # squares of another facet are left out, all others are there in their order
            at = {tuple(row): n for n, row in enumerate(want)}
            numbers = np.array([at[tuple(row)] for row in found])
            assert (np.diff(numbers) > 0).all()
            assert len(found) > 0.5 * len(want)


def test_points_of_a_box_are_sorted_by_their_eastings(ground, stored):
    x, y = np.sort(ground[0][:, 0]), np.sort(ground[0][:, 1])
    bounds = (x[4000], y[3000], x[12_000], y[20_000])  # edges that points lie on
    want = ground[0][np.argsort(ground[0][:, 0], kind="stable")]
    inside = (
        (want[:, 0] >= bounds[0]) & (want[:, 0] < bounds[2]) & (want[:, 1] >= bounds[1]) & (want[:, 1] <= bounds[3])
    )
    assert 1000 < inside.sum() < 10_000
    for one in (by_boxes(ground[0]), by_boxes(stored[0])):
        assert one.within(bounds).tobytes() == want[inside].tobytes()
    with pytest.raises(InputError, match="more lie around one zone"):
        by_boxes(stored[0].holding(1000)).within(bounds)


def test_more_memory_takes_more_tiles_at_a_time():
    assert tile_threads(0.0) == 1
    assert 1 <= tile_threads(7e8) <= tile_threads(1e12) <= 4
