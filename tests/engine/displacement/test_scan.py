"""Sums of windows that stand out: against sums made pair by pair, and against still maps drawn by lot."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from slopewatch.engine.displacement.frame import Frame
from slopewatch.engine.displacement.scan import Layout, map_probability, peaks, trials_of
from slopewatch.engine.displacement.vectors import Vectors
from slopewatch.tests.builders.rough_ground import axes

FRAME = Frame(axes(), np.zeros(3))
WIDTHS_M = (5.0, 8.0)


def layout_of(shape: tuple[int, int], spacing: float) -> tuple[Layout, np.ndarray]:
    """Windows over a plane that dips to the east, and their places (n, 3)."""
    cells = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1).reshape(-1, 2)
    east, north = ((cells[:, k] + 0.5) * spacing for k in (0, 1))
    places = np.column_stack([east, north, -east * np.tan(np.radians(35.0))])
    return Layout(cells, np.zeros(len(cells), dtype=np.int64), (FRAME,), spacing), places


def vectors_of(places: np.ndarray, plane: np.ndarray, covariance: np.ndarray, width: float) -> Vectors:
    """From motions (n, 2) along the axes and their covariances (n, 2, 2)."""
    count = len(places)
    whole = np.tile(np.eye(3) * 1e-6, (count, 1, 1))
    whole[:, :2, :2] = covariance
    along = np.tile(axes(), (count, 1, 1))
    motion = np.column_stack([plane, np.zeros(count)]) @ axes()
    back = np.swapaxes(along, 1, 2) @ whole @ along
    return Vectors(places, along, motion, back, np.zeros(count, np.int64), np.ones(count), np.full(count, width))


@cache
def common(x_off: float, y_off: float, width: float) -> float:
    """Share of a disc that it has in common with one so far away, counted on a fine grid."""
    step = np.arange(-width / 2, width / 2, width / 100)
    x, y = (a.ravel() for a in np.meshgrid(step, step))
    inside = x**2 + y**2 < (width / 2) ** 2
    away = np.array([x_off, y_off])
    return float((((x - away[0]) ** 2 + (y - away[1]) ** 2 < (width / 2) ** 2) & inside).sum() / inside.sum())


def test_the_largest_sum_is_that_of_all_pairs_one_by_one():
    layout, places = layout_of((7, 6), 2.0)
    rng = np.random.default_rng(2)
    root = rng.normal(size=(len(places), 2, 2)) * 0.01 + 0.02 * np.eye(2)
    covariance = root @ np.swapaxes(root, 1, 2)
    plane = rng.normal(size=(len(places), 2)) * 0.03
    used = rng.uniform(size=len(places)) > 0.2
    error = np.tile(np.diag([4e-6, 9e-6, 1e-6]), (len(places), 1, 1))
    vectors = vectors_of(places, plane, covariance, 5.0)
    found = next(peaks([vectors], [used], layout, error, 0.0))
    flat = FRAME.to_plane(places)[:, :2]
    registered = (axes() @ error[0] @ axes().T)[:2, :2]
    best = 0.0
    for middle in np.flatnonzero(used):
        for reach in (0.0, 2.5, 5.0, 10.0):
            near = np.flatnonzero(used & (np.hypot(*(flat - flat[middle]).T) <= reach))
            information = np.linalg.inv(covariance[near])
            total = np.einsum("nij,nj->i", information, plane[near])
            spread = np.zeros((2, 2))
            for i, a in enumerate(near):
                for j, b in enumerate(near):
                    share = common(*np.abs(flat[b] - flat[a]).round(6), 5.0)
                    spread += share * (information[i] + information[j]) / 2
            back = np.linalg.inv(information.sum(axis=0))
            motion = back @ total
            best = max(best, float(motion @ np.linalg.solve(back @ spread @ back + registered, motion)))
    assert found.statistic == pytest.approx(best, rel=0.01)


def means(places: np.ndarray, width: float) -> np.ndarray:
    """(n, k) that makes means over the windows' discs of values at the points of a grid on the plane."""
    flat = FRAME.to_plane(places)[:, :2]
    low, high = flat.min(axis=0) - 4.0, flat.max(axis=0) + 4.0
    points = np.stack(np.meshgrid(*(np.arange(low[k], high[k], 0.8) for k in (0, 1)), indexing="ij"), axis=-1)
    off = points.reshape(-1, 2)[None] - flat[:, None]
    inside = np.hypot(off[..., 0], off[..., 1]) < width / 2
    return inside / inside.sum(axis=1, keepdims=True)


def drawn(places: np.ndarray, over: list[np.ndarray], rng: np.random.Generator) -> list[Vectors]:
    """Windows of both widths of still ground: the same fine noise, meaned over their discs."""
    noise = rng.normal(size=(over[0].shape[1], 2))
    return [
        vectors_of(places, mean @ noise, np.eye(2) * (mean**2).sum(axis=1)[:, None, None], width)
        for width, mean in zip(WIDTHS_M, over, strict=True)
    ]


@pytest.mark.parametrize(("spacing", "shape"), [(2.0, (9, 9)), (4.0, (7, 7))])
def test_still_maps_show_a_sum_as_often_as_stated(spacing: float, shape: tuple[int, int]):
    layout, places = layout_of(shape, spacing)
    everywhere = np.ones(len(places), dtype=bool)
    tests = trials_of(layout, everywhere, WIDTHS_M[0])
    rng, error = np.random.default_rng(5), np.zeros((len(places), 3, 3))
    over = [means(places, width) for width in WIDTHS_M]
    chances = []
    for _ in range(120):
        best = next(peaks(drawn(places, over, rng), [everywhere, everywhere], layout, error, 0.0))
        chances.append(map_probability(best.statistic, tests))
    assert 0.02 <= np.mean(np.array(chances) < 0.1) <= 0.17
    assert 0.15 <= np.mean(np.array(chances) < 0.3) <= 0.42


def test_slow_motion_of_many_windows_stands_out_where_no_window_does():
    layout, places = layout_of((16, 16), 2.0)
    rng = np.random.default_rng(1)
    widths = drawn(places, [means(places, width) for width in WIDTHS_M], rng)
    moving = np.hypot(*(FRAME.to_plane(places)[:, :2] - FRAME.to_plane(places)[136, :2]).T) < 9.0
    slow = np.array([0.35, 0.0, 0.0]) @ axes()  # less than two standard errors of a narrow window
    moved = [
        Vectors(v.places, v.axes, v.motion + moving[:, None] * slow, v.covariance, v.status, v.seen, v.width)
        for v in widths
    ]
    left = [np.ones(len(places), dtype=bool) for _ in widths]
    found = next(peaks(moved, left, layout, np.zeros((len(places), 3, 3)), 20.0))
    assert moving[found.window]
    assert found.statistic > 2 * moved[0].statistic.max()
    assert found.motion == pytest.approx([0.35, 0.0], abs=0.1)


def test_what_is_taken_out_is_in_no_later_peak():
    layout, places = layout_of((14, 14), 2.0)
    flat = FRAME.to_plane(places)[:, :2]
    plane = np.zeros((len(places), 2))
    middles = [flat[30], flat[150]]
    for middle, motion in zip(middles, ([0.3, 0.0], [0.0, -0.2]), strict=True):
        plane[np.hypot(*(flat - middle).T) < 4.0] = motion
    vectors = vectors_of(places, plane, np.tile(np.eye(2) * 4e-4, (len(places), 1, 1)), 5.0)
    left = [np.ones(len(places), dtype=bool)]
    found = []
    for peak in peaks([vectors], left, layout, np.zeros((len(places), 3, 3)), 20.0):
        found.append(peak)
        left[0][np.hypot(*(flat - flat[peak.window]).T) < 9.0] = False
    assert [np.argmin([np.hypot(*(flat[p.window] - m)) for m in middles]) for p in found] == [0, 1]
    assert found[1].motion[1] < -0.1
