"""Shifts that are known."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.elevation_models.coregistration import Coregistration, TooFewCells, coregister
from slopewatch.tests.builders.elevation_models import hills, noise

_SHAPE = (200, 220)


def _with_noise(heights: np.ndarray, seed: int, sigma: float = 0.05) -> np.ndarray:
    return heights + noise(_SHAPE, sigma, 6.0, seed) + noise(_SHAPE, sigma, 25.0, seed + 100)


def _within(found: Coregistration, truth: tuple[float, float, float], deviations: float) -> None:
    error = np.array([found.east, found.north, found.bias]) - truth
    assert (np.abs(error) < deviations * np.array(found.errors)).all()


@pytest.mark.parametrize("shift", [(0.4, -0.7, -0.5), (-3.2, 5.1, 0.8)])
def test_a_shift_is_found_within_its_error(shift: tuple[float, float, float]) -> None:
    first = _with_noise(hills(*_SHAPE), 1)
    second = _with_noise(hills(*_SHAPE, east=shift[0], north=shift[1]) + shift[2], 2)
    found = coregister(first, second, 1.0)
    assert not found.why
    _within(found, shift, 3.5)
    assert max(found.errors[:2]) < 0.05
    assert found.nmad_after < 0.8 * found.nmad_before


def test_change_on_a_fifth_of_the_ground_does_not_pull() -> None:
    second = _with_noise(hills(*_SHAPE, east=0.4) + 0.1, 4)
    second[40:130, 60:160] -= 1.5
    _within(coregister(_with_noise(hills(*_SHAPE), 3), second, 1.0), (0.4, 0.0, 0.1), 3.5)


def test_errors_cover_the_truth_as_often_as_they_state() -> None:
    scores = []
    for seed in range(20):
        first = _with_noise(hills(*_SHAPE), 1000 + seed)
        found = coregister(first, _with_noise(hills(*_SHAPE, east=0.5) + 0.3, 2000 + seed), 1.0)
        scores.append((np.array([found.east, found.north, found.bias]) - (0.5, 0.0, 0.3)) / found.errors)
    rms = np.sqrt(np.mean(np.square(scores), axis=0))
    assert ((rms > 0.3) & (rms < 1.6)).all(), rms


def test_level_ground_gives_the_bias_alone() -> None:
    level = np.full(_SHAPE, 10.0)
    found = coregister(_with_noise(level, 5), _with_noise(level - 0.544, 6), 1.0)
    assert (found.east, found.north) == (0.0, 0.0)
    assert found.why
    assert abs(found.bias + 0.544) < 3.5 * found.errors[2]
    assert found.errors[2] < 0.03


def test_a_slope_of_one_aspect_shows_no_shift_along_its_contours() -> None:
    y = -np.arange(_SHAPE[0])[:, None] * 0.6 + np.zeros(_SHAPE)
    found = coregister(_with_noise(y, 7), _with_noise(y + 0.2, 8), 1.0)
    assert found.why
    assert (found.east, found.north) == (0.0, 0.0)
    assert found.bias == pytest.approx(0.2, abs=3.5 * found.errors[2])


def test_too_few_cells() -> None:
    heights = np.full((30, 30), np.nan)
    heights[:5, :5] = 1.0
    with pytest.raises(TooFewCells):
        coregister(heights, heights, 1.0)
