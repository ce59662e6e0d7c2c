"""Errors that follow the terrain, as they were put in."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.elevation_models.cell_errors import attribute_table, cell_errors

_SHAPE = (250, 300)


def _terrain() -> dict[str, np.ndarray]:
    draw = np.random.default_rng(1)
    return {"slope": draw.uniform(0, 40, _SHAPE), "roughness": draw.exponential(0.02, _SHAPE)}


def _sigma(terrain: dict[str, np.ndarray]) -> np.ndarray:
    return 0.03 + 0.004 * terrain["slope"] + 0.5 * np.minimum(terrain["roughness"], 0.08)


def test_the_error_follows_slope_and_roughness() -> None:
    terrain = _terrain()
    truth = _sigma(terrain)
    dz = truth * np.random.default_rng(2).normal(size=_SHAPE)
    found = cell_errors(dz, terrain, np.ones(_SHAPE, dtype=bool)).at(list(terrain.values()))
    ratio = found / truth
    assert np.median(ratio) == pytest.approx(1.0, abs=0.03)
    assert np.quantile(np.abs(ratio - 1.0), 0.9) < 0.2


def test_change_on_a_tenth_of_the_ground_hardly_widens_it() -> None:
    terrain = _terrain()
    dz = _sigma(terrain) * np.random.default_rng(2).normal(size=_SHAPE)
    dz[100:150, 100:250] -= 2.0
    found = cell_errors(dz, terrain, np.ones(_SHAPE, dtype=bool)).at(list(terrain.values()))
    assert np.median(found / _sigma(terrain)) < 1.25


def test_with_few_cells_one_scatter_stands_for_all() -> None:
    terrain = {name: values[:20, :20] for name, values in _terrain().items()}
    dz = 0.1 * np.random.default_rng(3).normal(size=(20, 20))
    found = cell_errors(dz, terrain, np.ones((20, 20), dtype=bool))
    assert found.names == ()
    assert np.ptp(found.at(list(terrain.values()))) == 0
    assert found.typical == pytest.approx(0.1, rel=0.15)


def test_heights_in_steps_err_by_these_at_least() -> None:
    terrain = _terrain()
    dz = np.zeros(_SHAPE)
    found = cell_errors(dz, terrain, np.ones(_SHAPE, dtype=bool), floor=0.41)
    assert found.at(list(terrain.values())) == pytest.approx(np.full(_SHAPE, 0.41))


def test_an_attribute_that_is_the_same_everywhere_makes_no_classes() -> None:
    terrain = {"slope": np.full(_SHAPE, 3.0)}
    dz = 0.1 * np.random.default_rng(3).normal(size=_SHAPE)
    found = cell_errors(dz, terrain, np.ones(_SHAPE, dtype=bool))
    assert found.at([terrain["slope"]]) == pytest.approx(np.full(_SHAPE, 0.1), rel=0.02)


def test_the_table_states_scatter_and_error_by_quarters() -> None:
    terrain = _terrain()
    dz = _sigma(terrain) * np.random.default_rng(2).normal(size=_SHAPE)
    stable = np.ones(_SHAPE, dtype=bool)
    rows = attribute_table(cell_errors(dz, terrain, stable), dz, terrain, stable)
    slope = [row for row in rows if row["attribute"] == "slope"]
    assert [row["nmad_m"] for row in slope] == sorted(row["nmad_m"] for row in slope)
    assert all(row["stated_m"] == pytest.approx(row["nmad_m"], rel=0.1) for row in slope)
