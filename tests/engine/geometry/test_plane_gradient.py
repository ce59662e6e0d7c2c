"""Gradients of planes, against least squares."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.geometry.plane_gradient import gradient_parts


def sums(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, ...]:
    """Sums of products about the means over the last axis: xx, yy, xy, xz, yz."""
    x, y, z = (v - v.mean(axis=-1, keepdims=True) for v in (x, y, z))
    return tuple((a * b).sum(axis=-1) for a, b in ((x, x), (y, y), (x, y), (x, z), (y, z)))


def test_it_is_that_of_least_squares():
    x, y, z = np.random.default_rng(2).normal(size=(3, 200, 7))
    east, north, determinant = gradient_parts(*sums(x, y, z))
    for k in range(200):
        design = np.column_stack([x[k], y[k], np.ones(7)])
        expected = np.linalg.lstsq(design, z[k], rcond=None)[0][:2]
        assert (east[k] / determinant[k], north[k] / determinant[k]) == pytest.approx(tuple(expected), rel=1e-6)


def test_places_in_a_line_fix_nothing():
    x = np.arange(5.0)
    assert gradient_parts(*sums(x, 2.0 * x, x**2))[2] == pytest.approx(0.0, abs=1e-12)
