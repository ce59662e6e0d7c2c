"""The closed form against LAPACK's eigenvalues and vectors."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.geometry.principal_axes import thinnest


def sets(name: str) -> np.ndarray:
    """(2000, 12, 3) points about the origin."""
    points = np.random.default_rng(1).normal(size=(2000, 12, 3))
    if name == "discs":  # as wide in all directions of the plane, hardly any thickness
        turn = 2 * np.pi * np.arange(12) / 12
        points = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(12)]) + 1e-3 * points
    elif name == "planes":
        points *= [1.0, 0.5, 0.0]
    elif name == "strips":
        points *= [1.0, 0.05, 0.005]
    elif name == "small":
        points *= 1e-4
    turns = np.linalg.qr(np.random.default_rng(2).normal(size=(len(points), 3, 3)))[0]
    points = points @ turns
    return points - points.mean(axis=1)[:, None]


def closed_form(matrices: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return thinnest(*(matrices[:, i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))))


@pytest.mark.parametrize("name", ["clouds", "discs", "planes", "strips", "small"])
def test_thinnest_is_that_of_lapack(name):
    points = sets(name)
    matrices = points.transpose(0, 2, 1) @ points
    values, vectors = np.linalg.eigh(matrices)
    smallest, middle, vector = closed_form(matrices)
    assert np.linalg.norm(vector, axis=1) == pytest.approx(1.0)
    assert np.abs(smallest - values[:, 0]).max() < 1e-12 * values[:, 2].max()
    assert np.abs(middle - values[:, 1]).max() < 1e-7 * values[:, 2].max()
    # two nearly alike thicknesses leave the direction to the last digits
    clear = values[:, 1] - values[:, 0] > 1e-3 * values[:, 2]
    assert clear.mean() > 0.85
    assert np.abs(np.einsum("ni,ni->n", vector, vectors[:, :, 0]))[clear].min() > 1 - 1e-9


def test_points_on_a_line_have_a_direction_across_it_and_one_place_has_one_upwards():
    line = np.array([1.0, 2.0, -2.0]) / 3
    smallest, middle, vector = closed_form(np.stack([np.outer(line, line), np.zeros((3, 3))]))
    assert np.isfinite(vector).all()
    assert max(*smallest, *middle) < 1e-7
    assert vector[1] == pytest.approx([0.0, 0.0, 1.0])
