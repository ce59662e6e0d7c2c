"""Scores that mean the same at any density and roughness, and the level for a number of false zones."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from slopewatch.engine.geometry.hazard_shapes import smooth_hazard
from slopewatch.lab.benchmarks import screening_ground
from slopewatch.models.preparation.even_scores import LEVELS, even_scores, level_for
from slopewatch.models.preparation.inserted_hazards import insert_hazards, thinned
from slopewatch.models.preparation.raster_zones import Scores, zone_counts
from slopewatch.models.preparation.relief_raster import ReliefRaster, relief_raster
from slopewatch.models.preparation.smallest_hazard import filter_scores


def ground(seed: int, *, side: float = 80.0, density: float = 30.0, rough: float = 0.06) -> np.ndarray:
    """A slope whose relief has the spectrum of natural ground, k^-3 in two dimensions, and 1 cm of noise."""
    rng = np.random.default_rng(seed)
    cells = int(side / 0.25)
    wave = np.hypot(*np.meshgrid(np.fft.fftfreq(cells, 0.25), np.fft.fftfreq(cells, 0.25)))
    power = np.where(wave > 1 / 40, np.maximum(wave, 1e-6) ** -1.5, 0.0)
    relief = np.fft.ifft2(np.fft.fft2(rng.normal(size=(cells, cells))) * power).real
    relief *= rough / (relief - gaussian_filter(relief, 16)).std()
    xy = rng.uniform(0, side - 0.01, (round(density * side**2), 2))
    i, j = (xy / 0.25).astype(int).T
    return np.column_stack([xy, relief[i, j] + rng.normal(0, 0.01, len(xy))])


def rate(flat: np.ndarray, level: float) -> float:
    scores = even_scores(relief_raster(flat))
    return 1000 * zone_counts(scores, np.array([level]))[0] / scores.area


def test_the_same_ground_has_as_many_false_zones_at_any_density() -> None:
    flat = ground(0)
    rates = [rate(flat[thinned(flat, density, np.random.default_rng(1))], 3.0) for density in (30.0, 8.0, 2.0)]
    assert rates[0] > 1.0
    assert max(rates) < 2.2 * min(rates)


def test_the_same_ground_ten_times_as_rough_has_as_many_false_zones() -> None:
    flat = ground(1)
    rough = flat * [1, 1, 10]
    assert rate(rough, 3.0) == pytest.approx(rate(flat, 3.0), rel=0.3)


def test_a_hazard_hardly_hides_itself() -> None:
    flat = ground(2, rough=0.02)
    scene = insert_hazards(flat, [smooth_hazard(0.6, 4.0, np.random.default_rng(0))], np.random.default_rng(0))
    raster = relief_raster(scene.flat)
    scores = even_scores(raster)
    (one,) = scene.hazards
    i, j = raster.index(np.array([[one.shape.u, one.shape.w]]))
    assert scores.uplift[i[0], j[0]] > 1.5 * level_for(1.0)
    assert scores.subsidence[i[0], j[0]] < 0


def test_fewer_false_zones_need_a_higher_level() -> None:
    levels = [level_for(rate) for rate in (0.1, 0.15, 0.5, 1.0, 1.5, 10.0)]
    assert levels == sorted(levels, reverse=True)
    assert level_for(1.0) == LEVELS[1.0]
    assert LEVELS[2.0] < level_for(1.4) < LEVELS[1.0]


def test_nothing_is_known_where_nothing_could_be_fitted() -> None:
    scores = even_scores(relief_raster(np.random.default_rng(0).uniform(0, 3, (6, 3))))
    assert np.isnan(scores.uplift).all()


def test_one_level_holds_on_dense_and_sparse_real_ground(shared_data: Path) -> None:
    """Gullies of 10 points/m² and forest ground of 1: t as it is has many times as many false zones on the first."""
    places = [one for one in screening_ground._clouds(extract=False) if one.group in ("santa_cruz", "british_columbia")]
    rasters = [(one.group, relief_raster(one.flat)) for one in places]

    def false(group: str, scores: Callable[[ReliefRaster], Scores], level: float) -> float:
        mine = [scores(raster) for name, raster in rasters if name == group]
        return 1000 * sum(zone_counts(one, np.array([level]))[0] for one in mine) / sum(one.area for one in mine)

    dense, sparse = (false(group, even_scores, level_for(1.0)) for group in ("santa_cruz", "british_columbia"))
    assert 0.2 <= sparse <= 2.0
    assert 0.2 <= dense <= 2.0
    dense, sparse = (false(group, filter_scores, 10.0) for group in ("santa_cruz", "british_columbia"))
    assert dense > 10 * sparse
