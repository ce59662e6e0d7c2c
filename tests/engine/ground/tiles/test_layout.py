"""Tiles and their halos against a loop over points; the largest that fit; points in files and back."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.ground.tally import metre_squares, square_places
from slopewatch.engine.ground.tiles.layout import (
    COARSE_M,
    HALO_M,
    MIN_SIDE_M,
    Tiles,
    counted,
    largest_tiles,
    tile_bytes,
    tiles_of,
)
from slopewatch.engine.ground.tiles.spool import SURFACE, Spool
from slopewatch.interface.parameters import GroundParameters
from slopewatch.tests.builders.long_slope import slope_points

SIDE = 30


@pytest.fixture(scope="module")
def points() -> np.ndarray:
    return slope_points(6_000)


def squares(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    keys, counts = np.unique(metre_squares(points), return_counts=True)
    return square_places(keys), counts.astype(np.float64)


def own_points(tiles: Tiles, tile: int, points: np.ndarray, halo: float) -> set[int]:
    """By a loop: numbers of the points within the tile and its halo."""
    west, south = tiles.corner(tile)
    return {
        i
        for i, (x, y, _) in enumerate(points.tolist())
        if west - halo <= x < west + tiles.side + halo and south - halo <= y < south + tiles.side + halo
    }


def test_every_point_lies_in_one_tile_and_halos_are_those_of_a_loop(points):
    tiles = tiles_of(counted(*squares(points)), SIDE)
    number = tiles.of(points)
    for tile in range(len(tiles)):
        assert set(np.flatnonzero(number == tile)) == own_points(tiles, tile, points, 0.0)
        assert set(np.flatnonzero(tiles.within(tile, points, 7.0))) == own_points(tiles, tile, points, 7.0)
        reached = {int(number[i]) for i in own_points(tiles, tile, points, 40.0)} - {tile}
        assert reached <= set(tiles.around(tile, 40.0))
    assert set(number) == set(range(len(tiles)))
    # corners lie on whole multiples of the squares, so the number that is known before the points is exact
    assert tiles.points == max(len(own_points(tiles, t, points, HALO_M)) for t in range(len(tiles)))


def test_the_fullest_square_is_that_of_a_loop(points):
    found = counted(*squares(points))
    assert found.counts.sum() == len(points)
    low = np.floor(points[:, :2].min(axis=0) / COARSE_M).astype(int)
    high = np.floor(points[:, :2].max(axis=0) / COARSE_M).astype(int)
    most = 0
    for column in range(low[0] - 4, high[0] + 1):
        for row in range(low[1] - 4, high[1] + 1):
            corner = np.array([column, row]) * COARSE_M
            inside = (points[:, :2] >= corner) & (points[:, :2] < corner + 4 * COARSE_M)
            most = max(most, int(inside.all(axis=1).sum()))
    assert found.fullest(4 * COARSE_M) == most
    assert found.fullest(1000 * COARSE_M) == len(points)


def test_the_largest_tiles_that_fit_are_taken(points):
    found, parameters = counted(*squares(points)), GroundParameters()
    everything = largest_tiles(found, 1e12, parameters)
    assert len(everything) == 1
    smallest = tiles_of(found, MIN_SIDE_M)
    needed = tile_bytes(found, MIN_SIDE_M, smallest.points, parameters)
    assert largest_tiles(found, 0.99 * needed, parameters) is None
    tiles = largest_tiles(found, 1.2 * needed, parameters)
    assert tiles is not None
    assert tile_bytes(found, int(tiles.side), tiles.points, parameters) <= 1.2 * needed
    larger = tiles_of(found, int(tiles.side) + 60)
    assert tile_bytes(found, int(tiles.side) + 60, larger.points, parameters) > 1.2 * needed
    # a cloth of that many particles would not be laid, whatever the memory
    assert len(largest_tiles(found, 1e15, GroundParameters(cloth_resolution=0.02))) > 1


def test_points_come_back_from_their_files_with_those_around(points, tmp_path):
    tiles = tiles_of(counted(*squares(points)), SIDE)
    spool, taken = Spool(tmp_path, tiles), np.arange(len(points)) % 3 == 0
    for part in np.array_split(np.arange(len(points)), 7):
        spool.add(tiles.of(points[part]), points[part], taken[part])
    number = tiles.of(points)
    assert np.array_equal(spool.counts, np.bincount(number, minlength=len(tiles)))
    for tile in range(len(tiles)):
        records = np.zeros(int(spool.counts[tile]), SURFACE)
        records["height"] = 10 * points[number == tile, 0]
        spool.save(tile, records, "surface")
    for tile in range(len(tiles)):
        around, surface = spool.read(tile, 7.0, [("surface", SURFACE)])
        assert np.array_equal(around.flat[: around.core], points[number == tile])
        found = {tuple(p) for p in around.flat.tolist()}
        assert found == {tuple(points[i].tolist()) for i in own_points(tiles, tile, points, 7.0)}
        assert np.array_equal(surface["height"], 10 * around.flat[:, 0])
        for own, place, xyz in zip(around.own, around.place, around.flat[around.core :], strict=True):
            assert np.array_equal(points[number == own][place], xyz)
        order = {tuple(p): t for p, t in zip(points.tolist(), taken.tolist(), strict=True)}
        assert [order[tuple(p)] for p in around.flat.tolist()] == around.taken.tolist()
