"""Photos of zones from a folder: into the tables, into both reports, and what is refused."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pyogrio
import pytest
from PIL import Image
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.interface.parameters import DetailParameters, ReportParameters
from slopewatch.tests.builders.signed_folder import Pages, change_folder
from slopewatch.workflows.photos import enter_photos
from slopewatch.workflows.report import report_step


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return change_folder(tmp_path_factory.mktemp("clouds"), tmp_path_factory.mktemp("out") / "new")


@pytest.fixture
def copy(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "copy"))


def pictures(folder: Path, **colours: str) -> Path:
    folder.mkdir(exist_ok=True)
    for name, colour in colours.items():
        Image.new("RGB", (60, 40), colour).save(folder / f"{name}.jpg")
    return folder


def photos(folder: Path) -> dict[str, str]:
    table = pyogrio.read_dataframe(folder / "zones.gpkg", layer="zones", read_geometry=False)
    return {
        zone: photo
        for zone, photo in zip(table["zone_id"], table["photo"], strict=True)
        if isinstance(photo, str) and photo
    }


def test_pictures_are_shown_with_the_zones_that_they_are_named_after(copy: Path, tmp_path: Path) -> None:
    source = pictures(tmp_path / "source", z001_crack="red", Z002="blue", berm="green")
    progress = Progress()
    done = report_step(
        copy, ReportParameters(), details=DetailParameters(pdf=True), profiles=None, photos=source, progress=progress
    )
    assert done.figures["photos"] == 2
    assert photos(copy) == {"Z001": "photos/Z001.jpg", "Z002": "photos/Z002.jpg"}
    assert (copy / "photos" / "Z001.jpg").read_bytes() == (source / "z001_crack.jpg").read_bytes()
    page = (copy / "report.html").read_text(encoding="utf-8")
    assert "Photo of Z001" in page
    assert "Photo of Z002" in page
    assert any("berm.jpg" in warning for warning in progress.warnings)
    assert "Unreviewed" in Pages(copy / "report.pdf").texts[1]


def test_measured_columns_stay_guarded_and_the_table_sound(copy: Path, tmp_path: Path) -> None:
    enter_photos(copy, pictures(tmp_path / "source", Z001="red"), Progress())
    with closing(sqlite3.connect(copy / "zones.gpkg")) as database:
        for name in ("ST_IsEmpty", "ST_MinX", "ST_MaxX", "ST_MinY", "ST_MaxY"):  # of the spatial index's triggers
            database.create_function(name, 1, lambda _: None)
        assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        with pytest.raises(sqlite3.Error, match="Measured columns"):
            database.execute("UPDATE zones SET area_m2 = 1")


def test_another_picture_of_a_zone_keeps_the_file_of_before(copy: Path, tmp_path: Path) -> None:
    enter_photos(copy, pictures(tmp_path / "first", Z001="red"), Progress())
    enter_photos(copy, pictures(tmp_path / "first", Z001="red"), Progress())
    assert photos(copy) == {"Z001": "photos/Z001.jpg"}
    enter_photos(copy, pictures(tmp_path / "second", Z001="blue"), Progress())
    assert photos(copy) == {"Z001": "photos/Z001_2.jpg"}
    assert (copy / "photos" / "Z001.jpg").read_bytes() == (tmp_path / "first" / "Z001.jpg").read_bytes()


def test_of_several_pictures_the_first_by_name_is_taken_and_it_is_said(copy: Path, tmp_path: Path) -> None:
    progress = Progress()
    enter_photos(copy, pictures(tmp_path / "source", Z001_b="blue", Z001_a="red"), progress)
    assert (copy / "photos" / "Z001.jpg").read_bytes() == (tmp_path / "source" / "Z001_a.jpg").read_bytes()
    assert progress.warnings == ["Z001 has 2 pictures; Z001_a.jpg is shown."]


def test_what_cannot_be_used_is_one_sentence_and_nothing_is_entered(copy: Path, tmp_path: Path) -> None:
    before = (copy / "zones.gpkg").read_bytes()
    (tmp_path / "empty").mkdir()
    bad = pictures(tmp_path / "bad", Z001="red")
    (bad / "Z002.jpg").write_bytes(b"no picture")
    for source, sentence in (
        (tmp_path / "none", "does not exist"),
        (tmp_path / "empty", "holds no picture"),
        (pictures(tmp_path / "strange", Z0011="red"), r"begin their names with one of Z001, Z002, such as Z001\.jpg"),
        (bad, "cannot be read as a picture"),
    ):
        with pytest.raises(InputError, match=sentence):
            enter_photos(copy, source, Progress())
    assert (copy / "zones.gpkg").read_bytes() == before
    assert not (copy / "photos").exists()
    with pytest.raises(InputError, match="no table of zones"):
        enter_photos(tmp_path / "empty", bad, Progress())


def test_a_table_that_another_program_writes_is_named(copy: Path, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("slopewatch.workflows.photos._WAIT_S", 0.1)
    source = pictures(tmp_path / "source", Z001="red")
    with closing(sqlite3.connect(copy / "zones.gpkg")) as other:
        other.execute("BEGIN EXCLUSIVE")
        with pytest.raises(InputError, match=r"cannot be (read|entered)"):
            enter_photos(copy, source, Progress())
