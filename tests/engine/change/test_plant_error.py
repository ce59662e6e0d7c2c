"""The error that plants make: in cells, beside the calibration, in stable ground and in volumes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slopewatch.engine.change.difference import difference, uniform_shift
from slopewatch.engine.change.judgement import judge
from slopewatch.engine.change.measured import Measured
from slopewatch.engine.change.size_calibration import widening_by_size
from slopewatch.engine.change.slope_calibration import Samples, calibrate
from slopewatch.engine.change.stable_cells import find_stable
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.grid.common_grid import common_grid
from slopewatch.engine.grid.grid import Grid, snapped_grid
from slopewatch.engine.grid.plant_cells import PlantCells, cell_means, together
from slopewatch.engine.pointcloud.plant_cover import PlantCover
from slopewatch.engine.statistics.normal import quantile
from slopewatch.engine.statistics.variogram import VariogramModel
from slopewatch.engine.zones.footprints import Cells, outline_footprints
from slopewatch.engine.zones.groups import label_groups
from slopewatch.engine.zones.volumes import CorrelationModel, fit_correlation, zone_volumes
from slopewatch.interface.parameters import ChangeParameters, ZoneParameters
from slopewatch.tests.builders.change_zones import single, zones_of

SHAPE = (160, 240)
ONE_SIZE = ChangeParameters(cell=0.5, adaptive=False)
SAMPLING, PLANTS = 0.01, 0.03


def patches(rng: np.random.Generator, shape: tuple[int, int], side: int) -> np.ndarray:
    """One number of variance 1 for each square of ``side`` cells: what neighbours share."""
    rows, columns = (-(-n // side) for n in shape)
    whole = np.kron(rng.normal(size=(rows, columns)), np.ones((side, side)))
    return whole[: shape[0], : shape[1]]


def slope_with_grass(seed: int, *, covered: float = 0.5, factor: float = 1.0, side: int = 5) -> tuple[np.ndarray, ...]:
    """Unchanged cells: dz, sampling error, slope, error by plants. ``covered`` of them have grass, in the east.

    Args:
        factor: by which the sampling errors are too small.
        side: of the squares, in cells, that share what plants do to them.
    """
    rng = np.random.default_rng(seed)
    column = np.broadcast_to(np.arange(SHAPE[1]), SHAPE)
    plants = np.where(column >= (1 - covered) * SHAPE[1], PLANTS, 0.0)
    sampling = rng.uniform(0.5, 1.5, SHAPE) * SAMPLING
    dz = factor * sampling * rng.normal(size=SHAPE) + plants * patches(rng, SHAPE, side)
    return dz, sampling, rng.uniform(10, 40, SHAPE), plants


def judged(seed: int, *, told: bool = True, stated: float = 1.0, **options):
    dz, sampling, slope, plants = slope_with_grass(seed, **options)
    cells = PlantCells(np.zeros(SHAPE), stated * plants) if told else None
    measured = Measured(dz, sampling, slope, single(dz, 0.5), cells)
    return judge(measured, ONE_SIZE, registration_error=0.0), plants > 0


@pytest.mark.parametrize("covered", [0.2, 0.5, 0.8, 1.0])
@pytest.mark.parametrize("factor", [0.8, 1.5])
def test_honest_plants_leave_5_percent_of_unchanged_cells_beyond_their_level(covered, factor):
    """And where scanners err more, or less, than their points' scatter tells."""
    shares = []
    for seed in range(4):
        found, grass = judged(seed, covered=covered, factor=factor)
        beyond = found.decision.significant
        shares.append((beyond.mean(), beyond[grass].mean(), beyond[~grass].mean() if covered < 1 else 0.05))
    every, on_grass, on_bare = np.mean(shares, axis=0)
    assert 0.03 <= every <= 0.07
    assert 0.03 <= on_grass <= 0.07
    assert 0.03 <= on_bare <= 0.07


def test_without_the_term_bare_ground_pays_for_the_grass_or_the_grass_for_nothing():
    found, grass = judged(1, told=False)
    beyond = found.decision.significant
    assert beyond[grass].mean() > 0.2 or beyond[~grass].mean() < 0.01


@pytest.mark.parametrize("stated", [0.3, 3.0])
def test_plants_that_are_stated_wrongly_do_not_spoil_the_calibration_of_bare_ground(stated):
    honest, grass = judged(2, factor=1.3)
    wrong, _ = judged(2, factor=1.3, stated=stated)
    assert np.median(wrong.error[~grass]) == pytest.approx(np.median(honest.error[~grass]), rel=0.05)
    assert wrong.model.typical == pytest.approx(1.3, rel=0.07)


def test_where_all_is_covered_overstated_plants_do_not_narrow_the_points_error():
    dz, sampling, slope, plants = slope_with_grass(3, covered=1.0)
    everywhere = np.ones(SHAPE, dtype=bool)
    samples = Samples(dz, sampling, slope, everywhere, 3 * plants)
    model = calibrate(samples, registration_error=0.0, confidence=0.95)
    assert model.typical == 1.0
    assert model.classes
    assert all(c.factor == 1.0 for c in model.classes)


def test_few_bare_cells_without_any_plants_calibrate_as_ever():
    dz, sampling, slope, _ = slope_with_grass(4, covered=0.0)
    few = np.zeros(SHAPE, dtype=bool)
    few[:10, :12] = True
    samples = Samples(0.7 * dz, sampling, slope, few)
    plain = calibrate(samples, registration_error=0.0, confidence=0.95)
    told = calibrate(replace(samples, plants=np.zeros(dz.shape)), registration_error=0.0, confidence=0.95)
    assert plain == told
    assert plain.typical < 1.0


def test_the_widening_by_size_leaves_the_plants_out():
    dz, sampling, slope, plants = slope_with_grass(5, covered=1.0)
    stable = np.ones(SHAPE, dtype=bool)
    common = {"registration_error": 0.0, "confidence": 0.95}
    measured = Measured(dz, sampling, slope, single(dz, 0.8))
    without = widening_by_size(measured, stable, **common)
    told = widening_by_size(replace(measured, plants=PlantCells(0 * plants, plants)), stable, **common)
    assert without.max() == 3.0
    assert told.max() < 1.5


def test_grass_that_shares_its_error_is_no_moved_ground():
    dz, sampling, slope, plants = slope_with_grass(6, covered=0.4)
    dz = dz.copy()
    dz[20:60, 10:60] -= 0.05  # bare ground that did move
    grass = plants > 0
    alone, told = (find_stable(dz, sampling, slope, single(dz, 0.5), alike) for alike in (None, plants))
    assert told[grass].mean() > 0.9
    assert alone[grass].mean() < 0.5
    assert told[22:58, 12:58].mean() < 0.02


def test_patches_of_grass_beyond_their_level_are_no_zones_but_a_slump_is():
    """1,536 patches of 2.5 m on unchanged ground, of which 5 % are beyond their level as a whole; and a slump."""
    found, _ = judged(14, covered=1.0)
    dz, significant = found.dz.copy(), found.decision.significant.copy()
    dz[60:80, 100:120] -= 0.3
    significant[60:80, 100:120] = True
    grid = Grid(0.0, 0.0, 0.5, *SHAPE)
    assert found.plants is not None
    alone = single(dz, 0.5)
    every = label_groups(dz, significant, ZoneParameters(), alone).max()
    labels = label_groups(dz, significant, ZoneParameters(), alone, plants=found.plants.error)
    assert every > 60
    assert labels.max() <= 10, "one in 370, and the slump"
    assert labels[70, 110] > 0
    parameters, args = ZoneParameters(minimum_confidence=0.0), (found.decision.level, found.error, np.full(SHAPE, 9))
    zones = [
        zones_of(dz, significant, *args, grid, None, parameters, plants=error) for error in (None, found.plants.error)
    ]
    within, none = (int((found.unsure["reason"] == "vegetation").sum()) for found in reversed(zones))
    assert within == every - labels.max() == len(zones[0].frame) - len(zones[1].frame)
    assert none == 0


def flat(seed: int, points: int = 30_000, side: float = 20.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, side, (2, points))
    return np.column_stack([x, y, 0.3 * x + rng.normal(0, 0.01, points)])


@pytest.mark.parametrize("adaptive", [False, True])
def test_both_epochs_add_in_quadrature_and_do_not_average_out(adaptive):
    first, second = flat(1), flat(2)
    parameters = ChangeParameters(cell=0.5 if not adaptive else 0.1, adaptive=adaptive, calibrate=False)
    grass = [c[:, 0] > 10 for c in (first, second)]
    covers = [
        PlantCover(np.where(g, e, 0.0).astype(np.float32), np.where(g, 0.2, 0.0)) for g, e in zip(grass, (0.03, 0.04))
    ]
    told = difference(first, second, parameters, plants=(covers[0], covers[1]))
    east = np.broadcast_to(told.grid.west + (np.arange(told.grid.columns) + 0.5) * told.grid.cell, told.grid.shape)
    inside, outside = told.valid & (east > 11.6), told.valid & (east < 8.4)
    assert told.plants is not None
    assert np.allclose(told.plants.error[inside], 0.05, atol=1e-6)
    assert np.all(told.plants.error[outside] == 0.0)
    assert np.allclose(told.error[inside] ** 2, told.sampling[inside] ** 2 + 0.05**2)
    assert told.level[inside].min() >= 1.96 * 0.05 * 0.999
    one = difference(first, second, parameters, plants=(covers[0], None))
    assert np.allclose(one.plants.error[one.valid & (east > 11.6)], 0.03, atol=1e-6)
    assert one.season is None
    if not adaptive:
        plain = difference(first, second, parameters)
        assert plain.plants is None
        assert np.allclose(told.error[outside], plain.error[outside])


def test_cells_do_not_grow_for_plants_that_no_size_averages_out():
    """Thin ground under plants: a larger cell lowers the points' part only, so there is an end to it."""
    first, second = flat(3, points=8_000), flat(4, points=8_000)
    sizes = []
    for error in (0.0, 0.06):
        cover = PlantCover(np.full(len(first), error)), PlantCover(np.full(len(second), error))
        change = difference(first, second, ChangeParameters(target_level=0.01), plants=cover)
        sizes.append(change.partition.side.mean())
    assert sizes[1] < 0.8 * sizes[0]


def test_the_direction_of_the_normal_takes_the_plants_along():
    first, second = flat(5), flat(6)
    cover = PlantCover(np.full(len(first), 0.05))
    change = difference(first, second, replace(ONE_SIZE, direction="normal", calibrate=False), plants=(cover, None))
    assert np.nanmedian(change.plants.error) == pytest.approx(0.05 * np.cos(np.arctan(0.3)), rel=0.01)


def test_the_memory_that_plants_take_is_asked_for():
    first, second = flat(12, points=2000, side=27.4), flat(13, points=2000, side=27.4)
    parameters = ChangeParameters(cell=0.05, memory_limit=0.09, adaptive=False)
    common_grid(first, second, parameters)
    with pytest.raises(InputError, match="more than the"):
        common_grid(first, second, parameters, plants=True)


def test_what_is_no_number_counts_as_bare():
    cover = PlantCover(np.array([0.1, np.nan, -1.0, np.inf]), np.array([np.nan, 0.2, 0.2, 0.2]))
    assert cover.error.tolist() == [0.1, 0.0, 0.0, 0.0]
    assert cover.height is not None
    assert cover.height.tolist() == [0.0, 0.2, 0.2, 0.2]


def test_means_of_cells():
    xyz = np.array([[0.5, 0.5, 9.0], [0.6, 0.5, 9.0], [2.5, 0.5, 9.0], [9.0, 9.0, 9.0]])
    grid = snapped_grid((0.0, 0.0, 2.9, 0.9), 1.0)
    means = cell_means(xyz, np.array([0.02, 0.04, 0.1, 7.0]), grid)
    assert np.allclose(means, [[0.03, np.nan, 0.1]], equal_nan=True)
    assert together((None, None), (None, None)) is None


def test_a_uniform_change_within_the_plants_error_is_no_bias():
    rng = np.random.default_rng(7)
    xyz = flat(8), flat(9)
    lowered = xyz[1] - [0.0, 0.0, 0.05]
    cover = PlantCover(np.full(len(xyz[0]), 0.05))
    assert difference(xyz[0], lowered, ONE_SIZE).uniform_dz == pytest.approx(-0.05, abs=0.002)
    assert difference(xyz[0], lowered, ONE_SIZE, plants=(cover, cover)).uniform_dz is None
    assert uniform_shift(rng.normal(-0.05, 0.01, 1000), np.full(1000, 0.02)) is not None


def covered_cells(side: int, plants: float) -> Cells:
    shape = (side + 40, side + 40)
    dz = np.zeros(shape)
    dz[20:-20, 20:-20] = -0.3
    error = np.full(shape, np.hypot(SAMPLING, plants))
    return Cells(dz, error, np.full(shape, 0.01), single(dz, 0.1), plants=np.full(shape, plants))


@pytest.mark.parametrize("side", [10, 40])
def test_a_volume_takes_the_plants_in_full_however_large_it_is(side):
    model = CorrelationModel(0.0, VariogramModel(1.0))
    labels = (covered_cells(side, PLANTS).dz < 0).astype(np.int32)
    errors = []
    for plants in (0.0, PLANTS):
        cells = covered_cells(side, plants)
        found = zone_volumes(outline_footprints(cells, labels, 1, gap=0.5), cells, model)
        errors.append((found.error[0] / found.area[0], found.mean_error[0]))
    points_only, with_plants = errors
    assert points_only[1] == pytest.approx(SAMPLING / side, rel=1e-6)
    assert with_plants[1] == pytest.approx(np.hypot(SAMPLING / side, PLANTS), rel=1e-6)
    assert with_plants[0] == pytest.approx(PLANTS, rel=0.02)


def test_plants_of_cells_of_either_sign_do_not_cancel():
    cells = covered_cells(10, PLANTS)
    weights = np.zeros(cells.dz.shape)
    weights[20:25, 20:30], weights[25:30, 20:30] = 1.0, -1.0
    model = CorrelationModel(0.0, VariogramModel(1.0))
    assert model.sum_error(weights, cells) == pytest.approx(np.hypot(10 * SAMPLING, 100 * PLANTS), rel=1e-6)


def test_the_variogram_is_that_of_the_points():
    """Patches of 2.5 m that plants make do not become a correlation of the sampling errors."""
    dz, sampling, _, plants = slope_with_grass(10, covered=0.5, side=25)
    cells = Cells(dz, np.hypot(sampling, plants), np.full(SHAPE, 0.01), single(dz, 0.1))
    stable = np.ones(SHAPE, dtype=bool)
    told = fit_correlation(replace(cells, plants=plants), stable, 0.0)
    untold = fit_correlation(cells, stable, 0.0)
    assert told.variogram is not None
    assert untold.variogram is not None
    assert sum(told.variogram.sills) < 0.1 * told.variogram.variance
    assert sum(untold.variogram.sills) > 0.3 * untold.variogram.variance


def test_a_footprint_does_not_grow_into_grass_whose_change_is_within_its_error():
    cells = covered_cells(20, PLANTS)
    spread = np.where(cells.dz < 0, cells.dz, -0.8 * PLANTS)
    labels = (cells.dz < 0).astype(np.int32)
    areas = [
        zone_volumes(
            outline_footprints(grown, labels, 1, gap=0.5), grown, CorrelationModel(0.0, VariogramModel(1.0))
        ).area[0]
        for grown in (replace(cells, dz=spread), replace(cells, dz=spread, plants=None))
    ]
    assert areas[0] < 0.8 * areas[1]


def test_the_level_is_the_quantile_of_all_parts():
    found, _ = judged(11)
    assert np.allclose(found.decision.level, quantile(0.95) * found.error)
