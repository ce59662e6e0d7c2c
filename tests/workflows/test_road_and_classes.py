"""Places on a road and change by class of asset, in whole runs on a slope whose western third sank by 0.3 m."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pyogrio
import pytest
import shapely
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.interface.parameters import AssetParameters, ChangeParameters, RoadParameters
from slopewatch.tests.builders.clouds import write_sunk_slope
from slopewatch.tests.builders.zone_layers import opened
from slopewatch.workflows.change import change_step
from slopewatch.workflows.layer_files import NO_LAYERS, LayerFiles
from slopewatch.workflows.locate import locate_step
from slopewatch.workflows.settings import Settings

X, Y = 500_000.0, 3_500_000.0


def layer(path: Path, shapes: list[Any], crs: int = 32651, **fields: list[Any]) -> Path:
    moved = [shapely.transform(shape, lambda xy: xy + (X, Y)) for shape in shapes]
    geopandas.GeoDataFrame(fields, geometry=moved, crs=32651).to_crs(crs).to_file(path)
    return path


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two clouds; a road south of the slope that runs west, K1+000 to K1+200; a bench and a drain."""
    folder = tmp_path_factory.mktemp("slope")
    write_sunk_slope(folder / "2024-05-01.laz")
    write_sunk_slope(folder / "2025-05-01.laz", lowered=0.3)
    axis = shapely.LineString([(112, -15), (-88, -15)])
    layer(folder / "road.gpkg", [axis], 4326, ROAD=["S1"], FROM=[1.0], UPTO=[1.2])
    (folder / "names.json").write_text('{"centreline": {"route": "ROAD", "chain_from": "FROM", "chain_to": "UPTO"}}')
    boxes = [shapely.box(-1, -1, 13, 8), shapely.box(-1, 8, 13, 10.9)]
    layer(folder / "classes.gpkg", boxes, kind=["bench", "drain"])
    return folder


def changed(place: Path, out: Path, layers: LayerFiles = NO_LAYERS, **road: Any) -> Progress:
    progress = Progress()
    settings = Settings(
        change=ChangeParameters(cell=0.5, adaptive=False, registration_error=0.002),
        road=RoadParameters(chainage_unit="km", **road),
        assets=AssetParameters(class_field="KIND"),
    )
    change_step(
        place / "2024-05-01.laz", place / "2025-05-01.laz", out, settings, dates=(None, None), transform_path=None,
        layers=layers, overwrite=True, progress=progress,
    )  # fmt: skip
    return progress


@pytest.fixture(scope="module")
def made(place: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("out")
    changed(place, out, LayerFiles(place / "road.gpkg", place / "names.json", place / "classes.gpkg"))
    return out


def test_the_zone_has_its_place_and_the_report_says_it(made: Path) -> None:
    (zone,) = pyogrio.read_dataframe(made / "zones.gpkg", layer="zones").to_dict("records")
    # 4 m wide from the slope's western edge; chainage grows to the west, so that the slope lies to the right
    assert (zone["route"], zone["side"]) == ("S1", "right")
    assert zone["chain_from"] == pytest.approx(1000 + 112 - 4, abs=0.51)
    assert zone["chain_to"] == pytest.approx(1000 + 112, abs=0.51)
    assert zone["offset_m"] == pytest.approx(15, abs=0.51)
    assert zone["offset_mid_m"] == pytest.approx(21, abs=0.51)
    assert zone["location"].startswith("S1 K1+1")
    record = json.loads((made / "run.json").read_text(encoding="utf-8"))
    assert {"centreline", "field_names", "classes"} <= {i["role"] for i in record["inputs"]}
    page = (made / "report.html").read_text(encoding="utf-8")
    assert zone["location"] in page
    assert "Change by class of asset" in page
    assert '<th scope="col">place<br>(x, y)</th>' not in page


def test_the_classes_are_the_whole_and_hold_the_true_volume(made: Path) -> None:
    with (made / "budget_by_class.csv").open(encoding="utf-8") as file:
        rows = {row["class"]: row for row in csv.DictReader(file)}
    assert list(rows) == ["bench", "drain", "no class", "all"]
    for name in (
        "compared_m2",
        "lowering_m2",
        "raising_m2",
        "vol_lowering_m3",
        "vol_raising_m3",
        "vol_net_m3",
        "all_net_m3",
    ):
        parts = math.fsum(float(rows[c][name]) for c in ("bench", "drain", "no class"))
        assert parts == pytest.approx(float(rows["all"][name]), abs=2.1e-6), "rows have six decimals"
    # by the cells whose centres lie in the class: 16 rows of 0.5 m, and 6
    for name, width in (("bench", 8.0), ("drain", 3.0)):
        net, error = (float(rows[name][k]) for k in ("all_net_m3", "all_net_err_m3"))
        assert net == pytest.approx(-0.3 * 4 * width, abs=max(4 * error, 0.05))
    with (made / "volumes.csv").open(encoding="utf-8") as file:
        volumes = {row["quantity"]: row for row in csv.DictReader(file) if row["group"] == "VOLUMETRIC"}
    net = volumes["Total Net Volume Difference"]
    assert float(rows["all"]["all_net_m3"]) == pytest.approx(float(net["raw"]), abs=2e-6)
    assert float(rows["all"]["all_net_err_m3"]) == pytest.approx(float(net["raw_error"]), abs=2e-6)
    assert float(rows["all"]["vol_net_m3"]) == pytest.approx(float(net["thresholded"]), abs=2e-6)
    found = pyogrio.read_dataframe(made / "budget_by_class.gpkg", layer="budget_by_class")
    assert found["class"].tolist() == ["bench", "drain"]
    assert found["vol_net_m3"].tolist() == [float(rows[c]["vol_net_m3"]) for c in ("bench", "drain")]
    assert found["area_m2"].tolist() == pytest.approx([14 * 9, 14 * 2.9])


def test_what_was_computed_is_no_entry_and_what_people_entered_stays(place: Path, made: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    changed(place, out)
    (plain,) = pyogrio.read_dataframe(out / "zones.gpkg", layer="zones").to_dict("records")
    assert not plain["location"]
    assert np.isnan(plain["chain_from"])
    with opened(out / "zones.gpkg") as database:
        database.execute("UPDATE zones SET route = 'by hand', chain_from = 7.0, chain_to = 8.0")
    road = LayerFiles(place / "road.gpkg", place / "names.json")
    progress = changed(place, out, road)
    (kept,) = pyogrio.read_dataframe(out / "zones.gpkg", layer="zones").to_dict("records")
    assert (kept["route"], kept["chain_from"], kept["location"] or "") == ("by hand", 7.0, "")
    assert not any("no place" in w for w in progress.warnings)
    # computed: guarded, and computed again with another start
    with opened(made / "zones.gpkg") as database:
        with pytest.raises(Exception, match="come from the centreline"):
            database.execute("UPDATE zones SET route = 'other'")
        database.execute("UPDATE zones SET slope_id = 'S 7'")
    again = tmp_path / "again"
    again.mkdir()
    (again / "zones.gpkg").write_bytes((made / "zones.gpkg").read_bytes())
    changed(place, again)
    (bare,) = pyogrio.read_dataframe(again / "zones.gpkg", layer="zones").to_dict("records")
    assert (bare["slope_id"], bare["route"] or "", bare["location"] or "") == ("S 7", "", "")


def test_a_layer_of_an_earlier_run_is_located_under_the_agencys_names(place: Path, tmp_path: Path) -> None:
    changed(place, tmp_path / "out")
    names = {"route": "ROAD", "chain_from": "FROM", "chain_to": "UPTO", "zones": {"side": "SIDE", "chain_from": "CH_A"}}
    (tmp_path / "names.json").write_text(json.dumps(names))
    output = tmp_path / "located.gpkg"
    files = LayerFiles(place / "road.gpkg", tmp_path / "names.json")
    zones = tmp_path / "out" / "zones.gpkg"
    done = locate_step(zones, output, files, RoadParameters(chainage_unit="km"), layer="zones", progress=Progress())
    assert (done.figures["features"], done.figures["located"], done.figures["layer"]) == (1, 1, "zones")
    before = pyogrio.read_dataframe(zones, layer="zones")
    (zone,) = (frame := pyogrio.read_dataframe(output, layer="zones")).to_dict("records")
    assert (zone["ROAD"], zone["SIDE"]) == ("S1", "right")
    assert not {"route", "side", "chain_from", "chain_to"} & set(frame.columns), "they have the agency's names"
    assert zone["CH_A"] == pytest.approx(1108, abs=0.51)
    assert zone["UPTO"] == pytest.approx(1112, abs=0.51)
    assert frame.geometry.geom_equals(before.geometry).all()
    assert zone["vol_net_m3"] == before["vol_net_m3"].iloc[0]
    with pytest.raises(InputError, match="holds results already"):
        locate_step(zones, output, files, RoadParameters(chainage_unit="km"), progress=Progress())


def test_names_of_fields_that_are_not_filled_in_are_said(place: Path, tmp_path: Path) -> None:
    source = layer(tmp_path / "assets.geojson", [shapely.Point(12, 0)], 4326, zone_id=[7])
    names = {
        "route": "ROAD",
        "zone_id": "ID",
        "zones": {"side": "SIDE", "kind": "TYPE"},
        "centreline": {"route": "ROAD"},
    }
    (tmp_path / "own.json").write_text(json.dumps(names))
    progress = Progress()
    files = LayerFiles(place / "road.gpkg", tmp_path / "own.json")
    locate_step(source, tmp_path / "o.gpkg", files, RoadParameters(chainage_unit="km"), progress=progress)
    said = [w for w in progress.warnings if "mapping file" in w]
    assert said == ["The mapping file names fields that are not filled in here: zone_id, zones.kind."]
    assert {"ROAD", "SIDE", "zone_id"} <= set(pyogrio.read_dataframe(tmp_path / "o.gpkg").columns)


def test_points_in_degrees_and_what_has_no_place(place: Path, tmp_path: Path) -> None:
    shapes = [
        shapely.Point(12, 0),
        shapely.Point(12, 400),
        shapely.Point(200, -15),
        shapely.LineString([(0, 0), (0, 9)]),
    ]
    source = layer(tmp_path / "assets.geojson", shapes, 4326, name=["a", "b", "c", "d"])
    progress = Progress()
    files = LayerFiles(place / "road.gpkg", place / "names.json")
    done = locate_step(source, tmp_path / "o.gpkg", files, RoadParameters(chainage_unit="km"), progress=progress)
    found = pyogrio.read_dataframe(tmp_path / "o.gpkg").set_index("name")
    assert done.figures["not_located"] == 2
    assert found.loc["a", ["chain_from", "offset_m"]].tolist() == pytest.approx([1100, 15], abs=0.02)
    assert found.loc["d", "offset_mid_m"] == pytest.approx(19.5, abs=0.02)
    assert found.loc["b", "location_note"] == "It lies farther than 200 m from every road."
    assert found.loc["c", "location_note"] == "It lies beyond the end of S1 at K1+000."
    assert any(w.startswith("2 of 4 features have no place on the road. 2: It lies farther") for w in progress.warnings)
    assert found.crs.to_epsg() == 4326


@pytest.mark.parametrize(
    ("files", "words"),
    [
        (LayerFiles(field_names=Path("n.json")), "--field-names was given without --centreline"),
        (LayerFiles(Path("far.gpkg")), "does not reach the slope: it ends 1000 m"),
        (LayerFiles(Path("gone.gpkg")), "does not exist"),
        (LayerFiles(classes=Path("far_classes.gpkg")), "lies on the slope; check their reference system"),
        (LayerFiles(classes=Path("overlap.gpkg")), "overlap on"),
        (LayerFiles(classes=Path("road.gpkg")), "holds no polygons"),
    ],
)
def test_bad_layers_are_refused_and_nothing_is_written(
    place: Path, tmp_path: Path, files: LayerFiles, words: str
) -> None:
    layer(place / "far.gpkg", [shapely.LineString([(0, -1000), (100, -1000)])])
    layer(place / "far_classes.gpkg", [shapely.box(1000, 0, 1010, 9)], kind=["bench"])
    layer(place / "overlap.gpkg", [shapely.box(0, 0, 9, 9), shapely.box(5, 0, 12, 9)], kind=["bench", "drain"])
    (place / "n.json").write_text('{"route": "R"}')
    given = LayerFiles(**{role: None if path is None else place / path for role, path in vars(files).items()})
    with pytest.raises(InputError) as caught:
        changed(place, tmp_path / "out", given)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not list((tmp_path / "out").rglob("*")), "nothing is left"
