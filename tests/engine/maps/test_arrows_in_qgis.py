"""Styles of motion along the surface as QGIS itself draws them."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import geopandas as gpd
import numpy as np
import pytest
import shapely
from PIL import Image
from pyproj import CRS
from slopewatch.engine.grid.geotiff import write_bands
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.maps import displacement_styles, opacity_band
from slopewatch.engine.maps.qgis_styles import write_qml_next_to
from slopewatch.engine.vector.geopackage import Layer, write_layers

X0, Y0 = 500000.0, 4000000.0
RED, BLUE, PURPLE = (179, 24, 24), (27, 94, 143), (84, 39, 136)

SCRIPT = """
import sys
from qgis.core import QgsApplication, QgsDateTimeRange, QgsMapRendererParallelJob, QgsMapSettings, QgsRectangle
from qgis.core import QgsRasterLayer, QgsVectorLayer
from qgis.PyQt.QtCore import QDate, QDateTime, QSize, QTime, Qt
from qgis.PyQt.QtGui import QColor
application = QgsApplication([], False)
application.initQgis()
folder = sys.argv[1]

def named(name):
    layer = QgsVectorLayer(folder + "/motion.gpkg|layername=" + name, name, "ogr")
    layer.loadDefaultStyle()  # as the plugin does: QGIS itself takes all but the times
    return layer

def draw(layer, file, background, day=""):
    settings = QgsMapSettings()
    settings.setLayers([layer])
    settings.setDestinationCrs(layer.crs())
    settings.setExtent(QgsRectangle(500000, 4000000, 500020, 4000015))
    settings.setOutputSize(QSize(800, 600))
    settings.setOutputDpi(96)
    settings.setBackgroundColor(QColor(background))
    if day:
        moment = QDateTime(QDate.fromString(day, Qt.DateFormat.ISODate), QTime(0, 0), Qt.TimeSpec.UTC)
        settings.setIsTemporal(True)
        settings.setTemporalRange(QgsDateTimeRange(moment, moment))
    job = QgsMapRendererParallelJob(settings)
    job.start()
    job.waitForFinished()
    job.renderedImage().save(folder + "/" + file)

draw(named("vectors"), "dark.png", "#4a1208")
draw(named("velocities"), "velocities.png", "white")
draw(named("doubted"), "doubted.png", "white")
draw(named("zones"), "zones.png", "white")
draw(QgsRasterLayer(folder + "/displacement.tif", "motion"), "raster.png", "white")  # finds its style by itself
for day in ("2024-05-31", "2024-06-01", "2024-06-30", "2024-07-01"):
    draw(named("moves"), day + ".png", "white", day)
sys.stdout.flush()
application.exitQgis()
"""


def motion(places: list[tuple[float, float]], east: list[float], unit: str = "m") -> gpd.GeoDataFrame:
    """Points that move to the east, with errors far smaller than the motion."""
    count = len(places)
    columns = {f"east_{unit}": east, f"north_{unit}": [0.0] * count, f"length_{unit}": east}
    columns |= {f"{name}_{unit}": [0.001] * count for name in ("length_err", "err_major", "err_minor")}
    columns |= {name: [90.0] * count for name in ("azimuth_deg", "plunge_deg", "err_azimuth_deg", "window_m")}
    points = shapely.points(np.array([(X0 + x, Y0 + y) for x, y in places]))
    return gpd.GeoDataFrame(columns, geometry=points, crs="EPSG:32651")


def write_raster(path: Path) -> None:
    """All ground moves alike down the dip, which is significant in the west and little in the middle, and known there
    alone.
    """
    down, beyond = np.full((15, 20), 0.3), np.zeros((15, 20), dtype=bool)
    beyond[:, :8], down[:, 14:] = True, np.nan
    names = [f"band {number}" for number in range(1, displacement_styles.OPACITY_BAND)]
    bands = {name: down if name == "band 4" else np.zeros_like(down) for name in names}
    bands[displacement_styles.OPACITY_NAME] = opacity_band.opacity(down, beyond)
    grid = Grid(west=X0, north=Y0 + 15.0, cell=1.0, rows=15, columns=20)
    write_bands(path, bands, grid, CRS(32651), unit=["m"] * len(bands))
    write_qml_next_to(path, displacement_styles.along_dip_qml(0.3))


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    python = shutil.which("python3", path="/usr/bin:/usr/local/bin")
    command = [python, "-c", "import qgis.core"]
    if python is None or subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip("no interpreter with QGIS in /usr/bin or /usr/local/bin")
    folder = tmp_path_factory.mktemp("arrows")
    moves = motion([(5.0, 5.0), (5.0, 10.0)], [0.1, 0.2])
    for name, days in (("time_from", ("2024-05-02", "2024-06-01")), ("time_to", ("2024-05-31", "2024-06-30"))):
        moves[name] = np.array(days, dtype="datetime64[ms]")
    zone = motion([(5.0, 5.0)], [0.3]).assign(zone_id="M001", area_m2=60.0, off_dip_deg=1.0, p_map=0.0)
    zone = zone.set_geometry([shapely.MultiPolygon([shapely.box(X0 + 2, Y0 + 2, X0 + 12, Y0 + 8)])], crs="EPSG:32651")
    velocities = motion([(5.0, 7.5)], [2.0], "mm_day")
    arrows = displacement_styles.vectors_qml(20.0)
    write_layers(
        folder / "motion.gpkg",
        [
            Layer(velocities, "velocities", displacement_styles.velocities_qml(2000.0), "Point"),
            Layer(motion([(5.0, 7.5)], [0.2]).assign(doubtful=0), "vectors", arrows, "Point"),
            Layer(motion([(5.0, 5.0), (5.0, 10.0)], [0.2, 0.2]).assign(doubtful=[1, 0]), "doubted", arrows, "Point"),
            Layer(zone, "zones", displacement_styles.moving_zones_qml(20.0), "MultiPolygon"),
            Layer(moves, "moves", displacement_styles.vectors_qml(20.0, temporal=True), "Point"),
        ],
    )  # fmt: skip
    write_raster(folder / "displacement.tif")
    environment = {"PATH": "/usr/bin:/bin", "QT_QPA_PLATFORM": "offscreen", "HOME": str(folder)}
    subprocess.run([python, "-c", SCRIPT, str(folder)], check=True, capture_output=True, env=environment, timeout=120)
    return folder


def near(path: Path, colour: tuple[int, int, int]) -> np.ndarray:
    """(rows, columns) where a picture has nearly a colour."""
    pixels = np.asarray(Image.open(path).convert("RGB")).astype(int)
    return np.abs(pixels - colour).max(axis=2) < 30


def test_an_arrow_is_as_long_as_its_motion_by_its_magnification_and_has_a_light_seam(drawn: Path) -> None:
    arrow = near(drawn / "dark.png", RED)
    columns = np.flatnonzero(arrow.any(axis=0))
    # 40 pixels a metre: from 5 m by 20 times 0.2 m
    assert columns.max() - columns.min() == pytest.approx(4.0 * 40, abs=8)
    # across the middle of its shaft: seam, arrow, seam, on ground of a colour near its own
    shaft = np.asarray(Image.open(drawn / "dark.png").convert("RGB"))[:, 5 * 40 + 60]
    light = np.flatnonzero(shaft.min(axis=1) > 180)
    red = np.flatnonzero(arrow[:, 5 * 40 + 60])
    assert len(red) >= 1
    assert light.min() < red.min()
    assert light.max() > red.max()


def test_a_doubtful_arrow_is_pale(drawn: Path) -> None:
    rows = np.flatnonzero(near(drawn / "doubted.png", RED).any(axis=1))
    assert rows.mean() == pytest.approx(600 - 40 * 10.0, abs=4)
    pale = np.asarray(Image.open(drawn / "doubted.png").convert("RGB")).astype(int)[600 - 5 * 40, 5 * 40 + 60]
    assert 180 < pale[0] <= 255
    assert 130 < pale[1] < 240


def test_motion_within_its_error_is_pale_in_the_raster(drawn: Path) -> None:
    pixels = np.asarray(Image.open(drawn / "raster.png").convert("RGB")).astype(int)[300]
    significant, within, unknown = (pixels[40 * column] for column in (4, 11, 17))
    assert 255 - significant[1:].mean() > 150  # the full red of the ramp's end
    assert 10 < 255 - within[1:].mean() < 60
    assert within[0] > within[2]  # of the same colour, only paler
    assert (unknown == 255).all()


def test_velocities_are_drawn_by_their_own_columns(drawn: Path) -> None:
    columns = np.flatnonzero(near(drawn / "velocities.png", BLUE).any(axis=0))
    # 2 mm a day in 2000 days: 4 m
    assert columns.max() - columns.min() == pytest.approx(4.0 * 40, abs=8)


def test_the_name_of_a_moving_zone_lies_outside_and_hides_no_arrow(drawn: Path) -> None:
    letters = near(drawn / "zones.png", (30, 30, 30))
    rows, columns = np.nonzero(letters)
    assert len(rows) > 50
    inside = (columns > 2 * 40) & (columns < 12 * 40) & (rows > 600 - 8 * 40) & (rows < 600 - 2 * 40)
    assert not inside.any()
    arrow = near(drawn / "zones.png", PURPLE)[600 - 5 * 40]
    assert np.count_nonzero(arrow) > 3.0 * 40  # 20 times 0.3 m, less what its head leaves


@pytest.mark.parametrize(("day", "row"), [("2024-05-31", 5.0), ("2024-06-01", 10.0), ("2024-06-30", 10.0),
                                          ("2024-07-01", None)])  # fmt: skip
def test_a_survey_s_arrows_are_shown_until_its_own_day(drawn: Path, day: str, row: float | None) -> None:
    rows = np.flatnonzero(near(drawn / f"{day}.png", RED).any(axis=1))
    if row is None:
        assert not len(rows)
    else:
        assert rows.mean() == pytest.approx(600 - 40 * row, abs=4)
