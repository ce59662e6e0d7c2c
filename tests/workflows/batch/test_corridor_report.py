"""The page and the report to sign of a corridor, made by a batch and again from its folder."""

from __future__ import annotations

import base64
import io
import json
import re
import shutil
import sqlite3
from contextlib import closing
from datetime import date
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
import pyogrio
import pytest
import rasterio
import shapely
from PIL import Image
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.report.corridor import corridor_pictures
from slopewatch.engine.report.signed.corridor_pictures import ATTENTION_COLOURS, Span
from slopewatch.interface.parameters import BatchParameters, DetailParameters, ReportParameters
from slopewatch.tests.builders.signed_folder import LEAST_FILLED, WIDEST_GAP, Pages, change_folder
from slopewatch.workflows.batch import pages
from slopewatch.workflows.batch.jobs import Slope, Survey
from slopewatch.workflows.batch.pages import _place
from slopewatch.workflows.batch.products import Made, write_products
from slopewatch.workflows.batch.results import SlopeResult
from slopewatch.workflows.report_corridor import corridor_record, read_corridor, report_of_folder
from slopewatch.workflows.run import Run

FAILED = (("S900", "Line 3: its cloud is gone."),)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A corridor of one slope with two zones of change, and one that failed."""
    corridor = tmp_path_factory.mktemp("corridor")
    folder = corridor / "slopes" / "S12" / "inspect"
    change_folder(tmp_path_factory.mktemp("clouds"), folder)
    record = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    outputs = {name: folder / path for name, path in record["outputs"].items()}
    result = SlopeResult("S12", folder, record, outputs)
    survey = Survey(date(2025, 5, 1), corridor / "a.laz")
    slopes = [Slope("S12", (Survey(date(2024, 5, 1), corridor / "b.laz"), survey))]
    details = DetailParameters(pdf=True, client="Road Directorate", report_route="S320")
    run = Run("batch", {"batch": BatchParameters()}, (), Progress())
    run.figures = {"slopes": 2}
    with run.writing(corridor):
        write_products(run, Made(slopes, [result], FAILED, corridor / "m.csv", {}, details), None)
        run.facts |= {
            "settings": {"pdf": True, "client": "Road Directorate", "report_route": "S320"},
            "tables_stamp": [1, 1_700_000_000_000_000_000],
            "failed": [{"slope": slope, "sentence": sentence} for slope, sentence in FAILED],
        }
    return corridor


@pytest.fixture
def copy(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "copy"))


def again(folder: Path, progress: Progress | None = None, **details: Any) -> dict[str, Path]:
    given = DetailParameters(**details)
    return report_of_folder(
        folder, ReportParameters(), details=given, profiles=None, progress=progress or Progress()
    ).outputs


def test_a_slope_that_asks_for_attention_has_a_sheet_with_its_zones_and_alerts(made: Path) -> None:
    signed = Pages(made / "corridor.pdf")
    zones = pyogrio.read_dataframe(made / "corridor.gpkg", layer="zones", read_geometry=False)
    highest = int(zones["attention"].max())
    assert highest > 0
    assert f"S12: attention {highest}" in signed.texts[1]
    assert "2 zones of change above the level of detection" in signed.texts[1]  # the verdict of the slope's own page
    assert "Section A–A′ through Z001" in signed.texts[1]
    asking = zones[zones["attention"] > 0]
    for zone in asking.to_dict("records"):
        name = zone["zone_id"].rpartition("/")[2]
        assert f"{name} {zone['kind']} {zone['severity']}" in signed.texts[1]
    assert f"Not computed: {len(FAILED)}; nothing is known of those." in signed.texts[0]
    assert "S12 asks for most attention" in signed.texts[0]
    assert FAILED[0][1] in signed.text
    assert signed.links >= 2
    assert min(signed.lowest_ink) >= 0.5
    assert min(signed.filled) >= LEAST_FILLED
    assert max(signed.widest_gap) <= WIDEST_GAP


def test_a_slope_without_a_region_is_on_the_map_by_the_extent_of_its_change(made: Path) -> None:
    record = corridor_record(made)
    assert record is not None
    shown = read_corridor(made, record)
    assert shown.slopes.geometry.isna().all()
    with rasterio.open(made / "slopes" / "S12" / "inspect" / "elevation_change.tif") as raster:
        place = _place("S12", None, shown)
        assert place is not None
        assert place.bounds == tuple(raster.bounds)
    assert _place("S900", None, shown) is None


def test_the_page_has_a_map_whose_slope_lies_where_its_results_do(made: Path, monkeypatch) -> None:
    page = (made / "corridor.html").read_text(encoding="utf-8")
    (source,) = re.findall(r'<figure class="map">\s*<img src="data:image/png;base64,([^"]+)" alt="([^"]+)"', page)
    with Image.open(io.BytesIO(base64.b64decode(source[0]))) as picture:
        colours = np.asarray(picture.convert("RGB")).reshape(-1, 3)
    attention = tuple(bytes.fromhex(ATTENTION_COLOURS[1][1:]))
    assert int((colours == attention).all(axis=1).sum()) > 50
    assert source[1] == "Map of the slopes in the colours of their attention: S12"
    drawn: dict[str, Any] = {}
    monkeypatch.setattr(pages, "corridor_pictures", lambda *given: drawn.update(given=given) or {})
    record = corridor_record(made)
    assert record is not None
    pages.page_of(read_corridor(made, record))
    zones, regions, attentions, spans = drawn["given"]
    with rasterio.open(made / "slopes" / "S12" / "inspect" / "elevation_change.tif") as raster:
        assert [(name, shape.bounds) for name, shape in regions] == [("S12", tuple(raster.bounds))]
    assert attentions == {"S12": int(zones["attention"].max())}
    assert spans == []


def test_a_corridor_on_a_road_shows_its_slopes_at_their_chainages() -> None:
    zones = gpd.GeoDataFrame({"zone_id": [], "slope": []}, geometry=[], crs=32651)
    regions = [("A", shapely.box(0, 0, 40, 30)), ("B", shapely.box(400, 0, 440, 30))]
    spans = [Span("A", "S320", 12_340.0, 12_380.0, 2), Span("B", "S320", 12_740.0, 12_780.0, None)]
    found = corridor_pictures(zones, regions, {"A": 2}, spans)
    assert found["road"].text == "The roads drawn straight, with A at 12+340, B at 12+740"
    assert found["map"].text.endswith("attention: A, B")
    assert corridor_pictures(zones, [], {}, []) == {}


def test_severities_of_the_zones_stand_on_the_first_page(made: Path) -> None:
    zones = pyogrio.read_dataframe(made / "corridor.gpkg", layer="zones", read_geometry=False)
    first = Pages(made / "corridor.pdf").texts[0]
    for grade, count in zones["severity"].value_counts().items():
        assert f"{grade} {count}" in first


def test_made_again_from_the_folder_both_are_the_same_bytes(copy: Path) -> None:
    before = {name: (copy / name).read_bytes() for name in ("corridor.html", "corridor.pdf")}
    outputs = again(copy)
    assert set(outputs) == {"page", "page_pdf", "run"}
    assert {name: (copy / name).read_bytes() for name in before} == before


def test_it_shows_what_people_entered_since_and_keeps_other_details(copy: Path) -> None:
    with closing(sqlite3.connect(copy / "corridor.gpkg")) as database, database:
        for name in ("ST_IsEmpty", "ST_MinX", "ST_MaxX", "ST_MinY", "ST_MaxY"):
            database.create_function(name, 1, lambda _: None)
        database.execute("UPDATE alerts SET state = 'acknowledged', state_reason = 'Seen on site.', reviewer = 'Sato'")
    again(copy, pdf=True, author="B. Lindqvist")
    text = Pages(copy / "corridor.pdf").text
    assert "acknowledged: Seen on site." in text
    assert "Sato" in text
    assert "Client Road Directorate" in text
    again(copy)
    assert "Author B. Lindqvist" in Pages(copy / "corridor.pdf").texts[0]
    assert "acknowledged" in (copy / "corridor.html").read_text(encoding="utf-8")
    record = corridor_record(copy)
    assert record is not None
    assert record["parameters"]["details"]["author"] == "B. Lindqvist"


def test_a_slope_whose_folder_is_gone_stays_in_the_table_and_is_named(copy: Path) -> None:
    shutil.rmtree(copy / "slopes")
    progress = Progress()
    again(copy, progress)
    assert any(w.startswith("S12 has no sheet in the report of the corridor: ") for w in progress.warnings)
    record = corridor_record(copy)
    assert record is not None
    (slope,) = read_corridor(copy, record).ranked
    assert (slope.slope, slope.surveys, slope.last_day) == ("S12", 2, "2025-05-01")


def test_what_does_not_belong_to_a_corridor_is_refused_and_nothing_is_written(copy: Path, tmp_path: Path) -> None:
    before = {path: path.read_bytes() for path in copy.rglob("*") if path.is_file()}
    for more in ({"profiles": tmp_path / "a.gpkg"}, {"profiles": None, "photos": tmp_path}):
        with pytest.raises(InputError, match="profiles and photos belong to a slope"):
            report_of_folder(copy, ReportParameters(), progress=Progress(), **more)
    with pytest.raises(InputError, match="letters wide"):
        again(copy, pdf=True, author="x" * 500)
    assert {path: path.read_bytes() for path in copy.rglob("*") if path.is_file()} == before
    (copy / "corridor.gpkg").unlink()
    with pytest.raises(InputError, match=r"corridor\.gpkg is not there"):
        again(copy)


@pytest.mark.parametrize("fault", [{"failed": [1]}, {"outputs": {"page": 3}}, {"metrics": []}, {"started": None}])
def test_a_damaged_record_of_a_corridor_is_one_sentence(copy: Path, fault: dict[str, Any]) -> None:
    path = copy / "run.json"
    path.write_text(json.dumps(json.loads(path.read_text(encoding="utf-8")) | fault), encoding="utf-8")
    with pytest.raises(InputError, match="is no run record that can be read"):
        again(copy)
