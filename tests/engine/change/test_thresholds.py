"""The four thresholds against their formulas, cell by cell."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import norm
from slopewatch.engine.change.thresholds import coherent_probability, decide
from slopewatch.interface.parameters import ChangeParameters
from slopewatch.tests.builders.change_zones import single


@pytest.fixture(scope="module")
def field() -> tuple[np.ndarray, np.ndarray]:
    """Noise of varying strength with a weak, coherent lowering in the middle and holes."""
    rng = np.random.default_rng(5)
    error = rng.uniform(0.01, 0.05, (30, 40))
    dz = rng.normal(0, error)
    dz[10:20, 12:26] -= 0.05
    dz[rng.random(dz.shape) < 0.15] = np.nan
    return dz, error


def test_constant_is_one_level_whatever_the_error(field):
    dz, error = field
    found = decide(dz, error, ChangeParameters(threshold="constant", constant_level=0.07), single(dz))
    assert np.array_equal(found.significant, np.abs(np.nan_to_num(dz)) > 0.07)
    assert np.unique(found.level[np.isfinite(dz)]).tolist() == [0.07]
    assert np.isnan(found.level[np.isnan(dz)]).all()


def test_propagated_is_the_quadrature_of_the_stated_errors(field):
    dz, error = field
    parameters = ChangeParameters(threshold="propagated", error_from=0.03, error_to=0.04, confidence=0.9)
    found = decide(dz, error, parameters, single(dz))
    assert found.level[np.isfinite(dz)] == pytest.approx(norm.ppf(0.95) * 0.05)


def test_two_surveys_of_four_centimetres_have_the_published_level():
    """4 cm an epoch gives a level of 0.11 m at 95 %."""
    dz = np.zeros((1, 1))
    found = decide(dz, dz + 1.0, ChangeParameters(threshold="propagated"), single(dz))
    assert found.level[0, 0] == pytest.approx(0.11, abs=0.002)


def test_probabilistic_follows_each_cells_error(field):
    dz, error = field
    found = decide(dz, error, ChangeParameters(confidence=0.8), single(dz))
    chance = 2 * norm.sf(np.abs(dz) / error)  # two-sided
    assert np.array_equal(found.significant, chance < 0.2)
    assert np.allclose(found.level, norm.ppf(0.9) * error)
    assert found.probability is None


def posterior(dz: np.ndarray, error: np.ndarray, row: int, column: int) -> float:
    """By the paper's steps, for one cell, with plain loops."""
    prior = 1 - 2 * norm.sf(abs(dz[row, column]) / error[row, column])
    measured = alike = 0
    for i in range(max(row - 2, 0), min(row + 3, dz.shape[0])):
        for j in range(max(column - 2, 0), min(column + 3, dz.shape[1])):
            if not math.isnan(dz[i, j]):
                measured += 1
                alike += (dz[i, j] < 0) == (dz[row, column] < 0)
    likelihood = min(max((alike / measured - 0.6) / 0.4, 0.0), 1.0)
    return prior * likelihood / (prior * likelihood + (1 - prior) * (1 - likelihood))


def test_coherent_is_bayes_theorem_in_every_cell(field):
    dz, error = field
    got = coherent_probability(dz, error, single(dz))
    for place in np.ndindex(dz.shape):
        if math.isnan(dz[place]):
            assert math.isnan(got[place])
        else:
            assert got[place] == pytest.approx(posterior(dz, error, *place), abs=1e-9)


def test_coherent_finds_weak_change_that_hangs_together_and_drops_what_stands_alone(field):
    dz, error = field
    alone = decide(dz, error, ChangeParameters(), single(dz)).significant
    together = decide(dz, error, ChangeParameters(threshold="coherent"), single(dz)).significant
    inside = np.zeros(dz.shape, dtype=bool)
    inside[12:18, 14:24] = True
    known = np.isfinite(dz)
    assert together[inside & known].mean() > alone[inside & known].mean() + 0.1
    outside = known.copy()
    outside[6:24, 8:30] = False
    assert together[outside].mean() < alone[outside].mean()


def test_certain_cells_do_not_divide_by_zero():
    lone = np.full((5, 5), 0.001)
    lone[2, 2] = -50.0  # prior 1, likelihood 0
    got = coherent_probability(lone, np.full((5, 5), 0.01), single(lone))
    assert np.isfinite(got).all()
    assert got[2, 2] == 0.0
