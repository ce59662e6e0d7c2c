"""The map of motion along the surface: arrows, ellipses and the reference arrow are as long as they say."""

from __future__ import annotations

import re

import geopandas as gpd
import numpy as np
import pytest
from matplotlib.collections import EllipseCollection
from matplotlib.patches import FancyArrow
from matplotlib.quiver import Quiver
from shapely.geometry import box
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.maps.displacement_styles import magnification
from slopewatch.engine.maps.motion_map import Arrows, MotionMap, motion_figure

GRID = Grid(500_000.0, 3_000_040.0, 2.0, 20, 30)
TIMES = 20.0


def zones(count: int) -> gpd.GeoDataFrame:
    table = {
        "zone_id": [f"M{k:03d}" for k in range(1, count + 1)],
        "east_m": 0.1, "north_m": -0.05, "err_major_m": 0.02, "err_minor_m": 0.01, "err_azimuth_deg": 30.0,
    }  # fmt: skip
    places = [box(500_010 + 20 * k, 3_000_010, 500_020 + 20 * k, 3_000_020) for k in range(count)]
    return gpd.GeoDataFrame(table, geometry=places, crs=32651)


def shown(count: int = 12, *, zone_count: int = 1, grid: Grid = GRID) -> MotionMap:
    rng = np.random.default_rng(3)
    west, south, east, north = grid.bounds
    places = np.column_stack([rng.uniform(west, east, count), rng.uniform(south, north, count)])
    ellipse = np.column_stack(
        [rng.uniform(0.02, 0.03, count), rng.uniform(0.01, 0.02, count), rng.uniform(0, 180, count)]
    )
    vectors = Arrows(places, rng.normal(0, 0.1, (count, 2)), ellipse)
    unseen = rng.uniform(size=grid.shape) < 0.3
    return MotionMap(grid, ~unseen, unseen, None, vectors, zones(zone_count), TIMES)


def drawn(figure, kind):
    return figure.findobj(kind)


def test_arrows_and_ellipses_are_magnified_alike():
    given = shown()
    figure = motion_figure(given, ("2024-05-01", "2025-05-01"))
    red = next(q for q in drawn(figure, Quiver) if len(q.U) == 12)
    np.testing.assert_allclose(np.column_stack([red.U, red.V]), TIMES * given.vectors.motion)
    ellipses = next(e for e in drawn(figure, EllipseCollection) if len(e.get_offsets()) == 12)
    np.testing.assert_allclose(ellipses.get_offsets(), given.vectors.places + TIMES * given.vectors.motion)
    # whole axes of two standard errors
    np.testing.assert_allclose(ellipses.get_widths(), 4 * TIMES * given.vectors.ellipse[:, 0])
    np.testing.assert_allclose(ellipses.get_angles() % 180, (90 - given.vectors.ellipse[:, 2]) % 180)


@pytest.mark.parametrize("grid", [GRID, Grid(500_000.0, 3_000_200.0, 2.0, 100, 20)], ids=["wide", "tall"])
def test_the_reference_arrow_is_as_long_as_it_says(grid: Grid):
    figure = motion_figure(shown(grid=grid), ("a", "b"))
    (arrow,) = drawn(figure, FancyArrow)
    inches = np.ptp(arrow.get_xy()[:, 0])
    words = [text.get_text() for text in figure.texts]
    named = [word for word in words if re.fullmatch(r"[\d.]+ (m|mm)", word) and word != "0"]
    axes = next(a for a in figure.axes if a.get_label() == "map")
    scale = axes.get_position().width * figure.get_size_inches()[0] / np.ptp(axes.get_xlim())
    lengths = [float(word.split()[0]) * (0.001 if word.endswith("mm") else 1.0) for word in named]
    assert any(length * scale * TIMES == pytest.approx(inches, rel=0.01) for length in lengths)
    assert "Arrows 20 times as long as the motion," in words


def test_what_is_not_known_is_veiled_and_nothing_else():
    given = shown()
    figure = motion_figure(given, ("a", "b"))
    axes = next(a for a in figure.axes if a.get_label() == "map")
    veil = axes.images[-1].get_array()
    np.testing.assert_array_equal(veil[..., 3] > 0, given.unseen)


def test_without_motion_there_is_no_reference_arrow_but_where_it_would_be_seen():
    figure = motion_figure(shown(0, zone_count=0), ("a", "b"))
    words = [text.get_text() for text in figure.texts]
    assert not drawn(figure, FancyArrow)
    assert {"Motion or its absence can be seen", "Nothing known of motion here"} <= set(words)
    assert "Zone that moves as one, with its vector" not in words


def test_arrows_are_magnified_by_a_round_number_and_hardly_reach_each_other():
    rng = np.random.default_rng(1)
    for size in (0.003, 0.05, 0.4, 3.0):
        times = magnification(rng.normal(0, size, (50, 2)), 2.0)
        assert str(f"{times:.6g}").replace("0", "").replace(".", "") in ("1", "2", "5")
        longest = np.quantile(np.hypot(*(rng.normal(0, size, (50, 2))).T), 0.95)
        assert 0.4 < times * longest / 2.0 < 1.7
