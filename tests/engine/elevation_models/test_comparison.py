"""Two models of a known change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slopewatch.engine.elevation_models.comparison import ModelChange, TakenOff, compare_models
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


def _tilted(change: float) -> tuple[np.ndarray, np.ndarray]:
    first, second = _pair(3, change)
    return first, second + 0.4 * (np.arange(_SHAPE[1]) / (_SHAPE[1] - 1) - 0.5)


def test_a_tilt_is_named_and_stays_unless_it_is_to_be_taken_off() -> None:
    first, second = _tilted(-0.3)
    kept = compare_models(first, second, _GRID)
    assert kept.trend.tilt[0] == pytest.approx(0.4, abs=0.03)
    assert not kept.trend_taken_off
    assert kept.change.by_trend is None
    assert kept.change.median_level > 0.2
    assert np.nanmean(kept.change.dz[:, -20:]) > 0.15


def test_without_the_tilt_the_hollow_is_found_with_its_volume_and_the_fit_is_in_the_error() -> None:
    first, second = _tilted(-0.3)
    taken = compare_models(first, second, _GRID, taken_off=TakenOff(tilt=True))
    straight = compare_models(*_pair(3, -0.3), _GRID)
    assert taken.trend_taken_off
    assert taken.change.median_level == pytest.approx(straight.change.median_level, rel=0.1)
    assert abs(np.nanmean(taken.change.dz[:, -20:])) < 0.03
    assert taken.coregistration.nmad_before > 2 * taken.coregistration.nmad_after
    zones = change_zones(taken.change)
    assert len(zones.frame) == 1
    zone = zones.frame.iloc[0]
    assert zone["vol_net_m3"] == pytest.approx(-180.0, abs=3 * zone["vol_err_m3"])
    assert taken.change.by_trend is not None
    without = change_zones(replace(taken.change, by_trend=None)).frame.iloc[0]
    assert zone["vol_err_m3"] > without["vol_err_m3"]


def test_models_without_a_tilt_are_compared_as_if_none_was_asked_for() -> None:
    asked = compare_models(*_pair(3, -0.3), _GRID, taken_off=TakenOff(tilt=True))
    assert asked.trend.order == 0
    assert np.array_equal(asked.change.level, compare_models(*_pair(3, -0.3), _GRID).change.level, equal_nan=True)
