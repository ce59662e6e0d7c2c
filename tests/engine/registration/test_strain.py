"""A survey that is stretched in plan: the stretch is measured, and the errors cover what one motion leaves of it."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.registration.register import register
from slopewatch.engine.registration.strain import estimated_strain
from slopewatch.interface.parameters import RegistrationParameters

PATCHES, BLOCKS, NOISE = 400, 40, 0.002


def asked(seed: int, strain: np.ndarray) -> tuple[np.ndarray, ...]:
    """Equations of patches that face all ways, on a slope of 40 m, with the gaps that a ``strain`` (3, 3) makes."""
    rng = np.random.default_rng(seed)
    centre = rng.uniform(-20, 20, (PATCHES, 3)) * [1, 1, 0.2]
    normal = rng.normal([0, 0, 1], [0.5, 0.5, 0.2], (PATCHES, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    jacobian = np.hstack([np.cross(centre, normal) / 10, normal]) / NOISE
    gap = (np.einsum("ni,ij,nj->n", normal, strain, centre) + rng.normal(0, NOISE, PATCHES)) / NOISE
    block = rng.integers(0, BLOCKS, PATCHES)
    return jacobian[:, :, None] * jacobian[:, None, :], jacobian * gap[:, None], centre, block


def ground(seed: int) -> np.ndarray:
    """Waves in both directions over 30 m, with 1 cm of noise."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-15, 15, (2, 54_000))
    z = 0.4 * np.sin(1.3 * x) * np.cos(0.9 * y) + 0.2 * np.sin(0.8 * x + 2.1 * y)
    return np.column_stack([x, y, z + rng.normal(0, 0.01, x.size)])


def test_a_stretch_is_measured_and_what_it_displaces_follows():
    true = np.array([[8e-4, 2e-4, 0], [2e-4, 1e-4, 0], [0, 0, 0]])
    found = estimated_strain(*asked(1, -true))
    assert found is not None
    assert found.components == pytest.approx([8e-4, 1e-4, 2e-4], abs=1e-4)
    assert found.largest == pytest.approx(np.linalg.eigvalsh(true)[-1], abs=1e-4)
    places = np.random.default_rng(2).uniform(-20, 20, (1000, 3))
    moved = (places - found.centre) @ true.T
    assert np.trace(found.displacement(places)) == pytest.approx(np.mean(np.sum(moved**2, axis=1)), rel=0.25)


def test_errors_alone_are_no_stretch():
    claims = [estimated_strain(*asked(seed, np.zeros((3, 3)))) is not None for seed in range(100)]
    assert sum(claims) <= 1


def test_a_stretched_survey_is_named_and_its_error_covers_what_the_motion_leaves():
    """Along x by 0.1 %, which is 15 mm at the edge."""
    true = ground(2)
    plain = register(ground(1), true, RegistrationParameters())
    assert not any("stretched" in sentence for sentence in plain.warnings)
    later = true * [0.999, 1.0, 1.0]
    found = register(ground(1), later, RegistrationParameters())
    sentence = next(sentence for sentence in found.warnings if "stretched" in sentence)
    assert float(sentence.split("%")[0].split()[-1]) == pytest.approx(-0.1, abs=0.02)
    error = float(np.sqrt(np.mean(np.sum((found.transform.apply(later) - true) ** 2, axis=1))))
    assert found.covariance is not None
    stated = float(np.sqrt(np.trace(found.covariance[3:, 3:])))
    assert error / 2 < stated < 2 * error
    assert plain.covariance is not None
    assert np.trace(plain.covariance[3:, 3:]) < (error / 2) ** 2
