"""The map of what can be found: rougher and sparser ground needs more, and hazards at it are found as often as said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slopewatch.engine.geometry.hazard_shapes import smooth_hazard
from slopewatch.models.preparation.even_scores import even_scores
from slopewatch.models.preparation.inserted_hazards import UPLIFT, footprint, insert_hazards
from slopewatch.models.preparation.raster_zones import strength_at
from slopewatch.models.preparation.relief_raster import relief_raster
from slopewatch.models.preparation.smallest_hazard import smallest_hazard


def slope(seed: int, *, width: float = 60.0, density: float = 8.0, rough: float = 0.04) -> np.ndarray:
    """Ground with relief of 2 to 12 m of wavelength and noise of 2 cm."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, width, (round(density * width**2), 2))
    z = rng.normal(0, 0.02, len(xy))
    for _ in range(60):
        length, angle, phase = rng.uniform(2, 12), *rng.uniform(0, 2 * np.pi, 2)
        along = xy[:, 0] * np.cos(angle) + xy[:, 1] * np.sin(angle)
        z += rough * np.sqrt(2 / 60) * np.sin(2 * np.pi * along / length + phase)
    return np.column_stack([xy, z])


def test_rough_and_sparse_ground_needs_higher_hazards() -> None:
    # On smooth ground it is the noise that hides hazards, which many points average out.
    usual, rough, smooth, sparse = (
        smallest_hazard(relief_raster(slope(0, **change)))
        for change in ({}, {"rough": 0.12}, {"rough": 0.005}, {"rough": 0.005, "density": 2.0})
    )
    for k in range(4):
        assert np.nanmedian(rough.heights[k]) > 1.8 * np.nanmedian(usual.heights[k])
    assert np.nanmedian(sparse.heights[0]) > 1.3 * np.nanmedian(smooth.heights[0])
    assert usual.share_below(0.6, 3.0) > rough.share_below(0.6, 3.0)
    assert usual.share_below(9.0, 3.0) == pytest.approx(1.0, abs=0.05)


def test_half_a_slope_that_is_rough_is_told_apart() -> None:
    flat = slope(1)
    left = flat[:, 0] < 30
    flat[:, 2] = np.where(left, flat[:, 2], 3 * flat[:, 2])
    found = smallest_hazard(relief_raster(flat))
    assert np.nanmedian(found.heights[1, 80:110]) > 1.8 * np.nanmedian(found.heights[1, 10:40])
    assert found.at(20, 40, 4.0) == pytest.approx((found.at(20, 40, 3.0) + found.at(20, 40, 5.0)) / 2, rel=1e-6)


def test_more_accepted_false_zones_find_lower_hazards() -> None:
    raster = relief_raster(slope(2))
    few, usual, many = (smallest_hazard(raster, accepted).heights for accepted in (0.1, 1.0, 10.0))
    assert np.nanmedian(few) > 1.5 * np.nanmedian(usual) > 2.2 * np.nanmedian(many)


def test_hazards_at_the_map_are_found_about_as_often_as_it_says() -> None:
    found = []
    for seed in range(2):
        flat = slope(10 + seed, rough=0.08)
        needed = smallest_hazard(relief_raster(flat))
        rng = np.random.default_rng(seed)
        heights = np.nanmedian(needed.heights, axis=(1, 2))
        wanted = [
            smooth_hazard((-1) ** k * float(height), diameter, rng)
            for k in range(5)
            for height, diameter in zip(heights, needed.diameters)
        ]
        scene = insert_hazards(flat, wanted, rng)
        raster = relief_raster(scene.flat)
        scores = even_scores(raster)
        for one in scene.hazards:
            up, down = footprint(one.shape, raster.origin, raster.cell, raster.shape)
            score, mine = (scores.uplift, up) if one.label == UPLIFT else (scores.subsidence, down)
            found.append(strength_at(score, mine, raster.cell) > needed.level)
    assert len(found) >= 30
    assert 0.5 <= np.mean(found) <= 0.95


def test_nothing_can_be_said_without_points() -> None:
    flat = np.random.default_rng(0).uniform(0, 3, (6, 3))
    found = smallest_hazard(relief_raster(flat))
    assert np.isnan(found.heights).all()
    assert np.isnan(found.at(0, 0, 3.0))
    partly = replace(found, heights=np.array([np.nan, 0.3, 0.5, np.nan], dtype=np.float32)[:, None, None])
    said = [partly.at(0, 0, diameter) for diameter in (2.0, 2.5, 3.0, 4.0, 5.0, 9.0)]
    assert said == pytest.approx([np.nan, np.nan, 0.3, 0.4, 0.5, np.nan], nan_ok=True)
    assert found.share_below(1.0, 3.0) == 0.0
