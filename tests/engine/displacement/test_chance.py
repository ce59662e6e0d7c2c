"""How many vectors chance makes, against still ground drawn by lot."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from slopewatch.engine.displacement.chance import counts_by_chance, variance_factor


def counts(width: int, confidence: float, maps: int, side: int, seed: int = 3) -> np.ndarray:
    """Exceeding windows on still maps: discs of a fine noise, in two directions along the surface."""
    rng = np.random.default_rng(seed)
    fine = 5  # cells of noise between two windows
    reach = width * fine / 2
    axis = np.arange(-int(reach), int(reach) + 1)
    disc = (axis[:, None] ** 2 + axis[None, :] ** 2 <= reach**2).astype(float)
    found = []
    for _ in range(maps):
        squared = np.zeros((side, side))
        for _ in range(2):
            noise = rng.normal(size=(side * fine, side * fine))
            mean = np.fft.ifft2(np.fft.fft2(noise) * np.fft.fft2(disc, noise.shape)).real
            squared += (mean[::fine, ::fine] / np.sqrt(disc.sum())) ** 2
        found.append(int((squared > stats.chi2.ppf(confidence, 2)).sum()))
    return np.array(found)


@pytest.mark.parametrize(("width", "side"), [(1, 20), (3, 20), (4, 16)])
def test_expected_count_its_scatter_and_its_limit(width: int, side: int) -> None:
    drawn = counts(width, 0.99, 400, side)
    expected, most = counts_by_chance(side * side, 1.0, [float(width)], 0.99)
    assert expected == pytest.approx(0.01 * side * side)
    assert drawn.mean() == pytest.approx(expected, rel=0.15)
    assert drawn.var() / expected == pytest.approx(variance_factor(float(width), 0.99), rel=0.25)
    assert 0.92 <= (drawn <= most).mean() <= 0.99


def test_two_widths_try_twice_and_windows_apart_are_independent() -> None:
    expected, _ = counts_by_chance(1000, 2.0, [4.0, 8.0], 0.99)
    assert expected == pytest.approx(1000 * (1 - 0.99**2))
    assert variance_factor(0.9, 0.99) == 1.0
    assert counts_by_chance(0, 1.0, [4.0], 0.99) == (0.0, 0)
