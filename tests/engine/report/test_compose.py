"""The report: its figures are those of the run record, it stands alone, and what it is given cannot break it."""

from __future__ import annotations

import json
import re
import shutil
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from typing import Any

import geopandas as gpd
import laspy
import numpy as np
import pytest
import rasterio
from pyproj import CRS
from shapely.geometry import LineString
from slopewatch.engine.core.errors import EngineError, InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.report.compose import check_report, write_report
from slopewatch.engine.report.figures import Figures, number
from slopewatch.engine.zones.profiles import read_profiles
from slopewatch.interface.parameters import (
    PUBLISHED_WORKFLOW,
    PUBLISHED_WORKFLOW_ID,
    ChangeParameters,
    ReportParameters,
)
from slopewatch.workflows.change import change_step
from slopewatch.workflows.report import report_step
from slopewatch.workflows.settings import Settings

NASTY = 'it\'s "A" <script>alert(1)</script> & b\nc'
TEMPLATES = Path(__file__).parents[3] / "engine" / "report" / "templates"


class Page(HTMLParser):
    """Elements with their attributes, the figures, and whether all that was opened was closed."""

    VOID = frozenset({"meta", "img", "br"})

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.stack: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.figures: list[tuple[dict[str, str | None], str]] = []
        self.cells: list[str] = []
        self.words = ""
        self.feed(text)
        self.close()
        assert not self.stack, self.stack

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.stack.append(tag)
        if tag == "data":
            self.figures.append((dict(attrs), ""))
        if tag == "td":
            self.cells.append("" if "class" not in dict(attrs) else "~")

    def handle_endtag(self, tag):
        assert self.stack.pop() == tag

    def handle_data(self, data):
        if "style" in self.stack:
            return
        self.words += data
        if "data" in self.stack:
            attrs, text = self.figures[-1]
            self.figures[-1] = (attrs, text + data)
        elif "td" in self.stack and not self.cells[-1].startswith("~"):
            self.cells[-1] += data

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attrs for name, attrs in self.elements if name == tag]


def at(record: Any, pointer: str) -> Any:
    """RFC 6901."""
    for key in pointer.split("/")[1:]:
        key = key.replace("~1", "/").replace("~0", "~")
        record = record[int(key)] if isinstance(record, list) else record[key]
    return record


def write_cloud(path: Path, *, bowl: float, seed: int, points: int = 60_000) -> Path:
    """A slope of 20 x 20 m at 30 degrees, with a bowl of 2.5 m radius and a bulge of the same depth beside it."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 20, points), rng.uniform(0, 20, points)
    z = 50 + 0.58 * y + rng.normal(0, 0.01, points)
    for cx, sign in ((6, -1), (14, 1)):
        z += sign * bowl * np.clip(1 - ((x - cx) ** 2 + (y - 10) ** 2) / 6.25, 0, None)
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [500_000, 3_500_000, 0]
    header.add_crs(CRS(32651))
    las = laspy.LasData(header)
    las.x, las.y, las.z = 500_000 + x, 3_500_000 + y, z
    las.classification = np.full(points, 2)
    las.write(path)
    return path


def run_change(folder: Path, out: Path, *, bowl: float = 0.3, dates=("2024-05-01", "2025-05-01"), name="", **more):
    first = write_cloud(folder / f"{name}first.laz", bowl=0.0, seed=1)
    second = write_cloud(folder / f"{name}second.laz", bowl=bowl, seed=2)
    settings = Settings(change=ChangeParameters(cell=0.25, registration_error=0.002))
    return change_step(
        first, second, out, settings, dates=dates, transform_path=None, progress=Progress(), **more
    ).outputs


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """Two clouds with names that break HTML, lines with such names, and their change."""
    folder = tmp_path_factory.mktemp("clouds")
    lines = gpd.GeoDataFrame(
        {"name": [NASTY, "beside"]},
        geometry=[
            LineString([(500002, 3500010.03), (500018, 3500010.03)]),
            LineString([(500100, 3500100), (500110, 3500100)]),
        ],
        crs=32651,
    )
    lines.to_file(folder / "lines.gpkg")
    out = tmp_path_factory.mktemp("out") / "new"
    outputs = run_change(folder, out, name=NASTY.replace("/", "_"), profiles=folder / "lines.gpkg")
    assert all(path.is_file() for path in outputs.values())
    return out


@pytest.fixture(scope="module")
def page(made: Path) -> Page:
    return Page((made / "report.html").read_text(encoding="utf-8"))


def record_of(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "run.json").read_text(encoding="utf-8"))


def test_the_record_promises_the_report_and_its_time(made: Path) -> None:
    record = record_of(made)
    assert record["outputs"]["report"] == "report.html"
    assert record["stages"][-1]["stage"] == "report"
    assert not [p for p in made.iterdir() if p.name.startswith(".")]


def test_every_figure_is_that_of_the_run_record(made: Path, page: Page) -> None:
    record = record_of(made)
    assert len(page.figures) > 120
    for attrs, text in page.figures:
        value = at(record, attrs["data-from"])
        assert float(attrs["value"]) == value, attrs
        shown = float(text.replace(",", "").replace("\u2212", "-"))
        decimals = len(text.partition(".")[2])
        expected = value * float(attrs.get("data-scale", 1))
        assert abs(shown - expected) <= 0.5 * 10**-decimals * (1 + 1e-9), attrs
    places = {attrs["data-from"] for attrs, _ in page.figures}
    for wanted in (
        "/metrics/lod_median_m", "/metrics/compared_share", "/metrics/registration_error_m", "/zones/0/vol_net_m3",
        "/zones/0/vol_err_m3", "/zones/1/rate_mm_day", "/rates/detectable_mm_day", "/level/by_slope/0/median_m",
        "/stable_ground/nmad_m", "/density/0/median_points_m2", "/density/1/points", "/profiles/0/dz_min_m",
        "/profiles/2/length_m", "/inputs/0/bytes", "/distribution/cells", "/cell_sizes/0/share", "/cell_sizes/1/side_m",
        "/metrics/common_cell_rate",
    ):  # fmt: skip
        assert wanted in places
    # and there is no other number in a cell of a table
    assert not [cell for cell in page.cells if re.search(r"\d", cell.lstrip("~"))]


def test_the_records_own_figures_are_those_of_the_rasters(made: Path) -> None:
    record = record_of(made)

    def read(name: str, band: int = 1) -> np.ndarray:
        with rasterio.open(made / f"{name}.tif") as raster:
            return raster.read(band, masked=True).filled(np.nan)

    dz, level, beyond = read("elevation_change"), read("level_of_detection"), read("significant_change")
    known = np.isfinite(dz)
    shown = record["distribution"]
    edges = np.linspace(-shown["reach_m"], shown["reach_m"], len(shown["compared"]) + 1)
    assert edges[len(edges) // 2] == pytest.approx(0, abs=1e-12)
    # cells on an edge may fall to either side by the rasters' rounding
    for name, values in (("compared", dz[known]), ("beyond", dz[np.isfinite(beyond)])):
        counted = np.histogram(values, edges)[0]
        assert np.abs(counted - shown[name]).sum() <= 4
    assert sum(shown["compared"]) + shown["lower"] + shown["higher"] == known.sum() == shown["cells"]
    assert sum(shown["stable"]) <= record["stable_ground"]["cells"]
    np.testing.assert_allclose(
        [record["level"][k] for k in ("p05_m", "median_m", "p95_m")],
        np.percentile(level[known], (5, 50, 95)),
        atol=1e-6,
    )
    assert sum(row["cells"] for row in record["level"]["by_slope"]) <= known.sum()
    with laspy.open(record["inputs"][0]["path"]) as cloud:
        assert record["density"][0]["points"] == cloud.header.point_count
    counts = read("point_counts", 1)
    blocks = counts[: counts.shape[0] // 4 * 4, : counts.shape[1] // 4 * 4]
    blocks = blocks.reshape(blocks.shape[0] // 4, 4, -1, 4).sum(axis=(1, 3))
    assert record["density"][0]["median_points_m2"] == pytest.approx(np.median(blocks[blocks > 0]), rel=0.05)
    assert record["density"][0]["median_points_m2"] == pytest.approx(150, rel=0.05)
    before, after = read("surface_heights", 1), read("surface_heights", 2)
    np.testing.assert_allclose((after - before)[known], dz[known], atol=2e-5)
    side = read("cell_size")
    for row in record["cell_sizes"]:
        assert row["share"] == pytest.approx((np.isclose(side, row["side_m"])).sum() / known.sum())
    assert sum(row["area_m2"] for row in record["cell_sizes"]) == pytest.approx(known.sum() * 0.25**2)
    assert len(record["cell_sizes"]) == len(np.unique(side[known])) > 1
    later = read("point_counts", 2)
    both, either = (
        (op(np.nan_to_num(counts) > 0, np.nan_to_num(later) > 0)).sum() for op in (np.logical_and, np.logical_or)
    )
    assert record["metrics"]["common_cell_rate"] == pytest.approx(both / either)
    assert record["rates"]["detectable_mm_day"] == pytest.approx(np.median(level[known]) * 1000 / 365, rel=1e-4)
    zones = gpd.read_file(made / "zones.gpkg", layer="zones")
    assert [z["zone_id"] for z in record["zones"]] == list(zones["zone_id"])
    for row, zone in zip(record["zones"], zones.itertuples(), strict=True):
        assert row["vol_net_m3"] == zone.vol_net_m3
        assert row["kind"] == zone.kind
        assert zone.geometry.distance(gpd.points_from_xy([row["x"]], [row["y"]])[0]) < 0.02
    table = read_profiles(made / "profiles.csv")
    for facts in record["profiles"]:
        if facts["dz_min_m"] is not None:
            assert facts["dz_min_m"] == pytest.approx(np.nanmin(table[facts["name"]]["dz_m"]), abs=1e-4)


def test_it_stands_alone(made: Path, page: Page) -> None:
    text = (made / "report.html").read_text(encoding="utf-8")
    assert not re.search(r"(src|href|action|data|poster)\s*=\s*[\"']?(?!data:|#)[a-z./]*:?//", text)
    assert not re.search(r"url\s*\(|@import|<script|<link|javascript:", text, re.IGNORECASE)
    pictures = page.all("img")
    assert len(pictures) == 13  # two maps, two histograms, two hillshades, two densities, cell sizes, four profiles
    for picture in pictures:
        assert picture["src"].startswith("data:image/")
    assert not [a for _, a in page.elements for name in a if name.startswith("on")]
    check_report(made / "report.html")


def test_what_users_named_is_shown_as_they_wrote_it(made: Path, page: Page) -> None:
    text = (made / "report.html").read_text(encoding="utf-8")
    assert "<script" not in text
    assert "alert(1)</script>" in page.words
    assert "".join(NASTY.split()) in "".join(page.words.split())
    assert "profile 'beside' meets no ground" in page.words
    assert not page.all("script")


def test_people_who_do_not_see_it_can_read_it(page: Page) -> None:
    assert page.all("html")[0]["lang"] == "en"
    assert page.all("img")
    assert page.all("th")
    assert all(len(picture["alt"]) > 20 for picture in page.all("img"))
    levels = [int(tag[1]) for tag, _ in page.elements if re.fullmatch(r"h[1-6]", tag)]
    assert levels.count(1) == 1
    assert all(b <= a + 1 for a, b in pairwise(levels))
    assert all("scope" in cell for cell in page.all("th"))
    ids = [a["id"] for _, a in page.elements if "id" in a]
    assert len(ids) == len(set(ids))
    assert {a["aria-labelledby"] for _, a in page.elements if "aria-labelledby" in a} <= set(ids)


def test_text_stands_out_from_its_ground() -> None:
    """Contrast of WCAG 2.1, 1.4.3: 4.5 to 1."""
    css = (TEMPLATES / "report.css").read_text(encoding="utf-8")
    colours = dict(re.findall(r"--([a-z-]+): (#[0-9a-f]{6})", css))

    def luminance(colour: str) -> float:
        parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
        linear = [p / 12.92 if p <= 0.03928 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    def contrast(one: str, other: str) -> float:
        low, high = sorted((luminance(one), luminance(other)))
        return (high + 0.05) / (low + 0.05)

    assert contrast("#000000", "#ffffff") == pytest.approx(21)
    for ink, ground in (
        ("ink", "#ffffff"), ("soft", "#ffffff"), ("soft", colours["pale"]), ("accent", "#f3f6fb"),
        ("warn", colours["warn-pale"]), ("ink", colours["warn-pale"]),
    ):  # fmt: skip
        assert contrast(colours[ink], ground) >= 4.5


def test_the_words_are_those_of_the_trade(page: Page) -> None:
    assert not re.search(r"\bsafe", page.words, re.IGNORECASE)
    assert "What this cannot tell you" in page.words
    for limit in ("not seen", "Slip along the surface", "mm/day", "Vegetation", "no statement on stability"):
        assert limit in page.words


def test_the_published_workflow_is_cited(made: Path) -> None:
    cited = (made / "report.html").read_text(encoding="utf-8")
    assert f"<cite>{PUBLISHED_WORKFLOW}</cite>, {PUBLISHED_WORKFLOW_ID}" in cited


def test_the_same_folder_gives_the_same_bytes(made: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(made, copy)
    (copy / "report.html").unlink()
    outputs = report_step(copy, ReportParameters(), profiles=None, progress=Progress()).outputs
    assert outputs == {"report": copy / "report.html"}
    assert (copy / "report.html").read_bytes() == (made / "report.html").read_bytes()


def test_other_lines_replace_the_profiles(made: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(made, copy)
    own = tmp_path / "own.geojson"
    gpd.GeoDataFrame(
        {"title": ["across <b>"]}, geometry=[LineString([(500010, 3500001), (500010, 3500019)])], crs=32651
    ).to_crs(4326).to_file(own)
    parameters = ReportParameters(zone_profiles=1, profile_field="title")
    outputs = report_step(copy, parameters, profiles=own, progress=Progress()).outputs
    record = record_of(copy)
    assert [p["name"] for p in record["profiles"]] == ["across <b>", "Steepest line through Z001"]
    assert [i["path"] for i in record["inputs"] if i["role"] == "profiles"] == [str(own)]
    assert record["parameters"]["report"] == {"zone_profiles": 1, "profile_field": "title"}
    again = Page(outputs["report"].read_text(encoding="utf-8"))
    for attrs, _ in again.figures:
        assert float(attrs["value"]) == at(record, attrs["data-from"])
    assert "across <b>" in again.words
    assert not [w for w in record["warnings"] if "'beside'" in w]
    assert [w for w in record["warnings"] if "own.geojson" in w and "transformed" in w]
    assert len(again.all("img")) == 11
    # the lines through the zones are those of the run itself
    old, new = (read_profiles(f / "profiles.csv")["Steepest line through Z001"] for f in (made, copy))
    np.testing.assert_array_equal(old["dz_m"], new["dz_m"])
    assert record["outputs"].keys() == record_of(made)["outputs"].keys()
    with pytest.raises(InputError, match="also an input"):
        report_step(copy, parameters, profiles=copy / "profiles.gpkg", progress=Progress())


def test_it_says_what_is_missing(tmp_path: Path) -> None:
    outputs = run_change(tmp_path, tmp_path / "out", bowl=0.0, dates=(None, None))
    assert "profiles" not in outputs
    text = outputs["report"].read_text(encoding="utf-8")
    words = Page(text).words
    assert "No zone of change above the level of detection" in words
    assert "days of the surveys are not known" in words
    assert "no registration is known" in words
    record = record_of(tmp_path / "out")
    for key in ("profiles", "rates", "stable_ground", "zones"):
        record[key] = None
    for name in ("heatmap.png", "surface_heights.tif", "point_counts.tif", "cell_size.tif", "zones.gpkg"):
        (tmp_path / "out" / name).unlink()
    (tmp_path / "out" / "run.json").write_text(json.dumps(record))
    assert len(Page(write_report(tmp_path / "out").read_text(encoding="utf-8")).all("img")) == 2


def test_a_folder_without_a_run_is_refused(made: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"holds no run\.json"):
        write_report(tmp_path)
    for text, words in (
        ("{", "is no JSON"),
        ("[1]", "is no run record"),
        ('{"command": "x"}', "software is not there"),
    ):
        (tmp_path / "run.json").write_text(text)
        with pytest.raises(InputError, match=words):
            write_report(tmp_path)
    record = record_of(made)
    del record["epochs"]
    (tmp_path / "run.json").write_text(json.dumps(record))
    with pytest.raises(InputError, match="no change between two surveys"):
        report_step(tmp_path, ReportParameters(), profiles=tmp_path / "lines.gpkg", progress=Progress())
    with pytest.raises(InputError, match="no record of a change"):
        write_report(tmp_path)
    assert not (tmp_path / "report.html").exists()


@pytest.mark.parametrize(
    "body",
    ['<img src="heatmap.png">', '<a href="https://example.org">x</a>', "<script>1</script>", "<p><b></p>", "<p>"],
)
def test_a_report_that_does_not_stand_alone_is_not_delivered(tmp_path: Path, body: str) -> None:
    path = tmp_path / "report.html"
    path.write_text(f"<!DOCTYPE html><html>{body}</html>")
    with pytest.raises(EngineError, match="not sound"):
        check_report(path)


def test_numbers_for_people() -> None:
    shown = [
        number(v, d, sign=s) for v, d, s in ((-0.0004, 3, True), (1234567.891, 1, False), (-2.5, 2, True), (3, 0, True))
    ]
    assert shown == ["0.000", "1,234,567.9", "\u22122.50", "+3"]
    figures = Figures({"a/b": {"~c": [None, 0.123]}, "word": "<b>", "flag": True})
    assert 'data-from="/a~1b/~0c/1"' in figures("a/b", "~c", 1)
    assert figures.percent("a/b", "~c", 1).endswith(">12</data>&nbsp;%")
    for place in (("a/b", "~c", 0), ("a/b", "~c", 7), ("none",), ("word",), ("flag",)):
        assert "not known" in figures(*place)
    assert figures.with_error(("a/b", "~c", 1), ("none",), unit="m") == figures("a/b", "~c", 1, unit="m")
