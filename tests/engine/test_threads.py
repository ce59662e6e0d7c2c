"""Tasks side by side."""

from __future__ import annotations

import threading

import pytest
from slopewatch.engine.threads import side_by_side


def test_tasks_run_at_the_same_time_and_answer_in_their_order():
    meet = threading.Barrier(2, timeout=10)  # passes only if both are there at once

    def task(name: str) -> str:
        meet.wait()
        return name

    assert side_by_side(lambda: task("first"), lambda: task("second")) == ["first", "second"]


def test_an_error_reaches_the_caller():
    with pytest.raises(ValueError, match="of the task"):
        side_by_side(lambda: 1, lambda: int("of the task"))
