"""Cells that grow, against least squares on each block's points, known surfaces and simulated change."""

from __future__ import annotations

from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np
import pytest
import shapely
from scipy import ndimage
from slopewatch.engine.change.difference import Areas, cells_inside, difference
from slopewatch.engine.change.result import Change
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.grid import grown_cells
from slopewatch.engine.grid.block_moments import cell_moments, merged
from slopewatch.engine.grid.cell_statistics import cell_statistics
from slopewatch.engine.grid.chosen_cell import LEAST_POINTS
from slopewatch.engine.grid.common_grid import common_grid
from slopewatch.engine.grid.grid import cell_index, snapped_grid
from slopewatch.engine.grid.growing_cells import adaptive_cells
from slopewatch.engine.pointcloud.plant_cover import PlantCover
from slopewatch.interface.parameters import ChangeParameters, SurveyParameters
from slopewatch.simulation.surveys.survey import simulate_pair

GROWING = ChangeParameters(adaptive=True, calibrate=False, cell=0.1, largest_cell=1.6)


def surface(x, y):
    return 100.0 + 0.7 * x + 0.3 * y + 0.3 * np.sin(x / 3) * np.cos(y / 4) + 0.02 * np.sin(4 * x) * np.sin(5 * y)


def epoch(seed: int, *, n: int = 20_000, noise: float = 0.03, side: float = 24.0, plants: int = 60) -> np.ndarray:
    """A rough slope under plants, each epoch seen through other gaps: discs where one point in twelve is left."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, side, (n, 2))
    gap = np.hypot(*(xy[:, None] - np.random.default_rng(0).uniform(0, side, (plants, 2))).transpose(2, 0, 1)).min(1)
    xy = xy[(gap > 1.2) | (rng.random(n) < 1 / 12)]
    return np.column_stack([xy, surface(*xy.T) + rng.normal(0, noise, len(xy))])


def blocks_of(change: Change) -> np.ndarray:
    """Flat index of one cell of each block."""
    return np.unique(change.partition.block.ravel(), return_index=True)[1][int((change.partition.block < 0).any()) :]


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
        assert min(len(p) for p in block.points) >= LEAST_POINTS


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
            assert min(len(p) for p in parts) < LEAST_POINTS or not sound(*parts, half)
        checked += 1
    assert checked > 500


def test_cells_grow_until_the_target_or_the_largest_size(sparse):
    change = sparse[2]
    largest = np.isclose(change.partition.sizes, 1.6)
    assert np.all(change.level[change.valid & ~largest] <= 0.05)
    assert (change.level[largest] > 0.05).any()
    finer = difference(*sparse[:2], replace(GROWING, target_level=0.03))
    assert np.nanmedian(finer.level) < np.nanmedian(change.level)
    assert np.nanmean(finer.partition.sizes) > np.nanmean(change.partition.sizes)


def test_cells_do_not_grow_for_the_registrations_error():
    """No size of cell lowers that part of the level."""
    clouds = epoch(1), epoch(2)
    alone = difference(*clouds, GROWING)
    registered = difference(*clouds, GROWING, registration_error=0.05)
    assert np.nanmean(registered.partition.sizes) <= np.nanmean(alone.partition.sizes)
    assert np.nanmin(registered.error) > 0.05


def test_far_more_ground_is_compared_than_cells_of_one_size_could(sparse):
    first, second, change, _ = sparse
    index = [np.unique(cell_index(c, change.grid)) for c in (first, second)]
    assert len(np.intersect1d(*index)) < 0.2 * change.valid.size, "few cells have points of both"
    assert change.common_cell_rate < 0.2, "which tells how dense the surveys are, not what was compared"
    assert change.valid.sum() * 0.01 == pytest.approx(24.0**2, rel=0.03)


def test_a_steep_plane_sampled_at_different_places_shows_no_change():
    """The first epoch has the lower part of each square, the second the upper one: means differ by 0.3 m."""
    clouds = []
    for seed in (0, 1):
        rng = np.random.default_rng(seed)
        x, y = rng.uniform(0, 16, (2, 12_000))
        keep = rng.random(12_000) < np.where((x % 0.8 < 0.4) == (seed == 0), 0.5, 0.08)
        x, y = x[keep], y[keep]
        clouds.append(np.column_stack([x, y, 50 + 1.5 * x + rng.normal(0, 0.02, len(x))]))
    change = difference(*clouds, GROWING)
    coarse = [cell_statistics(c, snapped_grid((0, 0, 15.99, 15.99), 0.8)) for c in clouds]
    means = [cells.on_grid(cells.height) for cells in coarse]
    assert np.median(np.abs(means[1] - means[0])) > 0.25
    blocks = blocks_of(change)
    assert np.sqrt(np.mean(change.dz.ravel()[blocks] ** 2)) < 0.025
    assert change.significant.ravel()[blocks].mean() < 0.07
    assert np.nanmedian(change.slope) == pytest.approx(np.degrees(np.arctan(1.5)), abs=0.5)


@pytest.mark.parametrize("density", [4_000, 20_000])
@pytest.mark.parametrize("target", [0.03, 0.05])
def test_unchanged_sparse_ground_exceeds_the_level_as_often_as_promised(density, target):
    shares, errors = [], []
    for seed in range(4):
        first, second = epoch(10 + seed, n=density), epoch(20 + seed, n=density)
        change = difference(first, second, replace(GROWING, target_level=target))
        blocks = blocks_of(change)
        shares.append(change.significant.ravel()[blocks].mean())
        errors.append((change.dz / change.error).ravel()[blocks])
    assert 0.03 <= np.mean(shares) <= 0.07
    assert np.concatenate(errors).std() == pytest.approx(1.0, abs=0.1)


def test_same_input_same_bytes():
    clouds = epoch(1), epoch(2)
    one, two = (difference(*clouds, GROWING) for _ in range(2))
    for name in ("dz", "error", "partition.block", "partition.sizes", "height_to", "count_from"):
        assert attrgetter(name)(one).tobytes() == attrgetter(name)(two).tobytes()


def test_blocks_do_not_depend_on_the_extent_of_the_clouds():
    """Squares lie at multiples of their side: what is cut off in the west does not move those in the east."""
    clouds = epoch(1), epoch(2)
    whole = difference(*clouds, GROWING)
    part = difference(*(c[c[:, 0] > 5.03] for c in clouds), GROWING)
    columns = 100  # beyond the reach of what is pooled around
    assert np.allclose(part.partition.sizes[:, -columns:], whole.partition.sizes[:, -columns:], equal_nan=True)
    assert np.allclose(part.dz[:, -columns:], whole.dz[:, -columns:], equal_nan=True)


def test_cells_outside_of_the_clipped_area_stay_empty_and_lend_no_points():
    clouds = epoch(1), epoch(2)
    area = shapely.Point(12, 12).buffer(8)
    change = difference(*clouds, GROWING, areas=Areas(area))
    inside = cells_inside(area, change.grid)
    assert not change.valid[~inside].any()
    assert change.valid[inside].mean() > 0.95
    kept = [c[inside.ravel()[cell_index(c, change.grid)]] for c in clouds]
    alone = adaptive_cells(*kept, change.grid, GROWING, inside=inside)
    assert np.allclose(alone.dz[inside], change.dz[inside], equal_nan=True)


def test_cells_do_not_grow_out_of_the_survey():
    """A square turned by 30 degrees, dense and sparse: compared is what lies in it, but for a rim as points lie."""
    for density, rim in ((300, 0.1), (8, 0.5)):
        clouds = []
        for seed in (1, 2):
            rng = np.random.default_rng(seed)
            local = rng.uniform(0, 10, (100 * density, 2))
            x, y = 20 + local @ [0.866, -0.5], 20 + local @ [0.5, 0.866]
            clouds.append(np.column_stack([x, y, surface(x, y) + rng.normal(0, 0.01, len(x))]))
        outlines = shapely.intersection_all([shapely.convex_hull(shapely.multipoints(c[:, :2])) for c in clouds])
        change = difference(*clouds, GROWING)
        row, column = np.nonzero(change.valid)
        x = change.grid.west + (column + 0.5) * change.grid.cell
        y = change.grid.north - (row + 0.5) * change.grid.cell
        assert shapely.contains_xy(outlines.buffer(rim), x, y).all()
        assert change.valid.sum() * 0.01 == pytest.approx(outlines.area, rel=0.08)


def test_on_dense_ground_single_thin_cells_take_after_their_neighbours():
    """A step of 0.16 m on ground with few thin cells: a mean of them over metres would be that of both its sides."""
    clouds = []
    for seed in (1, 2):
        rng = np.random.default_rng(seed)
        x, y = rng.uniform(0, 16, (2, 256 * 700))
        raised = (seed == 2) & (np.abs(x - 8.03) < 0.6) & (np.abs(y - 8.03) < 0.6)
        clouds.append(np.column_stack([x, y, 50 + 0.5 * x + 0.16 * raised + rng.normal(0, 0.015, len(x))]))
    change = difference(*clouds, GROWING)
    grid = change.grid
    x = grid.west + (np.arange(grid.columns) + 0.5) * grid.cell
    y = grid.north - (np.arange(grid.rows) + 0.5) * grid.cell
    away = np.maximum(np.abs(x[None, :] - 8.03), np.abs(y[:, None] - 8.03)) - 0.6
    assert np.nanmax(change.partition.sizes[np.abs(away) > 0.3]) <= 0.4, (
        "no thin cell is joined with others far from it"
    )
    assert np.nanmean(change.dz[away < -0.05]) == pytest.approx(0.16, abs=0.006)
    assert np.nanmean(np.abs(change.dz[(away > 0.15) & (away < 1.5)])) < 0.01


def test_heights_of_a_grown_cell_follow_its_plane():
    rng = np.random.default_rng(0)
    clouds = []
    for lift in (0.0, 0.2):
        x, y = rng.uniform(0, 8, (2, 300))
        clouds.append(np.column_stack([x, y, 10 + 0.5 * x - 0.25 * y + lift + rng.normal(0, 1e-4, 300)]))
    change = difference(*clouds, GROWING)
    grid = change.grid
    x = grid.west + (np.arange(grid.columns) + 0.5) * grid.cell
    y = grid.north - (np.arange(grid.rows) + 0.5) * grid.cell
    plane = 10 + 0.5 * x[None, :] - 0.25 * y[:, None]
    assert np.nanmax(np.abs(change.height_from - plane)) < 1e-3
    assert np.nanmax(np.abs(change.height_to - plane - 0.2)) < 1e-3
    assert np.nanmax(np.abs(change.dz - 0.2)) < 1e-3


@pytest.mark.parametrize("values", [{"cell": 1.0, "largest_cell": 1.6}, {"cell": 0.5, "cell_value": "mean"}])
def test_cells_that_cannot_grow_have_one_size_and_it_is_said(values):
    class Told(Progress):
        def __init__(self):
            super().__init__()
            self.said = []

        def show(self, level, message):
            self.said.append((level, message))

    told = Told()
    change = difference(epoch(1), epoch(2), ChangeParameters(**values), progress=told)
    fixed = difference(epoch(1), epoch(2), ChangeParameters(**values, adaptive=False))
    assert not change.partition.grown
    assert np.array_equal(change.dz, fixed.dz, equal_nan=True)
    assert [level for level, message in told.said if "Cells have one size" in message] == ["info"]


def test_too_few_points_even_for_the_largest_cell_are_refused():
    points = np.array([[0.5, 0.5, 1.0], [5.5, 0.5, 1.0], [9.5, 9.5, 1.0]])
    with pytest.raises(InputError, match="largest_cell"):
        difference(points, points + [0.0, 0.0, 3.0], GROWING)


def test_the_memory_that_growing_cells_take_counts():
    """Where growing cells still fit, cells of one size are refused with a cell that fits, and the other way round."""
    first = epoch(1)
    wide = np.vstack([first, first + [400.0, 400.0, 0.0]])
    common_grid(wide, wide, ChangeParameters(adaptive=True, memory_limit=4.0, cell=0.1))
    for adaptive, limit in ((False, 4.0), (True, 2.0)):
        with pytest.raises(InputError, match="cell of at least") as refusal:
            common_grid(wide, wide, ChangeParameters(adaptive=adaptive, memory_limit=limit, cell=0.1))
        fits = float(str(refusal.value).split("at least ")[1].split(" m")[0])
        common_grid(wide, wide, ChangeParameters(adaptive=adaptive, memory_limit=limit, cell=fits))


def test_a_known_change_under_simulated_plants_is_recovered():
    """Three changes of up to 0.3 m under plants on 80 % of the slope, 16 ground points a square metre."""
    pair = simulate_pair(SurveyParameters(seed=3, points=60_000, length=30, height=12, vegetation=0.8, offset=0.0))
    clouds = [
        cloud.xyz[cloud.truth_ground == 1] if number == 0 else pair.transform.apply(cloud.xyz[cloud.truth_ground == 1])
        for number, cloud in enumerate((pair.first, pair.second))
    ]
    area = shapely.Polygon(pair.roi)
    change = difference(*clouds, GROWING, areas=Areas(area))
    unseen = [np.bincount(cell_index(c, change.grid), minlength=change.valid.size) == 0 for c in clouds]
    truth = pair.true_change_raster(change.grid)
    moved = (np.abs(truth) > 0.1) & cells_inside(area, change.grid)
    right = change.significant & (np.sign(change.dz) == np.sign(truth))
    assert (right & moved).sum() > 0.9 * moved.sum()
    assert (moved.ravel() & (unseen[0] | unseen[1])).sum() > 0.7 * moved.sum(), "a fixed grid sees less than a third"
    # a block shows the mean of what its cells moved
    blocks = np.unique(change.partition.block[moved & change.valid])
    cells = change.valid
    number = change.partition.block[cells]
    mean_truth = np.bincount(number, truth[cells]) / np.bincount(number)
    measured = np.bincount(number, change.dz[cells]) / np.bincount(number)
    assert np.sqrt(np.mean((measured - mean_truth)[blocks] ** 2)) < 0.04
    assert abs(np.mean((measured - mean_truth)[blocks])) < 0.01
    still = np.flatnonzero(np.bincount(number, np.abs(truth[cells])) == 0)
    still = np.intersect1d(still, number)
    beyond = np.abs(measured) > 1.96 * (np.bincount(number, change.error[cells]) / np.bincount(number).clip(1))
    assert 0.03 <= beyond[still].mean() <= 0.07


def test_a_clear_change_is_not_blurred_and_unchanged_ground_keeps_its_points(monkeypatch):
    """A step of half a metre where cells have three to five points: a block of 0.2 m across its edge is far off."""
    rng = np.random.default_rng(11)

    def heights(xy, step):
        return 0.5 * xy[:, 0] + step * (np.hypot(*(xy - 6.0).T) < 2.0) + rng.normal(0, 0.01, len(xy))

    clouds = []
    for step in (0.0, 0.5):
        xy = rng.uniform(0, 12, (60_000, 2))
        clouds.append(np.column_stack([xy, heights(xy, step)]))
    grid = difference(*clouds, GROWING).grid
    x, y = grid.west + (np.arange(grid.columns) + 0.5) * 0.1, grid.north - (np.arange(grid.rows) + 0.5) * 0.1
    away = np.hypot(*(np.stack(np.meshgrid(x, y), axis=-1) - 6.0).transpose(2, 0, 1)) - 2.0
    rim = np.abs(away) < 0.15
    inner = (away > -0.15) & (away < -0.075)  # cells that the step covers whole

    def short_by(change):
        return 0.5 - np.nanmean(change.dz[inner])

    fine = difference(*clouds, GROWING)
    few = np.minimum(fine.count_from, fine.count_to)[fine.valid & (fine.partition.sizes < 0.15)]
    assert few.min() == 3
    unchanged = fine.valid & (away > 0.3)
    assert np.minimum(fine.count_from, fine.count_to)[unchanged].min() >= LEAST_POINTS
    monkeypatch.setattr("slopewatch.engine.grid.grown_cells.CLEAR", 0.0)
    blurred = difference(*clouds, GROWING)
    assert np.nanmean(fine.partition.sizes[rim]) < 0.9 * np.nanmean(blurred.partition.sizes[rim])
    assert short_by(fine) < 0.8 * short_by(blurred)
    np.testing.assert_allclose(fine.partition.sizes[unchanged], blurred.partition.sizes[unchanged])


def test_work_in_parts_is_that_on_the_whole(monkeypatch):
    """A slope turned against north, in parts of 6.4 m: the same blocks, and change to the last digits."""
    clouds = []
    for seed in (1, 2):
        points = epoch(seed)
        turned = (points[:, :2] * [2.0, 0.4]) @ np.array([[0.8, 0.6], [-0.6, 0.8]])
        clouds.append(np.column_stack([turned, points[:, 2] - 0.2 * (np.hypot(*(turned - [15, 15]).T) < 2)]))
    cover = PlantCover(np.linspace(0, 0.05, len(clouds[0])), np.linspace(0, 1, len(clouds[0])))
    grid = common_grid(*clouds, GROWING)
    area = shapely.box(*grid.bounds).buffer(-1.0)
    options = {"plants": (cover, None), "inside": cells_inside(area, grid)}
    whole = adaptive_cells(*clouds, grid, GROWING, **options)
    monkeypatch.setattr("slopewatch.engine.grid.growing_cells._AT_ONCE", 1)
    monkeypatch.setattr("slopewatch.engine.grid.growing_cells._TILE", 64)
    grown: list[tuple[int, int]] = []

    def grow(moments, *others):
        grown.append(moments[0].shape)
        return grown_cells.grow(moments, *others)

    monkeypatch.setattr("slopewatch.engine.grid.growing_cells.grow", grow)
    parts = adaptive_cells(*clouds, grid, GROWING, **options)
    assert np.array_equal(parts.partition.block, whole.partition.block)
    assert whole.partition.block.max() > 1000
    for name in ("dz", "sampling", "height_from", "height_to", "slope", "partition.sizes", "count_from", "count_to"):
        values = [attrgetter(name)(cells) for cells in (parts, whole)]
        assert np.allclose(*values, rtol=1e-9, atol=1e-9, equal_nan=True), name
    assert np.array_equal(parts.points[0], whole.points[0])
    assert np.allclose(parts.plants.error_from, whole.plants.error_from, equal_nan=True)
    # parts without points of both surveys are left out
    tiles = -(-grid.rows // 64) * -(-grid.columns // 64)
    assert 5 < len(grown) < 0.8 * tiles
    assert max(max(shape) for shape in grown) <= 64 + 2 * 64
