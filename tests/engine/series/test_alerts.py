"""The alert table: the one that is shipped, what is refused, and which level a zone gets."""

from __future__ import annotations

import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.series.alerts import COLUMNS, DEFAULT_TABLE, Evidence, alert_of, read_alerts
from slopewatch.engine.series.velocity_classes import velocity_class

HEAD = ",".join(COLUMNS)
ROWS = ("0,none,#999999,,,,,,,,", "1,look,#0000ff,2,,,,,2.5,2,", "2,go,#ff0000,2,4,80,60,50,2.5,2,Go there")


def table(tmp_path, *lines: str, head: str = HEAD):
    path = tmp_path / "alerts.csv"
    path.write_text("\n".join((head, *lines)) + "\n", encoding="utf-8")
    return path


def test_shipped_table_is_valid():
    rows = read_alerts(None)
    assert [r.level for r in rows] == [0, 1, 2, 3, 4]
    assert rows[0].name == "no confirmed change"
    assert all("safe" not in (r.name + r.action).lower() for r in rows)


def test_table_as_a_spreadsheet_saves_it(tmp_path):
    path = tmp_path / "alerts.csv"
    path.write_bytes(b"\xef\xbb\xbf" + DEFAULT_TABLE.read_bytes().replace(b",", b";").replace(b"\n", b"\r\n"))
    assert read_alerts(path) == read_alerts(None)


@pytest.mark.parametrize(
    ("lines", "head", "sentence"),
    [
        ((), "", "is empty"),
        (ROWS, HEAD.replace("rate_mm_day", "rate"), "column rate_mm_day is missing"),
        (ROWS, HEAD.replace("action", "name"), "column name is there twice"),
        (tuple(r + "," for r in ROWS), HEAD + ",note", "column 'note' is not known"),
        ((*ROWS[:2], "2,go,#ff0000,2,fast,,,,,,"), HEAD, "line 4: rate_mm_day is 'fast'; give a number of at least 0"),
        ((*ROWS[:2], "2,go,#ff0000,2,-1,,,,,,"), HEAD, "rate_mm_day is '-1'"),
        ((*ROWS[:2], "2,go,#ff0000,2,,95,,,,,"), HEAD, "tangent_angle_deg is '95'; give a number from 0 to 90"),
        ((*ROWS[:2], "2,go,#ff0000,1.5,,,,,,,"), HEAD, "epochs_confirmed is '1.5'; give a whole number"),
        ((*ROWS[:2], "2,go,red,2,,,,,,,"), HEAD, "colour is 'red'; give it as #rrggbb"),
        ((*ROWS[:2], "2,,#ff0000,2,,,,,,,"), HEAD, "name is empty"),
        ((*ROWS[:2], "2,look,#ff0000,2,,,,,,,"), HEAD, "same name"),
        ((*ROWS[:2], "3,go,#ff0000,2,,,,,,,"), HEAD, "levels must be 0, 1, 2"),
        (ROWS[:1], HEAD, "at least two"),
        ((*ROWS[:2], "2,go,#ff0000,,,,,,,,"), HEAD, "level 2 has no threshold"),
        (("0,none,#999999,1,,,,,,,", *ROWS[1:]), HEAD, "level 0 has a epochs_confirmed"),
        (
            (*ROWS, "3,run,#000000,2,3,,,,,,"),
            HEAD,
            r"rate_mm_day of level 3 \(3\) is easier to reach than that of level 2",
        ),
        ((*ROWS, "3,run,#000000,2,,,90,,,,"), HEAD, "failure_within_days of level 3"),
        ((*ROWS, "3,run,#000000,2,,,,,5,,"), HEAD, "chance_percent of level 3"),
        ((*ROWS[:2], "2,go,#ff0000,2,4,,,,0,,"), HEAD, "chance_percent is '0'; give a number from 0.0001 to 25"),
        ((*ROWS[:2], "2,go,#ff0000,2,4,,,,,0,"), HEAD, "quiet_surveys is '0'; give a whole number from 1 to 99"),
        ((*ROWS[:2], "2,go,#ff0000,2"), HEAD, "line 4 has 4 values instead of 11"),
    ],
)
def test_broken_table_gets_a_sentence(tmp_path, lines, head, sentence):
    path = tmp_path / "alerts.csv"
    path.write_text("\n".join((head, *lines)) + "\n" if head else "")
    with pytest.raises(InputError, match=f"alert table .*alerts.csv.*{sentence}"):
        read_alerts(path)


@pytest.mark.parametrize(
    ("known", "level", "reason"),
    [
        (Evidence(0), 0, ""),
        # one comparison alone is not enough
        (Evidence(1, 9.0, 50.0, tangent_angle_deg=89, failure_in_days=(1, 2), steady_chance=0), 0, ""),
        (Evidence(2, 2.0), 1, "confirmed by 2 comparisons, at least 2, with an error chance of 2.5 %"),
        (Evidence(2, 1.9), 0, ""),  # the mean of both may be an error
        (Evidence(7, 5.0, epochs_moved=1, rest=(2, 5)), 0, ""),  # all but one are of before the rest
        (Evidence(9, 5.0, epochs_moved=2, rest=(2, 5)), 1, "confirmed by 2 comparisons since the zone was at rest"),
        (Evidence(2, 5.0, 5.0, 0.6), 1, "confirmed"),  # 5 less 1.96 times 0.6 is below 4
        (Evidence(2, 5.0, 5.0, 0.5), 2, "rate 152 mm/month, beyond 122 with an error chance of 2.5 %"),
        (Evidence(2, 5.0, -9.0), 1, "confirmed"),  # back to where it was
        (Evidence(3, 5.0, 1, tangent_angle_deg=80.0, steady_chance=0.01), 2, "tangent angle 80 degrees"),
        (Evidence(3, 5.0, 1, tangent_angle_deg=80.0, steady_chance=0.03), 1, "confirmed"),
        (Evidence(2, 5.0, failure_in_days=(3, 60), steady_chance=0.01), 2, "failure 3 to 60 days after the survey"),
        (Evidence(2, 5.0, failure_in_days=(3, 61), steady_chance=0.01), 1, "confirmed"),  # not all of it
        (Evidence(2, 5.0, failure_in_days=(3, 60), steady_chance=0.03), 1, "confirmed"),
        (Evidence(1, volume_m3=70.0, volume_err=10.0), 2, "volume 70.0"),  # a large single event
        (Evidence(1, volume_m3=69.0, volume_err=10.0), 0, ""),
        (Evidence(2, 5.0, 9.0, along_surface=True), 2, "along the surface: rate 274 mm/month"),
    ],
)
def test_highest_level_whose_threshold_is_reached(tmp_path, known, level, reason):
    row, told = alert_of(known, read_alerts(table(tmp_path, *ROWS)))
    assert row.level == level
    assert reason in told
    assert bool(told) == (level > 0)


@pytest.mark.parametrize(
    ("mm_day", "name"),
    [
        (0.04, "extremely slow"),
        (-0.05, "very slow"),
        (4.3, "very slow"),
        (4.5, "slow"),
        (426, "slow"),
        (428, "moderate"),
        (43_300, "rapid"),
        (4.4e6, "very rapid"),
        (4.4e8, "extremely rapid"),
    ],
)
def test_classes_of_cruden_and_varnes(mm_day, name):
    assert velocity_class(mm_day) == name
