"""The words of an alert level, and the surveys that changed it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from slopewatch.interface.alert_states import LevelChange, alert_state, level_changes
from slopewatch.interface.language import translator

ENGLISH, CHINESE = translator("en"), translator("zh_CN")
WITHDRAWN = {
    "alert_level": 0, "alert": "no confirmed change", "alert_state": "withdrawn", "alert_since": "2024-09-28",
    "alert_reason": "level 2 withdrawn: no motion seen for 2 surveys or more", "action": "Next survey as planned",
}  # fmt: skip


@pytest.mark.parametrize(
    ("level", "state", "since", "words"),
    [
        (2, "reached", "2024-06-30", "2 inspect, reached on 2024-06-30"),
        (2, "kept", "2024-06-30", "2 inspect, kept, reached on 2024-06-30"),
        (1, "withdrawn", "2024-08-29", "1 inspect, withdrawn on 2024-08-29"),
        (2, "reached", "", "2 inspect, reached"),
        (0, "", "", "0 inspect"),
    ],
)
def test_level_state_and_day_in_words(level: int, state: str, since: str, words: str) -> None:
    row = {"alert_level": level, "alert": "inspect", "alert_state": state, "alert_since": since}
    found = alert_state(row)
    assert found is not None
    assert found.words(ENGLISH) == words


def test_chinese_readers_get_level_state_and_reason_in_chinese() -> None:
    found = alert_state(WITHDRAWN)
    assert found is not None
    assert found.words(CHINESE) == "0 无已确认变化，2024-09-28撤销"
    assert found.reason_words(CHINESE) == "2级已撤销：至少2次测量未见移动"
    assert found.reason_words(ENGLISH) == "Level 2 withdrawn: no motion seen for 2 surveys or more"


@pytest.mark.parametrize("level", [None, float("nan"), "", "none", True, "nan"])
def test_zones_without_a_level_have_no_state(level: Any) -> None:
    assert alert_state({"alert_level": level, "alert": "inspect"}) is None


@pytest.mark.parametrize("level", [2, 2.0, "2", "2.0", np.int64(2), np.float64(2)])
def test_tables_hold_levels_as_numbers_or_as_text(level: Any) -> None:
    found = alert_state({"alert_level": level})
    assert found is not None
    assert found.level == 2


def test_the_history_has_the_surveys_that_change_level_or_state() -> None:
    states = [(0, ""), (2, "reached"), (2, "reached"), (2, "kept"), (0, "withdrawn"), (0, "withdrawn"), (1, "reached")]
    rows = [
        {"epoch": f"2024-0{number}-01", "alert_level": level, "alert_state": state, "alert_reason": f"reason {number}"}
        for number, (level, state) in enumerate(states, 1)
    ]
    assert level_changes(rows) == [
        LevelChange("2024-02-01", 2, "reached", "reason 2"),
        LevelChange("2024-04-01", 2, "kept", "reason 4"),
        LevelChange("2024-05-01", 0, "withdrawn", "reason 5"),
        LevelChange("2024-07-01", 1, "reached", "reason 7"),
    ]
