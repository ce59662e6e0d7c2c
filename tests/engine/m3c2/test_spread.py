"""What uneven sampling makes of a mean, against planes of known tilt and least squares."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.m3c2.distances import Cylinder, cylinder_statistics
from slopewatch.engine.m3c2.lattice import Lattice
from slopewatch.engine.m3c2.spread import Spread, across, explained_squares, tilt_of, uneven_sampling

UTM = np.array([512_345.678, 4_234_567.891, 1234.5])
RADIUS, HALF_LENGTH = 1.0, 2.0


def tilted(seed: int, centre: tuple[float, float], *, height: float = 0.0, noise: float = 0.0) -> np.ndarray:
    """Points around ``centre`` on a plane that rises 0.3 m a metre eastwards and falls 0.1 m northwards."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-0.3, 0.3, (200, 2)) + centre
    z = xy @ [0.3, -0.1] + height + rng.normal(0, noise, 200)
    return np.column_stack([xy, z]) + UTM


def measured(cloud: np.ndarray, axis: np.ndarray):
    return cylinder_statistics(
        Lattice(cloud, RADIUS), UTM[None], axis[None], Cylinder(RADIUS, HALF_LENGTH), spread=True
    )


def uneven(first: Spread, second: Spread) -> float:
    return float(uneven_sampling(first, second)[0])


def test_the_directions_are_square_to_the_axis_and_to_each_other():
    rng = np.random.default_rng(0)
    unit = np.vstack([rng.normal(size=(50, 3)), np.eye(3), -np.eye(3)])
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    frames = np.stack([*across(unit), unit], axis=1)
    np.testing.assert_allclose(frames @ frames.transpose(0, 2, 1), np.tile(np.eye(3), (len(unit), 1, 1)), atol=1e-12)
    assert not np.any(across(np.zeros((1, 3))))


def test_one_plane_seen_at_two_places_differs_by_its_tilt():
    """The two means differ because the points are at other places, and by as much; what rose adds nothing."""
    up = np.array([0.0, 0.0, 1.0])
    first, second = measured(tilted(1, (-0.2, 0.0)), up), measured(tilted(2, (0.3, 0.1), height=0.25), up)
    places = [tilted(1, (-0.2, 0.0)), tilted(2, (0.3, 0.1))]
    expected = (places[1] - places[0]).mean(axis=0)[:2] @ [0.3, -0.1]
    assert expected == pytest.approx(0.14, abs=0.02)
    assert uneven(first.spread, second.spread) == pytest.approx(expected, rel=0.005)
    assert second.mean[0] - first.mean[0] == pytest.approx(expected + 0.25, rel=1e-6)


def test_tilts_are_those_of_least_squares_and_the_smaller_effect_counts():
    axis = np.array([0.3, -0.2, 0.9])
    axis /= np.linalg.norm(axis)
    clouds = [tilted(3, (-0.2, 0.1), noise=0.05), tilted(4, (0.25, -0.1), height=0.1, noise=0.05)]
    made = [measured(cloud, axis) for cloud in clouds]
    frame = np.linalg.svd(axis[None])[2][1:]  # any other two directions
    places, along = zip(*(((cloud - UTM) @ frame.T, (cloud - UTM) @ axis) for cloud in clouds), strict=True)
    rows, heights = ([v - v.mean(axis=0) for v in values] for values in (places, along))
    apart = places[1].mean(axis=0) - places[0].mean(axis=0)
    effects = [apart @ np.linalg.lstsq(r, h, rcond=None)[0] for r, h in zip(rows, heights, strict=True)]
    assert uneven(made[0].spread, made[1].spread) == pytest.approx(min(effects, key=abs), rel=0.01)
    # and the scatter that stays about the plane through both
    common = np.linalg.lstsq(np.vstack(rows), np.concatenate(heights), rcond=None)[0]
    for one, row, height in zip(made, rows, heights, strict=True):
        taken = explained_squares(one.spread, tilt_of(made[0].spread, made[1].spread))[0]
        left = np.sum((height - row @ common) ** 2)
        assert (one.count[0] - 1) * one.std[0] ** 2 - taken == pytest.approx(left, rel=0.001)


def test_a_tilt_of_one_survey_alone_is_no_uneven_sampling():
    """As where the later one holds the edge of what slid."""
    level = Spread(np.array([[0.0, 0.0]]), np.array([[1.0, 1.0, 0.0, 0.0, 0.0]]))
    edge = Spread(np.array([[0.3, 0.0]]), np.array([[1.0, 1.0, 0.0, 0.5, 0.0]]))
    against = Spread(np.array([[0.0, 0.0]]), np.array([[1.0, 1.0, 0.0, -0.2, 0.0]]))
    assert uneven(level, edge) == 0.0
    assert uneven(against, edge) == 0.0
    less = Spread(np.array([[0.0, 0.0]]), np.array([[1.0, 1.0, 0.0, 0.2, 0.0]]))
    assert uneven(less, edge) == pytest.approx(0.2 * 0.3, rel=0.01)


def test_points_on_a_line_fix_no_tilt_across_it_and_empty_cylinders_none():
    line = Spread(np.array([[0.0, 0.0]]), np.array([[1.0, 0.0, 0.0, 0.2, 0.0]]))
    beside = Spread(np.array([[0.0, 0.4]]), np.array([[1.0, 0.0, 0.0, 0.2, 0.0]]))
    assert uneven(line, beside) == 0.0
    empty = Spread(np.full((1, 2), np.nan), np.zeros((1, 5)))
    assert uneven(line, empty) == 0.0
