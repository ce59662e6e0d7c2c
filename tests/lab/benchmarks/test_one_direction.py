"""Motion across furrows is measured against what was put in, and the table counts it."""

from __future__ import annotations

import numpy as np
from slopewatch.lab.benchmarks.one_direction import _rows, furrows

SEED = 110


def test_windows_over_furrows_know_the_motion_across_them():
    found = furrows(SEED)
    assert len(found) > 5
    for row in found:
        assert row["amount"] >= 0
        assert abs(row["amount"] - row["true"]) < 5 * row["error"]
        assert 0 <= row["off"] < 5 * row["turn"]
        assert abs(row["true"] - row["along"]) <= 2 * row["motion"] * np.sin(row["off"] / 2) + 1e-9


def test_the_table_counts_lengths_and_azimuths_apart():
    row = {
        "amount": 0.10,
        "error": 0.01,
        "turn": 0.02,
        "along": 0.125,
        "motion": 0.2,
        "width": 5.0,
        "true": 0.11,
        "off": 0.03,
    }
    across, along, azimuth = _rows("x", [row, row | {"true": 0.13, "along": 0.1, "off": 0.05}])
    assert (across.value, along.value, azimuth.value) == ("50.0 % of 2", "50.0 % of 2", "50.0 %")
    assert across.met is False
    (none,) = _rows("x", [])
    assert none.value == "0"
