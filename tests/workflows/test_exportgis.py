"""What is handed over of finished runs, read back by other programs than the one that wrote it, and what is refused."""

from __future__ import annotations

import csv
import hashlib
import json
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import ezdxf
import geopandas as gpd
import numpy as np
import pyogrio
import pytest
import rasterio
import shapely
from pyproj import Transformer
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.handover.landxml import NAMESPACE
from slopewatch.tests.builders.handed_over import FEW_POINTS, hand_over, motion, pit, signed_area

_LAND = {"l": NAMESPACE}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("runs")
    return {"pit": pit(folder), "motion": motion(folder)}


@pytest.fixture(scope="module")
def given(runs: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pit handed over as a folder."""
    folder = tmp_path_factory.mktemp("given") / "out"
    hand_over(runs["pit"], folder, organisation="Strassenamt Zürich & Co", email="gis@example.org")
    return folder


def zones_of(run: Path) -> gpd.GeoDataFrame:
    return gpd.read_file(run / "zones.gpkg", layer="zones")


def test_every_file_has_its_checksum_as_sha256sum_reads_it(given: Path) -> None:
    lines = (given / "SHA256SUMS").read_text(encoding="utf-8").splitlines()
    named = dict(reversed(line.split("  ", 1)) for line in lines)
    there = {p.relative_to(given).as_posix() for p in given.rglob("*") if p.is_file()} - {"SHA256SUMS", "run.json"}
    assert set(named) == there
    assert len(there) > 30
    for name, digest in named.items():
        assert hashlib.sha256((given / name).read_bytes()).hexdigest() == digest
    if shutil.which("sha256sum"):
        done = subprocess.run(["sha256sum", "--check", "--quiet", "SHA256SUMS"], cwd=given, capture_output=True)
        assert done.returncode == 0, done.stdout


def test_the_archive_has_the_same_bytes_each_time(runs: dict[str, Path], given: Path, tmp_path: Path) -> None:
    for name in ("one.zip", "two.zip"):
        hand_over(runs["pit"], tmp_path / name, organisation="Strassenamt Zürich & Co", email="gis@example.org")
    assert (tmp_path / "one.zip").read_bytes() == (tmp_path / "two.zip").read_bytes()
    assert json.loads((tmp_path / "one_run.json").read_text(encoding="utf-8"))["command"] == "exportgis"
    with zipfile.ZipFile(tmp_path / "one.zip") as archive:
        assert archive.testzip() is None
        for name in archive.namelist():
            assert archive.read(name) == (given / name).read_bytes(), name
    assert sorted(p.name for p in tmp_path.iterdir()) == ["one.zip", "one_run.json", "two.zip", "two_run.json"]


def test_rasters_are_cloud_optimised_and_hold_the_same_cells(runs: dict[str, Path], given: Path) -> None:
    rasters = sorted((given / "rasters").glob("*.tif"))
    assert {p.name for p in rasters} == {p.name for p in runs["pit"].glob("*.tif")}
    for path in rasters:
        with rasterio.open(path) as copy, rasterio.open(runs["pit"] / path.name) as source:
            assert copy.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
            assert copy.transform == source.transform
            assert np.array_equal(copy.read(), source.read())


def test_a_raster_that_is_not_cloud_optimised_becomes_so(runs: dict[str, Path], tmp_path: Path) -> None:
    run = shutil.copytree(runs["pit"], tmp_path / "run")
    path = run / "significance.tif"
    with rasterio.open(path) as source:
        cells, profile, words = source.read(), source.profile, source.descriptions
    profile.update(tiled=False, blockysize=1)
    profile.pop("layout", None)
    path.unlink()
    with rasterio.open(path, "w", **{k: v for k, v in profile.items() if k != "blockxsize"}) as target:
        target.write(cells)
        target.descriptions = words
    hand_over(run, tmp_path / "out", formats="cog")
    with rasterio.open(tmp_path / "out" / "rasters" / "significance.tif") as copy:
        assert copy.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        assert copy.descriptions == words
        assert np.array_equal(copy.read(), cells)


def test_the_package_holds_all_layers_with_their_styles(runs: dict[str, Path], given: Path) -> None:
    names = {name for name, _ in pyogrio.list_layers(given / "layers.gpkg")}
    assert {"zones", "footprints", "volumes", "profiles", "layer_styles"} <= names
    ours, theirs = zones_of(runs["pit"]), gpd.read_file(given / "layers.gpkg", layer="zones")
    assert theirs.geometry.geom_equals_exact(ours.geometry, 0).all()
    assert list(theirs.columns) == list(ours.columns)
    theirs.loc[0, "kind"] = "slump"  # nothing guards a table that was handed over
    theirs.to_file(given / ".." / "edited.gpkg", layer="zones")


def test_geojson_keeps_to_its_specification(runs: dict[str, Path], given: Path) -> None:
    document = json.loads((given / "geojson" / "zones.geojson").read_text(encoding="utf-8"))
    assert "crs" not in document
    zones = zones_of(runs["pit"])
    move = Transformer.from_crs(zones.crs, "EPSG:4326", always_xy=True)
    (feature,) = document["features"]
    shape = shapely.geometry.shape(feature["geometry"])
    expected = shapely.transform(zones.geometry[0], lambda xy: np.column_stack(move.transform(*xy.T)))
    assert shape.symmetric_difference(expected).area < 1e-3 * expected.area
    polygons = feature["geometry"]["coordinates"]
    for outer, *holes in polygons if feature["geometry"]["type"] == "MultiPolygon" else [polygons]:
        assert signed_area(np.array(outer)) > 0
        assert all(signed_area(np.array(hole)) < 0 for hole in holes)
    text = (given / "geojson" / "zones.geojson").read_text(encoding="utf-8")
    corners = text.partition('"coordinates"')[2].partition("}")[0]
    assert (
        max(len(n.partition(".")[2]) for n in corners.replace("[", " ").replace("]", " ").replace(",", " ").split())
        == 7
    )


def test_kml_lies_on_the_ground_and_at_its_heights(runs: dict[str, Path], given: Path) -> None:
    flat = pyogrio.read_dataframe(given / "kml" / "zones.kml")
    raised = pyogrio.read_dataframe(given / "kml" / "zones_heights.kml")
    assert flat["Name"].tolist() == raised["Name"].tolist() == ["Z001"]
    assert (given / "kml" / "zones_heights.kml").read_text(encoding="utf-8").count("<altitudeMode>absolute<") >= 1
    corners = shapely.get_coordinates(raised.geometry.to_numpy(), include_z=True)
    zones = zones_of(runs["pit"])
    move = Transformer.from_crs("EPSG:4326", zones.crs, always_xy=True)
    with rasterio.open(runs["pit"] / "surface_heights.tif") as source:
        places = np.column_stack(move.transform(*corners[:, :2].T))
        low, high = source.read(2).min(), source.read(2).max()
        # corners lie on the edges of cells: the height is that of one of the cells around
        for (x, y), z in zip(places[:50], corners[:50, 2], strict=True):
            around = [v[1] for v in source.sample([(x + a, y + b) for a in (-0.1, 0.1) for b in (-0.1, 0.1)])]
            assert min(abs(np.array(around) - z)) < 1e-3
    assert low <= corners[:, 2].min()
    assert corners[:, 2].max() <= high


def test_tables_have_places_and_no_formula(runs: dict[str, Path], tmp_path: Path) -> None:
    run = shutil.copytree(runs["pit"], tmp_path / "run")
    frame = zones_of(run)
    frame["remarks"] = "=HYPERLINK(1)"
    (run / "zones.gpkg").unlink()
    frame.to_file(run / "zones.gpkg", layer="zones")
    hand_over(run, tmp_path / "out", formats="csv")
    with (tmp_path / "out" / "csv" / "zones.csv").open(encoding="utf-8", newline="") as file:
        (row,) = csv.DictReader(file)
    assert row["remarks"] == "'=HYPERLINK(1)"
    shape = shapely.from_wkt(row["wkt"])
    assert shape.symmetric_difference(frame.geometry[0]).area < 0.01
    assert shape.contains(shapely.Point(float(row["x_m"]), float(row["y_m"])))
    back = Transformer.from_crs("EPSG:4326", frame.crs, always_xy=True).transform(
        float(row["lon_deg"]), float(row["lat_deg"])
    )
    assert back == pytest.approx((float(row["x_m"]), float(row["y_m"])), abs=0.02)


def test_the_drawing_is_sound_and_in_metres(runs: dict[str, Path], given: Path) -> None:
    drawing = ezdxf.readfile(given / "cad" / "drawing.dxf")
    assert drawing.audit().errors == []
    assert drawing.units == ezdxf.units.M
    space = drawing.modelspace()
    (outline, *_) = space.query('POLYLINE[layer=="ZONES_SUBSIDENCE"]')
    assert (1000, "zone_id=Z001") in [tuple(tag) for tag in outline.get_xdata("SLOPEWATCH")]
    (zone,) = zones_of(runs["pit"]).geometry
    rings = [
        np.array([v.dxf.location for v in line.vertices]) for line in space.query('POLYLINE[layer=="ZONES_SUBSIDENCE"]')
    ]
    assert {len(r) for r in rings} == {
        len(shapely.get_coordinates(r)) for r in shapely.get_rings(shapely.get_parts(zone))
    }
    assert rings[0][:, 2].min() > 10  # on the ground, not at 0
    assert [t.dxf.text for t in space.query("TEXT")] == ["Z001"]
    faces = space.query("3DFACE")
    assert {face.dxf.layer for face in faces} == {"GROUND_2024-05-01", "GROUND_2025-05-01"}
    with rasterio.open(runs["pit"] / "surface_heights.tif") as source:
        for face in list(faces)[::37]:
            band = 2 if face.dxf.layer.endswith("2025-05-01") else 1
            for corner in face.wcs_vertices():
                (cells,) = source.sample([(corner.x, corner.y)])
                assert corner.z == pytest.approx(cells[band - 1], abs=1e-3)


def test_the_ground_of_landxml_is_that_of_the_raster(runs: dict[str, Path], given: Path) -> None:
    root = ElementTree.parse(given / "cad" / "landxml.xml").getroot()
    assert root.find("l:Units/l:Metric", _LAND).get("linearUnit") == "meter"
    assert root.find("l:CoordinateSystem", _LAND).get("epsgCode") == "32651"
    surfaces = root.findall("l:Surfaces/l:Surface", _LAND)
    assert [s.get("name") for s in surfaces] == ["ground 2024-05-01", "ground 2025-05-01"]
    with rasterio.open(runs["pit"] / "surface_heights.tif") as source:
        for band, surface in enumerate(surfaces, 1):
            points = np.array([p.text.split() for p in surface.iter(f"{{{NAMESPACE}}}P")], dtype=float)
            faces = np.array([f.text.split() for f in surface.iter(f"{{{NAMESPACE}}}F")], dtype=int) - 1
            assert 0.8 * FEW_POINTS < len(points) <= FEW_POINTS
            heights = [cells[band - 1] for cells in source.sample(points[:, [1, 0]])]
            assert points[:, 2] == pytest.approx(heights, abs=1e-3)
            corners = points[faces][:, :, [1, 0]]
            sides = corners[:, 1:] - corners[:, :1]
            area = (sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]) / 2
            assert (area > 0).all()  # counterclockwise, none flat
            reach = np.ptp(points[:, :2], axis=0)
            assert area.sum() == pytest.approx(reach.prod(), rel=1e-6)  # no gap, no overlap


def test_sections_and_zones_of_landxml_are_those_of_the_run(runs: dict[str, Path], given: Path) -> None:
    root = ElementTree.parse(given / "cad" / "landxml.xml").getroot()
    with (runs["pit"] / "profiles.csv").open(encoding="utf-8") as file:
        cells = list(csv.DictReader(file))
    (alignment,) = root.findall("l:Alignments/l:Alignment", _LAND)
    for name, column in (("earlier", "height_from_m"), ("later", "height_to_m")):
        drawn = alignment.find(f"l:Profile/l:ProfSurf[@name='{name}']/l:PntList2D", _LAND)
        pairs = np.array(drawn.text.split(), dtype=float).reshape(-1, 2)
        assert pairs == pytest.approx(np.array([[c["distance_m"], c[column]] for c in cells], dtype=float), abs=6e-4)
    (feature,) = root.findall("l:PlanFeatures[@name='zones']/l:PlanFeature", _LAND)
    starts = np.array([s.text.split() for s in feature.iter(f"{{{NAMESPACE}}}Start")], dtype=float)
    (zone,) = zones_of(runs["pit"]).geometry
    assert {tuple(np.round(c, 3)) for c in starts[:, ::-1]} == {
        tuple(np.round(c, 3)) for c in shapely.get_coordinates(zone)
    }
    said = {p.get("label"): p.get("value") for p in feature.iter(f"{{{NAMESPACE}}}Property")}
    assert said["kind"] == "subsidence"


def test_vectors_are_drawn_in_their_true_length(runs: dict[str, Path], tmp_path: Path) -> None:
    progress = Progress()
    said: list[str] = []
    progress.show = lambda level, message: said.append(message)  # type: ignore[method-assign]
    done = hand_over(runs["motion"], tmp_path / "out", progress=progress)
    assert any("no ground surfaces" in sentence for sentence in said)
    assert json.loads(done.outputs["run"].read_text(encoding="utf-8"))["not_held"] == ["ground surfaces", "sections"]
    space = ezdxf.readfile(tmp_path / "out" / "cad" / "drawing.dxf").modelspace()
    lengths = sorted(line.dxf.start.distance(line.dxf.end) for line in space.query("LINE"))
    vectors = gpd.read_file(runs["motion"] / "displacement.gpkg", layer="vectors")
    assert lengths == pytest.approx(sorted(np.linalg.norm(vectors[["east_m", "north_m", "up_m"]], axis=1)), abs=1e-6)
    assert not (tmp_path / "out" / "kml" / "zones_heights.kml").exists()
    assert ElementTree.parse(tmp_path / "out" / "cad" / "landxml.xml").getroot().find("l:Surfaces", _LAND) is None


def test_the_item_names_every_file_with_its_checksum(given: Path) -> None:
    item = json.loads((given / "item.json").read_text(encoding="utf-8"))
    files = {p.relative_to(given).as_posix() for p in given.rglob("*") if p.is_file()}
    assert set(item["assets"]) == files - {"SHA256SUMS", "run.json", "item.json"}
    for name, asset in item["assets"].items():
        content = (given / name).read_bytes()
        assert asset["file:checksum"] == "1220" + hashlib.sha256(content).hexdigest()
        assert asset["file:size"] == len(content)
    with rasterio.open(given / "rasters" / "elevation_change.tif") as source:
        asset = item["assets"]["rasters/elevation_change.tif"]
        assert asset["proj:transform"] == list(source.transform)[:6]
        assert [band["description"] for band in asset["bands"]] == list(source.descriptions)
        west, south, east, north = rasterio.warp.transform_bounds(source.crs, "EPSG:4326", *source.bounds)
    assert item["bbox"] == pytest.approx([west, south, east, north], abs=1e-6)
    assert signed_area(np.array(item["geometry"]["coordinates"][0])) > 0


def test_the_item_is_stac_by_its_own_library(given: Path) -> None:
    pystac = pytest.importorskip("pystac", reason="pystac is not installed")
    pytest.importorskip("jsonschema", reason="pystac's validation is not installed")
    item = pystac.Item.from_file(str(given / "item.json"))
    item.stac_extensions = []  # their schemas are not in the library, and tests use no network
    assert item.validate()


def test_the_agencys_names_are_in_tables_styles_and_drawings(runs: dict[str, Path], tmp_path: Path) -> None:
    names = tmp_path / "names.csv"
    names.write_text(
        "ours,theirs\nzone_id,ASSET_REF\nzones.kind,Movement Type\nseverity,SEV\nnever,X\n", encoding="utf-8"
    )
    progress = Progress()
    hand_over(runs["pit"], tmp_path / "out", fields=names, progress=progress)
    assert progress.warnings == ["The mapping file names fields that this run does not have: never."]
    zones = gpd.read_file(tmp_path / "out" / "layers.gpkg", layer="zones")
    assert {"ASSET_REF", "Movement Type", "SEV"} <= set(zones.columns)
    footprints = gpd.read_file(tmp_path / "out" / "layers.gpkg", layer="footprints")
    assert {"ASSET_REF", "kind"} <= set(footprints.columns)
    qml = (tmp_path / "out" / "styles" / "zones.qml").read_text(encoding="utf-8")
    assert ElementTree.fromstring(qml).find("renderer-v2").get("attr") == """concat("Movement Type", ', ', "SEV")"""
    assert '"zone_id"' not in qml.replace("&quot;", '"')
    sld = (tmp_path / "out" / "styles" / "zones.sld").read_text(encoding="utf-8")
    assert "<ogc:PropertyName>Movement Type</ogc:PropertyName>" in sld
    space = ezdxf.readfile(tmp_path / "out" / "cad" / "drawing.dxf").modelspace()
    (outline, *_) = space.query('POLYLINE[layer=="ZONES_SUBSIDENCE"]')
    assert (1000, "ASSET_REF=Z001") in [tuple(tag) for tag in outline.get_xdata("SLOPEWATCH")]


def test_what_an_earlier_hand_over_wrote_is_replaced_as_a_whole(runs: dict[str, Path], tmp_path: Path) -> None:
    hand_over(runs["pit"], tmp_path / "out", formats="geojson,csv")
    (tmp_path / "out" / "own.txt").write_text("kept", encoding="utf-8")
    with pytest.raises(InputError, match=r"holds results already .*--overwrite"):
        hand_over(runs["pit"], tmp_path / "out", formats="csv")
    hand_over(runs["pit"], tmp_path / "out", formats="csv", overwrite=True)
    assert not list((tmp_path / "out").rglob("*.geojson"))
    assert list((tmp_path / "out").rglob("*.csv"))
    assert (tmp_path / "out" / "own.txt").is_file()


def test_a_run_that_is_not_finished_is_refused(runs: dict[str, Path], tmp_path: Path) -> None:
    broken = shutil.copytree(runs["pit"], tmp_path / "broken")
    (broken / "zones.gpkg").unlink()
    cases = {
        tmp_path / "none": "does not exist",
        tmp_path: "holds no run.json, so no finished run",
        broken: r"lacks 'zones\.gpkg', which its run record names; run demchange again",
    }
    for folder, words in cases.items():
        with pytest.raises(InputError, match=words):
            hand_over(folder, tmp_path / "out.zip")
        with pytest.raises(InputError, match=words):
            hand_over(folder, tmp_path / "out")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["broken"]


def test_the_record_of_a_hand_over_next_to_results_is_no_run_of_theirs(runs: dict[str, Path], tmp_path: Path) -> None:
    run = shutil.copytree(runs["pit"], tmp_path / "run")
    (run / "run.json").rename(run / "labelled_run.json")
    hand_over(run, run / "a.zip", formats="gpkg")
    hand_over(run, run / "b.zip", formats="gpkg")
    shutil.copyfile(run / "labelled_run.json", run / "other_run.json")
    with pytest.raises(InputError, match=r"holds 2 runs; give the record of one of them, such as labelled_run\.json"):
        hand_over(run, tmp_path / "c.zip", formats="gpkg")
    hand_over(run / "other_run.json", tmp_path / "c.zip", formats="gpkg")


@pytest.mark.parametrize(
    ("record", "words"),
    [
        ("{", "is no run record that can be read"),
        ('{"command": "train", "outputs": {}}', "'train', whose results are not handed over"),
        ('{"command": "inspect", "outputs": {"zones": 3}}', "outputs.zones is not a text"),
        ('{"command": "inspect", "outputs": {}}', "have no reference system"),
    ],
)
def test_a_record_of_another_kind_is_refused(record: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text(record, encoding="utf-8")
    with pytest.raises(InputError, match=words):
        hand_over(tmp_path, tmp_path / "out.zip")
    assert [p.name for p in tmp_path.iterdir()] == ["run.json"]


def test_a_record_names_nothing_outside_its_folder(runs: dict[str, Path], tmp_path: Path) -> None:
    run = shutil.copytree(runs["pit"], tmp_path / "run")
    record = json.loads((run / "run.json").read_text(encoding="utf-8"))
    (tmp_path / "secret.csv").write_text("a\n1\n", encoding="utf-8")
    record["outputs"] |= {"up": "../secret.csv", "root": str(tmp_path / "secret.csv")}
    (run / "run.json").write_text(json.dumps(record), encoding="utf-8")
    hand_over(run, tmp_path / "out", formats="csv")
    assert not list((tmp_path / "out").rglob("*secret*"))


@pytest.mark.parametrize("formats", ["", "gpkg,shape", " , "])
def test_formats_that_are_none_are_refused(formats: str, runs: dict[str, Path], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"formats (is empty|has 'shape', which is none); give some of cog, gpkg"):
        hand_over(runs["pit"], tmp_path / "out", formats=formats)
    assert not (tmp_path / "out").exists()


def test_the_runs_own_folder_is_no_place_for_the_hand_over(runs: dict[str, Path]) -> None:
    before = sorted(runs["pit"].rglob("*"))
    with pytest.raises(InputError, match="is the folder of the run itself"):
        hand_over(runs["pit"], runs["pit"], overwrite=True)
    assert sorted(runs["pit"].rglob("*")) == before


def test_the_command_ends_with_the_files_and_refuses_in_one_sentence(runs: dict[str, Path], tmp_path: Path) -> None:
    command = [sys.executable, "-m", "slopewatch.cli", "exportgis"]
    chosen = [runs["pit"], "--output", tmp_path / "a.zip", "--formats", "gpkg,iso"]
    done = subprocess.run([*command, *chosen], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    with zipfile.ZipFile(tmp_path / "a.zip") as archive:
        assert archive.namelist() == ["SHA256SUMS", "layers.gpkg", "metadata/iso19139.xml"]
    done = subprocess.run([*command, tmp_path, "--output", tmp_path / "b.zip"], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
