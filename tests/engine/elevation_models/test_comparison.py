"""Two models of a known change."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.elevation_models.comparison import ModelChange, compare_models
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.zones.change_zones import change_zones
from slopewatch.interface.parameters import ZoneParameters
from slopewatch.tests.builders.elevation_models import hills, noise

_SHAPE = (220, 240)
_GRID = Grid(0.0, 220.0, 1.0, *_SHAPE)
_HOLE = np.s_[90:110, 100:130]


def _pair(seed: int, change: float) -> tuple[np.ndarray, np.ndarray]:
    first, second = (hills(*_SHAPE) + noise(_SHAPE, 0.04, 4.0, seed + i) for i in (0, 50))
    second = second - 0.544
    second[_HOLE] += change
    return first, second


@pytest.fixture(scope="module")
def lowered() -> ModelChange:
    return compare_models(*_pair(1, -1.0), _GRID)


def test_the_bias_is_no_change(lowered: ModelChange) -> None:
    assert lowered.coregistration.bias == pytest.approx(-0.544, abs=3.5 * lowered.coregistration.errors[2])
    away = np.ones(_SHAPE, dtype=bool)
    away[85:115, 95:135] = False
    assert abs(np.nanmedian(lowered.change.dz[away])) < 0.01


def test_the_level_holds_on_ground_that_it_was_not_taken_from() -> None:
    half = np.zeros(_SHAPE, dtype=bool)
    half[:, :120] = True
    change = compare_models(*_pair(7, 0.0), _GRID, stable=half).change
    other = change.valid & ~half
    for low, high in ((0, 10), (10, 20), (20, 30)):
        here = other & (change.slope >= low) & (change.slope < high)
        assert 0.015 < change.significant[here].mean() < 0.10


def test_a_lowering_is_found_with_its_volume(lowered: ModelChange) -> None:
    zones = change_zones(lowered.change, None, ZoneParameters())
    assert len(zones.frame) == 1
    zone = zones.frame.iloc[0]
    assert zone["kind"] == "subsidence"
    assert zone["vol_net_m3"] == pytest.approx(-600.0, abs=3 * zone["vol_err_m3"])
    assert 0 < zone["vol_err_m3"] < 60
    assert not lowered.change.stable[_HOLE][5:-5, 5:-5].any()


def test_heights_in_whole_metres_widen_the_level() -> None:
    first, second = _pair(1, 0.0)
    rounded = compare_models(np.round(first), np.round(second), _GRID, steps=(1.0, 1.0)).change
    assert rounded.median_level > 1.96 * np.sqrt(2 / 12) * 0.9


def test_gaps_stay_gaps() -> None:
    first, second = _pair(2, 0.0)
    first[10:30, 10:40] = np.nan
    change = compare_models(first, second, _GRID).change
    assert np.isnan(change.dz[10:30, 10:40]).all()
    assert np.isfinite(change.level[change.valid]).all()
    assert change.common_cell_rate < 1
