"""Each grown block against a plain search over its points."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy import ndimage
from slopewatch.engine.change.difference import difference
from slopewatch.engine.change.result import Change
from slopewatch.engine.grid.block_moments import cell_moments, merged
from slopewatch.engine.grid.chosen_cell import MIN_POINTS
from slopewatch.engine.grid.grid import cell_index, snapped_grid
from slopewatch.tests.builders.sparse_ground import GROWING, blocks_of, epoch


def brute_force(first: np.ndarray, second: np.ndarray):
    """dz, variance weights, residuals and degrees of both epochs: the normal equations of parallel planes."""
    both = np.vstack([first, second])
    later = np.arange(len(both)) >= len(first)
    middle = both.mean(axis=0)
    design = np.column_stack([np.ones(len(both)), later, both[:, :2] - middle[:2]])
    solve = np.linalg.pinv(design)
    solution = solve @ (both[:, 2] - middle[2])
    rest = both[:, 2] - middle[2] - design @ solution
    hat = np.einsum("ij,ji->i", design, solve)
    return (
        solution[1],
        [np.sum(solve[1, part] ** 2) for part in (~later, later)],
        [rest[part] for part in (~later, later)],
        [np.sum(1 - hat[part]) for part in (~later, later)],
    )


def brute_force_error(points, around, side):
    """Standard error of dz from a block's points, and from those of the squares around."""
    _, weights, rests, degrees = brute_force(*points)
    pooled = np.zeros((2, 2))
    for square_points in around:
        _, _, squares, free = brute_force(*square_points)
        pooled += [[np.sum(r**2) for r in squares], free]
    prior = pooled[0] / pooled[1]
    of_a_point = [(np.sum(r**2) + 8 * p) / (d + 8) for r, p, d in zip(rests, prior, degrees, strict=True)]
    variance = sum(w * v for w, v in zip(weights, of_a_point, strict=True))
    if side > 0.3:  # parts of a quarter of the side, each of which errs as one
        place = [[tuple(p) for p in np.floor(xyz[:, :2] / (side / 4) + 1e-6)] for xyz in points]
        parts = sorted({p for epoch_places in place for p in epoch_places})
        means = [
            np.array([sum(r for r, q in zip(rest, where, strict=True) if q == part) for part in parts]) / len(rest)
            for rest, where in zip(rests, place, strict=True)
        ]
        number = len(parts)
        effect = np.sum((means[1] - means[0]) ** 2) * number / max(number - 3, 1)
        effect /= sum(v / len(r) for v, r in zip(of_a_point, rests, strict=True))
        free = max(number - 3, 0)
        variance *= max((free * effect + 4) / (free + 4), 1)
    return np.sqrt(variance)


def sound(first: np.ndarray, second: np.ndarray, side: float) -> bool:
    """Whether the points (both epochs) hold a gradient, as the rule says it."""
    if not (len(first) and len(second)) or len(first) + len(second) < 4:
        return False
    a, b = (p[:, :2] - p[:, :2].mean(axis=0) for p in (first, second))
    spread = a.T @ a + b.T @ b
    if np.linalg.det(spread) <= 1e-4 * ((len(a) + len(b)) * side**2 / 12) ** 2:
        return False
    apart = second[:, :2].mean(axis=0) - first[:, :2].mean(axis=0)
    return apart @ np.linalg.solve(spread, apart) < 1


@dataclass(frozen=True)
class Block:
    """One cell of the block, its side, its points of both epochs, and whether they are those of its whole square."""

    cell: int
    side: float
    points: list[np.ndarray]
    whole: bool


def square(clouds, place, side):
    """Points of both epochs in the square of that side at (column, row) from the origin."""
    return [c[(np.floor(c[:, :2] / side + 1e-6) == place).all(axis=1)] for c in clouds]


def outline(points, grid):
    """Cells within a survey's outline: no square of 33 cells without points has them in it, but for a rim."""
    hit = np.pad(
        (np.bincount(cell_index(points, grid), minlength=grid.rows * grid.columns) > 0).reshape(grid.shape), 40
    )
    within = ndimage.binary_closing(hit, np.ones((33, 33)))
    rim = int(np.sqrt(within.sum() / len(points)))
    wide = ndimage.binary_dilation(hit, np.ones((33 + 2 * rim,) * 2))
    return ndimage.binary_erosion(wide, np.ones((33, 33)))[40:-40, 40:-40]


@pytest.fixture(scope="module")
def sparse() -> tuple[np.ndarray, np.ndarray, Change, list[Block]]:
    """Two epochs, their change and every block of it, its points found one by one."""
    clouds = epoch(1), epoch(2)
    change = difference(*clouds, GROWING)
    owner = [change.partition.block.ravel()[cell_index(c, change.grid)] for c in clouds]
    both = np.logical_and(*(outline(c, change.grid) for c in clouds))
    seen = [c[both.ravel()[cell_index(c, change.grid)]] for c in clouds]
    blocks = []
    for cell in blocks_of(change):
        number, side = change.partition.block.ravel()[cell], change.partition.sizes.ravel()[cell]
        own = [c[o == number] for c, o in zip(clouds, owner, strict=True)]
        counts = [change.count_from.ravel()[cell], change.count_to.ravel()[cell]]
        whole = [len(p) for p in own] != counts
        if whole:
            row, column = np.divmod(cell, change.grid.columns)
            centre = np.array([change.grid.west, change.grid.north]) + 0.1 * np.array([column + 0.5, -row - 0.5])
            own = square(seen, np.floor(centre / side), side)
        assert [len(p) for p in own] == counts
        blocks.append(Block(int(cell), float(side), own, whole))
    return *seen, change, blocks


def test_moments_of_merged_blocks_are_those_of_their_points():
    points = epoch(3, n=2000)
    moments = cell_moments(points, snapped_grid((0, 0, 25.5, 25.5), 0.1), 100.0)
    for _ in range(4):
        moments = merged(moments)
    again = cell_moments(points, snapped_grid((0, 0, 25.5, 25.5), 1.6), 100.0)
    assert np.allclose(moments.sums, again.sums, rtol=1e-12, atol=1e-9)
    assert moments.side == pytest.approx(1.6)


def test_every_block_is_the_fit_to_its_points(sparse):
    _, _, change, blocks = sparse
    assert {round(b.side, 6) for b in blocks} == {0.2, 0.4, 0.8, 1.6}
    for block in blocks:
        assert change.dz.ravel()[block.cell] == pytest.approx(brute_force(*block.points)[0], abs=1e-8)
        assert min(len(p) for p in block.points) >= MIN_POINTS


def test_a_blocks_error_is_that_of_its_points_and_of_the_squares_of_its_size_around(sparse):
    first, second, change, blocks = sparse
    rng = np.random.default_rng(0)
    for side, whole in ((0.4, False), (0.8, False), (0.8, True), (1.6, False), (1.6, True)):
        for block in rng.choice([b for b in blocks if np.isclose(b.side, side) and b.whole == whole], 3):
            here = np.floor(block.points[0][0, :2] / side + 1e-6)
            around = [square((first, second), here + place - 3, side) for place in np.ndindex(7, 7)]
            expected = brute_force_error(block.points, [p for p in around if sound(*p, side)], side)
            assert change.error.ravel()[block.cell] == pytest.approx(expected, rel=1e-6)


def test_the_error_is_wider_where_near_points_err_alike():
    """Lumps of half a metre, others in each epoch, as of plants that were taken for ground: not one error a point."""
    shares = []
    for seed in range(3):
        clouds = []
        for number in (0, 1):
            points = epoch(30 + 2 * seed + number, n=12_000, noise=0.01)
            lump = np.random.default_rng([seed, number]).normal(0, 0.03, (60, 60))
            points[:, 2] += lump[tuple(np.floor(points[:, :2] / 0.4).astype(int).T)]
            clouds.append(points)
        change = difference(*clouds, replace(GROWING, target_level=0.01))
        blocks = [b for b in blocks_of(change) if change.partition.sizes.ravel()[b] > 1.5]
        shares.append(change.significant.ravel()[blocks].mean())
        assert len(blocks) > 100
    assert np.mean(shares) < 0.15, "were its points' errors taken as independent, it would be 0.29"


def test_a_block_is_taken_at_the_smallest_size_that_serves(sparse):
    """With a target that every sound block meets, no quarter of a block has enough points, or they hold no gradient."""
    first, second, *_ = sparse
    change = difference(first, second, replace(GROWING, target_level=10.0))
    grid = change.grid
    owner = [change.partition.block.ravel()[cell_index(c, grid)] for c in (first, second)]
    checked = 0
    for cell in blocks_of(change):
        number, half = change.partition.block.ravel()[cell], change.partition.sizes.ravel()[cell] / 2
        points = [c[o == number] for c, o in zip((first, second), owner, strict=True)]
        if half < grid.cell * 0.9 or len(points[0]) != change.count_from.ravel()[cell]:
            continue
        quarter = [np.floor(p[:, :2] / half + 1e-6) for p in points]
        for place in np.unique(np.vstack(quarter), axis=0):
            parts = [p[(q == place).all(axis=1)] for p, q in zip(points, quarter, strict=True)]
            assert min(len(p) for p in parts) < MIN_POINTS or not sound(*parts, half)
        checked += 1
    assert checked > 500


def test_cells_grow_until_the_target_or_the_largest_size(sparse):
    change, blocks = sparse[2:]
    largest = np.isclose(change.partition.sizes, 1.6)
    own = [block.cell for block in blocks if not block.whole and block.side < 1.5]
    assert (change.level.ravel()[own] <= 0.05).mean() > 0.99, "the rest is left of squares that served finer blocks"
    assert (change.level[largest] > 0.05).any()
    finer = difference(*sparse[:2], replace(GROWING, target_level=0.03))
    assert np.nanmedian(finer.level) < np.nanmedian(change.level)
    assert np.nanmean(finer.partition.sizes) > np.nanmean(change.partition.sizes)


def test_far_more_ground_is_compared_than_cells_of_one_size_could(sparse):
    first, second, change, _ = sparse
    index = [np.unique(cell_index(c, change.grid)) for c in (first, second)]
    assert len(np.intersect1d(*index)) < 0.2 * change.valid.size, "few cells have points of both"
    assert change.common_cell_rate < 0.2, "which tells how dense the surveys are, not what was compared"
    assert change.valid.sum() * 0.01 == pytest.approx(24.0**2, rel=0.03)
