"""Top view against loops over the points."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.maps.relief import shaded_relief
from slopewatch.engine.maps.top_view import project, top_view_grid
from slopewatch.engine.statistics.layout import bands

GRID = Grid(west=100.0, north=210.0, cell=0.5, rows=20, columns=24)


def cloud(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Points in and around the grid, and their colours."""
    random = np.random.default_rng(seed)
    xyz = np.column_stack((random.uniform(98, 114, n), random.uniform(198, 212, n), random.normal(50, 5, n)))
    return xyz, random.integers(1, 256, (n, 3)).astype(np.uint8)


def full_cover() -> np.ndarray:
    """One point in the middle of every pixel."""
    rows, columns = np.indices(GRID.shape)
    return np.column_stack((100.25 + 0.5 * columns.ravel(), 209.75 - 0.5 * rows.ravel(), np.zeros(rows.size)))


def test_highest_point_of_each_pixel() -> None:
    xyz, rgb = cloud(900)
    expected = np.zeros((*GRID.shape, 4), dtype=np.uint8)
    highest = np.full(GRID.shape, -np.inf)
    for (x, y, z), colour in zip(xyz, rgb, strict=True):
        i, j = int(np.floor((210.0 - y) / 0.5)), int(np.floor((x - 100.0) / 0.5))
        if 0 <= i < 20 and 0 <= j < 24 and z > highest[i, j]:
            highest[i, j] = z
            expected[i, j] = (*colour, 255)
    assert (expected[..., 3] == 0).any()
    view = project(xyz, GRID, rgb=rgb, fill_distance=0)
    assert view.source == "rgb"
    assert np.array_equal(view.rgba, expected)


def without(*pixels: tuple[slice, slice]) -> tuple[np.ndarray, np.ndarray]:
    """A full cover with gaps; red grows with the column."""
    xyz = full_cover()
    keep = np.ones(GRID.shape, dtype=bool)
    for pixel in pixels:
        keep[pixel] = False
    rgb = np.zeros((len(xyz), 3), dtype=np.uint8)
    rgb[:, 0] = np.tile(np.arange(24) * 10, 20)
    return xyz[keep.ravel()], rgb[keep.ravel()]


def test_a_hole_takes_the_mean_of_its_neighbours() -> None:
    xyz, rgb = without((slice(5, 6), slice(7, 8)))
    view = project(xyz, GRID, rgb=rgb)
    assert view.rgba[5, 7].tolist() == [70, 0, 0, 255]
    assert (view.rgba[..., 3] == 255).all()


def test_only_narrow_gaps_are_filled() -> None:
    narrow, wide = (slice(2, 6), slice(3, 20)), (slice(10, 15), slice(3, 20))
    xyz, rgb = without(narrow, wide)
    alpha = project(xyz, GRID, rgb=rgb).rgba[..., 3]
    assert (alpha[narrow] == 255).all()
    assert (alpha[12, 5:18] == 0).all()


def test_the_outline_does_not_grow() -> None:
    outside = (slice(0, 20), slice(15, 24))
    xyz, rgb = without(outside)
    view = project(xyz, GRID, rgb=rgb)
    assert not view.rgba[outside].any()
    assert (view.rgba[:, :15, 3] == 255).all()


def test_intensity_is_stretched_grey() -> None:
    xyz = full_cover()
    intensity = np.arange(len(xyz)).astype(np.uint16)
    view = project(xyz, GRID, rgb=np.zeros((len(xyz), 3), np.uint8), intensity=intensity)
    assert view.source == "intensity"
    grey = view.rgba[..., 0].ravel().astype(int)
    assert np.array_equal(view.rgba[..., 0], view.rgba[..., 2])
    assert (np.diff(grey) >= 0).all()
    assert (grey[0], grey[-1]) == (0, 255)
    assert grey[len(grey) // 2] == pytest.approx(127, abs=2)


def test_without_colours_relief_lit_from_the_north_west() -> None:
    xyz = full_cover()
    xyz[:, 2] = 5.0 - np.abs(xyz[:, 0] - 106.0)  # a ridge that runs north
    view = project(xyz, GRID, intensity=np.full(len(xyz), 7, np.uint16))
    assert view.source == "height"
    brightness = view.rgba[..., :3].mean(axis=2)
    west_face, east_face = brightness[10, 4], brightness[10, 19]  # at the same height
    assert west_face > east_face + 50


def test_relief_of_a_plane_is_lamberts_cosine() -> None:
    rows, columns = np.indices((9, 9))
    tilt = np.tan(np.radians(30.0))
    flat = shaded_relief(np.zeros((9, 9)), 1.0)[4, 4, 0]
    facing = shaded_relief(tilt * (columns + rows) / np.sqrt(2), 1.0)[4, 4]  # falls towards the north-west
    averted = shaded_relief(-tilt * (columns + rows) / np.sqrt(2), 1.0)[4, 4]
    # light 45 degrees high: it meets these faces at 45 - 30 and 45 + 30 degrees to their normals
    base = (facing[0] - averted[0]) / (np.cos(np.radians(15)) - np.cos(np.radians(75))) / 0.9
    middle = 0.5 * (150.0 + 236.0)
    assert base == pytest.approx(middle, rel=0.01)
    assert flat == pytest.approx(150.0 * (0.35 + 0.9 * np.cos(np.radians(45))), rel=0.01)


def test_relief_beside_gaps_is_finite() -> None:
    heights = np.arange(25.0).reshape(5, 5)
    heights[2, 2] = np.nan
    heights[0, :] = np.nan
    assert np.isfinite(shaded_relief(heights, 0.5)).all()


def test_grid_of_the_picture_covers_the_change() -> None:
    grid = Grid(west=0.3, north=9.9, cell=0.3, rows=33, columns=10)
    same = top_view_grid(grid, 0.3)
    assert same.shape == grid.shape
    coarse = top_view_grid(grid, 0.4)
    assert coarse.shape == (25, 8)
    assert (coarse.west, coarse.north, coarse.cell) == (0.3, 9.9, 0.4)


def test_no_point_on_the_grid() -> None:
    xyz, rgb = cloud(50)
    view = project(xyz + 1000.0, GRID, rgb=rgb)
    assert not view.rgba.any()


def test_relief_in_lines_is_that_of_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    random = np.random.default_rng(1)
    heights = 0.1 * random.normal(size=(53, 40)).cumsum(axis=0)
    heights[random.random(heights.shape) < 0.2] = np.nan
    whole = shaded_relief(heights, 0.1)
    monkeypatch.setattr("slopewatch.engine.maps.relief._AT_ONCE", 7 * 40)
    assert np.array_equal(shaded_relief(heights, 0.1), whole)


@pytest.mark.parametrize("source", ["rgb", "intensity", "height"])
def test_in_bands_the_picture_is_the_same(source: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bands of three lines, from which gaps of four pixels reach on."""
    xyz, rgb = cloud(250, seed=3)
    xyz[:40, 2] = 60.0  # equally high ones
    given = {"rgb": rgb} if source == "rgb" else {"intensity": rgb[:, 0]} if source == "intensity" else {}
    whole = project(xyz, GRID, **given)
    assert whole.source == source
    assert 0.3 < (whole.rgba[..., 3] > 0).mean() < 0.95
    monkeypatch.setattr("slopewatch.engine.maps.top_view.bands", lambda shape: bands(shape, 3 * GRID.columns))
    assert np.array_equal(project(xyz, GRID, **given).rgba, whole.rgba)
