"""How many vectors chance makes, against still ground drawn by lot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from slopewatch.engine.displacement.chance import (
    beyond_chance,
    chance_vectors,
    components_beyond_chance,
    counts_by_chance,
    variance_factor,
)
from slopewatch.engine.displacement.components import Components
from slopewatch.engine.displacement.displacement import Displacement, measure_displacement
from slopewatch.engine.displacement.registered import Registered
from slopewatch.engine.displacement.zones import MovingZone
from slopewatch.interface.parameters import DisplacementParameters
from slopewatch.tests.builders.rough_ground import relief, sampled


def counts(width: int, confidence: float, maps: int, side: int, seed: int = 3) -> np.ndarray:
    """Exceeding windows on still maps: discs of a fine noise, in two directions along the surface."""
    rng = np.random.default_rng(seed)
    fine = 5  # cells of noise between two windows
    reach = width * fine / 2
    axis = np.arange(-int(reach), int(reach) + 1)
    disc = (axis[:, None] ** 2 + axis[None, :] ** 2 <= reach**2).astype(float)
    found = []
    for _ in range(maps):
        squared = np.zeros((side, side))
        for _ in range(2):
            noise = rng.normal(size=(side * fine, side * fine))
            mean = np.fft.ifft2(np.fft.fft2(noise) * np.fft.fft2(disc, noise.shape)).real
            squared += (mean[::fine, ::fine] / np.sqrt(disc.sum())) ** 2
        found.append(int((squared > stats.chi2.ppf(confidence, 2)).sum()))
    return np.array(found)


@pytest.mark.parametrize(("width", "side"), [(1, 20), (3, 20), (4, 16)])
def test_expected_count_its_scatter_and_its_limit(width: int, side: int) -> None:
    drawn = counts(width, 0.99, 400, side)
    expected, most = counts_by_chance(side * side, 1.0, float(width), 0.99)
    assert expected == pytest.approx(0.01 * side * side)
    assert drawn.mean() == pytest.approx(expected, rel=0.15)
    assert drawn.var() / expected == pytest.approx(variance_factor(float(width), 0.99), rel=0.25)
    assert 0.92 <= (drawn <= most).mean() <= 0.99


def test_windows_apart_are_independent() -> None:
    assert variance_factor(0.9, 0.99) == 1.0
    assert counts_by_chance(0, 1.0, 4.0, 0.99) == (0.0, 0)


@pytest.fixture(scope="module")
def still() -> Displacement:
    heights = relief(14.0, 0.15, seed=11)
    return measure_displacement(
        *(sampled(heights, 60.0, 0.02, seed) for seed in (1, 2)), DisplacementParameters(), Registered.unknown()
    )


def claiming(found: Displacement, count: int) -> Displacement:
    return replace(found, significant=np.arange(len(found.significant)) < count)


def test_vectors_as_many_as_chance_makes_are_not_shown_and_more_are(still: Displacement) -> None:
    most = chance_vectors(still)[1]
    assert most >= 1
    assert not beyond_chance(claiming(still, most)).any()
    assert beyond_chance(claiming(still, most + 1)).sum() == most + 1


def test_vectors_of_a_zone_are_shown_however_few(still: Displacement) -> None:
    zone = MovingZone(np.array([0, 1]), 8.0, *[np.zeros(3), np.eye(3)] * 2, 0.01, 8.0)
    shown = beyond_chance(replace(claiming(still, 1), zones=(zone,)))
    assert np.flatnonzero(shown).tolist() == [0]


def test_the_limit_of_components_holds_for_one_direction() -> None:
    """Against fields of discs of noise in one direction only."""
    rng = np.random.default_rng(8)
    side, width, fine, confidence = 16, 3, 5, 0.99
    axis = np.arange(-7, 8)
    disc = (axis[:, None] ** 2 + axis[None, :] ** 2 <= (width * fine / 2) ** 2).astype(float)
    drawn = []
    for _ in range(600):
        noise = rng.normal(size=(side * fine, side * fine))
        mean = np.fft.ifft2(np.fft.fft2(noise) * np.fft.fft2(disc, noise.shape)).real[::fine, ::fine]
        drawn.append(int((mean**2 / disc.sum() > stats.chi2.ppf(confidence, 1)).sum()))
    expected, most = counts_by_chance(side * side, 1.0, float(width), confidence, 1)
    assert np.mean(drawn) == pytest.approx(expected, rel=0.15)
    assert np.var(drawn) / expected == pytest.approx(variance_factor(float(width), confidence, 1), rel=0.25)
    assert 0.92 <= (np.array(drawn) <= most).mean() <= 0.99


def components(claimed: int, count: int = 60) -> Components:
    """``count`` components of which the first ``claimed`` stand at 3 standard errors, in one of two widths."""
    amount = np.where(np.arange(count) < claimed, 0.03, 0.005)
    ones = np.ones(count)
    direction = np.tile([1.0, 0.0, 0.0], (count, 1))
    return Components(np.arange(count), direction, amount, 0.01 * ones, 0.1 * ones, ones, 5.0 * ones, widths=2)


def test_components_are_shown_only_beyond_what_chance_makes(still: Displacement) -> None:
    most = counts_by_chance(60, still.grid.cell, 5.0, still.confidence, 1)[1]
    for claimed in (most, most + 1):
        found = replace(still, components=components(claimed))
        assert found.significant_components.sum() == claimed
        assert components_beyond_chance(found).sum() == (claimed if claimed > most else 0)


def test_two_widths_are_one_test() -> None:
    parts = replace(components(0, 1), amount=np.array([0.027]))  # 2.7 standard errors: 0.7 % of one width
    assert not parts.significant(0.99).any()
    assert replace(parts, widths=1).significant(0.99).all()
