"""Tilts and bends that are known, and changes that are neither."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.elevation_models.trend import BEND, TILT, Trend, find_trend
from slopewatch.engine.statistics.variogram import VariogramModel
from slopewatch.lab.benchmarks.volumes import correlated_field

_SHAPE = (160, 200)
_ERRORS = VariogramModel(0.1, (0.5, 0.4), (6.0, 40.0))
_SIGMA = 0.06
_X, _Y = np.meshgrid(np.linspace(-0.5, 0.5, _SHAPE[1]), np.linspace(-0.5, 0.5, _SHAPE[0]))
_SLIDE = np.s_[15:135, 20:100]  # 30 % of the map


def _noise(seed: int, model: VariogramModel = _ERRORS) -> np.ndarray:
    return _SIGMA * correlated_field(_SHAPE, 1.0, model, np.random.default_rng([seed, 5]))


def _found(dz: np.ndarray, given: np.ndarray | None = None) -> Trend:
    return find_trend(dz - np.median(dz), np.full(_SHAPE, _SIGMA), np.zeros(_SHAPE), given)


def _away(found: Trend, truth: np.ndarray) -> np.ndarray:
    """Errors of the surface in the corners, in units of those stated; both about their means."""
    left = found.surface - truth
    corners = np.array([(left - left.mean())[row, column] for row in (0, -1) for column in (0, -1)])
    stated = np.array([found.error[row, column] for row in (0, -1) for column in (0, -1)])
    return corners / stated


def test_a_tilt_is_found_with_its_size_within_its_error() -> None:
    truth = 0.4 * _X
    found = _found(truth + _noise(1))
    assert found.order == TILT
    size, error = found.tilt
    assert size == pytest.approx(0.4, abs=3 * error)
    assert error < 0.06
    assert found.bend == (0.0, 0.0)
    assert np.abs(_away(found, truth)).max() < 3.5


def test_a_bend_is_found_beside_a_tilt() -> None:
    truth = 0.3 * _Y + 1.2 * _X**2
    found = _found(truth + _noise(2))
    assert found.order == BEND
    assert found.tilt[0] == pytest.approx(0.3, abs=3 * found.tilt[1])
    assert found.bend[0] == pytest.approx(0.3, abs=3 * found.bend[1])
    assert np.abs(_away(found, truth)).max() < 3.5


@pytest.mark.parametrize("ranges", [(6.0, 40.0), (10.0, 120.0)])
def test_errors_alike_over_much_of_the_map_are_no_trend(ranges: tuple[float, float]) -> None:
    model = VariogramModel(0.0, (0.6, 0.4), ranges)
    assert [_found(_noise(seed, model)).order for seed in range(20, 24)] == [0] * 4


def test_the_stated_errors_are_those_made() -> None:
    scores = []
    for seed in range(8):
        truth = 0.5 * (np.cos(seed) * _X + np.sin(seed) * _Y)
        found = _found(truth + _noise(100 + seed))
        assert found.order >= TILT
        scores.append(_away(found, truth))
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.4


@pytest.mark.parametrize("sunk", [0.5, 2.0])
def test_a_landslide_on_three_tenths_of_the_map_is_neither_fitted_nor_a_trend(sunk: float) -> None:
    slide = np.zeros(_SHAPE)
    slide[_SLIDE] = -sunk
    assert _found(slide + _noise(3)).order == 0
    truth = 0.4 * _X
    found = _found(truth + slide + _noise(3))
    assert found.order == TILT
    assert found.tilt[0] == pytest.approx(0.4, abs=3 * found.tilt[1])
    assert np.abs(_away(found, truth)).max() < 3.5


def test_the_error_grows_away_from_the_stable_ground() -> None:
    given = np.zeros(_SHAPE, dtype=bool)
    given[:, :90] = True
    found = _found(0.8 * _X + _noise(4), given)
    assert found.order == TILT
    assert found.error[80, -1] > 2 * found.error[80, 45]
    whole = _found(0.8 * _X + _noise(4))
    assert found.error[80, -1] > 1.5 * whole.error[80, -1]


def test_stable_ground_in_one_line_or_too_little_of_it_shows_no_trend() -> None:
    road = np.zeros(_SHAPE, dtype=bool)
    road[70:80] = True
    assert _found(0.4 * _X + _noise(5), road).why
    small = np.zeros(_SHAPE, dtype=bool)
    small[:30, :30] = True
    assert _found(0.4 * _X + _noise(5), small).why == "too little stable ground"
