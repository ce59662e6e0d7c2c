"""Relief by a power law: its spectrum, scatter and tails by a periodogram that shares nothing with its making."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from slopewatch.lab.making.natural_relief import (
    AMOUNT,
    CONTRAST,
    EXPONENT,
    ReliefLaw,
    draw_law,
    relief_heights,
)

CELL, CELLS = 0.5, 88
SEEDS = 8


def _lattice() -> np.ndarray:
    i, j = np.meshgrid(*(np.arange(CELLS) * CELL,) * 2, indexing="ij")
    return np.column_stack([i.ravel(), j.ravel()])


def _fields(law: ReliefLaw) -> list[np.ndarray]:
    return [
        relief_heights(_lattice(), law, np.random.default_rng(seed)).height.reshape(CELLS, CELLS)
        for seed in range(SEEDS)
    ]


def _periodogram(fields: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Wave numbers (1/m) and the mean power spectral density (m^4) under Hann's window."""
    window = np.outer(*(np.sin(np.pi * np.arange(CELLS) / CELLS) ** 2,) * 2)
    power = [np.abs(np.fft.fft2((field - field.mean()) * window)) ** 2 for field in fields]
    frequency = np.fft.fftfreq(CELLS, CELL)
    return np.hypot(frequency[:, None], frequency), np.mean(power, axis=0) * CELL**2 / (window**2).sum()


@pytest.mark.parametrize("exponent", [3.4, 4.0, 4.6])
def test_the_spectrum_falls_with_the_exponent_asked_for(exponent: float) -> None:
    k, power = _periodogram(_fields(ReliefLaw(exponent, 0.08, 40.0, 0.4)))
    limits = np.geomspace(1 / 18, 1 / 1.4, 10)
    rings = [(k > low) & (k < high) for low, high in pairwise(limits)]
    slope = np.polyfit(*(np.log([values[ring].mean() for ring in rings]) for values in (k, power)), 1)[0]
    assert -slope == pytest.approx(exponent, abs=0.3)


def test_waves_up_to_seven_metres_scatter_as_asked_and_longer_ones_by_the_law() -> None:
    law = ReliefLaw(4.0, 0.08, 40.0, 0.3)
    k, power = _periodogram(_fields(law))
    cell = 1 / (CELLS * CELL) ** 2
    assert np.sqrt(power[k > 1 / 7].sum() * cell) == pytest.approx(0.08, rel=0.2)
    # k^-4 in the plane: as high as long.
    assert np.sqrt(power[k > 1 / 14].sum() * cell) == pytest.approx(0.16, rel=0.2)
    assert law.deviation(14.0) == pytest.approx(0.16, rel=0.01)


def test_no_wave_is_longer_than_the_longest() -> None:
    k, power = _periodogram(_fields(ReliefLaw(4.0, 0.08, 10.0, 0.3)))
    longer = k < 1 / 20
    assert power[longer].sum() < 0.1 * power.sum()


def test_contrast_makes_the_tails_heavy() -> None:
    def excess(contrast: float) -> float:
        found = []
        for field in _fields(ReliefLaw(4.0, 0.08, 30.0, contrast)):
            second = field[2:, 1:-1] + field[:-2, 1:-1] + field[1:-1, 2:] + field[1:-1, :-2] - 4 * field[1:-1, 1:-1]
            found.append(np.mean(second**4) / np.mean(second**2) ** 2 - 3)
        return float(np.mean(found))

    assert abs(excess(0.0)) < 0.3
    assert excess(0.3) > 0.8
    assert excess(0.6) > 2 * excess(0.3)


def test_hiding_is_the_local_scatter_of_short_waves() -> None:
    """Against the scatter of what a high pass leaves, place by place."""
    law = ReliefLaw(4.0, 0.08, 30.0, 0.35)
    made = [relief_heights(_lattice(), law, np.random.default_rng(seed)) for seed in range(SEEDS)]
    hiding = np.array([one.hiding.reshape(CELLS, CELLS) for one in made])
    assert np.sqrt(np.mean(hiding**2)) == pytest.approx(law.deviation(3.0), rel=0.25)
    # Twice the Gaussian's complement: half of the power at 3 m.
    short = np.array([one.height.reshape(CELLS, CELLS) for one in made])
    for _ in range(2):
        short = short - gaussian_filter(short, (0.0, 1.83, 1.83))
    short = short[:, 8:-8, 8:-8]
    inner = hiding[:, 8:-8, 8:-8]
    order = np.argsort(inner.ravel())
    scatter = [np.sqrt(np.mean(short.ravel()[part] ** 2)) for part in np.array_split(order, 4)]
    level = [np.sqrt(np.mean(inner.ravel()[part] ** 2)) for part in np.array_split(order, 4)]
    np.testing.assert_array_equal(np.argsort(scatter), np.arange(4))
    assert level[3] > 3 * level[0]
    np.testing.assert_allclose(np.array(scatter) / level, 1.0, atol=0.4)


def test_the_same_generator_gives_the_same_relief_and_laws_span_the_measured_ranges() -> None:
    one, again, other = (
        relief_heights(_lattice(), draw_law(60.0, rng), rng).height for rng in map(np.random.default_rng, (5, 5, 6))
    )
    np.testing.assert_array_equal(one, again)
    assert not np.allclose(one, other)
    rng = np.random.default_rng(1)
    laws = [draw_law(60.0, rng) for _ in range(300)]
    for values, limits in (
        ([law.amount for law in laws], AMOUNT),
        ([law.exponent for law in laws], EXPONENT),
        ([law.contrast for law in laws], CONTRAST),
        ([law.longest for law in laws], (20.0, 60.0)),
    ):
        assert limits[0] <= min(values) < limits[0] + 0.1 * np.ptp(limits)
        assert limits[1] >= max(values) > limits[1] - 0.1 * np.ptp(limits)
    assert draw_law(5.0, rng).longest == pytest.approx(20.0)
