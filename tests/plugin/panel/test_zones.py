"""The list of zones: those of a real run, filtered, and followed on the map."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from qgis.core import QgsProject, QgsVectorLayer
from slopewatch.interface.reviews import CONFIRMED, UNREVIEWED
from slopewatch.plugin.panel.dock import SlopeWatchPanel
from slopewatch.plugin.panel.zone_rows import counts, is_zones_layer, zone_rows


def table(path: Path, columns: str, layer: str = "zones") -> list[tuple]:
    """Rows of a layer as SQLite reads them."""
    with closing(sqlite3.connect(path)) as database:
        return database.execute(f"SELECT {columns} FROM {layer} ORDER BY zone_id").fetchall()


def shown(panel: SlopeWatchPanel) -> list[list[str]]:
    model = panel.zones.filter
    return [
        [model.index(row, column).data() for column in range(model.columnCount())] for row in range(model.rowCount())
    ]


def test_the_zones_of_a_run_are_listed(panel: SlopeWatchPanel, pair_run: Path) -> None:
    assert shown(panel) == []
    assert not panel.zoom_button.isEnabled()
    panel.load_run(pair_run)
    expected = table(pair_run / "zones.gpkg", "zone_id, kind, severity, dz_mean_m, area_m2, epoch_to")
    assert len(expected) >= 3
    assert shown(panel) == [
        [name, UNREVIEWED, kind, severity, f"{mean:+.3f}", f"{area:.1f}", day]
        for name, kind, severity, mean, area, day in expected
    ]
    assert panel.zones.summary.text() == f"{len(expected)} unreviewed"
    assert panel.report_button.isEnabled()


def test_the_zones_of_a_series_have_their_alert(panel: SlopeWatchPanel, series_run: Path) -> None:
    panel.load_run(series_run)
    expected = table(series_run / "series.gpkg", "zone_id, kind, alert, dz_mean_m, alert_level, alert_state")
    assert [(row[0], row[2], row[3], row[4]) for row in shown(panel)] == [
        (name, kind, f"{level} {alert}" + (f", {state}" if state else ""), f"{mean:+.3f}")
        for name, kind, alert, mean, level, state in expected
    ]


def test_a_run_is_loaded_once_and_what_is_no_run_is_refused(
    panel: SlopeWatchPanel, pair_run: Path, tmp_path: Path, warnings: list[str]
) -> None:
    first, second = panel.load_run(pair_run), panel.load_run(pair_run)
    assert [layer.id() for layer in first] == [layer.id() for layer in second]
    root = QgsProject.instance().layerTreeRoot()
    zones, unseen = (node.layer() for node in root.findLayers())
    assert zones.id() == first[0].id(), "above what is hatched"
    assert [part.layerType() for part in unseen.renderer().symbol().symbolLayers()] == ["SimpleFill", "LinePatternFill"]
    assert [node.itemVisibilityChecked() for node in root.findLayers()] == [True, True]
    assert panel.load_run(tmp_path) == []
    assert "holds no zones of a run" in warnings[0]


def test_other_layers_are_not_offered(panel: SlopeWatchPanel, pair_run: Path) -> None:
    footprints = QgsVectorLayer(f"{pair_run}/zones.gpkg|layername=footprints", "footprints", "ogr")
    assert footprints.isValid()
    assert not is_zones_layer(footprints)
    QgsProject.instance().addMapLayer(footprints)
    assert panel.layers.count() == 0
    layer = panel.load_run(pair_run)[0]
    assert panel.layers.count() == 1
    QgsProject.instance().removeMapLayer(layer.id())
    assert (panel.layers.count(), panel.layer(), shown(panel)) == (0, None, [])


def test_the_list_is_filtered_by_state(panel: SlopeWatchPanel, results: Path, settled: Callable[[], None]) -> None:
    layer = panel.load_run(results)[0]
    names = [row[0] for row in shown(panel)]
    panel.zones.choose(panel.zones.model.rows[1].feature)
    panel.reviews.enter(CONFIRMED)
    settled()
    for state, expected in (
        ("", names), (CONFIRMED, names[1:2]), (UNREVIEWED, [names[0], *names[2:]]), ("rejected", []),
    ):  # fmt: skip
        panel.zones.states.setCurrentIndex(panel.zones.states.findData(state))
        assert [row[0] for row in shown(panel)] == expected
    assert counts(zone_rows(layer)) == {UNREVIEWED: len(names) - 1, CONFIRMED: 1, "rejected": 0}


def test_numbers_are_sorted_as_numbers(panel: SlopeWatchPanel, pair_run: Path) -> None:
    panel.load_run(pair_run)
    panel.zones.view.sortByColumn(4, panel.zones.filter.sortOrder())
    means = [float(row[4]) for row in shown(panel)]
    assert means == sorted(means)
    assert means[0] < 0 < means[-1]


def test_a_zone_is_brought_on_the_map_and_one_chosen_there_is_shown(
    panel: SlopeWatchPanel, pair_run: Path, settled: Callable[[], None]
) -> None:
    layer = panel.load_run(pair_run)[0]
    last = panel.zones.model.rows[-1]
    panel.zones.choose(last.feature)
    panel.zoom_button.click()
    box = layer.getFeature(last.feature).geometry().boundingBox()
    seen = panel._canvas.extent()
    assert seen.contains(box)
    assert seen.width() < 20 * max(box.width(), box.height())
    first = panel.zones.model.rows[0]
    layer.selectByIds([first.feature])
    assert panel.zones.current() == first
    assert panel.charts.section.section.name.endswith(first.name)


@pytest.mark.parametrize("gone", ["run.json", "report.html"])
def test_without_a_run_or_its_report_there_is_none_to_open(panel: SlopeWatchPanel, results: Path, gone: str) -> None:
    (results / gone).unlink()
    panel.load_run(results)
    assert not panel.report_button.isEnabled()
    assert panel.write_button.isEnabled() == (gone == "report.html")
