"""The quick scores of bumps equal least squares that are solved window by window."""

import numpy as np
import pytest
from slopewatch.models.preparation.bump_filter import BumpDesign, bump
from slopewatch.models.preparation.linear_bumps import linear_scores


@pytest.mark.parametrize(("diameter", "cell"), [(2.0, 0.5), (5.0, 1.0)])
def test_scores_are_those_of_least_squares(diameter: float, cell: float) -> None:
    rng = np.random.default_rng(1)
    height = rng.normal(0, 0.1, (40, 34)) + 0.02 * np.arange(34) ** 1.5
    found = linear_scores(height, diameter, cell)
    design = BumpDesign.of(diameter, cell)
    for i, j in ((20, 17), (15, 12), (18, 20)):
        z = height[i + design.di, j + design.dj]
        columns = design.columns.astype(np.float64)
        solution, rest, _, _ = np.linalg.lstsq(columns, z, rcond=None)
        variance = rest[0] / (len(z) - 7) * np.linalg.inv(columns.T @ columns)[-1, -1]
        assert found[i, j] == pytest.approx(solution[-1] / np.sqrt(variance), rel=2e-3, abs=2e-3)


def test_a_bump_scores_highest_in_its_middle_and_a_hollow_as_low() -> None:
    i, j = np.mgrid[:60, :50]
    distance = np.hypot(i - 25, j - 30) * 0.5
    noise = np.random.default_rng(2).normal(0, 0.02, (60, 50))
    found = linear_scores(noise + 0.3 * bump(distance, 3.0) + 0.01 * i, 3.0, 0.5)
    assert np.unravel_index(found.argmax(), found.shape) == (25, 30)
    assert found[25, 30] > 15
    np.testing.assert_allclose(linear_scores(-noise, 3.0, 0.5), -linear_scores(noise, 3.0, 0.5), atol=1e-9)
