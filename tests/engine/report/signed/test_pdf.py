"""The report to sign as another program reads it: figures of the tables, pages, fonts, outline, bytes."""

from __future__ import annotations

import importlib.util
import json
import math
import shutil
import sqlite3
from pathlib import Path
from typing import Any

import geopandas as gpd
import pyogrio
import pytest
from matplotlib import font_manager
from PIL import Image
from shapely.geometry import LineString
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.maps import picture_words
from slopewatch.interface.parameters import DetailParameters, ReportParameters
from slopewatch.tests.builders.chinese_font import chinese_letters, font_file
from slopewatch.tests.builders.signed_folder import SOUTH, WEST, Pages, change_folder
from slopewatch.workflows.report import report_step

NASTY = 'S1 #import "a" $x$ [b] \\c *d* _e_ <f> @g `h`'
GIVEN = DetailParameters(
    pdf=True, slope_name=NASTY, client="Road Directorate", author="A. Sato", sensor="L1; L2", weather="dry"
)
HIGHEST_PAGES, LEAST_INKED = 12, 0.5


class Told(Progress):
    """Keeps what is said."""

    def __init__(self) -> None:
        super().__init__()
        self.said: list[str] = []

    def info(self, message: str) -> None:
        self.said.append(message)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    clouds = tmp_path_factory.mktemp("clouds")
    line = LineString([(WEST + 2, SOUTH + 10), (WEST + 18, SOUTH + 10)])
    gpd.GeoDataFrame({"name": ["Along the berm"]}, geometry=[line], crs=32651).to_file(clouds / "lines.gpkg")
    return change_folder(clouds, tmp_path_factory.mktemp("out") / "new", GIVEN, profiles=clouds / "lines.gpkg")


@pytest.fixture(scope="module")
def pages(made: Path) -> Pages:
    return Pages(made / "report.pdf")


@pytest.fixture
def copy(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "copy"))


def record_of(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "run.json").read_text(encoding="utf-8"))


def shown(value: float, digits: int, sign: str = "") -> str:
    return f"{value:{sign},.{digits}f}".replace("-", "\u2212")


def again(folder: Path, **details: Any) -> list[str]:
    told = Told()
    report_step(folder, ReportParameters(), details=DetailParameters(**details), profiles=None, progress=told)
    return told.said


def with_error(zone, value: str, error: str) -> str:
    """Two significant digits of the error, and the figure to the same place."""
    digits = 1 - math.floor(math.log10(zone[error]))
    return f"{shown(zone[value], digits, '+')} ± {shown(zone[error], digits)}"


def test_the_figures_are_those_of_the_table_of_zones(made, pages):
    zones = pyogrio.read_dataframe(made / "zones.gpkg", layer="zones")
    assert set(zones["kind"]) == {"subsidence", "uplift"}
    for number, zone in enumerate(zones.to_dict("records"), 1):
        page = pages.texts[number]
        assert f"Zone {zone['zone_id']}: {zone['kind']}, {zone['severity']}" in page
        point = zone["geometry"].representative_point()
        for words in (
            f"Mean change {shown(zone['dz_mean_m'], 3, '+')} m",
            f"95th percentile {shown(zone['dz_p95_m'], 3, '+')} m",
            f"highest change {shown(zone['dz_min_m'], 3, '+')} to {shown(zone['dz_max_m'], 3, '+')} m",
            f"Area of the zone {shown(zone['area_m2'], 2)} m²",
            f"Net volume within the zone {with_error(zone, 'zone_net_m3', 'zone_err_m3')} m³",
            f"Area of the footprint {shown(zone['vol_area_m2'], 2)} m²",
            f"Net volume over the footprint {with_error(zone, 'vol_net_m3', 'vol_err_m3')} m³",
            f"the volume {shown(zone['vol_low_m3'], 2, '+')} to {shown(zone['vol_high_m3'], 2, '+')} m³",
            f"Rate {with_error(zone, 'rate_mm_day', 'rate_err')} mm/",  # the line may end after the stroke
            f"median {shown(zone['lod95_m'], 3)} m",
            f"{point.x:.1f}, {point.y:.1f}",
        ):
            assert words in page
        assert f"{zone['zone_id']} {zone['kind']} {zone['severity']}" in pages.texts[0]


def test_first_page_has_the_verdict_of_the_html_report_and_the_details(made, pages):
    metrics = record_of(made)["metrics"]
    assert (
        f"2 zones of change above the level of detection, together {metrics['zone_area_m2']:.1f} m²" in pages.texts[0]
    )
    assert "Client Road Directorate" in pages.texts[0]
    assert "Author A. Sato" in pages.texts[0]
    assert NASTY in pages.texts[0]  # nothing in it is taken as an instruction of the typesetter


def test_pages_are_few_numbered_and_none_is_half_empty(pages):
    count = len(pages.texts)
    assert 4 <= count <= HIGHEST_PAGES
    for number, (text, lowest) in enumerate(zip(pages.texts, pages.lowest_ink, strict=True), 1):
        assert f"Page {number} of {count}" in text
        assert text.startswith(f"{NASTY}, Elevation change, 2024-05-01 to 2025-05-01")
        assert lowest >= LEAST_INKED, f"page {number} ends at {lowest:.2f}"


def test_fonts_are_embedded_and_the_outline_leads_to_the_sheets(made, pages):
    assert len(pages.fonts_embedded) >= 2
    assert all(pages.fonts_embedded.values()), pages.fonts_embedded
    zones = pyogrio.read_dataframe(made / "zones.gpkg", layer="zones", read_geometry=False)
    titles = dict(pages.outline)
    for number, name in enumerate(zones["zone_id"], 1):
        assert [page for title, page in titles.items() if title.startswith(f"Zone {name}")] == [number]
    assert {"Surveys and flights", "Thresholds explained", "Remarks, actions and signatures"} <= set(titles)
    assert pages.links >= len(zones)


def test_flights_limits_thresholds_and_signatures(made, pages):
    assert "2024-05-01 2024-05-01 ………… L1 ………… dry" in pages.text
    assert "2025-05-01 2025-05-01 ………… L2 ………… dry" in pages.text
    assert "Along the berm" in pages.text
    assert "No change above the level of detection is not the same as no movement" in pages.text
    assert "low below 0.10 m, moderate from there, high from 0.30 m on" in pages.text
    for entry in record_of(made)["inputs"]:
        assert entry["sha256"] in pages.text.replace(" ", "")
    assert "Prepared by Name A. Sato" in pages.texts[-1]
    assert "Checked by" in pages.texts[-1]


def test_the_same_folder_gives_the_same_bytes(made, copy):
    before = (made / "report.pdf").read_bytes()
    assert again(copy) == [("Left blank in report.pdf, to be filled in by hand: Route, Chainage, Checker, UAV, "
                           "Flying height.")]  # fmt: skip
    assert (copy / "report.pdf").read_bytes() == before


def test_details_are_kept_in_the_record_and_in_the_page(copy):
    said = again(copy, pdf=True, checker="B. Lind", report_route="S320", actions="Inspect Z001.")
    assert said == ["Left blank in report.pdf, to be filled in by hand: Chainage, UAV, Flying height."]
    details = record_of(copy)["parameters"]["details"]
    assert (details["checker"], details["client"]) == ("B. Lind", "Road Directorate")
    page = (copy / "report.html").read_text(encoding="utf-8")
    assert "<dt>Checker</dt><dd>B. Lind</dd>" in page
    assert "<f>" not in page
    text = Pages(copy / "report.pdf").text
    assert "Inspect Z001." in text
    assert "S320" in text


def test_chainage_and_review_of_the_zones_are_shown(copy):
    zones = pyogrio.read_dataframe(copy / "zones.gpkg", layer="zones")
    Image.new("RGB", (80, 60), "red").save(copy / "crack.jpg")
    first = zones["zone_id"][0]
    with sqlite3.connect(copy / "zones.gpkg") as table:
        known = [row[1] for row in table.execute("PRAGMA table_info(zones)")]
        for name in ("photo", "review_date"):
            if name not in known:
                table.execute(f"ALTER TABLE zones ADD COLUMN {name} TEXT")
        table.create_function("ST_IsEmpty", 1, lambda _: 0)
        for name in ("MinX", "MaxX", "MinY", "MaxY"):
            table.create_function(f"ST_{name}", 1, lambda _: 0.0)
        table.execute(
            "UPDATE zones SET route='S320', chain_from=12340.4, chain_to=12346.2, side='left', reviewer='A. Sato',"
            " review_status='confirmed', remarks='Crack at the head.', photo='crack.jpg' WHERE zone_id=?",
            (first,),
        )
    again(copy, pdf=True)
    pages = Pages(copy / "report.pdf")
    assert "On the road S320 12+340–12+346, left" in pages.texts[1]
    assert "Review Confirmed Reviewer A. Sato" in pages.texts[1]
    assert "Crack at the head." in pages.texts[1]
    assert "Route S320 " in pages.texts[0]
    assert "Chainage 12+340–12+346" in pages.texts[0]


def test_a_pdf_is_made_only_where_it_is_wanted(tmp_path):
    plain = change_folder(tmp_path, tmp_path / "out")
    assert not (plain / "report.pdf").exists()
    with pytest.raises(InputError, match=r"^Details of a report to sign were given, but no PDF is wanted; give --pdf"):
        again(plain, client="Road Directorate")
    assert not (plain / "report.pdf").exists()
    again(plain, pdf=True)
    assert record_of(plain)["outputs"]["report_pdf"] == "report.pdf"
    text = Pages(plain / "report.pdf").texts[0]
    assert "Elevation change, 2024-05-01 to 2025-05-01" in text


@pytest.mark.parametrize("name", ["sensor", "weather", "uav"])
def test_parts_that_fit_no_survey_are_refused_before_any_work(copy, name):
    before = {path: path.read_bytes() for path in copy.iterdir() if path.is_file()}
    sentence = rf"^{name} has 3 parts, and there are 2 surveys; give one for all, or one for each\.$"
    with pytest.raises(InputError, match=sentence):
        again(copy, pdf=True, **{name: "a; b; c"})
    assert {path: path.read_bytes() for path in copy.iterdir() if path.is_file()} == before


def test_without_typst_nothing_is_begun(tmp_path, monkeypatch):
    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: None if name == "typst" else found(name, *a))
    with pytest.raises(InputError, match=r"^The package typst, which makes the PDF, is not installed; set the engine"):
        change_folder(tmp_path, tmp_path / "out", DetailParameters(pdf=True))
    assert not (tmp_path / "out").exists()


@pytest.fixture
def only_fonts(monkeypatch):
    """Fonts of matplotlib and those of a test, whatever the machine has."""
    own = [font for font in font_manager.fontManager.ttflist if "matplotlib" in font.fname]
    monkeypatch.setattr(font_manager.fontManager, "ttflist", own)
    monkeypatch.setattr(font_manager, "findSystemFonts", lambda *a, **k: [])
    for cached in (picture_words.chinese_font, picture_words.fonts):
        cached.cache_clear()
    yield
    for cached in (picture_words.chinese_font, picture_words.fonts):
        cached.cache_clear()


def test_a_chinese_report_without_a_font_is_refused(copy, only_fonts, monkeypatch):
    monkeypatch.setenv("SLOPEWATCH_LANGUAGE", "zh_CN")
    with pytest.raises(InputError, match=r"^A PDF in Chinese needs a font with Chinese letters, and none was found"):
        again(copy)


def test_a_chinese_report_has_chinese_words_that_can_be_searched(copy, only_fonts, monkeypatch, tmp_path):
    monkeypatch.setenv("SLOPEWATCH_LANGUAGE", "zh_CN")
    font_manager.fontManager.addfont(
        font_file(tmp_path / "sim.ttf", "SimHei", "".join(sorted({*chinese_letters(), *"，、–′"})))
    )
    again(copy, pdf=True, slope_name="十二号边坡")
    pages = Pages(copy / "report.pdf")
    assert f"第 1 页，共 {len(pages.texts)} 页" in pages.texts[0]
    assert "十二号边坡" in pages.texts[0]
    assert "平均变化" in pages.texts[1]
    assert all(pages.fonts_embedded.values())
    assert min(pages.lowest_ink) >= LEAST_INKED
