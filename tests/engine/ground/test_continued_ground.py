"""Bare ground continued from window to window: what lies on planes from beside, and what only nearly does."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.geometry.plane_cells import Planes
from slopewatch.engine.ground.continued_ground import continued
from slopewatch.tests.builders.ground_shapes import NOISE, field, shares

SIDE, SCATTER = 0.25, 0.034


def followed(xy: np.ndarray, height: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    windows = Planes(xy / SIDE, pool=Planes.ALONE)
    return continued(height, known, np.abs(height) < 0.45, windows, SIDE, SCATTER)


def noisy(height: np.ndarray, seed: int = 1) -> np.ndarray:
    return height + np.random.default_rng(seed).normal(0, NOISE, len(height))


def test_the_top_of_a_step_is_followed_to_its_edge():
    xy = field(8_000, 4.0)
    edge = xy[:, 0] + 0.4 * xy[:, 1] - 2.8
    height = noisy(np.where(edge > 0, 0.16, 0.0))
    known = np.abs(edge) > 0.45
    residual, joined = followed(xy, height, known)
    assert joined[~known & (edge > 0)].mean() > 0.87
    assert not (joined & known).any()
    truth = height - np.where(edge > 0, 0.16, 0.0)
    assert np.abs(residual[joined] - truth[joined]).mean() < 0.012


def test_a_cone_is_followed_from_its_foot_to_its_tip():
    xy = field(16_000, 3.0)
    away = np.hypot(*(xy - 1.5).T)
    height = noisy(np.clip(0.36 * (1 - away / 0.6), 0, None))
    known = away > 0.45
    assert followed(xy, height, known)[1][~known].mean() > 0.95


@pytest.mark.parametrize(("lowest", "highest"), [(0.0, 0.4), (0.1, 0.4)])
def test_returns_in_grass_beside_bare_ground_are_not_ground(lowest, highest):
    xy = field(8_000, 4.0)
    known = xy[:, 0] < 2.0
    grass = np.random.default_rng(2).uniform(lowest, highest, len(xy))
    assert followed(xy, noisy(np.where(known, 0.0, grass)), known)[1].mean() < 0.005


def test_stubble_beside_bare_ground_is_not_its_continuation():
    xy = field(8_000, 4.0)
    known = xy[:, 0] < 2.0
    stubble = np.random.default_rng(2).uniform(0.0, 0.08, len(xy))
    assert not followed(xy, noisy(np.where(known, 0.0, stubble)), known)[1].any()


def test_without_known_ground_nothing_is_continued():
    xy = field(2_000, 3.0)
    height = noisy(np.zeros(len(xy)))
    residual, joined = followed(xy, height, np.zeros(len(xy), dtype=bool))
    assert not joined.any()
    assert np.isinf(residual).all()


def test_leaves_over_a_step_do_not_join_it():
    xy = field(8_000, 4.0)
    top = np.where(xy[:, 0] > 2.0, 0.16, 0.0)
    leaf = np.random.default_rng(3).random(len(xy)) < 0.25
    height = noisy(top + np.where(leaf, np.random.default_rng(4).uniform(0.15, 0.28, len(xy)), 0.0))
    known = (np.abs(xy[:, 0] - 2.0) > 0.4) & ~leaf
    ground = followed(xy, height, known)[1] | known
    recall, precision = shares(ground[top > 0], ~leaf[top > 0])
    assert recall > 0.97
    assert precision > 0.98
