"""Projects by the real qgis_process and by the command line, opened in another process after the folder has moved."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest
from qgis.core import QgsRasterLayer, QgsVectorLayer
from qgis.PyQt.QtGui import QImage
from slopewatch.plugin.bridge import language
from slopewatch.plugin.bridge.print_layout import LAYOUT, Sheet
from slopewatch.plugin.bridge.project_contents import NoRunError, read_contents
from slopewatch.plugin.bridge.project_file import ProjectError, write_project
from slopewatch.tests.builders.algorithm_inputs import Inputs
from slopewatch.tests.builders.qgis import QgisProcess, engine_python

_READ = """
import json, os, sys
from qgis.core import QgsApplication, QgsProject, QgsLayerTreeGroup, QgsLayoutExporter
application = QgsApplication([], False)
application.initQgis()
project = QgsProject.instance()
found = {"read": project.read(sys.argv[1]), "title": project.title(), "crs": project.crs().authid()}
def tree(group):
    return [[n.name(), tree(n)] if isinstance(n, QgsLayerTreeGroup) else n.name() for n in group.children()]
found["tree"] = tree(project.layerTreeRoot())
found["layers"] = {
    layer.name(): {"valid": layer.isValid(), "source": layer.source(), "time": [
        layer.temporalProperties().fixedTemporalRange().begin().toString("yyyy-MM-dd"),
        layer.temporalProperties().fixedTemporalRange().end().toString("yyyy-MM-dd"),
    ] if layer.temporalProperties() and layer.temporalProperties().isActive() else []}
    for layer in project.mapLayers().values()
}
times = project.timeSettings().temporalRange()
found["times"] = [times.begin().toString("yyyy-MM-dd"), times.end().toString("yyyy-MM-dd")]
layout = project.layoutManager().layoutByName(sys.argv[2])
if layout is not None:
    drawn = layout.itemById("map")
    settings = QgsLayoutExporter.ImageExportSettings()
    settings.dpi = 60
    QgsLayoutExporter(layout).exportToImage(sys.argv[3], settings)
    box, page = drawn.sceneBoundingRect(), layout.pageCollection().page(0).rect()
    found["map"] = [box.x(), box.y(), box.width(), box.height(), page.width(), page.height()]
    found["items"] = sorted(item.id() for item in layout.items() if hasattr(item, "id") and item.id())
    for table in layout.multiFrames():  # none without zones
        headings = [column.heading() for column in table.columns()]
        found["table"] = [table.vectorLayer().name(), table.maximumNumberOfFeatures(), headings]
        frame = layout.itemById("zones").sceneBoundingRect()
        found["frame"] = [frame.x(), frame.y(), frame.width(), frame.height()]
print(json.dumps(found))
sys.stdout.flush()
os._exit(0)
"""


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Inputs:
    engine_python()
    return Inputs(tmp_path_factory.mktemp("inputs"))


@pytest.fixture(scope="module")
def projects(inputs: Inputs, tmp_path_factory: pytest.TempPathFactory, qgis_app: object) -> dict[str, Path]:
    """Projects next to the results of a change, a series and of vectors, each moved away from where it was made."""
    folder = tmp_path_factory.mktemp("made, 'here'")
    inputs.engine("series", inputs.series, "--ground-ready", "--method", "none", "--cell", "0.5",
                  "--output-dir", folder / "series")  # fmt: skip
    inputs.engine("displacement", *inputs.moved.values(), "--output-dir", folder / "vectors")
    shutil.copytree(inputs.change, folder / "change")
    moved = {}
    for name in ("change", "series", "vectors"):
        contents = read_contents(str(folder / name))
        write_project(contents, folder / name / "slope.qgz", Sheet(f"Slope {name}", "a\nb", "A. Sato", "x", "A4"))
        moved[name] = shutil.move(folder / name, tmp_path_factory.mktemp("moved away") / name) / "slope.qgz"
    return moved


@pytest.fixture(scope="module")
def found(projects: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """What another process finds in each of the projects; ``picture`` is one of its sheet."""
    pictures = {name: tmp_path_factory.mktemp("sheets") / "sheet.png" for name in projects}
    return {name: opened(path, pictures[name]) | {"picture": pictures[name]} for name, path in projects.items()}


def opened(project: Path, picture: Path, layout: str = LAYOUT) -> dict[str, Any]:
    """What another process finds in a project, with a picture of its layout."""
    command = [sys.executable, "-c", _READ, str(project), layout, str(picture)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, env={**os.environ}, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("name", ["change", "series", "vectors"])
def test_nothing_is_missing_after_the_folder_has_moved(
    projects: dict[str, Path], found: dict[str, dict[str, Any]], name: str
) -> None:
    one = found[name]
    assert one["read"]
    assert one["title"] == f"Slope {name}"
    assert one["crs"] == "EPSG:32651"
    assert len(one["layers"]) >= 4
    for title, layer in one["layers"].items():
        assert layer["valid"], title
        assert layer["source"].startswith(str(projects[name].parent)), title
    with zipfile.ZipFile(projects[name]) as archive:
        (text,) = [archive.read(n).decode() for n in archive.namelist() if n.endswith(".qgs")]
    assert "/made, " not in text, "no path of the place where it was made"


def test_layers_stand_in_groups_by_kind_and_survey(found: dict[str, dict[str, Any]]) -> None:
    change = dict(one for one in found["change"]["tree"] if isinstance(one, list))
    assert list(change)[:2] == ["Zones and sections", "Change"]
    assert change["Zones and sections"][0] == "Hazard zones"
    assert change["Surveys"] == [
        ["Survey of 2025-05-01", ["Ground heights, later survey (m)", "Top view"]],
        ["Survey of 2024-05-01", ["Ground heights, earlier survey (m)"]],
    ]
    series = dict(one for one in found["series"]["tree"] if isinstance(one, list))
    ((survey, layers),) = series["Surveys"]
    assert survey == "Survey of 2025-05-01"
    assert "Change since the first survey" in layers
    vectors = found["vectors"]["layers"]
    assert any(re.fullmatch(r"Displacement vectors \(arrows × [\d.]+\)", title) for title in vectors)


def test_layers_are_shown_in_the_time_of_their_surveys(found: dict[str, dict[str, Any]]) -> None:
    assert found["change"]["times"] == ["2024-05-01", "2025-05-01"]
    times = {title: layer["time"] for title, layer in found["change"]["layers"].items()}
    assert times["Significant change (m)"] == ["2024-05-01", "2025-05-01"]
    assert times["Ground heights, earlier survey (m)"] == ["2024-05-01", "2025-05-01"]
    assert times["Ground heights, later survey (m)"] == ["2025-05-01", ""]
    assert times["Top view"] == []
    series = found["series"]["layers"]
    assert series["Change since the first survey"]["time"] == ["2024-05-02", "2025-05-01"]


@pytest.mark.parametrize("name", ["change", "series", "vectors"])
def test_the_sheet_shows_the_map_and_lists_the_zones(
    projects: dict[str, Path], found: dict[str, dict[str, Any]], name: str
) -> None:
    one = found[name]
    assert {"map", "legend", "scale", "north", "zones"} <= set(one["items"])
    package = {"change": "zones", "series": "series", "vectors": "displacement"}[name]
    layer = QgsVectorLayer(f"{projects[name].parent / package}.gpkg|layername=zones", "zones", "ogr")
    title, rows, headings = one["table"]
    assert "ones" in title
    assert rows == layer.featureCount() > 0
    assert headings[0] == "Zone"
    assert len(headings) >= 5
    image = QImage(str(one["picture"]))
    *drawn, across, down = one["map"]
    scale = image.width() / across, image.height() / down
    assert len(set(sampled(image, drawn, scale))) > 20, "the map is not blank"
    dark = [colour for colour in sampled(image, one["frame"], scale) if (colour & 0xFF) < 128]
    assert len(dark) > 20 * rows, "the table is not blank"


def sampled(image: QImage, box: list[float], scale: tuple[float, float]) -> list[int]:
    """Colours of a part of the picture, in 120 steps along each side."""
    left, top, width, height = box
    places = [((i + 0.5) / 120, (j + 0.5) / 120) for i in range(120) for j in range(120)]
    return [image.pixel(int((left + u * width) * scale[0]), int((top + v * height) * scale[1])) for u, v in places]


def test_the_layout_becomes_a_pdf_by_qgis_process(
    qgis_process: QgisProcess, projects: dict[str, Path], tmp_path: Path
) -> None:
    path = tmp_path / "sheet.pdf"
    done = qgis_process(
        "--json", "run", "native:printlayouttopdf", f"--PROJECT_PATH={projects['change']}", f"--LAYOUT={LAYOUT}",
        f"--OUTPUT={path}",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    data = path.read_bytes()
    assert data.startswith(b"%PDF")
    assert b"/Type /Page" in data
    if shutil.which("pdftoppm"):
        subprocess.run(["pdftoppm", "-r", "50", "-png", path, tmp_path / "page"], check=True)
        (page,) = tmp_path.glob("page*.png")
        image = QImage(str(page))
        assert image.width() > image.height()
        pixels = {image.pixel(x, y) for x in range(0, image.width(), 3) for y in range(0, image.height(), 3)}
        assert len(pixels) > 50


def test_the_toolbox_makes_one_and_refuses_another(qgis_process: QgisProcess, inputs: Inputs, tmp_path: Path) -> None:
    path = tmp_path / "slope.qgz"
    results = qgis_process.run("createproject", INPUT=inputs.change, PROJECT_TITLE="Slope 12", PAPER="A3", OUTPUT=path)
    found = opened(path, tmp_path / "a.png")
    assert found["title"] == "Slope 12"
    assert len(found["layers"]) == results["LAYERS"]
    assert results["LAYOUT"] == LAYOUT
    before = path.read_bytes()
    done = qgis_process.attempt("createproject", INPUT=inputs.change, OUTPUT=path)
    assert done.returncode == 1
    assert "is there already" in done.stderr
    assert path.read_bytes() == before
    done = qgis_process.attempt("createproject", INPUT=tmp_path, OUTPUT=tmp_path / "other.qgz")
    assert done.returncode == 1
    assert "holds no run.json, so no finished run" in done.stderr


def test_the_command_line_makes_one_through_qgis(inputs: Inputs, tmp_path: Path) -> None:
    if not shutil.which("qgis_process"):
        pytest.skip("qgis_process is not on PATH")
    inputs.engine("createproject", inputs.change, "--output", tmp_path / "slope.qgz", "--author", "A. Sato")
    assert opened(tmp_path / "slope.qgz", tmp_path / "a.png")["layers"]["Hazard zones"]["valid"]


def test_words_are_those_of_qgis(
    inputs: Inputs, tmp_path: Path, qgis_app: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(language.QgsApplication, "locale", staticmethod(lambda: "zh-Hans"))
    installed = language.install()
    try:
        contents = read_contents(str(inputs.change))
        write_project(contents, tmp_path / "slope.qgz", Sheet("t", "s", "", "x", "A4"))
    finally:
        language.remove(installed)
    found = opened(tmp_path / "slope.qgz", tmp_path / "a.png")
    groups = [one[0] for one in found["tree"] if isinstance(one, list)]
    assert groups
    assert not [name for name in (*groups, *found["layers"]) if name.isascii()]


@pytest.mark.parametrize("record", ["", "{}", "[]", '{"command": "change", "outputs": {"zones": "../../zones.gpkg"}}'])
def test_what_is_no_run_is_refused(record: str, tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text(record, encoding="utf-8")
    with pytest.raises(NoRunError, match=r"(give the output folder of a run|make the run of change again)\.$"):
        read_contents(str(tmp_path))


def test_a_damaged_layer_leaves_no_project(inputs: Inputs, tmp_path: Path, qgis_app: object) -> None:
    run = shutil.copytree(inputs.change, tmp_path / "run")
    (run / "elevation_change.tif").write_bytes(b"no raster")
    with pytest.raises(ProjectError, match=r"elevation_change\.tif cannot be opened as a layer"):
        write_project(read_contents(str(run)), tmp_path / "slope.qgz", Sheet("t", "s", "", "x", "A4"))
    assert not QgsRasterLayer(str(run / "elevation_change.tif")).isValid()
    assert [p.name for p in tmp_path.iterdir()] == ["run"]
