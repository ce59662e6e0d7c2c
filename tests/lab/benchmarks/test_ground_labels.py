"""Labels of real samples of other filters: fewer are wrong than with another program."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.lab.benchmarks.ground_labels import sample, total_error
from slopewatch.lab.benchmarks.ground_methods import slopewatch, smrf


def test_the_total_error_counts_both_kinds_of_wrong_labels():
    assert total_error(np.array([1, 1, 0, 0], bool), np.array([1, 0, 1, 0], bool)) == 0.5


@pytest.mark.parametrize("name", ["samp24", "samp41"])
def test_fewer_labels_are_wrong_than_with_smrf(shared_data, name):
    """Ramps and a town, the latter with ranging errors below the ground."""
    seen, truth = sample(shared_data / "isprs" / f"{name}.laz")
    assert total_error(slopewatch(seen), truth) < total_error(smrf(seen), truth)
