"""Every kind of folder that a run leaves is handed over whole; a corridor with each of its slopes."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import geopandas as gpd
import pyogrio
import pytest
import rasterio
import shapely
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.handover.stac import POINTS, RASTER
from slopewatch.interface.parameters import HandoverParameters
from slopewatch.tests.builders.handed_over import hand_over
from slopewatch.tests.builders.landxml_rules import faults
from slopewatch.tests.builders.postgres import Server, server
from slopewatch.tests.builders.run_folders import COMMANDS, made
from slopewatch.tests.builders.stac_schemas import extension_faults
from slopewatch.workflows.exportgis import export_step


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return made(tmp_path_factory.mktemp("runs"))


@pytest.fixture(scope="module")
def corridor(folders: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The batch handed over as a folder."""
    out = tmp_path_factory.mktemp("given") / "corridor"
    hand_over(folders["batch"], out, organisation="Roads Agency")
    return out


@pytest.fixture(scope="module")
def database() -> Iterator[Server]:
    with server() as made_server:
        yield made_server


def record(folder: Path) -> dict[str, Any]:
    (path,) = [p for p in folder.glob("*run.json") if json.loads(p.read_text(encoding="utf-8"))["command"] in COMMANDS]
    return dict(json.loads(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize("command", COMMANDS)
def test_all_layers_and_rasters_of_a_run_are_handed_over(
    folders: dict[str, Path], tmp_path: Path, command: str
) -> None:
    folder = folders[command]
    done = hand_over(folder, tmp_path / "out", each_slope=False)
    files = [folder / name for name in record(folder)["outputs"].values()]
    layers = [
        row[0] for f in files if f.suffix == ".gpkg" for row in pyogrio.list_layers(f) if row[0] != "layer_styles"
    ]
    rasters = [f for f in files if f.suffix in (".tif", ".vrt")]
    assert (done.figures["layers"], done.figures["rasters"]) == (len(layers), len(rasters))
    assert layers or rasters
    for path in rasters:
        with rasterio.open(tmp_path / "out" / "rasters" / f"{path.stem}.tif") as copy, rasterio.open(path) as source:
            assert (copy.read() == source.read()).mean() > 0.999 or copy.read_masks(1).sum() == 0
    if layers:
        given = {row[0]: row[1] for row in pyogrio.list_layers(tmp_path / "out" / "layers.gpkg")}
        assert set(layers) == set(given) - {"layer_styles"}
        if command in ("planflight", "compareflight"):
            assert given["lines"] == "LineString Z"
    assert faults(tmp_path / "out" / "cad" / "landxml.xml") == []
    item = item_of(tmp_path / "out")
    with_bands = [name for name, asset in item["assets"].items() if "bands" in asset]
    assert with_bands == sorted(f"rasters/{path.stem}.tif" for path in rasters)
    assert (RASTER in item["stac_extensions"]) == bool(rasters), "its schema asks for a raster"
    zones = any(name.endswith("zones") for name in layers)
    assert ("zone(s)" in item["properties"]["description"]) == zones, "a plan has none to count"


def item_of(folder: Path) -> dict[str, Any]:
    return dict(json.loads((folder / "item.json").read_text(encoding="utf-8")))


@pytest.mark.parametrize("command", COMMANDS)
def test_items_keep_to_the_schemas_of_their_extensions(folders: dict[str, Path], tmp_path: Path, command: str) -> None:
    for formats in ("cog,gpkg,copc,stac", "gpkg,stac"):
        hand_over(folders[command], tmp_path / "out", each_slope=False, formats=formats, overwrite=True)
        item = item_of(tmp_path / "out")
        assert (POINTS in item["stac_extensions"]) == any(name.endswith(".copc.laz") for name in item["assets"])
        assert extension_faults(item) == []
    item["properties"]["proj:bbox"] = [1, 2, 3]
    assert extension_faults(item)


def test_a_corridor_holds_what_each_of_its_slopes_holds(folders: dict[str, Path], corridor: Path) -> None:
    slopes = gpd.read_file(folders["batch"] / "corridor.gpkg", layer="slopes")
    assert slopes["state"].tolist() == ["done", "done"]
    parts = sorted(p.name for p in (corridor / "slopes").iterdir())
    assert parts == sorted(p.name for p in (folders["batch"] / "slopes").iterdir())
    for name in parts:
        (run,) = (folders["batch"] / "slopes" / name).iterdir()
        given = corridor / "slopes" / name
        named = record_of_slope(run)["outputs"].values()
        rasters = [run / path for path in named if path.endswith(".tif")]
        assert rasters
        for path in rasters:
            assert (given / "rasters" / path.name).read_bytes() == path.read_bytes()
        assert (given / "report" / "report.html").read_bytes() == (run / "report.html").read_bytes()
        assert (given / "metadata" / "iso19139.xml").is_file()
        assert faults(given / "cad" / "landxml.xml") == []
    sums = (corridor / "SHA256SUMS").read_text(encoding="utf-8").splitlines()
    named = {line.split("  ", 1)[1] for line in sums}
    assert named == {p.relative_to(corridor).as_posix() for p in corridor.rglob("*") if p.is_file()} - {
        "SHA256SUMS", "run.json",
    }  # fmt: skip


def record_of_slope(folder: Path) -> dict[str, Any]:
    return dict(json.loads((folder / "run.json").read_text(encoding="utf-8")))


def test_the_mosaic_of_a_corridor_has_the_colours_of_its_slopes(folders: dict[str, Path], corridor: Path) -> None:
    (slope,) = (folders["batch"] / "slopes").glob("*/*/elevation_change.qml")
    for folder in (folders["batch"], corridor / "rasters"):
        assert (folder / "elevation_change.qml").read_bytes() == slope.read_bytes()
    assert (corridor / "rasters" / "elevation_change.sld").is_file()


def test_links_of_the_corridor_lead_to_the_reports_in_the_hand_over(
    folders: dict[str, Path], corridor: Path, tmp_path: Path
) -> None:
    page = (corridor / "report" / "corridor.html").read_text(encoding="utf-8")
    links = re.findall(r'<a href="([^"#]+)"', page)
    assert len(links) >= 2
    for link in links:
        assert (corridor / "report" / link).is_file(), link
    table = gpd.read_file(corridor / "layers.gpkg", layer="slopes")
    assert all((corridor / path).is_file() for path in table["report"])
    hand_over(folders["batch"], tmp_path / "alone", each_slope=False)
    assert not (tmp_path / "alone" / "slopes").exists()
    assert not (tmp_path / "alone" / "collection.json").exists()
    page = (tmp_path / "alone" / "report" / "corridor.html").read_text(encoding="utf-8")
    assert "B pair" in page
    assert "report.html" not in page
    assert set(gpd.read_file(tmp_path / "alone" / "layers.gpkg", layer="slopes")["report"]) <= {"", None}


def test_the_collection_has_an_item_for_the_corridor_and_one_for_each_slope(corridor: Path) -> None:
    collection = json.loads((corridor / "collection.json").read_text(encoding="utf-8"))
    paths = [corridor / link["href"] for link in collection["links"] if link["rel"] == "item"]
    items = [json.loads(path.read_text(encoding="utf-8")) for path in paths]
    assert len(items) == 3
    assert len({item["id"] for item in items}) == 3
    (whole, *boxes) = [shapely.box(*b) for b in collection["extent"]["spatial"]["bbox"]]
    for path, item, box in zip(paths, items, boxes, strict=True):
        assert item["collection"] == collection["id"]
        assert {link["rel"] for link in item["links"]} == {"root", "parent", "collection"}
        assert all((path.parent / link["href"]).resolve() == corridor / "collection.json" for link in item["links"])
        assert shapely.box(*item["bbox"]).equals(box)
        assert whole.covers(box)
        assert all((path.parent / asset["href"]).is_file() for asset in item["assets"].values())
    titles = [link.get("title", "") for link in collection["links"] if link["rel"] == "item"]
    assert any(title.startswith("A one: ") for title in titles)


def test_the_collection_is_stac_by_its_own_library(corridor: Path) -> None:
    pystac = pytest.importorskip("pystac", reason="pystac is not installed")
    read = pystac.Collection.from_file(str(corridor / "collection.json"))
    pytest.importorskip("jsonschema", reason="pystac's validation is not installed")
    assert read.validate()
    items = list(read.get_items())
    assert len(items) == 3
    for item in items:
        item.stac_extensions = []  # their schemas are not in the library, and tests use no network
        assert item.validate()


def test_every_page_of_a_run_is_handed_over(folders: dict[str, Path], tmp_path: Path) -> None:
    run = shutil.copytree(folders["change"], tmp_path / "run")
    named = json.loads((run / "run.json").read_text(encoding="utf-8"))
    named["outputs"]["report_pdf"] = "report.pdf"  # as of --pdf
    (run / "run.json").write_text(json.dumps(named), encoding="utf-8")
    (run / "report.pdf").write_bytes(b"%PDF-1.7")
    hand_over(run, tmp_path / "out", formats="report")
    assert {"report.html", "report.pdf"} <= {path.name for path in (tmp_path / "out" / "report").iterdir()}


def test_a_slope_whose_results_are_gone_is_one_sentence(folders: dict[str, Path], tmp_path: Path) -> None:
    run = shutil.copytree(folders["batch"], tmp_path / "run")
    (folder,) = (run / "slopes" / next(p.name for p in (run / "slopes").iterdir() if p.name.startswith("B"))).iterdir()
    (folder / "elevation_change.tif").unlink()
    with pytest.raises(InputError, match=r"lacks 'elevation_change\.tif', which its run record names"):
        hand_over(run, tmp_path / "out")
    shutil.rmtree(folder)
    with pytest.raises(InputError, match="is missing, though the corridor names it; run the batch again"):
        hand_over(run, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    hand_over(run, tmp_path / "alone", each_slope=False, formats="gpkg,csv")


def test_a_mosaic_of_slopes_far_apart_is_left_out(folders: dict[str, Path], tmp_path: Path) -> None:
    run = shutil.copytree(folders["batch"], tmp_path / "run")
    path = run / "elevation_change.vrt"
    text = path.read_text(encoding="utf-8")
    size = 'rasterXSize="200000" rasterYSize="90000"'
    path.write_text(re.sub(r'rasterXSize="\d+" rasterYSize="\d+"', size, text, count=1), encoding="utf-8")
    done = hand_over(run, tmp_path / "out", formats="cog")
    assert any("18000 million cells" in sentence for sentence in done.warnings)
    assert not (tmp_path / "out" / "rasters").exists()
    assert len(list((tmp_path / "out" / "slopes").glob("*/rasters/elevation_change.tif"))) == 1


def test_events_of_a_corridor_are_on_the_centrelines_of_its_slopes(folders: dict[str, Path], database: Server) -> None:
    address = database.address()
    for _ in range(2):
        done = export_step(folders["batch"], None, HandoverParameters.build({}), address=address, progress=Progress())
    zones = gpd.read_file(folders["batch"] / "corridor.gpkg", layer="zones")
    placed = zones["chain_from"].notna()
    assert placed.any()
    found = database.run("SELECT count(*), count(road_point) FROM slopewatch.zones")
    assert found == [(len(zones), int(placed.sum()))]
    assert done.figures["database_history"] == 0
    axis = gpd.read_file(folders["batch"].parent / "road.gpkg").geometry[0]
    rows = database.run("SELECT zone_id, ST_AsText(road_point) FROM slopewatch.zones WHERE road_point IS NOT NULL")
    for zone_id, point in rows:
        centre = zones.set_index("zone_id").geometry[zone_id].centroid
        assert shapely.from_wkt(point).distance(shapely.Point(axis.interpolate(axis.project(centre)))) < 1e-6
    snapped = database.run("SELECT bool_and(snapped) FROM slopewatch.gdms_events WHERE start_chainage_m IS NOT NULL")
    assert snapped == [(True,)]
    graded = dict(database.run("SELECT event_id, rmms_category FROM slopewatch.gdms_events"))
    asked = dict(database.run("SELECT id, attention FROM slopewatch.events"))
    assert {event: {1: "2.2", 2: "2.1"}.get(asked[event], "1") for event in graded} == graded
