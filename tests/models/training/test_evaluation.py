"""Scores of labels by hand."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.models.inference.calibration_bins import calibration_bins, calibration_error
from slopewatch.models.training.evaluation import confusion, intersection_over_union, overall_accuracy


def test_accuracy_and_intersection_over_union_by_hand():
    truth = np.array([0, 0, 0, 1, 1, 2], dtype=np.uint8)
    predicted = np.array([0, 0, 1, 1, 2, 2], dtype=np.uint8)
    counts = confusion(truth, predicted)
    np.testing.assert_array_equal(counts, [[2, 1, 0], [0, 1, 1], [0, 0, 1]])
    assert overall_accuracy(counts) == pytest.approx(4 / 6)
    np.testing.assert_allclose(intersection_over_union(counts), [2 / 3, 1 / 3, 1 / 2])
    assert np.isnan(intersection_over_union(confusion(truth[:3], predicted[:2].repeat(2)[:3]))[2])


def test_the_calibration_error_by_hand():
    truth = np.zeros(100, dtype=np.uint8)
    probabilities = np.tile([0.8, 0.1, 0.1], (100, 1))
    truth[:40] = 1  # sure to 80 %, right in 60 %
    bins = calibration_bins(truth, probabilities)
    assert calibration_error(bins) == pytest.approx(0.2)
    bins += calibration_bins(np.zeros(300, dtype=np.uint8), np.tile([1.0, 0.0, 0.0], (300, 1)))
    assert calibration_error(bins) == pytest.approx(0.05)
