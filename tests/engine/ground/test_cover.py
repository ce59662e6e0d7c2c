"""What covers the ground, counted by hand on a cloud of five squares, and on others of many returns."""

from __future__ import annotations

import json
import math
import time
from dataclasses import replace

import numpy as np
import pytest
from slopewatch.engine.core.json_values import plain
from slopewatch.engine.ground.cover import (
    CLASSES,
    GroundCover,
    cover_facts,
    cover_table,
    cover_warnings,
    facts_of_squares,
    height_counts,
    with_more,
)
from slopewatch.engine.ground.cover_squares import (
    COARSEST_SQUARE_M,
    FINEST_SQUARE_M,
    MIN_QUARTERED_RETURNS,
    OverGround,
    cover_cells,
    finest_squares,
    square_sums,
    squares_of,
)
from slopewatch.engine.ground.tally import square_keys, square_places

WEST, SOUTH = 500_000.0, 3_500_000.0


def rows(x: float, y: float, heights: list[float], grounds: int, error: float, layer: float) -> np.ndarray:
    """Returns around one place: x, y, height, ground (the first ones), plant error, plant height."""
    count = len(heights)
    place = np.column_stack([np.full(count, x), np.full(count, y)])
    on_ground = np.arange(count) < grounds
    return np.column_stack([place, heights, on_ground, np.full(count, error), np.full(count, layer)])


@pytest.fixture(scope="module")
def by_hand() -> np.ndarray:
    """Four squares of 0.5 m (bare with one stray, grass, trees, unknown) and, far away, five returns of shrubs."""
    return np.concatenate(
        [
            rows(0.25, 0.25, [-0.01, 0.01] * 10 + [30.0], 20, 0.0, 0.0),
            rows(0.75, 0.25, [0.02, 0.04, 0.0] + [0.3] * 17, 3, 0.02, 0.3),
            rows(0.25, 0.75, [0.5] * 18 + [5.0, 6.0], 0, 0.04, 0.5),
            rows(0.75, 0.75, [0.0] * 9 + [math.nan] * 11, 1, math.nan, math.nan),
            *(rows(x, y, [1.5], 0, 0.06, 1.5) for x in (41.0, 43.0) for y in (81.0, 83.0)),
            rows(43.1, 83.1, [1.5], 0, 0.06, 1.5),
        ]
    )


def facts(table: np.ndarray) -> GroundCover:
    xyz = np.column_stack([table[:, 0] + WEST, table[:, 1] + SOUTH, table[:, 2]])
    return cover_facts(xyz, table[:, 3] > 0, table[:, 2], table[:, 4], table[:, 5])


def test_the_classes_are_those_counted_by_hand(by_hand):
    cover = facts(by_hand)
    area = 4 * 0.25 + 16.0
    expected = {
        # area, returns, ground of these, without ground, error, plant height
        "bare": (0.25, 21, 20, 0.0, 0.0, 0.0),
        "low_plants": (0.25, 20, 3, 0.0, 0.02, 0.3),
        "shrubs": (16.0, 5, 0, 1.0, 0.06, 1.5),
        "trees": (0.25, 20, 0, 1.0, 0.04, 0.5),
        "unknown": (0.25, 20, 1, 0.0, math.nan, math.nan),
    }
    assert [c.name for c in cover.classes] == list(expected) == list(CLASSES)
    for found in cover.classes:
        size, returns, on_ground, without, error, layer = expected[found.name]
        assert found.area_share == pytest.approx(size / area)
        assert found.returns == returns
        assert found.ground_share == pytest.approx(on_ground / returns)
        assert found.without_ground_share == without
        assert (found.error_m, found.plant_height_m) == pytest.approx((error, layer), nan_ok=True)
    assert (cover.returns, cover.area_m2, cover.finest_m, cover.coarsest_m) == (86, area, 0.5, 4.0)
    assert cover.ground_share == pytest.approx(24 / 86)
    assert cover.without_ground_share == pytest.approx(16.25 / area)
    assert cover.error_m == 0.06
    # of the bare square 20 returns of 1 cm to both sides, of the grass three of 0, 2 and 4 cm
    bare, grass = (np.std(v, ddof=1) / math.sqrt(len(v)) for v in ([0.01, -0.01] * 10, [0.0, 0.02, 0.04]))
    assert cover.noise_m == pytest.approx(min(bare, grass))
    # grass 2 cm beyond its noise of 1.2 cm; trees and shrubs, whose noise is not known, beyond that of the others
    assert grass < 0.02
    assert cover.error_beyond_noise_share == pytest.approx(16.5 / area)


def test_the_heights_are_counted_in_bins(by_hand):
    heights = facts(by_hand).heights
    edges = heights.from_m + heights.bin_m * np.arange(len(heights.returns) + 1)
    known = by_hand[np.isfinite(by_hand[:, 2])]
    # a hair up, as values on an edge belong to the bin above it
    assert list(heights.returns) == np.histogram(known[:, 2] + 1e-9, edges)[0].tolist()
    assert list(heights.ground) == np.histogram(known[known[:, 3] > 0, 2] + 1e-9, edges)[0].tolist()
    assert (heights.below, heights.above, heights.unknown) == (0, 3, 11)
    assert sum(heights.returns) + heights.above + heights.unknown == len(by_hand)


def test_short_closed_grass_is_not_bare(by_hand):
    short = rows(0.25, 0.25, [0.03] * 40, 1, 0.015, 0.03)
    assert facts(short).classes[1].area_share == 1.0
    assert facts(rows(0.25, 0.25, [0.03] * 40, 1, 0.005, 0.03)).classes[0].area_share == 1.0
    # without the plant errors the heights alone tell
    xyz = np.column_stack([by_hand[:, :2], by_hand[:, 2]])
    alone = cover_facts(xyz, by_hand[:, 3] > 0, by_hand[:, 2])
    assert math.isnan(alone.error_m)
    assert [c.area_share for c in alone.classes] == [c.area_share for c in facts(by_hand).classes]
    assert alone.error_beyond_noise_share == 0.0


def test_classes_are_measured_square_to_the_slope():
    table = rows(0.25, 0.25, [0.0] * 20 + [0.15] * 20, 20, 0.0, 0.1)
    xyz = np.column_stack([table[:, :2], table[:, 2]])
    for dip, name in ((0.0, "low_plants"), (40.0, "low_plants"), (60.0, "bare"), (90.0, "bare")):
        cover = cover_facts(xyz, table[:, 3] > 0, table[:, 2], dip=dip)
        assert [c.name for c in cover.classes if c.area_share == 1.0] == [name]
        assert sum(cover.heights.returns[11:14]) == 20


def test_squares_are_quartered_while_they_hold_enough():
    rng = np.random.default_rng(1)
    dense, thin = rng.uniform(0, 8, (30_000, 2)), rng.uniform([100, 0], [140, 40], (1_600, 2))
    xy = np.concatenate([dense, thin, [[9e6, -9e6]]]) + [400.0, -8.0]
    cells = cover_cells(xy)
    sides = cells.side[cells.index]
    assert set(sides[:30_000]) == {FINEST_SQUARE_M}
    assert set(cells.side[cells.index[30_000:-1]]) <= {FINEST_SQUARE_M, 1.0, 2.0, COARSEST_SQUARE_M}
    assert np.median(cells.side[cells.index[30_000:-1]]) == COARSEST_SQUARE_M
    assert sides[-1] == FINEST_SQUARE_M
    corner = np.column_stack([cells.column, cells.row])[cells.index] * FINEST_SQUARE_M
    assert ((xy >= corner) & (xy < corner + sides[:, None])).all()
    np.testing.assert_array_equal(corner % sides[:, None], 0)
    counts = np.bincount(cells.index)
    assert counts.min() >= 1
    assert (cells.area[cells.side == FINEST_SQUARE_M] == FINEST_SQUARE_M**2).all()
    for cell in np.flatnonzero(cells.side > FINEST_SQUARE_M):
        own = xy[cells.index == cell]
        held = len(np.unique(np.floor(own / (cells.side[cell] / 2)), axis=0))
        assert len(own) < MIN_QUARTERED_RETURNS * held
        assert (np.ptp(np.floor(own / (cells.side[cell] / 2)), axis=0) == 1).all()
        assert cells.area[cell] == held * cells.side[cell] ** 2 / 4
    assert len(np.unique(np.column_stack([cells.column, cells.row, cells.side]), axis=0)) == len(cells.side)


def test_squares_do_not_reach_far_beyond_the_edge_of_a_survey():
    rng = np.random.default_rng(4)
    xy = rng.uniform(-0.4, 16.4, (100_000, 2)) @ np.array([[0.8, 0.6], [-0.6, 0.8]]) + 100
    cells = cover_cells(xy)
    assert cells.area.sum() == pytest.approx(16.8**2, rel=0.08)
    assert (cells.side**2).sum() == pytest.approx(16.8**2, rel=0.08)
    # a strip of a few returns in squares of their own
    edge = np.concatenate([rng.uniform(0, [8, 8], (8_000, 2)), rng.uniform([8, 0], [8.01, 8], (9, 2))])
    assert cover_cells(edge).side.max() == FINEST_SQUARE_M


def test_the_table_tells_the_figures(by_hand):
    cover = facts(by_hand[21:41])
    lines = cover_table(facts(by_hand))
    assert len(lines) == 6
    assert " ".join(lines[2].split()) == "grass and low plants 1.5 % 20 15 % 0 % 2.0 cm"
    assert lines[5].split()[-1] == "–"
    assert len(cover_table(cover)) == 2


def test_warnings_come_with_their_share_and_the_season(by_hand):
    cover = facts(by_hand)
    calm = replace(cover, without_ground_share=0.25, error_beyond_noise_share=0.25)
    assert cover_warnings(calm, "may.laz") == []
    [missing] = cover_warnings(replace(calm, without_ground_share=0.312), "may.laz")
    assert missing.startswith("31 % of the area of may.laz has no ground return")
    assert "mowing" in missing
    [plants] = cover_warnings(replace(calm, error_beyond_noise_share=0.48, error_m=0.012, noise_m=0.004), "may.laz")
    assert "Vegetation on may.laz" in plants
    assert "(medians 1.2 and 0.4 cm over the whole area)" in plants
    assert "same state" in plants


def test_a_run_record_takes_it(by_hand):
    cover = facts(by_hand)
    kept = json.loads(json.dumps(plain(cover), allow_nan=False))
    assert kept["classes"][4]["error_m"] is None
    assert kept["heights"]["unknown"] == 11
    figures = cover.figures()
    assert figures["without_ground_share"] == cover.without_ground_share
    assert figures["plant_error_m"] == 0.06
    assert len(figures) == 2


def test_a_million_returns_take_less_than_a_second_of_the_processor():
    rng = np.random.default_rng(2)
    xyz = np.column_stack([rng.uniform(0, 60, (1_000_000, 2)), rng.normal(0, 0.2, 1_000_000)])
    seconds = []
    for _ in range(3):
        start = time.thread_time()
        cover_facts(xyz, xyz[:, 2] < 0.03, xyz[:, 2], np.abs(xyz[:, 2]))
        seconds.append(time.thread_time() - start)
    assert min(seconds) < 1.0


def test_cover_from_the_sums_of_the_finest_squares_is_that_of_the_points():
    rng = np.random.default_rng(8)
    count = 30_000
    xyz = np.column_stack([rng.uniform(-40, 40, count), rng.uniform(-25, 35, count) ** 3 / 1000, np.zeros(count)])
    height = np.where(rng.random(count) < 0.3, rng.uniform(0, 4, count), rng.normal(0, 0.02, count))
    height[rng.random(count) < 0.05] = np.nan
    ground = np.abs(height) < 0.04
    error, plants = np.abs(rng.normal(0, 0.02, count)), rng.uniform(0, 1, count)
    expected = cover_facts(xyz, ground, height, error, plants, dip=30.0)
    upright = height * math.cos(math.radians(30.0))
    keys, index = np.unique(square_keys(np.column_stack(finest_squares(xyz))), return_inverse=True)
    finest = square_sums(index.ravel(), len(keys), OverGround(ground, height, upright, error, plants))
    cells = squares_of(*square_places(keys).T, finest[0])
    sums = np.vstack([np.bincount(cells.index, row, len(cells.side)) for row in finest])
    parts = [height_counts(height[part], ground[part]) for part in (slice(0, 10_000), slice(10_000, None))]
    found = facts_of_squares(cells, sums, with_more(*parts))
    assert found.heights == expected.heights
    assert found.returns == count
    for name in ("area_m2", "ground_share", "without_ground_share", "error_m", "noise_m", "error_beyond_noise_share"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), rel=1e-9)
    for a, b in zip(found.classes, expected.classes, strict=True):
        assert (a.name, a.returns) == (b.name, b.returns)
        assert a.area_share == pytest.approx(b.area_share, rel=1e-9)
        assert a.plant_height_m == pytest.approx(b.plant_height_m, rel=1e-9, nan_ok=True)
    assert min(c.area_share for c in expected.classes[:4]) > 0
