from __future__ import annotations

from datetime import date
from pathlib import Path

import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.epochs.epoch import Epoch, check_pair, parse_epoch
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
    ],
)
def test_date_in_a_file_name(name, expected):
    assert date_in_name(Path(name)) == expected


def test_epoch_as_given_on_the_command_line():
    assert parse_epoch("2024-05-01=/a/b=c.laz") == Epoch(Path("/a/b=c.laz"), date(2024, 5, 1))


@pytest.mark.parametrize("text", ["2024-05-01", "2024-05-01=", "01.05.2024=a.laz", "=a.laz", "2024-02-30=a.laz"])
def test_epochs_that_are_not_understood(text):
    with pytest.raises(InputError, match="YYYY-MM-DD"):
        parse_epoch(text)


def test_pairs_that_cannot_be_compared(tmp_path):
    a, b, c = (tmp_path / name for name in ("a.laz", "b.laz", "c.laz"))
    a.write_bytes(b"one")
    b.write_bytes(b"one")
    c.write_bytes(b"two")
    early, late = date(2024, 5, 1), date(2025, 5, 1)
    with pytest.raises(InputError, match="reversed"):
        check_pair(Epoch(a, late), Epoch(c, early))
    with pytest.raises(InputError, match="same date"):
        check_pair(Epoch(a, early), Epoch(c, early))
    with pytest.raises(InputError, match="same cloud"):
        check_pair(Epoch(a, early), Epoch(b, late))
    with pytest.raises(InputError, match="does not exist"):
        check_pair(Epoch(a, early), Epoch(tmp_path / "d.laz", late))
    check_pair(Epoch(a, early), Epoch(c, late))


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
