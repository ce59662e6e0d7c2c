"""Reviews that the panel enters, as other programs read them from the file."""

from __future__ import annotations

import re
import sqlite3
import time
from collections.abc import Callable
from contextlib import closing
from datetime import date
from pathlib import Path

from qgis.core import QgsVectorLayer
from slopewatch.plugin.panel import reviews
from slopewatch.plugin.panel.dock import SlopeWatchPanel
from slopewatch.tests.builders.limits import PATIENCE_S

_REVIEW = "zone_id, review_status, reviewer, remarks"


def table(path: Path, columns: str = _REVIEW) -> dict[str, tuple]:
    with closing(sqlite3.connect(path)) as database:
        rows = database.execute(f"SELECT {columns} FROM zones ORDER BY zone_id").fetchall()
    return {row[0]: tuple(value or "" for value in row[1:]) for row in rows}


def choose(panel: SlopeWatchPanel, *names: str) -> None:
    panel.zones.view.clearSelection()
    rows = {row.name: row for row in panel.zones.model.rows}
    panel.zones.choose(rows[names[0]].feature)
    selection = panel.zones.view.selectionModel()
    for number in range(panel.zones.filter.rowCount()):
        index = panel.zones.filter.index(number, 0)
        if index.data() in names:
            selection.select(index, selection.SelectionFlag.Select | selection.SelectionFlag.Rows)


def test_reviews_are_in_the_file_once_they_are_saved(
    panel: SlopeWatchPanel, results: Path, settled: Callable[[], None]
) -> None:
    before = table(results / "zones.gpkg", "zone_id, dz_mean_m, area_m2, hex(geom)")
    panel.load_run(results)
    assert not panel.reviews.confirm.isEnabled()
    choose(panel, "Z001", "Z002")
    panel.reviews.confirm.click()
    choose(panel, "Z003")
    panel.reviews.reject.click()
    panel.reviews.enter_remark("  grass was cut here\n")
    settled()
    assert set(table(results / "zones.gpkg").values()) == {("unreviewed", "", "")}, "not before they are saved"
    assert panel.zones.summary.text().endswith("2 confirmed, 1 rejected")
    panel.reviews.save.click()
    entered = table(results / "zones.gpkg")
    assert entered["Z001"] == entered["Z002"] == ("confirmed", "A. Sato", "")
    assert entered["Z003"] == ("rejected", "A. Sato", "grass was cut here")
    assert table(results / "zones.gpkg", "zone_id, dz_mean_m, area_m2, hex(geom)") == before
    days = table(results / "zones.gpkg", "zone_id, review_date")
    today = date.today().isoformat()
    assert [days[name] for name in ("Z001", "Z002", "Z003")] == [(today,)] * 3
    assert {day for name, day in days.items() if name > "Z003"} <= {("",)}
    settled()
    assert not panel.reviews.save.isEnabled()
    choose(panel, "Z001")
    panel.reviews.reset.click()
    panel.reviews.save.click()
    assert table(results / "zones.gpkg")["Z001"] == ("unreviewed", "", "")
    assert table(results / "zones.gpkg", "zone_id, review_date")["Z001"] == ("",)


def test_what_is_not_saved_can_be_taken_back_step_by_step(
    panel: SlopeWatchPanel, results: Path, settled: Callable[[], None]
) -> None:
    panel.load_run(results)
    choose(panel, "Z001")
    panel.reviews.confirm.click()
    panel.reviews.enter_remark("crack")
    row = next(r for r in _rows(panel, settled) if r.name == "Z001")
    assert (row.state, row.remarks) == ("confirmed", "crack")
    panel.reviews.undo.click()
    row = next(r for r in _rows(panel, settled) if r.name == "Z001")
    assert (row.state, row.reviewer, row.remarks) == ("confirmed", "A. Sato", "")
    panel.reviews.undo.click()
    row = next(r for r in _rows(panel, settled) if r.name == "Z001")
    assert (row.state, row.reviewer) == ("unreviewed", "")
    panel.reviews.save.click()
    assert set(table(results / "zones.gpkg").values()) == {("unreviewed", "", "")}


def _rows(panel: SlopeWatchPanel, settled: Callable[[], None]) -> list:
    settled()
    return list(panel.zones.model.rows)


def test_a_picture_is_copied_once_and_found_again(
    panel: SlopeWatchPanel, results: Path, tmp_path: Path, settled: Callable[[], None]
) -> None:
    (tmp_path / "DSC 1.jpg").write_bytes(b"one")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "DSC 1.jpg").write_bytes(b"two")
    panel.load_run(results)
    choose(panel, "Z001", "Z002")
    panel.reviews.enter_photo(tmp_path / "DSC 1.jpg")
    choose(panel, "Z003")
    panel.reviews.enter_photo(tmp_path / "other" / "DSC 1.jpg")
    panel.reviews.save.click()
    assert table(results / "zones.gpkg", "zone_id, photo") == {
        "Z001": ("photos/DSC 1.jpg",),
        "Z002": ("photos/DSC 1.jpg",),
        "Z003": ("photos/DSC 1_2.jpg",),
        **{name: ("",) for name in table(results / "zones.gpkg") if name > "Z003"},
    }
    assert [p.read_bytes() for p in sorted((results / "photos").iterdir())] == [b"one", b"two"]
    settled()
    assert reviews.photo_path(panel.layer(), panel.zones.current().photo).read_bytes() == b"two"
    assert panel.reviews.look.isEnabled()


def test_an_undone_picture_takes_its_column_along(panel: SlopeWatchPanel, results: Path, tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"one")
    layer = panel.load_run(results)[0]
    choose(panel, "Z001")
    panel.reviews.enter_photo(tmp_path / "a.png")
    assert "photo" in layer.fields().names()
    panel.reviews.undo.click()
    assert "photo" not in layer.fields().names()


def test_what_cannot_be_entered_or_saved_is_said(
    panel: SlopeWatchPanel, results: Path, tmp_path: Path, warnings: list[str]
) -> None:
    with closing(sqlite3.connect(results / "zones.gpkg")) as database, database:
        database.execute(
            "CREATE TRIGGER locked BEFORE UPDATE ON zones BEGIN SELECT RAISE(ABORT, 'this table is closed'); END"
        )
    layer = panel.load_run(results)[0]
    choose(panel, "Z001")
    panel.reviews.enter_photo(tmp_path / "gone.png")
    assert warnings.pop().endswith("gone.png is not there; choose another one.")
    panel.reviews.confirm.click()
    panel.reviews.save.click()
    sentence = warnings.pop()
    assert sentence.startswith(f"The reviews of {layer.name()} could not be saved")
    assert "this table is closed" in sentence
    assert reviews.unsaved(layer), "what was entered is kept"
    with closing(sqlite3.connect(results / "zones.gpkg")) as database, database:
        database.execute("DROP TRIGGER locked")
    panel.reviews.save.click()
    assert table(results / "zones.gpkg")["Z001"] == ("confirmed", "A. Sato", "")


def test_a_layer_that_is_read_only_is_said(panel: SlopeWatchPanel, results: Path, warnings: list[str]) -> None:
    layer: QgsVectorLayer = panel.load_run(results)[0]
    layer.setReadOnly(True)
    choose(panel, "Z001")
    panel.reviews.confirm.click()
    assert "cannot be edited" in warnings[0]


def test_the_report_is_made_again_with_the_reviews(
    panel: SlopeWatchPanel, provider: object, results: Path, qgis_app: object
) -> None:
    panel.load_run(results)
    assert "A. Sato" not in (results / "report.html").read_text(encoding="utf-8")
    choose(panel, "Z001")
    panel.reviews.confirm.click()
    panel.write_button.click()
    assert not panel.write_button.isEnabled()
    end = time.monotonic() + PATIENCE_S
    while panel._task is not None and time.monotonic() < end:
        qgis_app.processEvents()
        time.sleep(0.02)
    assert panel.sentence.text() == f"The report of {results} is there."
    page = (results / "report.html").read_text(encoding="utf-8")
    assert re.search(r"Review: Confirmed by A\. Sato on \d{4}-\d\d-\d\d\.", page)
    assert panel.write_button.isEnabled()
