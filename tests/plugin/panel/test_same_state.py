"""One zone whose alert was raised and withdrawn: report, table, events, corridor page and panel say the same."""

from __future__ import annotations

import csv
import html
import os
import re
import subprocess
from pathlib import Path

import pytest
from slopewatch.plugin.panel.alerts import level_colours
from slopewatch.plugin.panel.dock import SlopeWatchPanel
from slopewatch.tests.builders.qgis import engine_python
from slopewatch.tests.plugin.panel.test_zones import table

STATE = "0 no confirmed change, withdrawn on 2024-08-29"
REASON = "level 2 withdrawn: no motion seen for 2 surveys or more"


@pytest.fixture(scope="module")
def corridor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("corridor")
    command = [str(engine_python()), "-m", "slopewatch.tests.builders.withdrawn_zone", str(folder)]
    alone = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    subprocess.run(command, check=True, env=alone)
    return folder


def texts(page: Path) -> str:
    """The words of a page, without its elements."""
    return html.unescape(" ".join(re.sub(r"<[^>]*>", " ", page.read_text(encoding="utf-8")).split()))


def test_all_five_say_the_same_of_a_withdrawn_alert(corridor: Path, panel: SlopeWatchPanel) -> None:
    folder = corridor / "slopes" / "S12" / "series"
    with (folder / "series.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    history = [(row["epoch"], row["alert_level"], row["alert_state"]) for row in rows]
    assert history[1:] == [
        ("2024-06-30", "2", "reached"), ("2024-07-30", "2", "kept"), ("2024-08-29", "0", "withdrawn"),
    ]  # fmt: skip
    assert rows[-1]["alert_reason"] == REASON
    columns = "alert_level, alert, alert_state, alert_since, alert_reason"
    expected = [(0, "no confirmed change", "withdrawn", "2024-08-29", REASON)]
    assert table(folder / "series.gpkg", columns) == expected
    assert table(corridor / "corridor.gpkg", columns) == expected
    assert table(corridor / "corridor.gpkg", "state, ended_on, state_reason", "alerts") == [
        ("withdrawn", "2024-08-29", f"Survey of 2024-08-29: {REASON}.")
    ]
    capital = REASON.capitalize()
    for page in (folder / "report.html", corridor / "corridor.html"):
        assert STATE in texts(page)
        assert capital in texts(page)
    for day, level, state in history[1:]:
        assert f"{day} {level} {state}" in texts(folder / "report.html")

    panel.load_run(folder)
    (row,) = panel.zones.model.rows
    panel.zones.choose(row.feature)
    shown = " ".join(panel.charts.alert.toPlainText().split())
    assert f"{STATE} {capital}" in shown
    for day, level, state in history[1:]:
        assert f"{day} {level} {state}" in shown
    grade = panel.zones.model.index(0, 3)
    assert grade.data() == "0 no confirmed change, withdrawn"
    colour = level_colours(folder)[0]
    assert panel.zones.model.data(grade, 1).name() == colour  # DecorationRole
    assert f"background:{colour}" in (folder / "report.html").read_text(encoding="utf-8")
