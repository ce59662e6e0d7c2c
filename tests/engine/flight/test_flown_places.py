"""Places of a flown survey against those of its plan: scatter that plants make is no shortfall, missing pulses are."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.core.arrays import Float
from slopewatch.engine.flight.flown_places import SHORTFALL, reached_of
from slopewatch.engine.grid.grid import Grid

GRID = Grid(0.0, 60.0, 2.0, 30, 30)
PROMISED = np.full(GRID.shape, 50.0)


def survey(density: Float, seed: int) -> Float:
    """Points (n, 2) by chance, of a mean ``density`` (rows, columns) a m²; also around the grid."""
    chance = np.random.default_rng(seed)
    counts = chance.poisson(density * GRID.cell**2)
    rows, columns = (np.repeat(index.ravel(), counts.ravel()) for index in np.indices(GRID.shape))
    xy = np.column_stack([columns, -rows - 1.0]) + chance.random((len(rows), 2))
    beyond = chance.uniform([-20.0, 0.0], [-1.0, 60.0], (4000, 2))
    return np.vstack([xy * GRID.cell + (0.0, 60.0), beyond])


@pytest.mark.parametrize("seed", range(3))
def test_shares_that_differ_from_place_to_place_are_no_shortfall(seed: int) -> None:
    shares = np.random.default_rng(seed).uniform(0.7, 1.3, GRID.shape)  # plants, seen from other places
    found = reached_of(survey(PROMISED * shares, seed), PROMISED, GRID)
    alone = (found.reached < (1 - SHORTFALL) * PROMISED).mean()
    assert alone > 0.2, "the scatter has to be one that single places fall short by"
    assert found.short_share <= 0.04


def test_ground_that_lacks_a_third_of_its_pulses_fell_short_and_no_other() -> None:
    shares = np.ones(GRID.shape)
    shares[10:20, 5:25] = 0.66
    found = reached_of(survey(PROMISED * shares, 9), PROMISED, GRID)
    assert found.short[11:19, 6:24].all()
    apart = np.ones(GRID.shape, bool)
    apart[9:21, 4:26] = False
    assert not found.short[apart].any()


def test_a_place_is_counted_with_those_around_it() -> None:
    """Against a brute-force sum."""
    shares = np.random.default_rng(5).uniform(0.3, 1.3, GRID.shape)
    promised = np.where(np.add.outer(np.arange(30), np.arange(30)) < 40, 50.0, np.nan)
    found = reached_of(survey(50.0 * shares, 5), promised, GRID)
    for row in range(30):
        for column in range(30):
            near = np.s_[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
            judged = found.judged[near]
            due, got = promised[near][judged].sum() * 4, found.reached[near][judged].sum() * 4
            expected = found.judged[row, column] and got < 0.85 * due and got < due - 2 * np.sqrt(due)
            assert found.short[row, column] == expected, (row, column)
