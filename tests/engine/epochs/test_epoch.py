from __future__ import annotations

from datetime import date
from pathlib import Path

import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.epochs.epoch import Epoch, check_pair, parse_epoch


def test_epoch_as_given_on_the_command_line():
    assert parse_epoch("2024-05-01=/a/b=c.laz") == Epoch(Path("/a/b=c.laz"), date(2024, 5, 1))


@pytest.mark.parametrize("name", ["slope_2024-05-01.laz", "20240501.laz", "25-05-2024 north.laz"])
def test_without_a_date_that_of_the_files_name_is_taken(name):
    day = date(2024, 5, 25) if name.startswith("25") else date(2024, 5, 1)
    assert parse_epoch(f"/a/{name}") == Epoch(Path(f"/a/{name}"), day)


def test_a_name_may_hold_the_sign_between_date_and_cloud(tmp_path):
    path = tmp_path / "side=left_2024-05-01.laz"
    path.write_bytes(b"")
    assert parse_epoch(str(path)) == Epoch(path, date(2024, 5, 1))


@pytest.mark.parametrize("name", ["slope.laz", "2024-05-01_2025-05-01.laz"])
def test_a_name_without_one_date_is_refused(name):
    with pytest.raises(InputError, match=r"holds no date, or more than one; write it as YYYY-MM-DD=CLOUD\.$"):
        parse_epoch(name)


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
