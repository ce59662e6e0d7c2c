"""Two standard errors cover 95 % of the cases, however few blocks fix a direction."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.registration.block_jackknife import block_jackknife


def within_two_errors(sizes: tuple[int, ...], trials: int = 1500) -> tuple[float, float]:
    """Share of the cases in which the mean of values with one error a block lies within two standard errors: by the
    covariance as it is, and widened.
    """
    rng = np.random.default_rng(3)
    block = np.repeat(np.arange(len(sizes)), sizes)
    ones = np.ones((len(block), 1, 1))
    hits = np.zeros((trials, 2), dtype=bool)
    for trial in hits:
        # the error of a block's mean falls with its size, as independent patches make it
        values = rng.normal(size=len(block))
        covariance, widen = block_jackknife(ones, -values[:, None], np.array([values.mean()]), block)
        sd = np.sqrt(covariance[0, 0]) * np.array([1.0, widen[0, 0]])
        trial[:] = abs(values.mean()) < 1.96 * sd
    plain, widened = hits.mean(axis=0)
    return float(plain), float(widened)


@pytest.mark.parametrize("sizes", [(10, 10, 10, 10), (30, 12, 8, 4, 2, 2), (8,) * 10])
def test_errors_of_few_blocks_are_widened_to_cover_what_they_say(sizes):
    plain, widened = within_two_errors(sizes)
    assert 0.93 < widened < 0.995  # leaving out a large block errs to the safe side
    if len(sizes) < 10:
        assert plain < 0.93


def test_many_blocks_hardly_widen_errors():
    rng = np.random.default_rng(1)
    block = np.repeat(np.arange(60), 5)
    jacobian = rng.normal(size=(len(block), 3))
    vectors = jacobian * rng.normal(0, 0.1, len(block))[:, None]
    matrices = jacobian[:, :, None] * jacobian[:, None, :]
    solution = -np.linalg.solve(matrices.sum(axis=0), vectors.sum(axis=0))
    covariance, widen = block_jackknife(matrices, vectors, solution, block)
    assert np.linalg.eigvalsh(widen) == pytest.approx(1.03, abs=0.03)
    assert np.sqrt(np.diag(covariance)) == pytest.approx(0.1 / np.sqrt(len(block)), rel=0.25)
