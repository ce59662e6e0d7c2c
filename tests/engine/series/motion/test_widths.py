"""Two widths of windows as one test, against nested windows drawn by lot."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.displacement.status import Status
from slopewatch.engine.displacement.vectors import Vectors, chosen, confidence_of_each
from slopewatch.engine.series.motion.widths import narrower_tells

NARROW_M, WIDE_M = 5.0, 8.0
SHARE = (NARROW_M / WIDE_M) ** 2
ERROR_M = 0.02  # of a narrow window
EACH = confidence_of_each(0.99, 2)


def windows(motion: np.ndarray, error: float, width: float) -> Vectors:
    count = len(motion)
    return Vectors(
        np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1)), motion, np.tile(error**2 * np.eye(3), (count, 1, 1)),
        np.full(count, Status.MEASURED.value), np.ones(count), np.full(count, width),
    )  # fmt: skip


def nested(count: int, inside: float, around: float) -> tuple[Vectors, Vectors]:
    """Windows that move down the dip by so many metres in the narrow one and around it; both see the same noise."""
    rng = np.random.default_rng(8)
    down = np.array([1.0, 0.0, 0.0])
    narrow = inside * down + rng.normal(0, ERROR_M, (count, 3))
    rest = around * down + rng.normal(0, ERROR_M * np.sqrt(SHARE / (1 - SHARE)), (count, 3))
    return (
        windows(narrow, ERROR_M, NARROW_M),
        windows(SHARE * narrow + (1 - SHARE) * rest, ERROR_M * np.sqrt(SHARE), WIDE_M),
    )


def joined(sizes: tuple[Vectors, Vectors], confidence: float) -> Vectors:
    return chosen(narrower_tells(*sizes, confidence), *sizes)


def test_still_ground_moves_no_more_often_than_stated():
    found = joined(nested(100_000, 0.0, 0.0), EACH)
    assert 0.005 < found.significant(EACH).mean() <= 0.010
    assert (found.p_value(2) < 0.01).mean() == found.significant(EACH).mean()


def test_what_moves_as_a_whole_is_given_by_the_wide_window():
    found = joined(nested(2000, 0.1, 0.1), EACH)
    assert found.significant(EACH).all()
    assert (found.width == WIDE_M).all()
    assert np.sqrt(((found.motion[:, 0] - 0.1) ** 2).mean()) == pytest.approx(ERROR_M * np.sqrt(SHARE), rel=0.1)


def test_a_narrow_window_counts_if_the_wide_one_rather_moves_with_it():
    narrow = windows(np.array([[0.08, 0.0, 0.0]] * 3), ERROR_M, NARROW_M)
    wide = windows(np.array([[0.036, 0.0, 0.0], [0.044, 0.0, 0.0], [-0.03, 0.0, 0.0]]), 0.014, WIDE_M)
    found = joined((narrow, wide), EACH)
    assert found.width.tolist() == [WIDE_M, NARROW_M, WIDE_M]
    assert found.significant(EACH).tolist() == [False, True, False]


def test_a_narrow_window_alone_is_asked_the_same():
    narrow = windows(np.array([[0.08, 0.0, 0.0], [0.03, 0.0, 0.0]]), ERROR_M, NARROW_M)
    wide = windows(np.full((2, 3), np.nan), np.nan, WIDE_M)
    wide.status[:] = Status.LITTLE_SEEN
    found = joined((narrow, wide), EACH)
    assert (found.width == NARROW_M).all()
    assert found.significant(EACH).tolist() == [True, False]
