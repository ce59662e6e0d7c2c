"""Places through time from pairs of surveys, against motions and errors that are drawn as the model says."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.series.motion.network import Links, Measured, Noise, adjust, noise_of, own_variances

DAYS = np.array([0.0, 30.0, 60.0, 90.0, 120.0])
VELOCITY = np.array([0.002, -0.001, 0.0002])
SHAPE = np.array([[2.0, 0.5, 0.1], [0.5, 1.5, 0.0], [0.1, 0.0, 0.2]]) * 1e-4  # of a pair's error, m²
REGISTRATION = np.diag([4.0, 4.0, 1.0]) * 1e-6


def drawn(places: int, seed: int = 0, own: float = 0.4, weights=(1, 1, 1, 1, 1), registration: float = 1.0) -> Measured:
    """Vectors of ``VELOCITY`` with noise of each survey, of each pair alone (``own``), and of each registration."""
    rng = np.random.default_rng(seed)
    links, count = Links.of(len(DAYS)), len(DAYS)
    root = np.linalg.cholesky(SHAPE)
    noise = rng.normal(size=(places, count, 3)) * np.sqrt(np.array(weights, dtype=np.float64))[:, None]
    registered = rng.normal(size=(places, count, 3)) @ np.linalg.cholesky(REGISTRATION).T * registration**0.5
    registered[:, 0] = 0.0
    motion, covariance = [], []
    for earlier, later in links.pairs:
        size = (weights[earlier] + weights[later]) / 2
        shared = (noise[:, later] - noise[:, earlier]) * np.sqrt((1 - own) / 2)
        alone = rng.normal(size=(places, 3)) * np.sqrt(own * size)
        way = (DAYS[later] - DAYS[earlier]) * VELOCITY
        motion.append(way + (shared + alone) @ root.T + registered[:, later] - registered[:, earlier])
        covariance.append(np.broadcast_to(size * SHAPE, (places, 3, 3)))
    errors = np.broadcast_to(registration * REGISTRATION, (places, count, 3, 3)).copy()
    errors[:, 0] = 0.0
    return Measured(links, np.stack(motion), np.stack(covariance), errors)


@pytest.mark.parametrize("own", [0.1, 0.5, 0.9])
def test_the_share_that_is_a_pair_s_own_shows_in_triangles_that_do_not_close(own):
    assert noise_of(drawn(2000, own=own)).own == pytest.approx([own] * 3, rel=0.1)


def test_surveys_bring_as_much_noise_as_they_have():
    weights = (1.0, 4.0, 1.0, 2.0, 1.0)
    found = noise_of(drawn(2000, weights=weights)).weights
    assert found / found[0] == pytest.approx(weights, rel=0.05)


@pytest.mark.parametrize("own", [0.1, 0.8])
def test_errors_of_velocities_and_motions_are_as_stated(own):
    measured = drawn(3000, seed=1, own=own)
    found = adjust(measured, noise_of(measured), DAYS)
    off = found.velocity - VELOCITY
    stated = found.velocity_covariance
    assert off.std(axis=0) == pytest.approx(np.sqrt(np.einsum("nii->ni", stated).mean(axis=0)), rel=0.12)
    distance = np.einsum("ni,nij,nj->n", off, np.linalg.inv(stated), off)
    assert 0.94 <= np.mean(distance < 7.815) <= 0.98  # 95 % of three degrees of freedom, never too small
    last = found.motion[:, -1] - DAYS[-1] * VELOCITY
    assert last.std(axis=0) == pytest.approx(np.sqrt(np.diag(found.covariance[0, -1, :, -1])), rel=0.06)
    step = found.motion[:, 3] - found.motion[:, 2] - 30 * VELOCITY
    cross = found.covariance[0, 3, :, 2]
    variance = found.covariance[0, 3, :, 3] + found.covariance[0, 2, :, 2] - cross - cross.T
    assert step.std(axis=0) == pytest.approx(np.sqrt(np.diag(variance)), rel=0.06)


def test_what_vectors_share_counts():
    """Vectors against the first survey, regressed as if their errors were independent, would be too sure."""
    measured = drawn(3000, seed=2, own=0.1, registration=1e-6)
    days = DAYS[1:]
    slopes = np.einsum("k,kn->n", days, measured.motion[:4, :, 0]) / (days @ days)
    feigned = np.sqrt(SHAPE[0, 0] / (days @ days))
    found = adjust(measured, noise_of(measured), DAYS)
    stated = np.sqrt(found.velocity_covariance[:, 0, 0].mean())
    assert slopes.std() > 1.25 * feigned
    assert (found.velocity - VELOCITY)[:, 0].std() == pytest.approx(stated, rel=0.12)


def test_a_survey_is_reached_by_steps_where_it_is_not_seen_from_the_first():
    measured = drawn(400, seed=3)
    motion = measured.motion.copy()
    motion[3] = np.nan  # the first to the last
    motion[:, :50][1] = np.nan  # the first to the third
    motion[4, :50] = np.nan  # the second to the third
    motion[5, :50] = np.nan  # the third to the fourth
    found = adjust(
        Measured(measured.links, motion, measured.covariance, measured.registration), noise_of(measured), DAYS
    )
    assert np.isnan(found.motion[:50, 2]).all()
    assert np.isfinite(found.motion[50:, 2]).all()
    assert np.isfinite(found.motion[:, 4]).all()
    error = found.motion[:, 4] - DAYS[4] * VELOCITY
    assert error.std(axis=0) == pytest.approx(
        np.sqrt(np.einsum("nii->ni", found.covariance[:, 4, :, 4]).mean(axis=0)), rel=0.15
    )


def test_only_surveys_until_the_one_asked_for_count():
    measured = drawn(50, seed=4)
    noise = Noise(np.full(3, 0.4), np.ones(5))
    until = adjust(measured, noise, DAYS, last=2)
    keep = [0, 1, 4]
    links = Links.of(3)
    alone = Measured(links, measured.motion[keep], measured.covariance[keep], measured.registration[:, :3])
    assert [measured.links.pairs[row] for row in keep] == list(links.pairs)
    assert until.velocity == pytest.approx(adjust(alone, Noise(noise.own, np.ones(3)), DAYS[:3]).velocity)
    assert np.isnan(until.motion[:, 3:]).all()


def test_two_surveys_give_their_vector():
    links = Links.of(2)
    motion, covariance = np.array([[[0.1, 0.02, 0.0]]]), SHAPE[None, None]
    found = adjust(
        Measured(links, motion, covariance, np.zeros((1, 2, 3, 3))), Noise(np.full(3, 0.5), np.ones(2)), DAYS[:2]
    )
    assert found.motion[0, 1] == pytest.approx(motion[0, 0])
    assert found.covariance[0, 1, :, 1] == pytest.approx(SHAPE)
    assert found.velocity[0] == pytest.approx(motion[0, 0] / 30)


def test_own_variances_are_those_of_the_differences():
    own = np.array([1.0, 2.0, 0.5, 3.0])
    covariance = np.diag(own) + own[0]
    covariance[0] = covariance[:, 0] = 0.0
    assert own_variances(covariance) == pytest.approx(own)
