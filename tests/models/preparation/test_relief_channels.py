"""Channels of the raster network on ground of known shape: what must not change them, and what must."""

from dataclasses import replace

import numpy as np
import pytest
from slopewatch.models.preparation.bump_filter import CellHeights, bump, cell_heights
from slopewatch.models.preparation.relief_channels import (
    CHANNELS,
    SIGNED,
    TREND_REACHES_M,
    hiding_scatter,
    relief_channels,
    upside_down,
)

SIDE = 80


def lattice(points: np.ndarray) -> CellHeights:
    return cell_heights(points, 0.5, np.zeros(2), (SIDE, SIDE))


def rolling(density: float = 8.0, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, SIDE / 2, (round(density * (SIDE / 2) ** 2), 2))
    z = 0.2 * np.sin(xy[:, 0] / 2.1) * np.cos(xy[:, 1] / 1.7) + rng.normal(0, 0.03, len(xy))
    return np.column_stack([xy, z])


def test_shift_tilt_and_height_unit_change_nothing() -> None:
    points = rolling()
    found = relief_channels(lattice(points)).channels
    tilted = points.copy()
    tilted[:, 2] += 87.0 + 0.4 * points[:, 0] - 0.3 * points[:, 1]
    moved = relief_channels(lattice(tilted)).channels
    signed = len(SIGNED)
    # Cells bring points to their middle by a plane of their own, which a prior pulls a little towards level.
    assert np.abs(moved[:signed] - found[:signed]).mean() < 0.03
    assert np.abs(moved[signed:-2] - found[signed:-2]).max() < 0.2
    cells = lattice(points)
    taller = relief_channels(replace(cells, height=3.0 * cells.height, scatter=3.0 * cells.scatter)).channels
    np.testing.assert_allclose(taller[:signed], found[:signed], atol=0.02)
    np.testing.assert_allclose(taller[signed] - found[signed], np.log(3.0), atol=1e-3)
    np.testing.assert_allclose(taller[signed + 1 : -2], found[signed + 1 : -2], atol=1e-3)


def test_on_full_cells_a_tilt_changes_nothing_at_all() -> None:
    rng = np.random.default_rng(2)
    height = rng.normal(0, 0.1, (SIDE, SIDE))
    full = CellHeights(height, np.full_like(height, 4.0), np.full_like(height, 0.02), np.zeros(2), 0.5)
    i, j = np.ogrid[:SIDE, :SIDE]
    tilted = replace(full, height=height + 5.0 + 0.3 * i - 0.2 * j)
    np.testing.assert_allclose(relief_channels(tilted).channels, relief_channels(full).channels, atol=2e-4)


def test_upside_down_the_signed_channels_change_their_sign() -> None:
    cells = lattice(rolling())
    mirrored = relief_channels(replace(cells, height=-cells.height)).channels
    np.testing.assert_allclose(mirrored, upside_down(relief_channels(cells).channels), atol=1e-5)


@pytest.mark.parametrize("number", range(len(TREND_REACHES_M)))
def test_a_bump_stands_out_over_trends_wider_than_it(number: int) -> None:
    points = rolling()
    points[:, 2] = np.random.default_rng(3).normal(0, 0.03, len(points))
    reach = TREND_REACHES_M[number]
    middle = np.array([20.25, 20.25])
    points[:, 2] += 0.6 * bump(np.hypot(*(points[:, :2] - middle).T), reach)
    relief = relief_channels(lattice(points)).channels[number + 1]
    assert relief[40, 40] > 3.5
    assert relief[40, 40] > 1.5 * np.abs(relief[5:25, 5:-5]).max()


@pytest.mark.parametrize(("name", "across"), [("relief 10 x 0.35 m", 1), ("relief 0.35 x 10 m", 0)])
def test_a_band_follows_what_runs_along_it_and_not_a_bump(name: str, across: int) -> None:
    """A ridge of 2 m width along the whole ground, and a bump as wide and high on a place of its own."""
    points = rolling()
    points[:, 2] = np.random.default_rng(3).normal(0, 0.03, len(points))
    off = points[:, :2] - (20.25, 20.25)
    ridge, single = points.copy(), points.copy()
    ridge[:, 2] += 0.5 * bump(np.abs(off[:, across]), 1.0)
    single[:, 2] += 0.5 * bump(np.hypot(*off.T), 1.0)
    number = CHANNELS.index(name)
    of_ridge, of_bump = (relief_channels(lattice(p)).channels[number, 38:43, 38:43].mean() for p in (ridge, single))
    assert of_bump > 2.0
    assert abs(of_ridge) < 0.5 * of_bump


def test_channels_are_named_and_zero_without_data() -> None:
    points = rolling()
    points = points[np.hypot(points[:, 0] - 20, points[:, 1] - 20) > 6]
    relief = relief_channels(lattice(points))
    assert relief.channels.shape == (len(CHANNELS), SIDE, SIDE)
    assert not relief.covered[40, 40]
    assert not relief.channels[:, 40, 40].any()
    assert np.isfinite(relief.channels).all()
    density = relief.channels[CHANNELS.index("log density")]
    assert np.median(density[:20]) == pytest.approx(np.log(8 / 10), abs=0.12)


def test_rough_ground_has_a_larger_unit_only_where_it_is_rough() -> None:
    points = rolling()
    rng = np.random.default_rng(4)
    points[:, 2] = rng.normal(0, 1, len(points)) * np.where(points[:, 0] > 20, 0.2, 0.02)
    cells = lattice(points)
    unit = relief_channels(cells).unit
    assert np.median(unit[60:]) > 3 * np.median(unit[:20])
    hiding = hiding_scatter(cells)
    assert (hiding <= unit * 1.0001).all()
    assert np.median(hiding[60:]) > 3 * np.median(hiding[:20])


def test_benches_hide_no_hazard_that_is_shorter_than_they_are() -> None:
    """Steps of half a metre all along the slope, and a bump of 30 cm on one of them."""
    points = rolling()
    points[:, 2] = np.random.default_rng(5).normal(0, 0.02, len(points)) + 0.5 * np.sin(points[:, 1] * 2 * np.pi / 8.0)
    cells = lattice(points)
    assert np.median(hiding_scatter(cells)) < 0.2 * np.median(relief_channels(cells).unit)
    points[:, 2] += 0.3 * bump(np.hypot(*(points[:, :2] - (20.25, 20.25)).T), 1.5)
    channels = relief_channels(lattice(points)).channels
    for name in ("relief 10 x 0.35 m", "bump 3 m off benches"):
        channel = np.abs(channels[CHANNELS.index(name)])
        assert channel[39:42, 39:42].max() > 1.3 * np.quantile(channel[5:30, 5:-5], 0.99)
