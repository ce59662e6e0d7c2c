"""Zones that meet are found by a tree: the same as by comparing all with all, and without the memory of that."""

from __future__ import annotations

import time
import tracemalloc

import numpy as np
import pytest
from shapely import MultiPolygon, Polygon, box
from slopewatch.engine.zones import matching
from slopewatch.engine.zones.matching import _common, _Outline, match_zones
from slopewatch.tests.builders.zone_layers import zone_layer


def outlines(rng: np.random.Generator, count: int, width: int) -> list[_Outline]:
    """Outlines of up to 9 by 9 pixels, some of them empty, on a square of ``width`` pixels."""
    found = []
    for _ in range(count):
        top, left = rng.integers(-width // 2, width // 2, 2)
        rows, columns = rng.integers(0, 10, 2)
        found.append(_Outline(int(top), int(left), rng.random((rows, columns)) < 0.5))
    return found


def pixels(outline: _Outline) -> set[tuple[int, int]]:
    return {(outline.top + int(r), outline.left + int(c)) for r, c in np.argwhere(outline.pixels)}


@pytest.mark.parametrize("width", [20, 80])
def test_the_same_pairs_as_by_comparing_all_with_all(width: int) -> None:
    rng = np.random.default_rng(width)
    old, new = outlines(rng, 60, width), outlines(rng, 70, width)
    first, second, count = _common(old, new)
    found = {(int(i), int(j)): int(n) for i, j, n in zip(first, second, count, strict=True) if n}
    sets = [[pixels(o) for o in part] for part in (old, new)]
    expected = {(i, j): len(a & b) for i, a in enumerate(sets[0]) for j, b in enumerate(sets[1]) if a & b}
    assert found == expected
    assert len(expected) > 20
    pairs = list(zip(first.tolist(), second.tolist(), strict=True))
    assert pairs == sorted(set(pairs))


def all_with_all(old: list[_Outline], new: list[_Outline]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    sets = [[pixels(o) for o in part] for part in (old, new)]
    rows = [(i, j, len(a & b)) for i, a in enumerate(sets[0]) for j, b in enumerate(sets[1]) if a & b]
    first, second, count = np.array(rows, dtype=np.int64).reshape(-1, 3).T
    return first, second, count


def test_zones_are_matched_as_by_comparing_all_with_all(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(5)
    layers = [zone_layer([(x, y, x + w, y + h) for x, y, w, h in rng.uniform(1, 12, (30, 4))]) for _ in range(2)]
    found = match_zones(*layers)
    monkeypatch.setattr(matching, "_common", all_with_all)
    assert found == match_zones(*layers)
    assert max(map(len, found.heirs)) > 1 or max(map(len, found.sources)) > 1


@pytest.mark.parametrize("empty", [0, 1])
def test_a_table_without_zones_and_one_with_an_empty_shape(empty: int) -> None:
    layers = [zone_layer([(0, 0, 2, 2), (5, 0, 7, 2)]), zone_layer([(0, 0, 2, 2), (5, 0, 7, 2)])]
    layers[empty].loc[0, "geometry"] = MultiPolygon()
    found = match_zones(*layers)
    assert found.heirs == ((), (1,))
    layers[empty] = layers[empty].iloc[:0]
    assert not any(match_zones(*layers).heirs)


def test_zones_that_only_touch_do_not_meet() -> None:
    first, _, count = _common([_Outline(0, 0, np.ones((3, 3), bool))], [_Outline(0, 3, np.ones((3, 3), bool))])
    assert (len(first), len(count)) == (0, 0)


def test_memory_grows_with_the_zones_and_not_with_their_square() -> None:
    """All with all would take 1.6 GB for the corners of 10,000 and 10,000 alone."""
    square = np.ones((3, 3), dtype=bool)
    old = [_Outline(10 * (n // 100), 10 * (n % 100), square) for n in range(10_000)]
    new = [_Outline(o.top + 1, o.left, square) for o in old]
    tracemalloc.start()
    started = time.process_time()
    first, second, count = _common(old, new)
    seconds = time.process_time() - started
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert (first == np.arange(10_000)).all()
    assert (second == first).all()
    assert (count == 6).all()
    assert peak < 50e6
    assert seconds < 10


def test_shapes_of_other_kinds_of_polygon_are_matched() -> None:
    """A triangle inside a square: a box around both would have them meet where they do not."""
    layers = [zone_layer([(0, 0, 10, 10)]), zone_layer([(0, 0, 10, 10)])]
    layers[0].loc[0, "geometry"] = MultiPolygon([Polygon([(0, 0), (10, 0), (0, 10)])])
    layers[1].loc[0, "geometry"] = MultiPolygon([box(8, 8, 10, 10)])
    assert match_zones(*layers).heirs == ((),)
