"""The variogram against fields of known covariance and against plain loops; sums against Monte Carlo."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from slopewatch.engine.statistics import variogram
from slopewatch.engine.statistics.variogram import (
    VariogramModel,
    effective_samples,
    empirical_variogram,
    fit_variogram,
    spherical,
    sum_variance,
)

CELL = 0.1


def covariance(rows: np.ndarray, columns: np.ndarray, model: VariogramModel) -> np.ndarray:
    """Matrix of the covariances between cells, written out."""
    distance = CELL * np.hypot(rows[:, None] - rows, columns[:, None] - columns)
    matrix = np.zeros(distance.shape)
    for sill, reach in zip(model.sills, model.ranges, strict=True):
        h = distance / reach
        matrix += np.where(h < 1, sill * (1 - 1.5 * h + 0.5 * h**3), 0.0)
    return matrix + model.nugget * np.eye(len(rows))


def correlated_field(shape: tuple[int, int], reach: int, random: np.random.Generator) -> np.ndarray:
    """White noise averaged over squares of ``reach`` cells, of variance 1: its covariance is a product of triangles."""
    white = random.normal(size=(shape[0] + reach - 1, shape[1] + reach - 1))
    sums = np.zeros(shape)
    for i, j in itertools.product(range(reach), repeat=2):
        sums += white[i : i + shape[0], j : j + shape[1]]
    return sums / reach


def test_semivariances_equal_a_loop_over_all_pairs() -> None:
    random = np.random.default_rng(1)
    values = correlated_field((26, 31), 4, random)
    values[random.random(values.shape) < 0.2] = np.nan
    found = empirical_variogram(values, CELL)
    points = np.argwhere(np.isfinite(values))
    z = values[tuple(points.T)]
    distance = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    pair = np.triu(np.ones(distance.shape, dtype=bool), 1) & (distance <= 13)
    z = z - z.mean()
    squares, sizes = (z[:, None] - z) ** 2 / 2, (z[:, None] ** 2 + z**2) / 2
    edges = [0.0, 1.2, 1.7, 2.5, 3.5, 4.9, 6.86, 9.604, 13.4456]
    assert len(found.lag) == len(edges) - 1
    for i, (low, high) in enumerate(itertools.pairwise(edges)):
        some = pair & (distance >= low) & (distance < high)
        assert found.pairs[i] == some.sum()
        assert found.lag[i] == pytest.approx(CELL * distance[some].mean())
        assert found.semivariance[i] == pytest.approx(z.var() * squares[some].sum() / sizes[some].sum())
    assert found.cells == len(z)
    assert found.variance == pytest.approx(z.var())


def test_the_fit_finds_the_covariance_of_a_known_field() -> None:
    random = np.random.default_rng(2)
    shape, reach = (300, 400), 8
    values = np.sqrt(0.5) * correlated_field(shape, reach, random) + np.sqrt(0.5) * random.normal(size=shape)
    values[random.random(shape) < 0.4] = np.nan
    model = fit_variogram(empirical_variogram(values, CELL))
    assert model.variance == pytest.approx(1.0, abs=0.04)
    # triangles along the axes and the diagonal, averaged, against the model's curve
    for cells in (2, 4, 6):
        known = []
        for angle in np.linspace(0, np.pi / 2, 50):
            across = np.abs([cells * np.cos(angle), cells * np.sin(angle)]) / reach
            known.append(0.5 * np.prod(np.maximum(1 - across, 0)))
        assert model.variance - model.semivariance(np.array(cells * CELL)) == pytest.approx(np.mean(known), abs=0.04)
    assert model.structured(np.array(1.5 * reach * CELL)) < 0.03


def test_uncorrelated_values_have_hardly_more_than_a_nugget() -> None:
    values = np.random.default_rng(3).normal(size=(250, 250))
    model = fit_variogram(empirical_variogram(values, CELL))
    assert model.nugget == pytest.approx(1.0, abs=0.03)
    weights = np.ones((60, 60))
    assert sum_variance(weights, CELL, model) == pytest.approx(3600, rel=0.3)


def test_one_wild_value_does_not_make_the_variogram() -> None:
    values = np.random.default_rng(4).normal(size=(100, 100))
    values[50, 50] = 1e6
    assert fit_variogram(empirical_variogram(values, CELL)).variance == pytest.approx(1.0, abs=0.05)


def test_a_thinned_grid_tells_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    random = np.random.default_rng(5)
    values = correlated_field((240, 300), 12, random) + random.normal(size=(240, 300))
    whole = empirical_variogram(values, CELL)
    monkeypatch.setattr(variogram, "_MAX_LATTICE_CELLS", 20_000)
    thinned = empirical_variogram(values, CELL)
    assert thinned.pairs.sum() < 0.5 * whole.pairs.sum()
    np.testing.assert_allclose(thinned.semivariance[:4], whole.semivariance[:4], rtol=1e-9)
    for lag in (0.4, 1.0, 2.0):
        a, b = (np.interp(lag, v.lag, v.semivariance) for v in (whole, thinned))
        assert a == pytest.approx(b, rel=0.05)


def test_too_few_values_are_refused() -> None:
    with pytest.raises(ValueError, match="few"):
        empirical_variogram(np.random.default_rng(6).normal(size=(10, 10)), CELL)


def test_the_variance_of_a_sum_is_the_double_sum() -> None:
    random = np.random.default_rng(7)
    model = VariogramModel(0.5, (0.3, 0.2), (0.5, 3.0))
    weights = random.normal(size=(33, 47)) * (random.random((33, 47)) < 0.5)
    rows, columns = np.nonzero(weights)
    w = weights[rows, columns]
    assert sum_variance(weights, CELL, model) == pytest.approx(w @ covariance(rows, columns, model) @ w, rel=1e-9)
    # wherever the cells lie in the grid
    padded = np.pad(weights, ((20, 3), (0, 11)))
    assert sum_variance(padded, CELL, model) == pytest.approx(sum_variance(weights, CELL, model), rel=1e-9)


def test_sums_over_blocks_come_close_to_the_double_sum(monkeypatch: pytest.MonkeyPatch) -> None:
    random = np.random.default_rng(8)
    weights = random.uniform(0.5, 1.5, (130, 170)) * (random.random((130, 170)) < 0.6)
    for reach in (0.3, 1.0, 8.0):
        model = VariogramModel(0.6, (0.4,), (reach,))
        exact = sum_variance(weights, CELL, model)
        monkeypatch.setattr(variogram, "_MAX_SIDE_CELLS", 30)
        assert sum_variance(weights, CELL, model) == pytest.approx(exact, rel=0.02)
        monkeypatch.setattr(variogram, "_MAX_SIDE_CELLS", 200)


def test_effective_samples_against_monte_carlo() -> None:
    """The scatter of means over many simulated fields; the fields come from the covariance's Cholesky factor."""
    random = np.random.default_rng(9)
    model = VariogramModel(0.4, (0.6,), (0.8,))
    inside = np.hypot(*np.mgrid[-9:10, -9:10]) < 9.2
    rows, columns = np.nonzero(inside)
    errors = random.uniform(0.5, 2.0, len(rows))
    factor = np.linalg.cholesky(covariance(rows, columns, model))
    sums = (errors * (factor @ random.normal(size=(len(rows), 20_000))).T).sum(axis=1)
    weights = np.zeros(inside.shape)
    weights[inside] = errors
    found = effective_samples(weights, CELL, model)
    assert found == pytest.approx(errors.sum() ** 2 * model.variance / sums.var(), rel=0.04)
    assert 3 < found < len(rows) / 4


def test_effective_samples_of_a_disc_against_rolstad() -> None:
    """Rolstad et al. (2009), eq. 8: a disc much larger than the range has 5 area / (pi range²) samples."""
    inside = np.hypot(*np.mgrid[-150:151, -150:151]) <= 150.0
    model = VariogramModel(0.0, (1.0,), (2.0,))
    area = inside.sum() * CELL**2
    found = effective_samples(inside.astype(float), CELL, model)
    assert found == pytest.approx(5 * area / (np.pi * 2.0**2), rel=0.1)


def test_the_limits_of_effective_samples() -> None:
    weights = np.ones((12, 12))
    assert effective_samples(weights, CELL, VariogramModel(1.0)) == pytest.approx(144)
    assert effective_samples(weights, CELL, VariogramModel(0.0, (1.0,), (1e5,))) == pytest.approx(1, abs=1e-3)
    assert spherical(np.array([0.0, 1.0, 9.0]), 1.0).tolist() == [1.0, 0.0, 0.0]


def test_lags_at_which_no_two_cells_lie_are_left_out():
    """Where cells grew, only one cell of each block is known, and none beside it."""
    values = np.full((1100, 1100), np.nan)
    values[5::16, 3::16] = np.random.default_rng(9).normal(size=values[5::16, 3::16].shape)
    found = empirical_variogram(values, 0.1)
    assert (found.pairs > 0).all()
    assert np.isfinite(found.lag).all()
    assert found.lag[0] >= 1.6
    assert fit_variogram(found).variance == pytest.approx(1.0, abs=0.15)


def sparse_values(spacing: int, shape: tuple[int, int] = (400, 400), first: int = 0) -> np.ndarray:
    """Values of variance 1 every ``spacing`` cells, as those of grown cells lie; NaN between."""
    values = np.full(shape, np.nan)
    places = values[first::spacing, first::spacing]
    places[:] = np.random.default_rng(7).normal(size=places.shape)
    return values


@pytest.mark.filterwarnings("error")
def test_lags_without_pairs_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Values farther apart than the short lags reach, in a grid that is thinned for the long ones."""
    monkeypatch.setattr(variogram, "_MAX_LATTICE_CELLS", 400 * 400 // 4)
    found = empirical_variogram(sparse_values(8), CELL)
    assert np.isfinite(found.semivariance).all()
    assert (found.pairs > 0).all()
    assert found.lag[0] >= 8 * CELL
    model = fit_variogram(found)
    assert model.variance == pytest.approx(1.0, abs=0.1)
    assert model.structured(np.array(3.0)) < 0.05


def test_a_thinning_does_not_miss_the_values_of_grown_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    """A single value in the first row and column sets the box; all others lie at odd rows and columns."""
    monkeypatch.setattr(variogram, "_MAX_LATTICE_CELLS", 400 * 400 // 4)
    values = sparse_values(8, first=3)
    values[0, 0] = 0.0
    found = empirical_variogram(values, CELL)
    n = int(np.isfinite(values).sum())
    assert found.pairs.sum() > 0.2 * n * (n - 1) / 2


@pytest.mark.filterwarnings("error")
def test_too_few_lags_give_no_model() -> None:
    """Values along one line: half of the shorter side is one cell, so that only one class holds pairs."""
    values = np.random.default_rng(8).normal(size=(1, 600))
    found = empirical_variogram(values, CELL)
    assert len(found.lag) < variogram.MIN_LAGS
    with pytest.raises(ValueError, match="too few"):
        fit_variogram(found)
    apart = np.full((1, 6000), np.nan)
    apart[0, ::10] = values[0]
    assert len(empirical_variogram(apart, CELL).lag) == 0
