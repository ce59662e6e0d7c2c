"""Windows shrunk towards their neighbours, against fields of motion and noise drawn by lot."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage
from slopewatch.engine.displacement import neighbours
from slopewatch.engine.displacement.frame import Frame
from slopewatch.engine.displacement.neighbours import with_neighbours
from slopewatch.engine.displacement.status import Status
from slopewatch.engine.displacement.vectors import Vectors

STEP_M, SPACING_M, SIDE_M = 0.25, 2.0, 40.0
RADII_M = (2.5, 4.0)
ERROR_M = 0.024  # of a narrow window, as on ground of 70 points a m²
FRAME = Frame(axes=np.eye(3), origin=np.zeros(3))
FRAMES = (FRAME,)


def disc(radius: float) -> np.ndarray:
    reach = int(radius / STEP_M)
    rows, columns = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    inside = np.hypot(rows, columns) * STEP_M <= radius
    return inside / inside.sum()


def drawn(motion: np.ndarray, seed: int) -> tuple[list[Vectors], np.ndarray]:
    """Windows of both radii over a field of motion (n, n) down the dip and noise, and the motion at their middles.

    A window is the mean over its disc, so that windows that overlap err alike.
    """
    rng = np.random.default_rng(seed)
    count = len(motion)
    every = slice(16, count - 16, int(SPACING_M / STEP_M))
    sizes = []
    noise = rng.normal(0, 1, (2, count, count))
    unit = ERROR_M / np.sqrt((disc(RADII_M[0]) ** 2).sum())
    for radius in RADII_M:
        kernel = disc(radius)
        field = np.stack([motion, np.zeros_like(motion)]) + unit * noise
        seen = np.stack([ndimage.convolve(part, kernel)[every, every].ravel() for part in field], axis=1)
        error = unit * np.sqrt((kernel**2).sum())
        sizes.append(windows(np.column_stack([seen, np.full(len(seen), 0.3)]), error, 2 * radius, places(count, every)))
    return sizes, motion[every, every].ravel()


def places(count: int, every: slice) -> np.ndarray:
    at = np.arange(count)[every] * STEP_M
    x, y = np.meshgrid(at, at, indexing="ij")
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def windows(motion: np.ndarray, error: float, width: float, at: np.ndarray) -> Vectors:
    count = len(motion)
    return Vectors(
        at, np.tile(np.eye(3), (count, 1, 1)), motion, np.tile(error**2 * np.eye(3), (count, 1, 1)),
        np.full(count, Status.MEASURED.value), np.ones(count), np.full(count, width),
    )  # fmt: skip


def still() -> np.ndarray:
    return np.zeros((int(SIDE_M / STEP_M),) * 2)


def slid(amount: float) -> np.ndarray:
    """A strip of 14 m that moved, with edges of 2 m."""
    x = np.arange(int(SIDE_M / STEP_M)) * STEP_M
    share = np.clip((8.0 - np.abs(x - SIDE_M / 2)) / 2.0, 0.0, 1.0)
    return np.repeat(amount * share[:, None], len(x), axis=1)


def errors(field: np.ndarray, seeds: range) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(n, 2) errors of all windows, (n, 2) those stated, and (n, 2) errors of the narrow windows alone."""
    off, stated, alone = [], [], []
    for seed in seeds:
        sizes, truth = drawn(field, seed)
        found = with_neighbours(sizes, np.zeros(len(truth), dtype=np.int64), FRAMES)
        wanted = np.column_stack([truth, np.zeros_like(truth)])
        off.append(found.motion[:, :2] - wanted)
        stated.append(np.sqrt(np.einsum("nii->ni", found.covariance)[:, :2]))
        alone.append(sizes[0].motion[:, :2] - wanted)
    return np.concatenate(off), np.concatenate(stated), np.concatenate(alone)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


def test_neighbours_halve_the_error_of_still_ground_and_the_stated_one_covers_it():
    off, stated, alone = errors(still(), range(8))
    assert rms(alone) == pytest.approx(ERROR_M, rel=0.1)
    assert rms(off) < 0.6 * rms(alone)
    assert (np.abs(off) < 2 * stated).mean() > 0.95
    assert stated.mean() < 0.8 * ERROR_M


@pytest.mark.parametrize("amount", [0.05, 0.1, 0.2])
def test_a_slide_is_as_near_to_the_stated_error_as_by_windows_alone(amount):
    off, stated, alone = errors(slid(amount), range(8))
    assert rms(off) < 0.9 * rms(alone)
    of_windows = (np.abs(alone) < 2 * ERROR_M).mean()  # across the edge of a slide a window reads too little
    assert (np.abs(off) < 2 * stated).mean() >= of_windows - 0.01


def test_still_ground_is_significant_no_more_often_than_stated():
    count = total = 0
    for seed in range(8):
        sizes, truth = drawn(still(), 100 + seed)
        found = with_neighbours(sizes, np.zeros(len(truth), dtype=np.int64), FRAMES)
        count, total = count + int(found.significant(0.99).sum()), total + len(truth)
    assert count <= 0.01 * total


def test_a_window_without_neighbours_stays_as_it_is():
    at = np.array([[0.0, 0.0, 0.0], [20.0, 0.0, 0.0]])
    narrow = windows(np.array([[0.03, 0.01, 0.002], [0.0, 0.02, 0.001]]), 0.02, 5.0, at)
    wide = windows(np.zeros((2, 3)), 0.01, 8.0, at)
    found = with_neighbours([narrow, wide], np.zeros(2, dtype=np.int64), FRAMES)
    np.testing.assert_allclose(found.motion, narrow.motion, atol=1e-12)
    np.testing.assert_allclose(found.covariance, narrow.covariance, atol=1e-12)


def test_the_wide_window_stands_in_for_a_narrow_one_that_is_missing():
    at = np.array([[0.0, 0.0, 0.0], [20.0, 0.0, 0.0]])
    narrow = windows(np.full((2, 3), np.nan), np.nan, 5.0, at)
    narrow.status[:] = Status.NO_RELIEF
    wide = windows(np.full((2, 3), 0.02), 0.01, 8.0, at)
    found = with_neighbours([narrow, wide], np.zeros(2, dtype=np.int64), FRAMES)
    assert found.measured.all()
    assert (found.width == 8.0).all()
    np.testing.assert_allclose(found.motion, wide.motion, atol=1e-12)


def test_windows_of_another_facet_do_not_count():
    sizes, _ = drawn(still(), 3)
    facet = (sizes[0].places[:, 0] > SIDE_M / 2).astype(np.int64)
    apart = Frame(axes=np.eye(3), origin=np.ones(3))
    found = with_neighbours(sizes, facet, (FRAME, apart))
    for number in (0, 1):
        mine = facet == number
        alone = [neighbours._taken(size, np.flatnonzero(mine)) for size in sizes]
        own = with_neighbours(alone, np.zeros(int(mine.sum()), dtype=np.int64), FRAMES)
        np.testing.assert_allclose(found.motion[mine], own.motion, atol=1e-9)
        np.testing.assert_allclose(found.covariance[mine], own.covariance, atol=1e-12)


def test_batches_give_the_same(monkeypatch):
    sizes, truth = drawn(slid(0.1), 5)
    facet = np.zeros(len(truth), dtype=np.int64)
    whole = with_neighbours(sizes, facet, FRAMES)
    monkeypatch.setattr(neighbours, "_ROWS", 50)
    parts = with_neighbours(sizes, facet, FRAMES)
    np.testing.assert_allclose(parts.motion, whole.motion, atol=1e-12)
    np.testing.assert_allclose(parts.covariance, whole.covariance, atol=1e-15)


def test_the_motion_along_the_normal_is_the_windows_own():
    sizes, truth = drawn(still(), 7)
    found = with_neighbours(sizes, np.zeros(len(truth), dtype=np.int64), FRAMES)
    np.testing.assert_allclose(found.motion[:, 2], 0.3, atol=1e-12)
    assert (np.linalg.eigvalsh(found.covariance) > 0).all()
