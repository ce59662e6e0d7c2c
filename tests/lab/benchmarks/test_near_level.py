"""What the benchmark of zones near their level of detection counts."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.lab.benchmarks import near_level
from slopewatch.lab.benchmarks.near_level import MapOutcome, Patch, measured, table


def test_a_patch_is_as_high_as_it_says_and_ends_at_its_radius():
    for flat in (True, False):
        patch = Patch(2.0, 3.0, 1.5, -0.2, flat)
        x = np.array([2.0, 3.0, 3.45, 3.51])
        dz = patch.dz(x, np.full(4, 3.0))
        assert dz[0] == pytest.approx(-0.2)
        assert dz[3] == 0.0
        assert dz[2] < 0
        assert abs(dz[1]) == pytest.approx(0.2 if flat else 0.05)


def test_changes_of_many_levels_are_all_found_and_right(monkeypatch):
    for name, value in (("SIDE", 26.0), ("CHANGES", 3), ("RATIO", (6.0, 7.0)), ("AREA", (8.0, 12.0))):
        monkeypatch.setattr(near_level, name, value)
    still, moved = measured(3)
    assert still.changes == ()
    assert not any(still.right)
    assert all(found for _, found in moved.changes)
    assert len(moved.changes) == 3
    assert all(moved.reported)
    assert len(moved.reported) >= 3
    assert max(moved.confidence) > 0.99


def test_rows_give_the_share_that_is_right_and_by_how_much_it_is_over():
    still = MapOutcome((0.3,), (False,), (), ())
    moved = MapOutcome((0.99, 0.3), (True, True), (True,), ((1.7, True), (1.0, False)))
    made = {row.figure: row for row in table([still], [moved])}
    first = next(iter(made.values()))
    assert first.value == "1 of 1 (100.0 %)"
    assert "3.0 points above 97 %" in first.peer
    assert first.met is True
    assert made["groups with a confidence of 0 to 0.5 that are right"].value == "1 of 2 (50 %)"
    assert made["groups with a confidence of 0.93 to 0.97 that are right"].met is None
    assert made["changes reported, height 1.6 to 2 times the level"].value == "1 of 1"
    wrong = MapOutcome((0.96,), (False,), (False,), ())
    made = table([wrong] * 3, [moved])
    assert made[0].value == "1 of 4 (25.0 %)"
    assert made[0].met is False
    assert made[1].met is False


def test_a_class_may_be_right_less_often_than_promised_by_chance_only():
    few = MapOutcome((0.9,) * 10, (True,) * 8 + (False,) * 2, (), ())
    name = "groups with a confidence of 0.8 to 0.93 that are right"
    assert next(row for row in table([few], []) if row.figure == name).met is True
    assert next(row for row in table([few] * 10, []) if row.figure == name).met is False


def test_zones_of_95_percent_are_to_be_right_in_93_to_97():
    name = "groups with a confidence of 0.93 to 0.97 that are right"
    for right, met in ((19, True), (20, False), (17, False)):
        outcome = MapOutcome((0.95,) * 20, (True,) * right + (False,) * (20 - right), (), ())
        assert next(row for row in table([outcome], []) if row.figure == name).met is met
