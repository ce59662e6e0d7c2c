"""How sure zones are: against maps of noise, of which at most one in twenty may hold a zone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import fft
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.statistics.variogram import VariogramModel
from slopewatch.engine.zones.confidence import MIN_SURE_CONFIDENCE, confidence_after_selection, mean_that_counts
from slopewatch.engine.zones.extraction import Zones
from slopewatch.engine.zones.fields import UNSURE
from slopewatch.interface.parameters import ZoneParameters
from slopewatch.tests.builders.change_zones import zones_of as made_zones

CELL, ERROR = 1.0, 0.05
SHAPE = (80, 80)
EVERY = ZoneParameters(minimum_confidence=0.0)


def noise(model: VariogramModel, seed: int) -> np.ndarray:
    """Normal values of variance 1 with the model's correlation, (rows, columns)."""
    large = tuple(2 * n for n in SHAPE)
    lag = [np.abs(np.fft.fftfreq(n, 1.0 / n)) * CELL for n in large]
    covariance = model.structured(np.hypot(lag[0][:, None], lag[1]))
    covariance[0, 0] += model.nugget
    spectrum = np.sqrt(np.maximum(fft.fft2(covariance).real, 0.0))
    white = fft.fft2(np.random.default_rng(seed).standard_normal(large))
    return fft.ifft2(spectrum * white).real[: SHAPE[0], : SHAPE[1]] / np.sqrt(model.variance)


def zones_of(dz: np.ndarray, parameters: ZoneParameters | None = None, **options: object) -> Zones:
    error = np.full(dz.shape, ERROR)
    count = options.pop("count", np.full(dz.shape, 9))
    significant = np.abs(dz) > 1.96 * error
    grid = Grid(0.0, 0.0, CELL, *dz.shape)
    return made_zones(dz, significant, 1.96 * error, error, count, grid, None, parameters, **options)


@pytest.mark.parametrize(
    "model",
    [
        VariogramModel(1.0),
        VariogramModel(0.2, (0.6, 0.2), (3.0, 40.0)),
        VariogramModel(0.6, (0.2, 0.2), (6.0, 40.0)),
    ],
    ids=["independent", "near and far", "mostly independent"],
)
def test_noise_makes_groups_and_hardly_a_zone(model: VariogramModel) -> None:
    groups, maps = 0, 0
    for seed in range(20):
        dz = ERROR * noise(model, seed)
        groups += len(zones_of(dz, EVERY).frame)
        maps += len(zones_of(dz).frame) > 0
    assert maps <= 2, "one in twenty, or by chance two"
    if model.sills:
        assert groups >= 20, "which were zones before"


def test_a_change_within_noise_is_found_and_noise_beside_it_is_not() -> None:
    model = VariogramModel(0.2, (0.6, 0.2), (3.0, 40.0))
    row, column = np.indices(SHAPE)
    bump = 0.3 * np.exp(-((row - 30) ** 2 + (column - 40) ** 2) / 40.0)
    for seed in range(6):
        dz = ERROR * noise(model, seed) + bump
        found, every = zones_of(dz), zones_of(dz, EVERY)
        assert found.labels[30, 40] > 0
        assert len(found.frame) == 1
        assert found.frame["confidence"].iloc[0] >= MIN_SURE_CONFIDENCE
        assert (found.unsure["reason"] == "chance").sum() == len(every.frame) - 1
        sure = every.frame["confidence"] >= MIN_SURE_CONFIDENCE
        assert set(every.frame.loc[~sure, "severity"]) <= {UNSURE}
        assert UNSURE not in set(every.frame.loc[sure, "severity"])


def test_one_place_named_before_is_the_plain_test() -> None:
    for beyond, expected in ((1.96, 0.95), (2.576, 0.99)):
        known = confidence_after_selection(beyond, 1.0, 0.0, samples=1.0, cells=1e6, compared=1.0)
        assert known == pytest.approx(expected, abs=1e-3)
        shared = confidence_after_selection(beyond, 1e-9, 1.0, samples=1.0, cells=4.0, compared=1e6)
        assert shared == pytest.approx(expected, abs=2e-3), "an error of the whole map is drawn once"


def test_more_places_and_more_shapes_make_less_sure() -> None:
    told = {"samples": 4.0, "cells": 10.0, "compared": 1e4}
    sure = confidence_after_selection(6.5, 1.0, 0.1, **told)
    assert 0.95 < sure < 1.0
    assert confidence_after_selection(6.5, 1.0, 0.1, **told | {"compared": 1e7}) < sure
    assert confidence_after_selection(6.5, 1.0, 0.1, **told | {"samples": 6.0}) < sure
    assert confidence_after_selection(6.5, 1.0, 1.0, **told) < sure
    # few cells tell little of their own errors
    assert confidence_after_selection(6.5, 1.0, 0.1, **told | {"cells": 2.0, "compared": 2e3}) < sure


def test_a_cell_of_one_point_carries_no_zone_alone() -> None:
    dz, sigma, own = np.array([9.0, 0.1, 0.1, np.nan]), np.full(4, 0.05), np.array([1, 1, 1, 0]) / 3.0
    assert mean_that_counts(dz, sigma, np.array([1, 5, 5, 0]), own) == pytest.approx(0.35 / 3)
    assert mean_that_counts(dz, sigma, np.array([2, 5, 5, 0]), own) == pytest.approx(9.2 / 3)
    change = ERROR * noise(VariogramModel(1.0), 1)
    change[10, 10:15] = 2.0 * ERROR
    change[10, 12] = 40 * ERROR
    count = np.full(SHAPE, 4)
    assert zones_of(change, count=count).labels[10, 12] > 0
    count[10, 12] = 1
    assert zones_of(change, count=count).labels[10, 12] == 0
