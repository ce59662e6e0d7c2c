"""A small run of every algorithm: what its dialog is filled with, and what is looked at when it is done.

``RUNS`` is read by tests/qgis/test_every_dialog.py; an algorithm that is not in it fails there.
"""

from __future__ import annotations

import json
import math
import struct
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from qgis.core import QgsPointXY, QgsProject, QgsRasterLayer, QgsVectorLayer
from qgis.PyQt.QtCore import QDate
from slopewatch.processing_algorithms import setupengine
from slopewatch.tests.builders import known_truth
from slopewatch.tests.builders.algorithm_inputs import Inputs
from slopewatch.tests.builders.qgis import ROOT, engine_python

ON_BARE_GROUND = {"GROUND": "as_is"}
FIRST, LATER = QDate(2024, 5, 1), QDate(2025, 5, 1)


@dataclass(frozen=True)
class Run:
    """A run.

    Attributes:
        given: the dialog's values, from the inputs and an empty folder for the results.
        right: fails where the results are not what the inputs must give; gets the results and the inputs.
        layers: names of layers that the dialog loads, at least.
        arrange: what has to be done before, with the folder for the results.
    """

    given: Callable[[Inputs, Path], dict[str, Any]]
    right: Callable[[dict[str, Any], Inputs], None]
    layers: tuple[str, ...] = ()
    arrange: Callable[[Inputs, Path, pytest.MonkeyPatch], None] = lambda inputs, folder, monkeypatch: None


def must(right: bool) -> None:
    assert right


def one_fact(name: str, low: float, high: float) -> Callable[[dict[str, Any], Inputs], None]:
    def right(results: dict[str, Any], inputs: Inputs) -> None:
        assert low <= results[name] <= high, (name, results[name])

    return right


def near_the_truth(results: dict[str, Any], inputs: Inputs) -> None:
    """Where the simulation moved the ground by much, the change says so, too."""
    errors = []
    for expected, measured in pairs_of_cells(inputs.survey / "truth_dz.tif", Path(results["ELEVATION_CHANGE"])):
        if abs(expected) > 0.15:
            errors.append(abs(measured - expected))
    assert len(errors) > 20
    assert sorted(errors)[len(errors) // 2] < 0.06


def pairs_of_cells(first: Path, second: Path) -> list[tuple[float, float]]:
    """The values of one raster at the middle of its cells, and of another there."""
    one, other = QgsRasterLayer(str(first)), QgsRasterLayer(str(second))
    extent, size = one.extent(), one.rasterUnitsPerPixelX()
    found = []
    for column in range(one.width()):
        for row in range(one.height()):
            place = QgsPointXY(extent.xMinimum() + (column + 0.5) * size, extent.yMinimum() + (row + 0.5) * size)
            (a, known), (b, seen) = (layer.dataProvider().sample(place, 1) for layer in (one, other))
            if known and seen:
                found.append((a, b))
    return found


def points_in(cloud: Path) -> int:
    """Of the header of a LAS 1.4 file."""
    return int(struct.unpack_from("<Q", cloud.read_bytes()[:375], 247)[0])


def features(path: str, layer: str) -> int:
    return int(QgsVectorLayer(f"{path}|layername={layer}", layer, "ogr").featureCount())


def screened(results: dict[str, Any], inputs: Inputs) -> None:
    assert results["GROUND_POINTS"] == points_in(inputs.pair["CLOUD"]) == points_in(Path(results["OUTPUT"]))
    assert features(results["ZONES"], "zones") == results["ZONE_COUNT"] > 0


def inspected(results: dict[str, Any], inputs: Inputs) -> None:
    near_the_truth(results, inputs)
    assert features(results["ZONES"], "zones") == results["ZONE_COUNT"] > 0
    assert "Z001" in Path(results["REPORT"]).read_text(encoding="utf-8")


def registered(results: dict[str, Any], inputs: Inputs) -> None:
    """The two surveys fit each other as they are."""
    assert max(abs(results[name]) for name in ("SHIFT_X", "SHIFT_Y", "SHIFT_Z")) < 0.05
    matrix = json.loads(Path(results["TRANSFORM"]).read_text(encoding="utf-8"))["matrix"]
    assert [matrix[row][3] for row in range(3)] != [0, 0, 0]
    assert points_in(Path(results["OUTPUT"])) == points_in(inputs.pair["CLOUD"])


def measured(results: dict[str, Any], inputs: Inputs) -> None:
    assert 0 < results["MEASURED_POINTS"] <= results["CORE_POINTS"]
    assert -0.4 < results["LARGEST_LOWERING"] < -0.1
    assert 0.1 < results["LARGEST_RAISING"] < 0.4


def bias_and_pit(results: dict[str, Any], inputs: Inputs) -> None:
    """The bias is taken off, the pit is the one zone, and its volume is the true one within its error."""
    assert results["MODEL_COUNT"] == 2
    assert 0 < results["BIAS_ERROR"] < 0.02
    assert results["BIAS"] == pytest.approx(known_truth.BIAS_M, abs=3.5 * results["BIAS_ERROR"])
    assert features(results["ZONES"], "zones") == results["ZONE_COUNT"] == 1
    volume = known_truth.PIT_M * known_truth.PIT_SIZE_M**2
    assert 0 < results["LOSS_ERROR"] < 0.05 * abs(volume)
    assert abs(results["LOSS"]) == pytest.approx(abs(volume), abs=3 * results["LOSS_ERROR"])
    change = QgsRasterLayer(results["ELEVATION_CHANGE"])
    west, north = change.extent().xMinimum(), change.extent().yMaximum()
    east, south = (start + known_truth.PIT_SIZE_M / 2 for start in known_truth.PIT_WEST_NORTH_M)
    places = {known_truth.PIT_M: (west + east, north - south), 0.0: (west + 100.5, north - 20.5)}
    for expected, place in places.items():
        seen, known = change.dataProvider().sample(QgsPointXY(*place), 1)
        assert known
        assert seen == pytest.approx(expected, abs=0.15)  # three times the noise of both models


def half_moved(results: dict[str, Any], inputs: Inputs) -> None:
    """One zone, which moved as the northern half did; no vectors well inside the southern half."""
    moved, dip = known_truth.MOTION_M, math.radians(known_truth.DIP_DEG)
    assert features(results["MOVING_ZONES"], "zones") == results["ZONE_COUNT"] == 1
    (zone,) = QgsVectorLayer(f"{results['MOVING_ZONES']}|layername=zones", "zones", "ogr").getFeatures()
    assert zone["length_m"] == pytest.approx(moved, abs=max(0.02, 3 * zone["length_err_m"]))
    assert results["FASTEST_ZONE"] == pytest.approx(zone["length_m"], abs=0.001)  # the layer's is rounded
    expected = {"motion east": moved * math.cos(dip), "motion north": 0.0, "motion up": -moved * math.sin(dip)}
    raster = QgsRasterLayer(results["DISPLACEMENT"])
    extent, data = raster.extent(), raster.dataProvider()
    bands = {raster.bandName(i).partition(": ")[2]: i for i in range(1, raster.bandCount() + 1)}
    for name, value in expected.items():
        for share, true in ((0.75, value), (0.25, 0.0)):
            north = extent.yMinimum() + share * extent.height()
            row = [data.sample(QgsPointXY(x, north), bands[name]) for x in columns(raster)]
            seen = sorted(motion for motion, known in row if known)
            assert len(seen) >= 3
            assert seen[len(seen) // 2] == pytest.approx(true, abs=0.03), (name, share)


def columns(raster: QgsRasterLayer) -> list[float]:
    size = raster.rasterUnitsPerPixelX()
    return [raster.extent().xMinimum() + (column + 0.5) * size for column in range(raster.width())]


def reported(results: dict[str, Any], inputs: Inputs) -> None:
    zones = features(str(inputs.change / "zones.gpkg"), "zones")
    page = Path(results["REPORT"]).read_text(encoding="utf-8")
    assert Path(results["REPORT"]).parent == inputs.change
    assert all(f"Z{number + 1:03d}" in page for number in range(zones))


def viewed(results: dict[str, Any], inputs: Inputs) -> None:
    assert results["POINTS"] == points_in(inputs.pair["CLOUD"])
    assert QgsRasterLayer(results["TOP_VIEW"]).rasterUnitsPerPixelX() == pytest.approx(results["CELL_USED"])


def planned(results: dict[str, Any], inputs: Inputs) -> None:
    lines = QgsVectorLayer(f"{results['LINES']}|layername=lines", "lines", "ogr")
    assert lines.featureCount() == results["LINE_COUNT"] >= 2
    assert results["LEVEL"] > 0
    assert results["GROUND_DENSITY"] > 0


def flight_compared(results: dict[str, Any], inputs: Inputs) -> None:
    assert features(results["PLACES"].split("|")[0], "places") > results["SHORT_PLACES"] >= 0
    assert results["RETURNS_RATIO"] > 0
    assert results["LINES_PLANNED"] >= 2


def trained(results: dict[str, Any], inputs: Inputs) -> None:
    clouds = sorted(inputs.scenes.glob("*.laz"))
    assert results["LABELLED_POINTS"] == sum(map(points_in, clouds))
    described = json.loads(Path(results["DESCRIPTION"]).read_text(encoding="utf-8"))
    assert [file["name"] for file in described["training"]["files"]] == [cloud.name for cloud in clouds]


def handed_over(results: dict[str, Any], inputs: Inputs) -> None:
    """The archive holds what its checksums name, and the zones of the change."""
    with zipfile.ZipFile(results["OUTPUT"]) as archive:
        names = set(archive.namelist())
        sums = archive.read("SHA256SUMS").decode().splitlines()
        assert {line.split("  ", 1)[1] for line in sums} == names - {"SHA256SUMS"}
        zones = json.loads(archive.read("geojson/zones.geojson"))
    assert len(zones["features"]) == features(str(inputs.change / "zones.gpkg"), "zones") > 0
    assert results["FILES"] == len(names)


def projected(results: dict[str, Any], inputs: Inputs) -> None:
    project = QgsProject()
    assert project.read(results["OUTPUT"])
    layers = project.mapLayers().values()
    assert len(layers) == results["LAYERS"] > 5
    assert all(layer.isValid() for layer in layers)
    assert project.layoutManager().layoutByName(results["LAYOUT"]) is not None


def imported(results: dict[str, Any], inputs: Inputs) -> None:
    assert features(results["OUTPUT"], "labels") == results["POLYGONS"] == 1


def exported(results: dict[str, Any], inputs: Inputs) -> None:
    (task,) = json.loads(Path(results["TASKS"]).read_text(encoding="utf-8"))
    assert len(task["predictions"][0]["result"]) == 1


def whole_flow(results: dict[str, Any], inputs: Inputs) -> None:
    folder = Path(results["output_folder"])
    near_the_truth({"ELEVATION_CHANGE": folder / "elevation_change.tif"}, inputs)
    assert features(str(folder / "zones.gpkg"), "zones") > 0


def described(results: dict[str, Any], inputs: Inputs) -> None:
    assert results["POINTS"] == points_in(inputs.pair["CLOUD"])
    assert "UTM zone 51N" in results["REFERENCE_SYSTEM"]


def checked(results: dict[str, Any], inputs: Inputs) -> None:
    assert results["ENGINE"] == str(engine_python())
    assert f"\nversion={results['VERSION']}\n" in (ROOT / "metadata.txt").read_text(encoding="utf-8")


def built(results: dict[str, Any], inputs: Inputs) -> None:
    assert Path(results["ENGINE"]).is_file()
    assert results["ENGINE"].startswith(results["FOLDER"])


def with_tiny_wheels(inputs: Inputs, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Has the set-up build an engine of two tiny packages in an empty data folder."""
    plugin = inputs.tiny_plugin
    lock = plugin / "plugin" / "bridge" / "setup" / "engine.lock"
    real = setupengine.order
    monkeypatch.setenv("SLOPEWATCH_DATA", str(folder / "data"))
    monkeypatch.setattr(
        setupengine, "order", lambda *given: replace(real(*given), plugin=plugin, engine_lock=lock, engine_bytes=1)
    )


CHANGE_LAYERS = ("Hazard zones", "Significant change (m)", "Elevation change (m)")
RUNS = {
    "slopewatch:inspectslope": Run(
        lambda i, to: {
            **i.pair, "ROI": i.survey / "roi.gpkg", "CELL": 0.25, "SCREENING_METHOD": "residual", "OUTPUT_FOLDER": to
        },
        inspected,
        (*CHANGE_LAYERS, "Screened zones", "Top view"),
    ),
    "slopewatch:inspectseries": Run(
        lambda i, to: {"INPUT": i.series, "GROUND_READY": True, "METHOD": "none", "CELL": 0.5, "OUTPUT_FOLDER": to},
        one_fact("EPOCH_COUNT", 2, 2),
        ("2025-05-01 change since the first survey", "Zones survey by survey"),
    ),
    "slopewatch:corridorbatch": Run(
        lambda i, to: {
            "MANIFEST": i.manifest, "CELL": 0.5, "SCREEN_LAST_EPOCH": False, "METHOD": "none", "OUTPUT_FOLDER": to
        },
        one_fact("SLOPES_DONE", 1, 1),
        ("Slopes", "Alerts"),
    ),
    "slopewatch:screenhazards": Run(
        lambda i, to: {
            "INPUT": i.pair["CLOUD"], **ON_BARE_GROUND, "SCREENING_METHOD": "residual", "OUTPUT": to / "labelled.laz"
        },
        screened,
        ("Hazard zones (screening)", "Probability of a hazard"),
    ),
    "slopewatch:extractground": Run(
        lambda i, to: {"INPUT": i.pair["CLOUD"], "ROI": i.survey / "roi.gpkg", "OUTPUT": to / "ground.laz"},
        lambda r, i: must(0 < points_in(Path(r["OUTPUT"])) == r["GROUND_POINTS"] <= r["ROI_POINTS"]),
    ),
    "slopewatch:registerepochs": Run(
        lambda i, to: {**i.pair, **ON_BARE_GROUND, "OUTPUT": to / "moved.laz", "TRANSFORM": to / "transform.json"},
        registered,
    ),
    "slopewatch:elevationchange": Run(
        lambda i, to: {**i.pair, **ON_BARE_GROUND, "CELL": 0.25, "OUTPUT_FOLDER": to}, near_the_truth, CHANGE_LAYERS
    ),
    "slopewatch:m3c2distances": Run(
        lambda i, to: {**i.pair, **ON_BARE_GROUND, "CORE_SPACING": 0.5, "OUTPUT": to / "core.laz"}, measured
    ),
    "slopewatch:demchange": Run(
        lambda i, to: {"MODELS": list(map(str, i.models)), "OUTPUT_FOLDER": to}, bias_and_pit, CHANGE_LAYERS
    ),
    "slopewatch:displacementvectors": Run(
        lambda i, to: {**i.moved, **ON_BARE_GROUND, "OUTPUT_FOLDER": to},
        half_moved,
        ("Displacement vectors", "Zones of coherent motion"),
    ),
    "slopewatch:locateonroad": Run(
        lambda i, to: {"INPUT": str(i.change / "zones.gpkg"), "CENTRELINE": i.road, "OUTPUT": to / "z.gpkg"},
        lambda r, i: must(r["FEATURES"] == r["LOCATED"] == features(r["OUTPUT"], "zones") > 0 == r["NOT_LOCATED"]),
        ("Located features",),
    ),
    "slopewatch:writereport": Run(lambda i, to: {"INPUT": i.change}, reported),
    "slopewatch:exportgis": Run(
        lambda i, to: {"INPUT": i.change, "SURFACE_POINTS": 500, "OUTPUT": to / "hand over.zip"}, handed_over
    ),
    "slopewatch:createproject": Run(
        lambda i, to: {"INPUT": i.change, "AUTHOR": "A. Sato", "OUTPUT": to / "slope.qgz"}, projected
    ),
    "slopewatch:topview": Run(
        lambda i, to: {"INPUT": i.pair["CLOUD"], "OUTPUT_FOLDER": to}, viewed, ("Top view", "Hillshade")
    ),
    "slopewatch:suggestroi": Run(
        lambda i, to: {"INPUT": i.pair["CLOUD"], "OUTPUT": to / "roi.gpkg"},
        one_fact("AREA_SHARE", 0.7, 1.1),
        ("Proposed region",),
    ),
    "slopewatch:planflight": Run(
        lambda i, to: {
            "TERRAIN": i.pair["CLOUD"], "ROI": i.survey / "roi.gpkg", "PULSE_RATE": 2000.0, "OUTPUT_FOLDER": to
        },
        planned,
        ("Waypoints", "Flight lines", "Expected level of detection (m)"),
    ),
    "slopewatch:compareflight": Run(
        lambda i, to: {"PLAN": i.plan, "INPUT": i.pair["CLOUD"], "GROUND": i.pair["CLOUD"], "OUTPUT_FOLDER": to},
        flight_compared,
        ("Returns promised and reached",),
    ),
    "slopewatch:exportlabelstudio": Run(
        lambda i, to: {
            "PICTURE": i.view, "SEGMENTS": i.survey / "roi.gpkg", "LABEL_FIELD": "name", "OUTPUT_FOLDER": to
        },
        exported,
    ),
    "slopewatch:importlabelstudio": Run(
        lambda i, to: {
            "EXPORT": i.labelling / "export.json", "TASKS": i.labelling / "tasks.json", "OUTPUT": to / "labels.gpkg"
        },
        imported,
        ("Labels",),
    ),
    "slopewatch:simulatesurvey": Run(
        lambda i, to: {"POINTS": 8000, "LENGTH": 10, "HEIGHT": 5, "OUTPUT_FOLDER": to},
        lambda r, i: must(7000 < points_in(Path(r["CLOUD"])) < 12000),
        ("Region of interest",),
    ),
    "slopewatch:simulateseries": Run(
        lambda i, to: {
            "POINTS": 8000, "LENGTH": 10, "HEIGHT": 5, "SURVEYS": 2, "VELOCITIES": "-6", "OUTPUT_FOLDER": to
        },
        lambda r, i: must(len(Path(r["MANIFEST"]).read_text(encoding="utf-8").split()) == 3),
    ),
    "slopewatch:simulatescenes": Run(
        lambda i, to: {"KIND": "realistic", "COUNT": 1, "AREA": 200, "DENSITY": 20, "OUTPUT_FOLDER": to},
        lambda r, i: must(0.99 < sum(r[f"SHARE_{x}"] for x in ("BACKGROUND", "UPLIFT", "SUBSIDENCE")) < 1.01),
    ),
    "slopewatch:trainmodel": Run(
        lambda i, to: {
            "CLOUDS": sorted(map(str, i.scenes.glob("*.laz"))), "DIMENSION": "truth_class",
            "START": "none", "NETWORK": "smoke", "STEPS": 1, "THREADS": 1, "OUTPUT_FOLDER": to,
        },
        trained,
    ),
    "slopewatch:setupengine": Run(lambda i, to: {"WHEELS": i.wheels}, built, arrange=with_tiny_wheels),
    "slopewatch:cloudinfo": Run(lambda i, to: {"INPUT": i.pair["CLOUD"]}, described),
    "slopewatch:checkenvironment": Run(lambda i, to: {}, checked),
    "slopewatch:slopeflow": Run(
        lambda i, to: {**i.pair, "ROI": i.survey / "roi.gpkg", "REFERENCE_DATE": FIRST, "CLOUD_DATE": LATER,
                       "output_folder": to},
        whole_flow,
        CHANGE_LAYERS,
    ),
}  # fmt: skip
