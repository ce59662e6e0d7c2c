"""What a batch writes of all slopes together: tables, page and GeoParquet, from results that are made here."""

from __future__ import annotations

import json
from datetime import date
from pathlib import Path
from typing import Any

import geopandas as gpd
import pyogrio
import pytest
import shapely
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.report.corridor import corridor_page
from slopewatch.engine.vector.geopackage import write_layer
from slopewatch.interface.parameters import BatchParameters, DetailParameters, RoadParameters
from slopewatch.tests.builders.signed_folder import Pages
from slopewatch.workflows.batch.jobs import Slope, Survey
from slopewatch.workflows.batch.products import Made, clouds_of, read_alerts, write_products
from slopewatch.workflows.batch.ranking import Ranked, rank
from slopewatch.workflows.batch.regions_on_roads import Road
from slopewatch.workflows.batch.results import SlopeResult
from slopewatch.workflows.run import Run

SPAN = [{"role": "epoch 2024-05-01"}, {"role": "epoch 2025-05-01"}]


def result(folder: Path, slope: str, *severities: str, crs: int = 32651, x: float = 500_000.0) -> SlopeResult:
    """Results of a slope whose zones are squares of 2 m, 10 m apart, lowered by 0.5 m."""
    place = folder / "slopes" / slope / "inspect"
    place.mkdir(parents=True)
    shapes = [shapely.MultiPolygon([shapely.box(x + 10 * n, 10, x + 10 * n + 2, 12)]) for n in range(len(severities))]
    count = len(shapes)
    columns: dict[str, Any] = {
        "zone_id": [f"Z{n + 1:03d}" for n in range(count)], "kind": ["subsidence"] * count,
        "severity": list(severities), "dz_p95_m": [-0.5] * count, "vol_net_m3": [-2.0 * (n + 1) for n in range(count)],
        "reviewer": ["Sato"] * count,
    }  # fmt: skip
    frame = gpd.GeoDataFrame(columns, geometry=shapes, crs=32651).to_crs(crs)
    write_layer(place / "zones.gpkg", frame, "zones", geometry_type="MultiPolygon")
    (place / "report.html").write_text("x")
    outputs = {"zones": place / "zones.gpkg", "report": place / "report.html"}
    return SlopeResult(slope, place, {"command": "inspect", "inputs": SPAN, "task": slope}, outputs)


def products(
    folder: Path,
    *results: SlopeResult,
    failed: tuple[tuple[str, str], ...] = (),
    roads: dict[str, Road] | None = None,
    details: DetailParameters | None = None,
) -> Run:
    roi = folder / "roi.gpkg" if roads else None
    slopes = [Slope(r.slope, (Survey(date(2025, 5, 1), folder / "a.laz"),), roi) for r in results]
    made = Made(slopes, results, failed, folder / "m.csv", roads or {}, details or DetailParameters())
    run = Run("batch", {"batch": BatchParameters()}, (), Progress())
    run.read_reviews(folder, ["corridor.gpkg"])
    run.figures = {"slopes": len(slopes) + len(failed)}
    alerts = read_alerts(folder)
    with run.writing(folder):
        write_products(run, made, alerts)
        run.finish_reviews()
    return run


def test_a_report_to_sign_is_written_where_it_is_wanted_and_goes_with_the_wish(tmp_path: Path) -> None:
    found = result(tmp_path, "S1", "high", "low")
    run = products(tmp_path, found, details=DetailParameters(pdf=True, client="Road Directorate"))
    assert run.outputs["page_pdf"] == tmp_path / "corridor.pdf"
    page = Pages(tmp_path / "corridor.pdf").texts[0]
    assert "Client Road Directorate" in page
    assert "S1 2 1 2 – −4.00 −0.50 – 2 2025-05-01" in page
    assert "page_pdf" not in products(tmp_path, found).outputs
    assert not (tmp_path / "corridor.pdf").exists()


def test_slopes_are_ranked_and_failures_are_rows(tmp_path: Path) -> None:
    found = [result(tmp_path, "calm"), result(tmp_path, "high", "high", "low"), result(tmp_path, "mid", "moderate")]
    products(tmp_path, *found, failed=(("=gone", "Line 9: <b>it</b> is gone."),))
    slopes = pyogrio.read_dataframe(tmp_path / "corridor.gpkg", layer="slopes")
    assert list(zip(slopes["slope"], slopes["state"], strict=True)) == [
        ("high", "done"), ("mid", "done"), ("calm", "done"), ("=gone", "failed"),
    ]  # fmt: skip
    assert slopes["place"].tolist()[:3] == [1, 2, 3]
    assert slopes.loc[3, "sentence"] == "Line 9: <b>it</b> is gone."
    alerts = pyogrio.read_dataframe(tmp_path / "corridor.gpkg", layer="alerts")
    assert [(a["slope"], a["attention"], a["reason"]) for a in alerts.to_dict("records")] == [
        ("high", 2, "high severity, subsidence of up to 0.50 m"),
        ("mid", 1, "moderate severity, subsidence of up to 0.50 m"),
    ]
    page = (tmp_path / "corridor.html").read_text(encoding="utf-8")
    assert "&lt;b&gt;it&lt;/b&gt; is gone." in page
    assert page.index(">high<") < page.index(">mid<") < page.index(">calm<")
    zones = pyogrio.read_dataframe(tmp_path / "corridor.gpkg", layer="zones")
    assert zones["slope_review"].unique().tolist() == ["entries by Sato"]
    assert zones["reviewer"].eq("").all(), "the corridor's own fields are its own"


def test_slopes_of_two_zones_of_the_globe_share_a_table(tmp_path: Path) -> None:
    products(tmp_path, result(tmp_path, "a", "high"), result(tmp_path, "b", "high", crs=32650, x=500_100.0))
    zones = gpd.read_file(tmp_path / "corridor.gpkg", layer="zones")
    assert zones.crs.to_epsg() == 32651
    assert zones.geometry.iloc[1].centroid.x == pytest.approx(500_101, abs=0.01)


def test_the_same_results_are_the_same_bytes(tmp_path: Path) -> None:
    names = ("corridor.gpkg", "corridor.html", "clouds.vpc")
    found = []
    for number in range(2):
        folder = tmp_path / str(number)
        folder.mkdir()
        products(folder, result(folder, "a", "high"), result(folder, "b"))
        found.append([(folder / name).read_bytes() for name in names])
    assert found[0] == found[1]


def test_regions_have_their_place_on_the_road(tmp_path: Path) -> None:
    road = gpd.GeoDataFrame({"NO": ["S1"]}, geometry=[shapely.LineString([(499_900, 0), (500_300, 0)])], crs=32651)
    road.to_file(tmp_path / "road.gpkg")
    region = gpd.GeoDataFrame(geometry=[shapely.box(500_000, 5, 500_040, 30)], crs=32651)
    region.to_file(tmp_path / "roi.gpkg")
    (tmp_path / "names.csv").write_text("ours,theirs\nroute,NO\n", encoding="utf-8")
    roads = {"a": Road(tmp_path / "road.gpkg", tmp_path / "names.csv", RoadParameters(chainage_start=1000.0))}
    products(tmp_path, result(tmp_path, "a", "high"), result(tmp_path, "b", "low"), roads=roads)
    slopes = pyogrio.read_dataframe(tmp_path / "corridor.gpkg", layer="slopes").set_index("slope")
    assert slopes.loc["a", "location"] == "S1 K1+100 to K1+140"
    assert slopes.loc["a", ["chain_from", "chain_to", "side", "offset_m"]].tolist() == [1100.0, 1140.0, "left", 5.0]
    assert not slopes.loc["b", "location"], "it has no centreline"


def test_geoparquet_where_pyarrow_is(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="pyarrow is not installed; install slopewatch[parquet]")
    run = products(tmp_path, result(tmp_path, "a", "high", "low"))
    zones = gpd.read_parquet(run.outputs["parquet"])
    other = gpd.read_file(tmp_path / "corridor.gpkg", layer="zones")
    assert zones.crs == other.crs
    assert zones["zone_id"].tolist() == other["zone_id"].tolist()
    assert zones.geometry.geom_equals(other.geometry).all()


def test_without_pyarrow_the_command_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import importlib.util

    known = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda n, *a: None if n == "pyarrow" else known(n, *a))
    shown: list[str] = []
    monkeypatch.setattr(Progress, "show", lambda self, level, message: shown.append(message))
    (tmp_path / "corridor.parquet").write_bytes(b"of an earlier run")
    run = products(tmp_path, result(tmp_path, "a", "high"))
    assert any("pip install 'slopewatch[parquet]'" in line for line in shown)
    assert "parquet" not in run.outputs
    assert not (tmp_path / "corridor.parquet").exists(), "it would be of other zones"


def test_rank_orders_by_attention_then_alerts_then_rate(tmp_path: Path) -> None:
    zones = gpd.GeoDataFrame(
        {
            "slope": ["a", "b", "c", "c"], "source": ["series"] * 4, "attention": [1, 1, 1, 1],
            "rate_mm_day": [-1.0, 3.0, 0.1, float("nan")], "vol_net_m3": [1.0, 1.0, 1.0, -9.0], "dz_p95_m": [0.1] * 4,
            "location": ["A K0+005", "", "A K0+007", "A K0+002"], "chain_from": [5.0, float("nan"), 7.0, 2.0],
        },
        geometry=[shapely.Point(0, 0)] * 4,
    )  # fmt: skip
    alerts = gpd.GeoDataFrame({"slope": ["c", "a", "a"], "state": ["raised", "closed", "CLOSED "]}, geometry=[None] * 3)
    results = [SlopeResult(s, tmp_path, {"command": "series", "inputs": SPAN}, {}) for s in "abc"]
    ranked = rank(results, zones, alerts, tmp_path)
    assert [s.slope for s in ranked] == ["c", "b", "a"]
    first = ranked[0]
    assert (first.open_alerts, first.rate_mm_day, first.volume_m3, first.chainage) == (1, 0.1, -9.0, 2.0)
    assert (first.location, ranked[1].location) == ("A K0+002", "")
    assert ranked[1].chainage is None


def test_clouds_of_a_series_and_of_a_pair(tmp_path: Path) -> None:
    (tmp_path / "work").mkdir()
    (tmp_path / "work" / "k1_ground.laz").write_bytes(b"x")
    stage = {"stage": "surveys", "epochs": {"2024-05-01": {"classified": "work/k1_classified.laz"}, "2025-05-01": {}}}
    series = SlopeResult("a", tmp_path, {"command": "series", "inputs": SPAN, "stages": [stage]}, {})
    assert [(c.path.name, c.day) for c in clouds_of(series)] == [("k1_ground.laz", "2024-05-01")]
    outputs = {name: tmp_path / f"{name}.laz" for name in ("aligned", "reference_ground", "moving_ground", "screened")}
    pair = SlopeResult("a", tmp_path, {"command": "inspect", "inputs": SPAN}, outputs)
    assert [(c.path.stem, c.day) for c in clouds_of(pair)] == [
        ("aligned", "2025-05-01"), ("reference_ground", "2024-05-01"), ("screened", "2025-05-01"),
    ]  # fmt: skip


@pytest.mark.parametrize("text", ["<script>alert(1)</script>", '"><img src=x onerror=alert(1)>', "{{ 7*7 }}", "\udcff"])
def test_no_text_becomes_markup(text: str) -> None:
    slope = Ranked(text, 2, text, text, 1, 1, 1, None, None, None, None, "", text)
    row = dict.fromkeys(("slope", "zone_id", "reason", "raised_on", "state", "reviewer"), text)
    page = corridor_page(
        [slope], [(text, text)], [{**row, "attention": 1}], {"software": text, "manifest": text, "count": 1, "zones": 0}
    )
    page.encode("utf-8", "backslashreplace")
    assert "<script" not in page
    assert "<img" not in page
    assert "49" not in page.partition("</style>")[2]


def test_alerts_of_an_older_table_have_all_fields(tmp_path: Path) -> None:
    frame = gpd.GeoDataFrame({"slope": ["a"], "zone_id": ["a/1"]}, geometry=[shapely.box(0, 0, 1, 1)], crs=32651)
    write_layer(tmp_path / "corridor.gpkg", frame, "alerts")
    alerts = read_alerts(tmp_path)
    assert alerts is not None
    assert alerts.loc[0, "state"] == ""
    assert read_alerts(tmp_path / "nowhere") is None
    assert json.dumps(alerts["slope"].tolist()) == '["a"]'
