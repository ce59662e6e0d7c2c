"""How many cells a grown cell counts for, and which groups of few cells are zones by it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import norm
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.zones.groups import cells_worth, label_groups
from slopewatch.interface.parameters import ZoneParameters
from slopewatch.tests.builders.change_zones import blocks_of, zones_of

CELL, SIDE = 0.2, 4
LEAST, MOST = 5, 2.5
SIGMA = 0.01


def blocks(z: np.ndarray) -> tuple[np.ndarray, np.ndarray, Grid]:
    """Change of grown cells of 0.8 m with changes of ``z`` standard errors (rows, columns), their numbers, the grid."""

    def spread(values: np.ndarray) -> np.ndarray:
        return values.repeat(SIDE, axis=0).repeat(SIDE, axis=1)

    dz = spread(SIGMA * z)
    return dz, spread(np.arange(z.size).reshape(z.shape)), Grid(0.0, 0.0, CELL, *dz.shape)


def groups(z: np.ndarray, told: bool = True) -> int:
    """Groups that are large enough; ``told``: whether the cells' errors are."""
    dz, block, _ = blocks(z)
    sigma = np.full(dz.shape, SIGMA) if told else None
    partition = blocks_of(block, CELL, np.full(dz.shape, CELL * SIDE))
    return int(label_groups(dz, np.abs(dz) > 1.96 * SIGMA, ZoneParameters(), partition, sigma=sigma).max())


def beside(*z: float) -> np.ndarray:
    """Cells in a row on unchanged ground."""
    found = np.zeros((5, len(z) + 4))
    found[2, 2 : 2 + len(z)] = z
    return found


def test_a_cell_counts_as_its_probability_says():
    z = np.array([2.0, 3.0, 3.6, 3.9])
    told = cells_worth(-z * SIGMA, np.full(4, SIGMA), LEAST)
    expected = [-math.log(2 * norm.sf(v)) / (1 + math.log(20)) for v in z]
    assert told == pytest.approx(np.clip(expected, 1.0, MOST))
    assert 1.0 < told[2] < told[3] < MOST


def test_no_cell_counts_for_less_than_one_or_for_many():
    told = cells_worth(np.array([0.0, 1e-4, 1.0, np.nan, 1.0]), np.array([0.01, 0.01, 0.01, 0.01, 0.0]), LEAST)
    assert told.tolist() == [1.0, 1.0, MOST, 1.0, MOST]


@pytest.mark.parametrize(("least", "most"), [(2, 1.0), (3, 1.5), (10, 5.0)])
def test_two_cells_are_always_needed(least, most):
    assert cells_worth(np.array([1.0]), np.array([0.01]), least)[0] == most


def test_chance_brings_cells_that_count_for_one_on_average():
    z = np.random.default_rng(1).normal(size=2_000_000)
    beyond = z[np.abs(z) > 1.96]
    improbable = -np.log(2 * norm.sf(np.abs(beyond)))
    assert np.mean(improbable / (1 + math.log(20))) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ("z", "zones"),
    [
        ((8.0, 8.0), 1),
        ((-8.0, -8.0), 1),
        ((8.0, -8.0), 0),
        ((2.5, 2.5, 2.5, 2.5), 0),
        ((3.0, 3.0, 3.0, 3.0), 1),
        ((3.0, 3.0), 0),
        ((2.0,) * 5, 1),
        ((50.0,), 0),
    ],
)
def test_few_cells_are_a_zone_if_they_are_far_beyond_their_level(z, zones):
    assert groups(beside(*z)) == zones
    assert groups(beside(*z), told=False) == int(len(z) >= 5)


def test_what_is_left_of_a_grown_cell_counts_as_a_part_however_sure_it_is():
    dz, block, _ = blocks(beside(8.0, 8.0))
    dz[:, 14:] = np.nan
    partition, sigma = blocks_of(block, CELL, np.full(dz.shape, CELL * SIDE)), np.full(dz.shape, SIGMA)
    labels = label_groups(dz, dz > 0.02, ZoneParameters(minimum_area=0.0), partition, sigma=sigma)
    assert not labels.any(), "a cell and half of one"


def test_chance_makes_hardly_more_zones_than_without():
    """400 unchanged slopes of 400 grown cells, 5 % of which are beyond their level."""
    random = np.random.default_rng(3)
    plain, told = 0, 0
    for _ in range(400):
        z = random.normal(size=(20, 20))
        plain, told = plain + groups(z, told=False), told + groups(z)
    assert told <= plain + 8, "one in 50 slopes"


def test_zones_of_grown_cells_take_their_errors_into_account():
    dz, block, grid = blocks(beside(9.0, 9.0))
    sigma, size = np.full(dz.shape, SIGMA), np.full(dz.shape, CELL * SIDE)
    args = dz, np.abs(dz) > 1.96 * SIGMA, 1.96 * sigma, sigma, np.full(dz.shape, 9), grid, None
    found = zones_of(*args, partition=blocks_of(block, CELL, size))
    assert found.frame["n_cells"].tolist() == [2]
    assert found.frame["area_m2"].iloc[0] == pytest.approx(2 * 0.64)
    assert len(zones_of(*args).frame) == 1, "32 cells of one size"
