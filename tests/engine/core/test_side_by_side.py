"""Work side by side: all of it, in order, on several threads where there are several processors."""

from __future__ import annotations

import threading

import pytest
from slopewatch.engine.core import side_by_side as module
from slopewatch.engine.core.side_by_side import side_by_side


@pytest.mark.parametrize("processors", [1, 2])
def test_results_come_in_order(monkeypatch, processors):
    monkeypatch.setattr(module, "processors", lambda: processors)
    assert side_by_side(lambda: 1, lambda: 2, lambda: 3) == [1, 2, 3]


def test_two_work_at_once_where_there_are_two_processors(monkeypatch):
    monkeypatch.setattr(module, "processors", lambda: 2)
    meeting = threading.Barrier(2, timeout=10)
    assert sorted(side_by_side(meeting.wait, meeting.wait)) == [0, 1]


@pytest.mark.parametrize("processors", [1, 2])
def test_an_error_is_raised(monkeypatch, processors):
    monkeypatch.setattr(module, "processors", lambda: processors)

    def fail() -> int:
        raise ValueError("of the second")

    with pytest.raises(ValueError, match="of the second"):
        side_by_side(lambda: 1, fail)
