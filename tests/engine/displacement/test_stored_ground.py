"""Motion along the surface from ground on the disk: the same bytes as in memory, whatever is read at a time."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.displacement.displacement import Displacement, measure_displacement
from slopewatch.engine.displacement.facets import find_facets
from slopewatch.engine.displacement.registered import Registered
from slopewatch.engine.displacement.stored_ground import StoredGround, at_places
from slopewatch.engine.displacement.windows import density, tile_threads
from slopewatch.engine.pointcloud import in_parts, point_squares
from slopewatch.engine.pointcloud.in_parts import SpooledCloud, point_dtype
from slopewatch.interface.parameters import DisplacementParameters
from slopewatch.tests.builders.rough_ground import axes, relief, sampled

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


def on_disk(xyz: np.ndarray, file: Path, at_once: int = AT_ONCE) -> StoredGround:
    records = np.empty(len(xyz), point_dtype(0))
    records["xyz"] = xyz
    records.tofile(file)
    return StoredGround.of(SpooledCloud(file, len(xyz), 0, 0, CRS.from_epsg(32651), file), at_once)


@pytest.fixture
def stored(ground, tmp_path, monkeypatch) -> tuple[StoredGround, StoredGround]:
    monkeypatch.setattr(in_parts, "_PART_POINTS", 3_000)
    monkeypatch.setattr(point_squares, "_SQUARE_POINTS", 200)
    first, later = (on_disk(xyz, tmp_path / f"{n}.points") for n, xyz in enumerate(ground))
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


def test_places_are_asked_with_all_points_around_them(ground, stored):
    places = ground[0][::200, :2] + [0.0, 1.0]

    def crowded(points: np.ndarray, xy: np.ndarray) -> np.ndarray:
        return np.array([np.count_nonzero(np.hypot(*(points[:, :2] - at).T) < 1.5) > 250 for at in xy])

    want = crowded(ground[0], places)
    assert 0 < want.sum() < len(want)
    assert np.array_equal(at_places(stored[0].holding(8_000), places, 1.5, crowded), want)


def test_more_memory_takes_more_tiles_at_a_time():
    assert tile_threads(0.0) == 1
    assert 1 <= tile_threads(7e8) <= tile_threads(1e12) <= 4
