"""Cells that grow: how much is compared, how well, and where they do not grow."""

from __future__ import annotations

from dataclasses import replace
from operator import attrgetter

import numpy as np
import pytest
import shapely
from slopewatch.engine.change.difference import Areas, cells_inside, difference
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.grid import grown_cells
from slopewatch.engine.grid.cell_statistics import cell_statistics
from slopewatch.engine.grid.chosen_cell import MIN_POINTS
from slopewatch.engine.grid.common_grid import common_grid
from slopewatch.engine.grid.grid import cell_index, snapped_grid
from slopewatch.engine.grid.growing_cells import adaptive_cells
from slopewatch.engine.pointcloud.plant_cover import PlantCover
from slopewatch.interface.parameters import ChangeParameters, SurveyParameters
from slopewatch.simulation.surveys.survey import simulate_pair
from slopewatch.tests.builders.sparse_ground import GROWING, blocks_of, epoch, surface


def test_cells_do_not_grow_for_the_registrations_error():
    """No size of cell lowers that part of the level."""
    clouds = epoch(1), epoch(2)
    alone = difference(*clouds, GROWING)
    registered = difference(*clouds, GROWING, registration_error=0.05)
    assert np.nanmean(registered.partition.sizes) <= np.nanmean(alone.partition.sizes)
    assert np.nanmin(registered.error) > 0.05


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
    alone_dz = alone.partition.layout.on_grid(alone.dz)
    assert np.allclose(alone_dz[inside], change.dz[inside], equal_nan=True)


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


def test_a_step_keeps_its_volume_though_its_edge_divides_cells():
    """Slabs of 2 m: cells on the edge used to get the mean of a square of 1.6 m, and 5 % of the volume was lost."""
    shares = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        middle = 4.0 + rng.uniform(-0.2, 0.2, 2)
        first, second = (np.column_stack([rng.uniform(0, 8, (9_600, 2)), rng.normal(0, 0.02, 9_600)]) for _ in range(2))
        second[(np.abs(second[:, :2] - middle) <= 1.0).all(axis=1), 2] += 0.5
        change = difference(first, second, GROWING)
        row, column = np.indices(change.grid.shape)
        east, north = change.grid.west + (column + 0.5) * 0.1, change.grid.north - (row + 0.5) * 0.1
        near = (np.abs(east - middle[0]) < 1.8) & (np.abs(north - middle[1]) < 1.8)
        shares.append(np.nansum(change.dz[near]) * 0.1**2 / (0.5 * 4.0))
    assert np.mean(shares) == pytest.approx(1.0, abs=0.02)
    assert np.std(shares) < 0.03


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
    for adaptive, limit in ((False, 4.0), (True, 0.65)):
        with pytest.raises(InputError, match="cell of at least") as refusal:
            common_grid(wide, wide, ChangeParameters(adaptive=adaptive, memory_limit=limit, cell=0.1))
        fits = float(str(refusal.value).split("at least ")[1].split(" m")[0])
        common_grid(wide, wide, ChangeParameters(adaptive=adaptive, memory_limit=limit, cell=fits))


@pytest.mark.slow
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
    assert np.minimum(fine.count_from, fine.count_to)[unchanged].min() >= MIN_POINTS
    monkeypatch.setattr("slopewatch.engine.grid.grown_cells.MAX_CLEAR_LEVEL_SHARE", 0.0)
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
    monkeypatch.setattr("slopewatch.engine.grid.tiled_points._AT_ONCE", 1)
    monkeypatch.setattr("slopewatch.engine.grid.tiled_points._TILE", 64)
    grown: list[tuple[int, int]] = []

    def grow(moments, *others):
        grown.append(moments[0].shape)
        return grown_cells.grow(moments, *others)

    monkeypatch.setattr("slopewatch.engine.grid.growing_cells.grow", grow)
    parts = adaptive_cells(*clouds, grid, GROWING, **options)
    assert np.array_equal(parts.partition.listed, whole.partition.listed)
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
