"""The surveys of a series: folder, manifest, and what is refused."""

from __future__ import annotations

from datetime import date
from pathlib import Path

import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.epochs.epoch import Epoch
from slopewatch.engine.epochs.manifest import check_series, epochs_of


def touch(folder: Path, *names: str) -> list[Path]:
    paths = [folder / name for name in names]
    for number, path in enumerate(paths):
        path.write_bytes(b"cloud %d" % number)
    return paths


def test_folder_gives_its_clouds_in_the_order_of_their_dates(tmp_path):
    touch(tmp_path, "slope_20250301.LAZ", "a 2024-05-01.laz", "b_2024_11_30.las", "notes.txt")
    epochs = epochs_of(tmp_path)
    assert [e.date for e in epochs] == [date(2024, 5, 1), date(2024, 11, 30), date(2025, 3, 1)]
    check_series(epochs)


@pytest.mark.parametrize("name", ["slope.laz", "2024-05-01_2025-05-01.laz", "2024-13-01.laz"])
def test_folder_with_a_cloud_without_its_date(tmp_path, name):
    touch(tmp_path, "2024-05-01.laz", name)
    with pytest.raises(InputError, match=f"{name}.*exactly one date.*rename"):
        epochs_of(tmp_path)


def test_folder_without_a_cloud_and_other_wrong_sources(tmp_path):
    with pytest.raises(InputError, match="holds no LAS or LAZ"):
        epochs_of(tmp_path)
    with pytest.raises(InputError, match="nothing' does not exist"):
        epochs_of(tmp_path / "nothing")
    (cloud,) = touch(tmp_path, "2024-05-01.laz")
    with pytest.raises(InputError, match="is one cloud; give the folder"):
        epochs_of(cloud)


@pytest.mark.parametrize(
    "text",
    [
        "date,path\n2024-05-01,a.laz\n2024-08-01,b.laz\n",
        "path;weather;date\na.laz;sun;2024-05-01\n\nb.laz;rain;2024-08-01\n",
        "\ufeffDate,Path\r\n2024-05-01, a.laz\r\n2024-08-01,{folder}/b.laz\r\n",
    ],
)
def test_manifest_names_its_clouds(tmp_path, text):
    a, b = touch(tmp_path, "a.laz", "b.laz")
    manifest = tmp_path / "surveys.csv"
    manifest.write_bytes(text.format(folder=tmp_path).encode())
    assert epochs_of(manifest) == (Epoch(a, date(2024, 5, 1)), Epoch(b, date(2024, 8, 1)))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "is empty; give a line date,path"),
        ("day,path\n2024-05-01,a.laz\n", "no column date in its first line"),
        ("date,cloud\n2024-05-01,a.laz\n", "no column path"),
        ("date,path\n2024-05-01,a.laz\n2024-08-01\n", "Line 3 .* lacks its path"),
        ("date,path\n,a.laz\n", "Line 2 .* lacks its date"),
        ("date,path\n1 May 2024,a.laz\n", "Line 2 .*'1 May 2024' is not a date; write it as YYYY-MM-DD"),
        ("date,path\n2024-05-01,a.laz\n2024-08-01,c.laz\n", "Line 3 .*c.laz', which does not exist"),
        ("date,path\n2024-05-01,\0\n", "is no text in UTF-8"),
    ],
)
def test_broken_manifest_gets_a_sentence(tmp_path, text, sentence):
    touch(tmp_path, "a.laz")
    manifest = tmp_path / "surveys.csv"
    manifest.write_text(text)
    with pytest.raises(InputError, match=sentence):
        epochs_of(manifest)


def test_manifest_that_is_no_text(tmp_path):
    (tmp_path / "surveys.csv").write_bytes(b"date,path\n2024-05-01,\xe4.laz\n")
    with pytest.raises(InputError, match="no text in UTF-8; save it as CSV"):
        epochs_of(tmp_path / "surveys.csv")


def test_surveys_that_make_no_series(tmp_path):
    a, b, c = touch(tmp_path, "a.laz", "b.laz", "c.laz")
    first, second = Epoch(a, date(2024, 5, 1)), Epoch(b, date(2024, 8, 1))
    for wrong, sentence in (
        ([], "No survey was given"),
        ([first], "One survey was given; a series takes at least two"),
        ([second, first], "2024-08-01 and 2024-05-01 are in reversed order"),
        ([first, Epoch(tmp_path / "d.laz", date(2024, 8, 1))], "d.laz' does not exist"),
        ([first, Epoch(b, None)], "b.laz' has no date"),
    ):
        with pytest.raises(InputError, match=sentence):
            check_series(wrong)
    c.write_bytes(a.read_bytes())
    with pytest.raises(InputError, match=r"a.laz' and .*c.laz' are the same cloud"):
        check_series([first, second, Epoch(c, date(2024, 11, 1))])
