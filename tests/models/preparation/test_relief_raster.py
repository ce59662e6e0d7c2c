"""The raster of a slope: places, gaps, and every channel on ground of known shape."""

import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.models.preparation.bump_filter import bump
from slopewatch.models.preparation.relief_raster import DIAMETERS_M, laplacian_score, relief_raster


def ground(density: float, seed: int = 0, *, width: float = 40.0, noise: float = 0.02) -> np.ndarray:
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, width, (round(density * width**2), 2)) - 7.3
    return np.column_stack([xy, rng.normal(0, noise, len(xy))])


@pytest.mark.parametrize("diameter", DIAMETERS_M)
def test_each_width_is_strongest_at_a_bump_of_that_width(diameter: float) -> None:
    xyz = ground(20)
    place = np.array([12.25, 14.25])
    xyz[:, 2] += 0.5 * bump(np.hypot(*(xyz[:, :2] - place).T), diameter)
    raster = relief_raster(xyz)
    at = tuple(int(k[0]) for k in raster.index(place[None]))
    fit = next(fit for fit in raster.bumps if fit.diameter == diameter)
    assert fit.amplitude[at] == pytest.approx(0.5, abs=0.04)
    top = np.unravel_index(np.nanargmax(fit.amplitude), raster.shape)
    assert np.hypot(top[0] - at[0], top[1] - at[1]) * raster.cell <= 1.0
    scores = {fit.diameter: fit.t[at] for fit in raster.bumps}
    assert scores[diameter] > 8
    assert laplacian_score(raster, diameter)[at] > 4


def test_density_scatter_and_height() -> None:
    xyz = ground(16, noise=0.03)
    raised = np.hypot(*(xyz[:, :2] - [12.0, 12.0]).T) < 1.5
    raster = relief_raster(np.column_stack([xyz[:, :2], xyz[:, 2] + 0.3 * raised]))
    inner = np.s_[20:-20, 20:-20]
    assert np.median(raster.density[inner]) == pytest.approx(16, rel=0.06)
    # Four points a cell: half of the points' own scatter.
    assert np.median(raster.scatter[10:20, 10:20]) == pytest.approx(0.015, rel=0.25)
    at = tuple(int(k[0]) for k in raster.index(np.array([[12.0, 12.0]])))
    assert raster.height[at] == pytest.approx(0.29, abs=0.04)
    assert raster.channels().shape == (7, *raster.shape)


def test_holes_and_what_lies_beyond_have_no_data() -> None:
    xyz = ground(20)
    hole = np.hypot(*(xyz[:, :2] - [12.0, 12.0]).T) < 5
    raster = relief_raster(xyz[~hole])
    at = tuple(int(k[0]) for k in raster.index(np.array([[12.0, 12.0]])))
    assert not raster.covered[at]
    assert np.isnan(raster.channels()[:, at[0], at[1]]).all()
    assert raster.area == pytest.approx(40**2 - np.pi * 4.0**2, rel=0.04)
    assert np.isfinite(raster.height[raster.covered]).all()


def test_points_find_their_cells_wherever_the_origin_lies() -> None:
    xyz = ground(5, width=20.0)
    raster = relief_raster(xyz)
    i, j = raster.index(xyz)
    middle = raster.origin + (np.column_stack([i, j]) + 0.5) * raster.cell
    assert np.abs(xyz[:, :2] - middle).max() <= raster.cell / 2 + 1e-9
    again = relief_raster(xyz + [200.0, -300.0, 50.0])
    np.testing.assert_allclose(again.bumps[1].amplitude, raster.bumps[1].amplitude, atol=1e-4)


def test_too_wide_or_empty_is_refused() -> None:
    with pytest.raises(InputError, match="no ground point"):
        relief_raster(np.zeros((0, 3)))
    with pytest.raises(InputError, match="takes too much memory"):
        relief_raster(np.array([[0.0, 0.0, 0.0], [9000.0, 9000.0, 0.0]]))
