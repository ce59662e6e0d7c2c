"""Reports to sign of a corridor: its own, and those of slopes whose details have changed."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import geopandas as gpd
import pytest
import shapely
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.report.signed.corridor import SignedCorridor, write_corridor_pdf
from slopewatch.interface.parameters import DetailParameters
from slopewatch.tests.builders.signed_folder import LEAST_FILLED, WIDEST_GAP, Pages, change_folder
from slopewatch.workflows.batch.jobs import Job, Slope, Survey
from slopewatch.workflows.batch.ranking import Ranked
from slopewatch.workflows.batch.results import SlopeResult
from slopewatch.workflows.batch.settings import INSPECT, effective, options_of
from slopewatch.workflows.batch.signed_reports import renewed_reports

CALM: dict[str, Any] = {
    "surveys": 2, "last_day": "2025-05-01", "command": "inspect", "zones": 0, "attention": 0, "open_alerts": 0,
    "rate_mm_day": None, "volume_m3": None, "largest_m": None, "chainage": None, "report": "",
}  # fmt: skip


def corridor(count: int) -> SignedCorridor:
    moved = CALM | {
        "zones": 3, "attention": 3, "open_alerts": 1, "rate_mm_day": -4.62, "volume_m3": -12.34, "largest_m": -0.61,
        "chainage": 12340.4,
    }  # fmt: skip
    done = [Ranked(slope="Cut [7] #x", **moved), *(Ranked(slope=f"S{n:03d}", **CALM) for n in range(1, count))]
    shapes = [shapely.box(100 * n, 0, 100 * n + 60, 40) for n in range(count)]
    zones = gpd.GeoDataFrame({"zone_id": ["Z001"]}, geometry=[shapely.box(10, 10, 20, 20)], crs=32651)
    alert = {
        "slope": "Cut [7] #x", "zone_id": "Z001", "attention": 3, "reason": "high severity", "raised_on": "2025-05-01",
        "state": "raised", "reviewer": "",
    }  # fmt: skip
    alerts = gpd.GeoDataFrame([alert], geometry=[shapely.box(10, 10, 20, 20)], crs=32651)
    regions = [(slope.slope, shape) for slope, shape in zip(done, shapes, strict=True)]
    return SignedCorridor(done, [("S900", "No ROI.")], zones, alerts, regions, "slopes.csv")


@pytest.mark.parametrize("count", [1, 3, 70])
def test_the_corridor_has_all_slopes_on_full_pages(tmp_path: Path, count: int) -> None:
    path = tmp_path / "corridor.pdf"
    details = {"pdf": True, "client": "Road Directorate", "report_route": "S320"}
    write_corridor_pdf(path, corridor(count), details, "2026-11-23T10:00:00", Progress())
    pages = Pages(path)
    assert "Cut [7] #x 3 1 3 \u2212140.6 \u221212.34 \u22120.61 12+340 2 2025-05-01" in pages.texts[0]
    assert all(f"S{n:03d}" in pages.text for n in range(1, count))
    assert "No ROI." in pages.text
    assert "high severity" in pages.text
    assert f"Slopes looked at: {count}; with an attention of 2 or more: 1; open alerts: 1." in pages.texts[0]
    assert "Client Road Directorate" in pages.texts[0]
    assert min(pages.lowest_ink) >= 0.5
    assert min(pages.filled) >= LEAST_FILLED
    assert max(pages.widest_gap) <= WIDEST_GAP
    assert all(pages.fonts_embedded.values())


def test_details_are_settings_of_a_slope_that_its_results_do_not_depend_on() -> None:
    survey = Survey(date(2025, 5, 1), Path("a.laz"))
    slope = Slope("S12", (survey,), options={"sensor": "L2"})
    options = options_of(slope, INSPECT, {"pdf": True, "client": "X", "cell": 0.2})
    assert options == {"pdf": True, "client": "X", "cell": 0.2, "sensor": "L2", "slope_name": "S12"}
    plain = options_of(Slope("S12", (survey,)), INSPECT, {"cell": 0.2})
    assert plain == {"cell": 0.2}
    assert effective(INSPECT, options, "default") == effective(INSPECT, plain, "default")
    assert "cell" in effective(INSPECT, plain, "default")


def test_other_details_write_the_report_of_a_slope_again_and_nothing_else(tmp_path: Path) -> None:
    folder = change_folder(tmp_path, tmp_path / "out")
    record = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    outputs = {name: folder / path for name, path in record["outputs"].items()}
    before = {path: path.stat().st_mtime_ns for path in outputs.values() if path.suffix in (".tif", ".gpkg")}
    result = SlopeResult("S12", folder, record, outputs)
    jobs = {"S12": Job("t", "S12", "inspect", (), {}, "default", {"pdf": True, "client": "X"}, str(folder), "")}
    (renewed,) = renewed_reports([result], jobs, Progress())
    assert "Client X" in Pages(renewed.outputs["report_pdf"]).texts[0]
    assert {path: path.stat().st_mtime_ns for path in before} == before
    stamp = (folder / "report.pdf").stat().st_mtime_ns
    (again,) = renewed_reports([renewed], jobs, Progress())
    assert (folder / "report.pdf").stat().st_mtime_ns == stamp
    assert again.record["parameters"]["details"]["client"] == "X"
    (left,) = renewed_reports([result], {"S12": replace(jobs["S12"], options={})}, Progress())
    assert left is result
    assert DetailParameters.build(again.record["parameters"]["details"]).pdf
