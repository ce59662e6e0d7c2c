"""Sections and time series: the values of the run's own tables and rasters, and what is drawn of them."""

from __future__ import annotations

import csv
import math
import sys
from collections.abc import Callable
from datetime import date
from pathlib import Path

import pytest
from qgis.core import QgsRasterLayer, QgsVectorLayer
from qgis.PyQt.QtGui import QImage
from slopewatch.plugin.panel.axes import Axis, label, pieces, span, ticks
from slopewatch.plugin.panel.chart_painter import LOWERED, RAISED
from slopewatch.plugin.panel.charts import CourseChart, SectionChart
from slopewatch.plugin.panel.courses import Course, Survey, course_of
from slopewatch.plugin.panel.dock import SlopeWatchPanel
from slopewatch.plugin.panel.sampled_section import MARGIN_M, sampled_section
from slopewatch.plugin.panel.sections import Place, Section, sections_of


def rows_of(path: Path, zone: str) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return [row for row in csv.DictReader(file) if row["zone_id"] == zone]


def pixels(image: QImage, colour: object) -> list[tuple[int, int]]:
    return [
        (x, y)
        for x in range(image.width())
        for y in range(image.height())
        if image.pixelColor(x, y).name() == colour.name()
    ]


def picture(chart: object) -> QImage:
    chart.resize(420, 320)
    return chart.grab().toImage()


def test_the_section_is_that_of_the_runs_table(pair_run: Path) -> None:
    (section,) = sections_of(pair_run, "Z001")
    expected = rows_of(pair_run / "profiles.csv", "Z001")
    assert len(expected) > 20
    assert section.name == expected[0]["profile"]
    assert [p.distance for p in section.places] == [float(row["distance_m"]) for row in expected]
    for name, values in (
        ("dz_m", [p.change for p in section.places]),
        ("level_m", [p.level for p in section.places]),
        ("height_to_m", [p.height_to for p in section.places]),
    ):
        assert values == pytest.approx([float(row[name] or "nan") for row in expected], nan_ok=True)


def test_a_zone_without_a_profile_is_cut_down_the_slope(pair_run: Path) -> None:
    layer = QgsVectorLayer(f"{pair_run}/zones.gpkg|layername=zones", "zones", "ogr")
    zone = next(f for f in layer.getFeatures() if not sections_of(pair_run, f["zone_id"]))
    section = sampled_section(pair_run, zone["zone_id"], zone.geometry(), layer.crs())
    known = [p for p in section.places if math.isfinite(p.height_to)]
    assert known[0].height_to - known[-1].height_to > 0.5 * (known[-1].distance - known[0].distance)
    for place in (p for p in section.places if math.isfinite(p.change)):
        assert place.change == pytest.approx(place.height_to - place.height_from, abs=2e-3)
    box = zone.geometry().boundingBox()
    assert section.places[-1].distance <= math.hypot(box.width(), box.height()) + 2 * MARGIN_M + 0.01
    # the zone is on it: its own cells are beyond their level
    assert sum(abs(p.change) > p.level for p in known) >= 5


def test_a_zone_of_a_series_is_cut_along_its_longer_side(series_run: Path) -> None:
    layer = QgsVectorLayer(f"{series_run}/series.gpkg|layername=zones", "zones", "ogr")
    zone = next(layer.getFeatures())
    section = sampled_section(series_run, zone["zone_id"], zone.geometry(), layer.crs())
    assert not section.has_heights
    last = QgsRasterLayer(str(max((series_run / "cumulative").glob("elevation_change_*.tif"))), "last")
    low, high = (last.dataProvider().bandStatistics(1).minimumValue, last.dataProvider().bandStatistics(1).maximumValue)
    known = [p.change for p in section.places if math.isfinite(p.change)]
    assert len(known) >= 4
    assert all(low - 1e-6 <= change <= high + 1e-6 for change in known)
    assert sampled_section(series_run.parent, "S001", zone.geometry(), layer.crs()) is None


def test_the_course_is_that_of_the_series_table(series_run: Path) -> None:
    course = course_of(series_run, "S001")
    expected = rows_of(series_run / "series.csv", "S001")
    assert course.begin == date(2024, 5, 1)
    assert [s.day.isoformat() for s in course.surveys] == [row["epoch"] for row in expected]
    assert [s.change for s in course.surveys] == [float(row["dz_mean_m"]) for row in expected]
    assert [s.level for s in course.surveys] == [float(row["lod95_m"]) for row in expected]
    assert course_of(series_run, "S999") is None


def test_a_table_of_something_else_is_refused(tmp_path: Path) -> None:
    for name, read in (("profiles.csv", sections_of), ("series.csv", course_of)):
        (tmp_path / name).write_text("a,b\n1,2\n", encoding="utf-8")
        with pytest.raises(ValueError, match="has no column 'zone_id'"):
            read(tmp_path, "Z001")


def test_what_is_beyond_its_level_is_coloured_and_the_rest_is_not(qgis_app: object) -> None:
    chart = SectionChart()
    places = [Place(float(n), math.nan, math.nan, dz, 0.1) for n, dz in enumerate((0.0, 0.05, 0.5, -0.5, -0.05, 0.0))]
    chart.show_section(Section("a line", tuple(places)))
    image = picture(chart)
    raised, lowered = pixels(image, RAISED), pixels(image, LOWERED)
    # one dot each, the raised one higher and before the lowered one
    assert 3 < len(raised) < 60
    assert 3 < len(lowered) < 60
    assert max(y for _, y in raised) < min(y for _, y in lowered)
    assert max(x for x, _ in raised) < min(x for x, _ in lowered)
    within = [Place(p.distance, math.nan, math.nan, p.change, 0.6) for p in places]
    chart.show_section(Section("a line", tuple(within)))
    image = picture(chart)
    assert pixels(image, RAISED) == pixels(image, LOWERED) == []


def test_the_band_of_the_level_is_drawn(qgis_app: object) -> None:
    """Its grey fills more of the chart where the level is higher."""
    grey = []
    for level in (0.1, 0.3):
        chart = CourseChart()
        surveys = tuple(Survey(date(2024, 5, day), 0.5, 0.02, level) for day in (5, 10, 20))
        chart.show_course(Course("S001", date(2024, 5, 1), surveys))
        image = picture(chart)
        assert len(pixels(image, RAISED)) > 30
        counted = [
            (x, y)
            for x in range(image.width())
            for y in range(image.height())
            if 210 < image.pixelColor(x, y).red() < 235 and image.pixelColor(x, y).saturation() < 8
        ]
        grey.append(len(counted))
    assert grey[1] > 1.8 * grey[0] > 1000


def test_charts_of_nothing_say_so(qgis_app: object) -> None:
    chart = SectionChart()
    chart.say("Nothing is known here.")
    spoken = picture(chart)
    chart.say("")
    assert spoken != picture(chart)


def test_the_panel_draws_what_the_run_has(
    panel: SlopeWatchPanel, pair_run: Path, series_run: Path, settled: Callable[[], None]
) -> None:
    panel.load_run(pair_run)
    panel.zones.choose(panel.zones.model.rows[0].feature)
    drawn, known = panel.charts.section.section, sections_of(pair_run, "Z001")[0]
    assert (drawn.name, drawn.places) == (known.name, known.places)
    assert panel.charts.currentWidget() is panel.charts.section
    assert "compares two surveys" in panel.charts.course.sentence
    panel.load_run(series_run)
    panel.zones.choose(panel.zones.model.rows[0].feature)
    assert panel.charts.course.course == course_of(series_run, "S001")
    assert panel.charts.currentWidget() is panel.charts.course
    assert panel.charts.course.sentence == ""
    assert "matplotlib" not in sys.modules


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [(0.0, 1.0, ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]), (74.0, 83.0, ["74", "76", "78", "80", "82"]),
     (-0.06, 0.04, ["-0.06", "-0.04", "-0.02", "0.00", "0.02", "0.04"]),
     (0.0, 11.0, ["0.0", "2.5", "5.0", "7.5", "10.0"])],
)  # fmt: skip
def test_ticks_are_round_and_named_with_enough_decimals(low: float, high: float, expected: list[str]) -> None:
    found = ticks(low, high)
    assert [label(value, found[1] - found[0]) for value in found] == expected


def test_values_find_their_pixels_and_gaps_stay_open() -> None:
    axis = Axis(0.0, 10.0, 200.0, 100.0)
    assert [axis.at(v) for v in (0.0, 5.0, 10.0)] == [200.0, 150.0, 100.0]
    nan = math.nan
    assert pieces([(0, 1), (1, nan), (2, 3), (3, 4), (4, nan)]) == [[(0, 1)], [(2, 3), (3, 4)]]
    assert span([nan, 2.0, 4.0], margin=0.5) == (1.0, 5.0)
    low, high = span([nan])
    assert low < 0 < high


def test_a_point_outside_a_raster_is_a_gap(pair_run: Path) -> None:
    layer = QgsVectorLayer(f"{pair_run}/zones.gpkg|layername=zones", "zones", "ogr")
    zone = next(layer.getFeatures())
    shape = zone.geometry()
    shape.translate(1000.0, 0.0)
    section = sampled_section(pair_run, "Z001", shape, layer.crs())
    assert all(math.isnan(p.change) for p in section.places)
