"""The factor of the errors by plants that stable ground tells: surveys of one season, of two, and too little of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slopewatch.engine.change.judgement import judge
from slopewatch.engine.change.measured import Measured
from slopewatch.engine.change.plant_calibration import (
    common_share,
    plants_factor,
    squares_of,
    sum_by_plants,
)
from slopewatch.engine.grid.partition import Partition
from slopewatch.engine.grid.plant_cells import PlantCells
from slopewatch.engine.statistics.layout import layout_of
from slopewatch.engine.statistics.variogram import VariogramModel
from slopewatch.engine.zones.footprints import Cells
from slopewatch.engine.zones.volumes import CorrelationModel, fit_correlation
from slopewatch.interface.parameters import ChangeParameters

SHAPE, CELL, SIDE = (160, 240), 0.5, 4
SAMPLING, PLANTS = 0.01, 0.04


def covered(seed: int, error: float = PLANTS, shape: tuple[int, int] = SHAPE) -> np.ndarray:
    """Change (rows, columns) of unchanged ground under grass whose real ``error`` (m) squares of 2 m share."""
    rng = np.random.default_rng(seed)
    rows, columns = (-(-n // SIDE) for n in shape)
    shared = np.kron(rng.normal(size=(rows, columns)), np.ones((SIDE, SIDE)))[: shape[0], : shape[1]]
    return SAMPLING * rng.normal(size=shape) + error * shared


def told(dz: np.ndarray, stable: np.ndarray | None = None, stated: float = PLANTS, **options: float) -> float:
    every = np.ones(dz.shape, dtype=bool)
    arguments = {"registration_error": 0.0, "confidence": 0.95} | options
    sampling, plants = np.full(dz.shape, SAMPLING), np.full(dz.shape, stated)
    return plants_factor(
        dz, sampling, plants, every if stable is None else stable, squares_of(layout_of(dz), CELL), **arguments
    )


@pytest.mark.parametrize("real", [0.02, 0.025, 0.03, 0.035])
def test_the_factor_is_that_of_the_real_errors_to_the_stated_ones(real):
    found = [told(covered(seed, real)) for seed in range(6)]
    assert np.mean(found) == pytest.approx(real / PLANTS, rel=0.1)
    assert min(found) >= 0.95 * real / PLANTS


def test_it_stays_within_what_can_be_believed():
    assert told(covered(1, 0.0)) < 0.1
    assert told(0.5 * covered(1, 0.0)) == 0.0, "the points' error is larger than all that differs"
    assert told(covered(1, 0.3)) == 1.0


def test_a_small_patch_of_grass_tells_nothing_and_few_tell_with_care():
    dz = covered(2, 0.02)
    small, few = (np.zeros(SHAPE, dtype=bool) for _ in range(2))
    small[: 4 * SIDE, : 4 * SIDE] = True  # 16 squares
    few[: 5 * SIDE, : 5 * SIDE] = True
    assert told(dz, small) == 1.0
    assert told(dz) < 0.6
    some = np.mean([told(covered(seed, 0.02), few) for seed in range(30)])
    assert 0.55 < some < 0.8, "wider than the half that it would be with many"


def test_errors_that_cells_of_a_square_do_not_share_need_less_care():
    """Of grass all over, the error of 30 squares: alike in each, or every cell's own."""
    few = np.zeros(SHAPE, dtype=bool)
    few[: 5 * SIDE, : 6 * SIDE] = True
    real = np.hypot(0.02, SAMPLING)
    alike = np.mean([told(covered(seed, 0.02), few) for seed in range(30)])
    own = [np.random.default_rng(seed).normal(scale=real, size=SHAPE) for seed in range(30)]
    factors = [told(dz, few) for dz in own]
    assert np.mean(factors) == pytest.approx(0.5, abs=0.05)
    assert np.mean(factors) < alike
    levels = [1.96 * np.hypot(SAMPLING, factor * PLANTS) for factor in factors]
    assert 0.03 <= np.mean([np.abs(dz[few]) > level for dz, level in zip(own, levels, strict=True)]) <= 0.05


def test_only_cells_count_in_which_plants_decide():
    dz = covered(4, 0.02)
    dz[:, 120:] = 0.5
    plants = np.full(SHAPE, PLANTS)
    plants[:, 120:] = 0.009
    every, sampling = np.ones(SHAPE, dtype=bool), np.full(SHAPE, SAMPLING)
    found = plants_factor(
        dz, sampling, plants, every, squares_of(layout_of(dz), CELL), registration_error=0.0, confidence=0.95
    )
    assert found == pytest.approx(0.53, abs=0.06)


def test_the_registrations_part_is_not_counted_twice():
    dz = covered(5, 0.02) + 0.03
    assert told(dz) > told(dz, registration_error=0.03) > 0.0


def judged(real: float, stated: float, **options: float):
    """An unchanged slope with grass in the east, whose errors by plants are ``real`` and told as ``stated``."""
    dz = covered(6, real)
    grass = np.broadcast_to(np.arange(SHAPE[1]) >= 100, SHAPE)
    bare = SAMPLING * np.random.default_rng(7).normal(size=SHAPE)
    plants = PlantCells(np.where(grass, stated * 0.6, 0.0), np.where(grass, stated * 0.8, 0.0))
    slope, partition = np.full(SHAPE, 30.0), Partition(SHAPE, CELL)
    measured = Measured(np.where(grass, dz, bare), np.full(SHAPE, SAMPLING), slope, partition, plants)
    return judge(measured, ChangeParameters(cell=CELL, adaptive=False, **options), registration_error=0.0), grass


@pytest.mark.parametrize(("real", "stated"), [(0.03, 0.055), (0.03, 0.04), (0.04, 0.04)])
def test_errors_stated_too_large_leave_5_percent_beyond(real, stated):
    found, grass = judged(real, stated)
    beyond = found.decision.significant
    assert 0.03 <= beyond[grass].mean() <= 0.07
    assert 0.03 <= beyond[~grass].mean() <= 0.07
    assert found.plants_factor == pytest.approx(real / stated, rel=0.15)
    assert found.plants_factor <= 1.0
    assert found.plants is not None
    assert np.median(found.plants.error[grass]) == pytest.approx(found.plants_factor * stated)
    assert np.median(found.plants.error_from[grass]) == pytest.approx(found.plants_factor * 0.6 * stated)


@pytest.mark.parametrize("points", [0.5, 0.7])
def test_points_errors_stated_too_large_leave_5_percent_beyond_where_vegetation_errs_alike(points):
    """All is covered, so that the points' errors are first taken as they are."""
    rng = np.random.default_rng(9)
    partition, slope = Partition(SHAPE, CELL), np.full(SHAPE, 30.0)
    plants = PlantCells(np.full(SHAPE, PLANTS), np.full(SHAPE, PLANTS))
    dz, sampling = SAMPLING * rng.normal(size=SHAPE), np.full(SHAPE, SAMPLING / points)
    measured = Measured(dz, sampling, slope, partition, plants)
    found = judge(measured, ChangeParameters(cell=CELL, adaptive=False), registration_error=0.0)
    assert found.plants_factor == 0.0
    assert found.model.typical == pytest.approx(points, rel=0.05)
    assert 0.03 <= found.decision.significant.mean() <= 0.07


def test_without_calibration_the_stated_errors_stay():
    found, grass = judged(0.03, 0.05, calibrate=False)
    assert found.plants_factor == 1.0
    assert found.decision.significant[grass].mean() < 0.01


@pytest.mark.parametrize(("real", "moved"), [(0.02, 0.3), (0.01, 0.15), (0.008, 0.12)])
def test_ground_that_moved_under_grass_does_not_widen_the_rest(real, moved):
    """Also ground that moved by three to four times the stated error, of which a quarter is left in the difference."""
    dz = covered(8, real)
    rested = told(dz)
    dz[40:80, 60:150] -= moved
    plants = PlantCells(np.zeros(SHAPE), np.full(SHAPE, PLANTS))
    parameters = ChangeParameters(cell=CELL, adaptive=False)
    slope, sampling = np.full(SHAPE, 30.0), np.full(SHAPE, SAMPLING)
    measured = Measured(dz, sampling, slope, Partition(SHAPE, CELL), plants)
    found = judge(measured, parameters, registration_error=0.0)
    assert found.plants_factor < 1.3 * rested
    assert found.decision.significant[42:78, 62:148].mean() > 0.99


def share_of(dz: np.ndarray, stable: np.ndarray | None = None) -> float:
    every = np.ones(dz.shape, dtype=bool)
    parts = np.full(dz.shape, SAMPLING), np.full(dz.shape, PLANTS)
    return common_share(dz, *parts, every if stable is None else stable, CELL)


def test_a_season_is_common_and_what_differs_from_place_to_place_is_not():
    for seed in range(5):
        assert share_of(covered(seed)) < 0.12, "2400 squares, each with its own error"
        assert share_of(covered(seed, 0.01) - 0.5 * PLANTS) == pytest.approx(0.5, abs=0.03)
    assert share_of(covered(1) + 2 * PLANTS) == 1.0
    few = np.zeros(SHAPE, dtype=bool)
    few[: 4 * SIDE, : 4 * SIDE] = True
    assert share_of(covered(1), few) == 1.0, "16 squares tell nothing"


@pytest.mark.parametrize("season", [0.0, 0.3, 1.0])
def test_intervals_of_a_net_volume_under_plants_hold_the_truth(season):
    shape, runs = (60, 60), 200
    plants = np.full(shape, PLANTS)
    error = np.full(shape, np.hypot(SAMPLING, PLANTS))
    held, told_errors = 0, []
    for seed in range(runs):
        drawn = np.random.default_rng([seed, 7]).normal()
        dz = covered(seed, shape=shape) + season * PLANTS * drawn
        cells = Cells(dz, error, np.full(shape, CELL**2), Partition(shape, CELL), plants=plants)
        model = CorrelationModel(0.0, VariogramModel(1.0), plants_in_common=share_of(dz))
        told_errors.append(model.whole_error(cells.area, cells))
        held += abs(dz.sum() * CELL**2) <= 1.96 * told_errors[-1]
    assert held / runs >= 0.9
    if season == 0:
        assert np.median(told_errors) < 0.15 * PLANTS * shape[0] * shape[1] * CELL**2


def test_the_model_takes_the_share_from_stable_ground_and_from_what_plants_explain():
    dz = covered(3)
    dz[:, 120:] -= 10 * PLANTS
    left = np.zeros(SHAPE, dtype=bool)
    left[:, :120] = True
    parts = np.full(SHAPE, np.hypot(SAMPLING, PLANTS)), np.full(SHAPE, CELL**2)
    cells = Cells(dz, *parts, Partition(SHAPE, CELL), np.full(SHAPE, PLANTS), np.zeros(SHAPE, dtype=bool))
    assert fit_correlation(cells, left, 0.0).plants_in_common == pytest.approx(share_of(dz, left))
    mown = replace(cells, plant_like=~left)
    assert fit_correlation(mown, left, 0.0).plants_in_common == 1.0, "the mown half tells of the season"


def test_what_plants_make_of_a_sum_lies_between_its_squares_own_and_all_of_it():
    weighted = np.ones((8, 8))
    assert sum_by_plants(weighted, CELL, 0.0) == pytest.approx(16 * 2.0), "four squares of 16 cells"
    assert sum_by_plants(weighted, CELL, 0.5) == pytest.approx(np.hypot(32.0, 32.0))
    assert sum_by_plants(weighted, CELL, 1.0) == 64.0
    assert sum_by_plants(np.zeros((8, 8)), CELL, 1.0) == 0.0


def test_a_grown_cell_errs_as_one_across_the_squares_that_it_lies_in():
    shape = (8, 8)
    plants, block = np.full(shape, PLANTS), np.zeros(shape, dtype=np.int32)
    cells = Cells(np.zeros(shape), plants, np.ones(shape), Partition.of_blocks(block, CELL), plants)
    model = CorrelationModel(0.0, VariogramModel(1.0), plants_in_common=0.0)
    assert model.whole_error(np.ones(shape), cells) == pytest.approx(64 * PLANTS)
