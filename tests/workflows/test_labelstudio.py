"""A top view to Label Studio and back: what is drawn there lies where it was drawn, and bad exports are refused."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import geopandas as gpd
import numpy as np
import pyogrio
import pytest
import rasterio
import shapely
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.grid.geotiff import write_raster, write_rgba
from slopewatch.engine.grid.grid import Grid
from slopewatch.interface.parameters import LabellingParameters
from slopewatch.models.training.label_polygons import read_label_polygons
from slopewatch.tests.builders.label_studio import painted, polygon, result, task, write_export
from slopewatch.workflows.labelstudio import export_step, import_step

UTM = CRS.from_epsg(32651)
GRID = Grid(500_000.0, 3_500_030.0, 0.2, 120, 200)
SIZE = (GRID.columns, GRID.rows)
PIXEL = GRID.cell
# with a hole, in two parts, and one beyond the picture's eastern edge
ZONES = [
    shapely.box(500_002, 3_500_008, 500_012, 3_500_018).difference(shapely.Point(500_007, 3_500_013).buffer(2)),
    shapely.union(
        shapely.box(500_020, 3_500_010, 500_024, 3_500_013), shapely.box(500_026, 3_500_010, 500_029, 3_500_014)
    ),
    shapely.Polygon([(500_035.123, 3_500_020.456), (500_039, 3_500_021), (500_038, 3_500_026.789)]),
]  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A picture whose western 0.4 m are transparent, zones on it, and what is exported of both."""
    place = tmp_path_factory.mktemp("labels")
    rgba = np.random.default_rng(0).integers(0, 256, (*GRID.shape, 4)).astype(np.uint8)
    rgba[..., 3] = 255
    rgba[:, :2] = 0
    write_rgba(place / "top_view.tif", rgba, GRID, UTM)
    zones = {
        "zone_id": ["Z001", "Z002", "Z003"],
        "kind": ["uplift", "subsidence", "crack"],
        "area_m2": [z.area for z in ZONES],
        "reviewer": ["A. Sato", None, "B. Ito"],
    }
    gpd.GeoDataFrame(zones, geometry=ZONES, crs=UTM).to_file(place / "zones.gpkg", layer="zones")
    exported(place / "top_view.tif", place / "out", segments=place / "zones.gpkg")
    return place


def exported(picture: Path, output: Path, *, segments: Path | None = None, overwrite: bool = False, **given):
    parameters = LabellingParameters(**given)
    return export_step(picture, output, parameters, segments=segments, overwrite=overwrite, progress=Progress())


def imported(folder: Path, tmp_path: Path, tasks: object, output: str = "labels.gpkg") -> gpd.GeoDataFrame:
    export = write_export(tmp_path / "project-7-at-2025.json", tasks)
    import_step(export, folder / "out" / "tasks.json", tmp_path / output, progress=Progress())
    return pyogrio.read_dataframe(tmp_path / output, layer="labels")


def per_cent(shape: shapely.Polygon) -> np.ndarray:
    """Corners as Label Studio has them, by the world file."""
    corners = np.asarray(shape.exterior.coords)[:-1]
    return np.column_stack([corners[:, 0] - GRID.west, GRID.north - corners[:, 1]]) / PIXEL / SIZE * 100


def test_the_pictures_lie_where_the_raster_does(folder):
    out = folder / "out"
    assert {p.name for p in out.iterdir()} == {
        "top_view.png", "top_view.pgw", "top_view.png.aux.xml", "tasks.json", "labels.xml", "run.json",
    }  # fmt: skip
    with rasterio.open(out / "top_view.png") as picture, rasterio.open(folder / "top_view.tif") as raster:
        assert picture.transform.almost_equals(raster.transform)
        assert picture.crs == raster.crs
        np.testing.assert_array_equal(picture.read(), raster.read())
    labels = ElementTree.parse(out / "labels.xml").getroot()
    assert [tag.tag for tag in labels] == ["Image", "PolygonLabels", "RectangleLabels", "BrushLabels", "TextArea"]
    offered = [label.get("value") for label in labels.find("BrushLabels")]
    assert offered == ["uplift", "subsidence", "background", "unknown", "crack"]


def test_zones_come_back_as_they_were_with_their_attributes(folder, tmp_path):
    """Annotated as predicted; a polygon has no holes in Label Studio, so that the zone's pieces are put together."""
    (made,) = json.loads((folder / "out" / "tasks.json").read_text())
    predicted = made["predictions"][0]["result"]
    assert {r["type"] for r in predicted} == {"polygonlabels"}
    assert {(r["original_width"], r["original_height"]) for r in predicted} == {SIZE}
    assert len(predicted) >= 5
    found = imported(folder, tmp_path, [task([{**r, "origin": "prediction"} for r in predicted], data=made["data"])])
    assert found["segment"].tolist() == ["Z001", "Z002", "Z003"]
    assert found["class"].tolist() == ["uplift", "subsidence", "crack"]
    assert found["annotator"].tolist() == ["a.sato@example.org"] * 3
    assert found["reviewer"].fillna("").tolist() == ["A. Sato", "", "B. Ito"]
    np.testing.assert_allclose(found["was_area_m2"], [z.area for z in ZONES])
    assert found.crs == gpd.GeoSeries(crs=UTM).crs
    for zone, shape in zip(ZONES, found.geometry, strict=True):
        assert shape.hausdorff_distance(zone) < 1e-5
        assert shape.symmetric_difference(zone).area < 1e-4
    assert "tasks" in json.loads((tmp_path / "labels_run.json").read_text())["inputs"][1]["role"]


def test_polygons_drawn_there_come_back_within_half_a_pixel(folder, tmp_path):
    drawn = [shapely.Polygon([(500_001, 3_500_009), (500_004.3, 3_500_010.2), (500_003, 3_500_015.7)]), ZONES[2]]
    # the editor rounds nothing; one pixel of a screen that shows the picture in half its size is rounded here
    results = [polygon(np.round(per_cent(s), 2), "uplift", SIZE, f"r{k}") for k, s in enumerate(drawn)]
    found = imported(folder, tmp_path, [task(results)])
    for shape, wanted in zip(found.geometry, drawn, strict=True):
        assert shape.hausdorff_distance(wanted) < PIXEL / 2
    mapping = {"uplift": 1, "background": 0}
    labels = read_label_polygons(tmp_path / "labels.gpkg", "class", mapping, str)
    assert labels.frame["label"].tolist() == [1, 1]


@pytest.mark.parametrize("angle", [0, 30, 90, 200.5, -45])
def test_rectangles_turn_clockwise_about_their_upper_left_corner(folder, tmp_path, angle):
    x, y, width, height = 90.0, 50.0, 40.0, 12.0  # pixels
    value = {"x": x / 2, "y": y / 1.2, "width": width / 2, "height": height / 1.2, "rotation": angle}
    value["rectanglelabels"] = ["subsidence"]
    found = imported(folder, tmp_path, task([result("rectanglelabels", value, SIZE)]))
    corner = (GRID.west + x * PIXEL, GRID.north - y * PIXEL)
    box = shapely.box(corner[0], corner[1] - height * PIXEL, corner[0] + width * PIXEL, corner[1])
    wanted = shapely.affinity.rotate(box, -angle, origin=corner)  # on the map north is up
    assert found.geometry[0].symmetric_difference(wanted).area < 1e-6
    assert found.loc[0, "shape"] == "rectangle"


def test_brush_masks_follow_the_pixels_painted(folder, tmp_path):
    mask = np.zeros(GRID.shape, dtype=bool)
    mask[40:60, 50:90] = mask[70, 100:103] = True
    mask[45:50, 60:65] = False
    value = {"format": "rle", "rle": painted(mask), "brushlabels": ["uplift"]}
    found = imported(folder, tmp_path, [task([result("brushlabels", value, SIZE)])])
    row, column = np.nonzero(mask)
    pixels = shapely.union_all(
        [
            shapely.box(x, y - PIXEL, x + PIXEL, y)
            for x, y in zip(GRID.west + column * PIXEL, GRID.north - row * PIXEL, strict=True)
        ]
    )
    assert found.geometry[0].symmetric_difference(pixels).area < 1e-6
    assert found.loc[0, "area_m2"] == pytest.approx(mask.sum() * PIXEL**2)
    assert found.loc[0, "shape"] == "brush"


def test_labels_attributes_and_annotators_of_each_region_are_kept(folder, tmp_path):
    square = per_cent(shapely.box(500_010, 3_500_010, 500_012, 3_500_012))
    body = {"points": square.tolist()}
    first = [
        result("polygon", body, SIZE, "one", from_name="shape"),
        result("labels", {"labels": ["uplift", "crack"]}, SIZE, "one", from_name="name"),
        result("textarea", {"text": ["wet", "since May"]}, SIZE, "one", from_name="Remark!"),
        result("choices", {"choices": ["sure"]}, SIZE, "one", from_name="confidence"),
        result("rating", {"rating": 4}, SIZE, "one", from_name="severity"),
        polygon(square + 5, "subsidence", SIZE, "two", meta={"text": ["see photo 12"]}),
    ]
    second = task([polygon(square, "background", SIZE, "three")], number=2)
    second["annotations"][0]["completed_by"] = 9
    skipped = {**second["annotations"][0], "was_cancelled": True}
    second["annotations"].append(skipped)
    found = imported(folder, tmp_path, [task(first), second])
    assert found["class"].tolist() == ["uplift, crack", "subsidence", "background"]
    assert found["annotator"].tolist() == ["a.sato@example.org"] * 2 + ["9"]
    assert found["task_id"].tolist() == ["1", "1", "2"]
    assert found["region_id"].tolist() == ["one", "two", "three"]
    assert found["remark"].fillna("").tolist() == ["wet, since May", "", ""]
    assert found["confidence"].fillna("").tolist() == ["sure", "", ""]
    assert found["severity"].tolist()[:1] == [4]
    assert found["note"].fillna("").tolist() == ["", "see photo 12", ""]


def test_a_large_picture_is_cut_and_zones_across_the_cut_come_back_whole(folder, tmp_path):
    run = exported(folder / "top_view.tif", tmp_path / "out", segments=folder / "zones.gpkg", largest_picture=256)
    assert run.figures["pictures"] == 1
    big = Grid(GRID.west, GRID.north, 0.1, 300, 600)
    rgba = np.full((*big.shape, 4), 255, dtype=np.uint8)
    rgba[:, 300:] = 0  # the eastern part shows nothing
    write_rgba(tmp_path / "big.tif", rgba, big, UTM)
    across = shapely.box(500_005, 3_500_010, 500_025, 3_500_022)
    layer = gpd.GeoDataFrame({"name": ["west"], "kind": ["uplift"]}, geometry=[across], crs=UTM)
    layer.to_crs(4326).to_file(tmp_path / "seg.geojson")
    exported(tmp_path / "big.tif", tmp_path / "cut" / "out", segments=tmp_path / "seg.geojson", largest_picture=256)
    tasks = json.loads((tmp_path / "cut" / "out" / "tasks.json").read_text())
    assert [t["data"]["slopewatch"]["picture"] for t in tasks] == [
        "big_1_1.png", "big_1_2.png", "big_2_1.png", "big_2_2.png",
    ]  # fmt: skip
    export = [
        task(t["predictions"][0]["result"], image=f"/data/local-files/?d=a%2Fb%2F{t['data']['slopewatch']['picture']}",
             number=k, file_upload=None)
        for k, t in enumerate(tasks) if "predictions" in t
    ]  # fmt: skip
    assert len(export) == 4
    found = imported(tmp_path / "cut", tmp_path, export)
    assert found["segment"].tolist() == ["west"]
    assert found.geometry[0].symmetric_difference(across).area < 0.02


def test_a_raster_of_one_band_becomes_grey(tmp_path):
    values = np.tile(np.linspace(0, 10, 60), (40, 1))
    values[:5] = np.nan
    grid = Grid(500_000.0, 3_500_030.0, 0.5, 40, 60)
    write_raster(tmp_path / "hillshade.tif", values, grid, UTM, description="x")
    exported(tmp_path / "hillshade.tif", tmp_path / "out")
    with rasterio.open(tmp_path / "out" / "hillshade.png") as source:
        bands = source.read()
    assert (bands[3, :5] == 0).all()
    assert (bands[3, 5:] == 255).all()
    assert (np.diff(bands[0, 20].astype(int)) >= 0).all()
    assert bands[0, 20, 0] == 0
    assert bands[0, 20, -1] == 255
    assert "predictions" not in json.loads((tmp_path / "out" / "tasks.json").read_text())[0]


SQUARE = per_cent(shapely.box(500_010, 3_500_010, 500_012, 3_500_012))
GOOD = polygon(SQUARE, "uplift", SIZE)
BAD = {
    "another size": ([task([polygon(SQUARE, "uplift", (400, 240))])], "on a picture of 400 by 240 pixels"),
    "another name": (
        [task([GOOD], "/data/upload/7/0a1b2c3d-cat.jpg", file_upload="x-cat.jpg")],
        "is of another picture",
    ),
    "no polygons": ([task([result("keypointlabels", {"x": 1, "y": 2}, SIZE)])], r"no polygons.*\(there are keypointl"),
    "nothing drawn": ([task([])], "has no polygons"),
    "turned picture": ([task([{**GOOD, "image_rotation": 90}])], "turned by 90 degrees; turn it back"),
    "a task of text": ([task([], data={"text": "hello"}, file_upload="")], "has no picture, so it is of another type"),
    "JSON-MIN": ([{"id": 1, "image": "top_view.png", "label": [], "data": {}}], "JSON-MIN"),
    "a list of numbers": ([1, 2], "no JSON export of Label Studio"),
    "off the cloud": ([task([polygon(SQUARE * [0, 1], "uplift", SIZE)])], "has no area"),
    "on transparent pixels": (
        [task([polygon([[0.0, 10], [0.9, 10], [0.9, 60], [0.0, 60]], "uplift", SIZE)])],
        r"The region aBcDeF1234 \(uplift\) of task 1 lies off the cloud",
    ),
    "beyond the picture": (
        [task([polygon([[110, 10], [130, 10], [130, 60]], "uplift", SIZE)])],
        "lies off the cloud on top_view.png",
    ),
    "a damaged mask": (
        [task([result("brushlabels", {"format": "rle", "rle": [0, 1, 2], "brushlabels": ["uplift"]}, SIZE)])],
        "its run lengths end early",
    ),
    "two corners": ([task([polygon(SQUARE[:2], "uplift", SIZE)])], "points is not a list of at least 3"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_exports_are_refused_in_a_sentence(folder, tmp_path, name):
    tasks, words = BAD[name]
    with pytest.raises(InputError, match=words) as refused:
        imported(folder, tmp_path, tasks)
    assert str(refused.value).endswith(".")
    assert "\n" not in str(refused.value)
    assert [p.suffix for p in tmp_path.iterdir()] == [".json"]


def test_other_files_are_refused(folder, tmp_path):
    tasks = folder / "out" / "tasks.json"
    good = write_export(tmp_path / "good.json", [task([GOOD])])
    bad = tmp_path / "bad.json"
    bad.write_text("annotations: none")
    for export, known, output, words in (
        (bad, tasks, "labels.gpkg", "no JSON export of Label Studio .it is no JSON"),
        (tmp_path / "gone.json", tasks, "labels.gpkg", "does not exist"),
        (good, good, "labels.gpkg", "give the tasks.json that slopewatch exportlabelstudio wrote"),
        (good, tmp_path / "gone.json", "labels.gpkg", "do not exist"),
        (good, tasks, "labels.shp", "end its name in .gpkg"),
    ):
        with pytest.raises(InputError, match=words):
            import_step(export, known, tmp_path / output, progress=Progress())
    moved = tmp_path / "moved"
    moved.mkdir()
    (moved / "tasks.json").write_bytes(tasks.read_bytes())
    with pytest.raises(InputError, match="is not next to its tasks"):
        import_step(good, moved / "tasks.json", tmp_path / "labels.gpkg", progress=Progress())
    picture = (folder / "out" / "top_view.png").read_bytes()
    (moved / "top_view.png").write_bytes(picture[:-1])
    with pytest.raises(InputError, match="not the one that its tasks were written for"):
        import_step(good, moved / "tasks.json", tmp_path / "labels.gpkg", progress=Progress())
    assert not (tmp_path / "labels.gpkg").exists()


def test_what_cannot_be_exported_is_refused(folder, tmp_path):
    picture = folder / "top_view.tif"
    empty = tmp_path / "empty.tif"
    write_rgba(empty, np.zeros((*GRID.shape, 4), dtype=np.uint8), GRID, UTM)
    for given, words in (
        ({"picture": folder / "zones.gpkg"}, "is not a GeoTIFF"),
        ({"picture": empty}, "shows nothing"),
        ({"picture": picture, "labels": " , "}, "labels is empty"),
        ({"picture": picture, "segments": folder / "zones.gpkg", "label_field": "nope"}, "have no field nope"),
        ({"picture": picture, "segments": picture}, "cannot be read|holds no polygons"),
        ({"picture": picture, "segments": folder / "gone.gpkg"}, "does not exist"),
    ):
        with pytest.raises(InputError, match=words):
            exported(given.pop("picture"), tmp_path / "out", **given)
        assert not (tmp_path / "out").exists()
    with pytest.raises(InputError, match="holds results already"):
        exported(picture, folder / "out")


def test_the_same_files_have_the_same_bytes(folder, tmp_path):
    for name in ("a", "b"):
        exported(folder / "top_view.tif", tmp_path / name, segments=folder / "zones.gpkg")
    for name in ("top_view.png", "tasks.json", "labels.xml", "top_view.pgw"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
