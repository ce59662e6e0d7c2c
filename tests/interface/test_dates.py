"""Dates in the names of files."""

from __future__ import annotations

from datetime import date
from pathlib import Path

import pytest
from slopewatch.interface.dates import date_in_name


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("2024-05-01.laz", date(2024, 5, 1)),
        ("slope_20240501_ground.laz", date(2024, 5, 1)),
        ("autzen-bmx-2010.las", None),
        ("2024-13-01.laz", None),
        ("2024-05-01_2025-05-01.laz", None),
        ("1234567890.laz", None),
        ("2024_05_01.copc.laz", date(2024, 5, 1)),
        ("/2020-01-01/slope.laz", None),
    ],
)
def test_date_in_a_file_name(name, expected):
    assert date_in_name(Path(name)) == expected


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("25-05-2024.laz", date(2024, 5, 25)),
        ("slope_25.05.2024_ground.laz", date(2024, 5, 25)),
        ("05_25_2024.laz", date(2024, 5, 25)),
        ("05-05-2024.laz", date(2024, 5, 5)),
        ("01-05-2024.laz", None),  # of May or of January
        ("2024-05-01-2025.laz", date(2024, 5, 1)),
        ("25-05-2024 2024-05-25.laz", date(2024, 5, 25)),
        ("25-05-2024 2024-05-26.laz", None),
        ("may24.laz", None),
        ("tile_0652_0612.laz", None),
        ("19800106.laz", None),
        ("31-02-2024.laz", None),
    ],
)
def test_dates_with_the_year_last_and_numbers_that_are_none(name, expected):
    assert date_in_name(Path(name)) == expected
