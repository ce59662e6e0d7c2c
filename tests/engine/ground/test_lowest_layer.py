"""The ground in histograms of returns, against numbers drawn from known distributions."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from slopewatch.engine.ground.lowest_layer import BIN_M, BINS, HIGHEST_M, LOWEST_M, Layers, histograms, lowest_layers

SIGMA, THRESHOLD = 0.016, 0.06
WINDOWS = 200


class Drawn:
    """Heights of the returns of many windows; the ground of each lies a few centimetres above or below 0."""

    def __init__(self, draw, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        self.truth = rng.uniform(-0.05, 0.05, WINDOWS)
        self.heights = [draw(rng) + height for height in self.truth]
        window = np.repeat(np.arange(WINDOWS), [len(h) for h in self.heights])
        self.layers = lowest_layers(histograms(np.concatenate(self.heights), window, WINDOWS), SIGMA, THRESHOLD)

    @property
    def errors(self) -> np.ndarray:
        return self.layers.ground - self.truth

    @property
    def means_of_taken(self) -> np.ndarray:
        """Of the returns from the threshold below the ground to the top, over the ground."""
        rows = zip(self.heights, self.layers.ground, self.layers.top, strict=True)
        return np.array([h[(h >= ground - THRESHOLD) & (h <= top)].mean() - ground for h, ground, top in rows])


def bare(rng: np.random.Generator, count: int = 1000, scatter: float = SIGMA) -> np.ndarray:
    return rng.normal(0, scatter, count)


def grass(rng: np.random.Generator, count: int = 600, share: float = 0.05) -> np.ndarray:
    """A ``share`` of the returns from the ground, the others from all heights up to half a metre."""
    return rng.normal(0, SIGMA, count) + np.where(rng.random(count) < share, 0.0, rng.uniform(0, 0.5, count))


def test_histograms_count_by_window_and_leave_out_what_is_beyond():
    rng = np.random.default_rng(0)
    height, window = rng.uniform(-0.6, 1.0, 3000), rng.integers(0, 7, 3000)
    counts = histograms(height, window, 9)
    assert counts.shape == (9, BINS)
    for number in range(9):
        expected, _ = np.histogram(height[window == number], BINS, (LOWEST_M, HIGHEST_M))
        assert np.array_equal(counts[number], expected)


def test_bare_ground_is_the_middle_of_its_returns():
    for count, scatter in ((1000, SIGMA), (300, SIGMA / 2), (3000, SIGMA)):
        drawn = Drawn(lambda rng, n=count, s=scatter: bare(rng, n, s))
        assert abs(drawn.errors.mean()) < 0.002
        assert np.quantile(np.abs(drawn.errors), 0.95) < 0.005
        # nearly all returns are ground, and nothing stands in them
        assert (drawn.layers.taken / drawn.layers.returns).mean() > 0.97


def test_ground_with_one_return_in_twenty_is_found_below_the_grass():
    drawn = Drawn(grass)
    assert abs(drawn.errors.mean()) < 0.005
    assert np.abs(drawn.errors).mean() < 0.015
    assert drawn.layers.median == pytest.approx(0.24, abs=0.06)
    # where the layer is densest, or its lowest return, would be far off
    lowest = np.array([h.min() for h in drawn.heights]) - drawn.truth
    assert np.abs(lowest).mean() > 0.025


def test_a_gap_above_the_ground_does_not_matter():
    drawn = Drawn(lambda rng: np.concatenate([bare(rng, 50), bare(rng, 950) + 0.1 + 0.4 * rng.beta(2, 2, 950)]))
    assert np.abs(drawn.errors).mean() < 0.01


@pytest.mark.parametrize("draw", [bare, grass])
def test_the_mean_of_the_returns_taken_is_the_ground(draw):
    drawn = Drawn(draw)
    assert abs(drawn.means_of_taken.mean()) < BIN_M / 2
    assert drawn.means_of_taken.max() < BIN_M + 1e-9
    for slack, more in ((-BIN_M, False), (BIN_M, True)):
        rows = zip(drawn.heights, drawn.layers.ground - THRESHOLD - slack, drawn.layers.top + slack, strict=True)
        counted = np.array([np.count_nonzero((h > low) & (h < high)) for h, low, high in rows])
        assert (counted >= drawn.layers.taken if more else counted <= drawn.layers.taken).all()


def test_single_returns_below_the_ground_are_not_believed():
    """Two in a thousand, as multipath leaves them."""
    drawn = Drawn(lambda rng: np.append(bare(rng, 998), rng.uniform(-0.25, -0.12, 2)))
    assert np.quantile(np.abs(drawn.errors), 0.98) < 0.01


def test_a_window_of_too_few_returns_has_no_ground():
    counts = np.zeros((3, BINS))
    counts[1, 60] = 1
    counts[2, 56:64] = 5
    layers = lowest_layers(counts, SIGMA, THRESHOLD)
    assert np.isnan(layers.ground[:2]).all()
    assert layers.ground[2] == pytest.approx(0.0, abs=0.01)
    assert layers.returns.tolist() == [0, 1, 40]


def test_one_window_alone_and_a_grid_of_windows_give_the_same():
    rng = np.random.default_rng(2)
    counts = np.stack([histograms(grass(rng), np.zeros(600, int), 1)[0] for _ in range(6)])
    flat, grid = (lowest_layers(c, SIGMA, THRESHOLD) for c in (counts, counts.reshape(2, 3, BINS)))
    for field in fields(Layers):
        values = getattr(flat, field.name)
        assert np.array_equal(getattr(grid, field.name), values.reshape(2, 3))
        assert getattr(lowest_layers(counts[4], SIGMA, THRESHOLD), field.name) == values[4]


def test_chosen_windows_are_replaced_and_the_others_and_the_first_layers_are_not():
    rng = np.random.default_rng(3)
    counts = np.stack([histograms(bare(rng) + shift, np.zeros(1000, int), 1)[0] for shift in (0.0, 0.1, 0.2)])
    layers = lowest_layers(counts, SIGMA, THRESHOLD)
    chosen = np.array([False, True, False])
    mixed = layers.where(chosen, lowest_layers(counts[2:], SIGMA, THRESHOLD))
    assert np.array_equal(mixed.ground, layers.ground[[0, 2, 2]])
    assert layers.ground[1] == pytest.approx(0.1, abs=0.005)
