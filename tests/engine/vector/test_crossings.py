"""Outlines that cross too often are refused, whatever many corners sound ones have."""

from __future__ import annotations

import time

import numpy as np
import pytest
import shapely
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.vector import crossings
from slopewatch.engine.vector.crossings import refuse_tangled


def random_outline(corners: int) -> shapely.Polygon:
    return shapely.Polygon(np.random.default_rng(1).random((corners, 2)) * 100)


def brute_force(shapes: list[shapely.Polygon]) -> int:
    """Pairs of pieces that cross, by shapely, each with each."""
    pieces = []
    for shape in shapes:
        xy = shapely.get_coordinates(shape)
        pieces += list(shapely.linestrings(np.stack([xy[:-1], xy[1:]], axis=1)))
    first, second = np.triu_indices(len(pieces), 1)
    pieces = np.array(pieces)
    return int(shapely.crosses(pieces[first], pieces[second]).sum())


@pytest.mark.parametrize("shapes", [[random_outline(60)], [shapely.box(0, 0, 10, 10), shapely.box(5, 5, 15, 15)]])
def test_crossings_are_counted(shapes):
    assert crossings._crossings(crossings._segments(shapes), 10_000) == brute_force(shapes) > 1


def test_tangled_outlines_are_refused_in_time():
    began = time.process_time()
    for shapes in ([random_outline(6000)], [random_outline(300)], [None, shapely.Polygon(), random_outline(400)]):
        with pytest.raises(InputError, match="The area crosses itself too often"):
            refuse_tangled(shapes, "The area")
    assert time.process_time() - began < 5.0


def test_pieces_side_by_side_are_refused_before_all_pairs_are_looked_at():
    x = np.arange(20_000) / 20_000
    comb = np.empty((40_000, 2))
    comb[0::2], comb[1::2] = np.c_[x, 0 * x], np.c_[x + 5, 0 * x + 5]
    began = time.process_time()
    with pytest.raises(InputError, match="too often"):
        refuse_tangled([shapely.Polygon(comb)], "The area")
    assert time.process_time() - began < 8.0


def test_sound_outlines_of_many_corners_pass():
    angle = np.linspace(0, 2 * np.pi, 100_000, endpoint=False)
    refuse_tangled([shapely.Polygon(np.c_[np.cos(angle), np.sin(angle)])], "The area")
    refuse_tangled([shapely.box(i, j, i + 1, j + 1) for i in range(50) for j in range(50)], "The area")
    refuse_tangled([shapely.Polygon([(0, 0), (10, 10), (10, 0), (0, 10)])], "The area")  # a bow tie, to be repaired
