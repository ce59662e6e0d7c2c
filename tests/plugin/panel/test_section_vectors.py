"""Displacement vectors in the panel's sections: which ones, in the plane of the section, and how they are drawn."""

from __future__ import annotations

import json
import math
import random
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from qgis.core import (
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
    QgsFeature,
    QgsGeometry,
    QgsPointXY,
    QgsProject,
    QgsVectorFileWriter,
    QgsVectorLayer,
)
from qgis.PyQt.QtGui import QImage
from slopewatch.plugin.panel.charts import SectionChart
from slopewatch.plugin.panel.section_arrows import magnification, surface_at
from slopewatch.plugin.panel.section_vectors import line_of, vectors_near
from slopewatch.plugin.panel.sections import Place, Section, SectionVector, sections_of
from slopewatch.plugin.panel.zone_charts import section_of
from slopewatch.plugin.panel.zone_rows import zone_rows
from slopewatch.tests.builders.qgis import engine_python

UTM = "EPSG:32651"
X0, Y0 = 500500.0, 3500200.0
COLUMNS = ("east_m", "north_m", "up_m", "window_m")

Row = tuple[float, ...]
"""Place, and the columns; of a series with the days at the end."""


def vectors_file(folder: Path, rows: Sequence[Row], *more: str) -> None:
    columns = "".join(f"&field={name}:double" for name in COLUMNS) + "".join(f"&field={name}:integer" for name in more)
    layer = QgsVectorLayer(f"Point?crs={UTM}{columns}", "vectors", "memory")
    for row in rows:
        feature = QgsFeature(layer.fields())
        feature.setGeometry(QgsGeometry.fromPointXY(QgsPointXY(X0 + row[0], Y0 + row[1])))
        feature.setAttributes(list(row[2:]))
        assert layer.dataProvider().addFeature(feature)
    options = QgsVectorFileWriter.SaveVectorOptions()
    options.driverName, options.layerName = "GPKG", "vectors"
    context = QgsProject.instance().transformContext()
    path = str(folder / "displacement.gpkg")
    assert QgsVectorFileWriter.writeAsVectorFormatV3(layer, path, context, options)[0] == 0


def line(*corners: tuple[float, float]) -> QgsGeometry:
    return QgsGeometry.fromPolylineXY([QgsPointXY(X0 + x, Y0 + y) for x, y in corners])


def found(folder: Path, way: QgsGeometry, crs: str = UTM) -> list[tuple[float, ...]]:
    return [(v.distance, v.along, v.up) for v in vectors_near(folder, way, QgsCoordinateReferenceSystem(crs))]


def test_vectors_within_half_their_window_are_turned_into_the_section(qgis_app: Any, tmp_path: Path) -> None:
    """A line that runs 3 east and 4 north: what moves along it, across it, and what lies too far off."""
    along, across = (0.6, 0.8), (-0.8, 0.6)

    def place(distance: float, off: float) -> tuple[float, float]:
        return tuple(distance * a + off * b for a, b in zip(along, across))

    rows = [
        (*place(12.0, 2.4), 0.06, 0.08, -0.05, 5.0),  # along it, by 0.1 m
        (*place(4.0, -2.4), -0.08, 0.06, 0.02, 5.0),  # across it
        (*place(8.0, 2.6), 0.06, 0.08, 0.0, 5.0),  # beyond half its window
        (*place(9.0, 2.6), -0.03, -0.04, 0.01, 8.0),  # within half of a wider one, backwards
        (*place(-1.0, 0.5), 0.06, 0.08, 0.0, 5.0),  # before the line begins
        (*place(21.0, 0.5), 0.06, 0.08, 0.0, 5.0),  # behind its end
    ]
    vectors_file(tmp_path, rows)
    expected = [(4.0, 0.0, 0.02), (9.0, -0.05, 0.01), (12.0, 0.1, -0.05)]
    section = line((0.0, 0.0), (12.0, 16.0))
    assert found(tmp_path, section) == [pytest.approx(row, abs=1e-6) for row in expected]
    # a line of another reference system comes to the same places
    degrees = QgsGeometry(section)
    context = QgsProject.instance()
    degrees.transform(
        QgsCoordinateTransform(QgsCoordinateReferenceSystem(UTM), QgsCoordinateReferenceSystem("EPSG:4326"), context)
    )
    assert found(tmp_path, degrees, "EPSG:4326") == [pytest.approx(row, abs=1e-4) for row in expected]
    assert found(tmp_path / "nothing", section) == []


def test_of_a_series_the_motion_until_the_last_survey_is_taken(qgis_app: Any, tmp_path: Path) -> None:
    rows = [(5.0, 0.0, 0.01 * days, 0.0, 0.0, 5.0, days) for days in (60, 180, 120)]
    vectors_file(tmp_path, rows, "days")
    assert found(tmp_path, line((0.0, 0.0), (10.0, 0.0))) == [pytest.approx((5.0, 1.8, 0.0))]


def test_they_are_those_of_the_reports_profiles(qgis_app: Any, tmp_path: Path) -> None:
    """The engine takes the same vectors, from the same file, near a line with a corner."""
    draw = random.Random(7)
    rows = [
        (draw.uniform(-3, 23), draw.uniform(-8, 14), *(draw.gauss(0, 0.1) for _ in range(3)), draw.choice((5.0, 8.0)))
        for _ in range(120)
    ]
    vectors_file(tmp_path, rows)
    corners = [(0.0, 0.0), (11.0, 2.0), (20.0, 9.0)]
    program = (
        "import json, sys; from shapely.geometry import LineString; from pathlib import Path;"
        "from slopewatch.engine.vector.geopackage import read_layer;"
        "from slopewatch.engine.zones.section_vectors import vectors_near;"
        "v = vectors_near(LineString(json.loads(sys.argv[2])), read_layer(Path(sys.argv[1]), 'vectors'));"
        "print(json.dumps([list(map(float, row)) for row in zip(v.distance, v.along, v.up)]))"
    )
    place = json.dumps([(X0 + x, Y0 + y) for x, y in corners])
    command = [engine_python(), "-c", program, str(tmp_path / "displacement.gpkg"), place]
    told = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    assert 20 < len(told) < len(rows)
    assert found(tmp_path, line(*corners)) == [pytest.approx(row, abs=1e-4) for row in told]


def test_the_section_of_a_zone_has_the_vectors_near_its_line(pair_run: Path, tmp_path: Path) -> None:
    """Both of the run's own profile and of one cut through its rasters: vectors straight down the slope go along it."""
    results = shutil.copytree(pair_run, tmp_path / "results")
    (results / "displacement.gpkg").unlink(missing_ok=True)
    layer = QgsVectorLayer(f"{results}/zones.gpkg|layername=zones", "zones", "ogr")
    rows = zone_rows(layer)
    in_table = next(row for row in rows if sections_of(results, row.name))
    cut = next(row for row in rows if not sections_of(results, row.name))
    assert section_of(results, layer, in_table).vectors == ()
    way, _ = line_of(results, sections_of(results, in_table.name)[0].name)
    assert line_of(results, "another line") is None
    (begin, *_, end) = way.asPolyline()
    ahead = ((end.x() - begin.x()) / way.length(), (end.y() - begin.y()) / way.length())
    vectors = []
    for row in (in_table, cut):
        middle = layer.getFeature(row.feature).geometry().centroid().asPoint()
        vectors.append((middle.x() - X0, middle.y() - Y0, 0.2 * ahead[0], 0.2 * ahead[1], -0.1, 8.0))
    vectors_file(results, vectors)
    for row in (in_table, cut):
        section = section_of(results, layer, row)
        assert len(section.vectors) >= 1
        one = min(section.vectors, key=lambda v: abs(v.distance - section.places[-1].distance / 2))
        assert one.along == pytest.approx(0.2, abs=0.02)
        assert one.up == -0.1
        assert 0.25 < one.distance / section.places[-1].distance < 0.75
    del layer


def test_arrows_are_magnified_to_a_round_number_that_fits() -> None:
    def times(amounts: Sequence[float], length: float) -> float:
        return magnification([SectionVector(0.0, a, 0.0) for a in amounts], length)

    assert times([0.1], 20.0) == 10.0  # 1.6 m of 20 m by 0.1 m: 16
    assert times([0.1, -0.2, 0.15], 50.0) == 20.0  # nine tenths are 0.19 m: 21
    assert times([30.0], 20.0) == 1.0
    assert times([0.0], 20.0) == 1000.0


def test_the_surface_below_an_arrow_is_between_the_known_places() -> None:
    nan = math.nan
    places = [
        Place(0.0, 10.0, 10.2, 0.2, 0.1), Place(2.0, nan, nan, nan, nan), Place(4.0, nan, 8.1, nan, nan),
    ]  # fmt: skip
    assert surface_at(places, 3.0) == pytest.approx(10.1 - 0.75 * 2.0)
    assert surface_at(places, 9.0) == 8.1
    assert math.isnan(surface_at([places[1]], 1.0))


def red(image: QImage) -> list[tuple[int, int]]:
    """Where the colour of the arrows is, or lies half over white."""
    return [
        (x, y)
        for x in range(image.width())
        for y in range(image.height())
        if image.pixelColor(x, y).red() - image.pixelColor(x, y).green() > 70
    ]


def drawn(vectors: tuple[SectionVector, ...], heights: bool, width: int = 520) -> QImage:
    chart = SectionChart()
    places = tuple(
        Place(float(n), *((20.0 - 0.5 * n, 20.0 - 0.5 * n) if heights else (math.nan, math.nan)), 0.0, 0.1)
        for n in range(21)
    )
    chart.show_section(Section("a line", places, vectors))
    chart.resize(width, 360)
    return chart.grab().toImage()


@pytest.mark.parametrize("heights", [True, False])
def test_arrows_are_drawn_where_the_vectors_lie(qgis_app: Any, heights: bool) -> None:
    assert red(drawn((), heights)) == []
    # of both the length of the longest sets the scale, so that the shorter one is drawn half as long
    left, right = SectionVector(5.0, 0.2, -0.1), SectionVector(15.0, 0.1, -0.05)
    image = drawn((left, right), heights)
    arrows = [(x, y) for x, y in red(image) if y > 60]  # without the words on them
    first = [(x, y) for x, y in arrows if x < 0.55 * image.width()]
    second = [(x, y) for x, y in arrows if x >= 0.55 * image.width()]
    spans = [max(x for x, _ in one) - min(x for x, _ in one) for one in (first, second)]
    assert 20 < spans[0] < 60
    assert 1.6 < spans[0] / spans[1] < 2.6
    # both go down, and the second lies lower only where the surface does
    tops = [min(y for _, y in one) for one in (first, second)]
    assert (tops[1] - tops[0] > 20) == heights
    for one in (first, second):
        start = min(one)[1]
        assert max(one)[1] > start


def test_sliding_along_the_drawn_surface_is_parallel_to_it(qgis_app: Any) -> None:
    image = drawn((SectionVector(8.0, 0.2, -0.1),), heights=True)
    arrow = [(x, y) for x, y in red(image) if y > 60]
    (x0, y0), (x1, y1) = min(arrow), max(arrow)
    ink = [
        (x, y)
        for x in range(80, image.width() - 30)
        for y in range(60, image.height() // 2)
        if image.pixelColor(x, y).name() == "#24292f"
    ]
    (u0, v0), (u1, v1) = min(ink), max(ink)
    assert (y1 - y0) / (x1 - x0) == pytest.approx((v1 - v0) / (u1 - u0), abs=0.12)


def test_a_narrow_panel_gives_the_words_on_arrows_a_row_of_their_own(qgis_app: Any) -> None:
    def rows_of_words(width: int) -> set[int]:
        return {y for _, y in red(drawn((SectionVector(10.0, 0.0005, 0.0),), heights=True, width=width)) if y < 60}

    wide, narrow = rows_of_words(700), rows_of_words(330)
    assert wide
    assert narrow
