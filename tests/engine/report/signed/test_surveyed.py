"""What the report to sign says of how the surveys were compared."""

from __future__ import annotations

import json

import pytest
from slopewatch.engine.report.signed.details import details_of
from slopewatch.engine.report.signed.surveyed import surveyed


def said(**facts) -> str:
    record = {"metrics": {}, "inputs": [], "parameters": {}, "grid": {"cell_m": 0.5}, **facts}
    return json.dumps(surveyed(record, details_of(record, ["2024", "2025"])), ensure_ascii=False).replace("\u00a0", " ")


def test_cells_that_grew_are_told_with_their_shares_of_the_area():
    rows = [{"side_m": side, "share": share} for side, share in ((0.5, 0.22), (1.0, 0.086), (2.0, 0.69), (4.0, 0.004))]
    text = said(cell_sizes=rows)
    assert "0.50 m: 22 %, 1.00 m: 9 %, 2.00 m: 69 %, 4.00 m: 0.4 %" in text
    assert '"Side of a cell"' not in text


def test_cells_of_one_size_are_told_as_before():
    for rows in ([], None):
        text = said(cell_sizes=rows)
        assert '"Side of a cell"' in text
        assert "0.50 m" in text


@pytest.mark.parametrize(
    ("ground", "words"),
    [
        ("extract", "extracted from all points"),
        ("class_2", "points of class 2 of the surveys"),
        ("as_is", "all points of the surveys"),
    ],
)
def test_the_ground_that_was_used_is_told(ground, words):
    assert words in said(parameters={"ground": {"ground": ground}})
    assert "points of class 2" not in said()
