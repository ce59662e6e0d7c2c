"""The report to sign of a series: the figures of its tables, and its course, on pages that are full."""

from __future__ import annotations

import shutil

import geopandas as gpd
import pyogrio
import pytest
from shapely.geometry import Point
from slopewatch.engine.core.earlier_results import refuse_another_series
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.core.run_record import RunRecord
from slopewatch.engine.report.compose import read_record
from slopewatch.engine.report.signed.page_words import PageWords
from slopewatch.engine.report.signed.parts import zone_table
from slopewatch.engine.report.signed.sheets import _series_facts
from slopewatch.engine.report.signed.source import read_source
from slopewatch.interface.parameters import DetailParameters, ReportParameters
from slopewatch.interface.rates import rate_unit
from slopewatch.interface.rounding import digits_of_error
from slopewatch.tests.builders.signed_folder import LEAST_FILLED, WIDEST_GAP, Pages
from slopewatch.workflows.report import report_step

MONTH = 365.25 / 12
"""Days."""


def shown(value: float, digits: int) -> str:
    return f"{value:+,.{digits}f}".replace("-", "\u2212")


@pytest.fixture(scope="module")
def signed(runs, tmp_path_factory):
    out, _ = runs
    folder = shutil.copytree(out, tmp_path_factory.mktemp("series") / "copy", ignore=shutil.ignore_patterns("work"))
    details = DetailParameters(pdf=True, slope_name="S7", weather="dry")
    report_step(folder, ReportParameters(), details=details, profiles=None, progress=Progress())
    return folder, Pages(folder / "report.pdf")


def test_each_zone_has_a_sheet_with_its_alert_velocity_and_course(runs, signed):
    record = runs[1][-1][1]
    folder, pages = signed
    zones = pyogrio.read_dataframe(folder / "series.gpkg", layer="zones", read_geometry=False)
    assert len(zones) >= 2
    for number, zone in enumerate(zones.to_dict("records"), 1):
        page = pages.texts[number]
        assert page.find(f"Zone {zone['zone_id']}: {zone['kind']}, {zone['alert']}") >= 0
        assert f"Alert level {zone['alert_level']:.0f} {zone['alert']}" in page
        digits = digits_of_error(MONTH * zone["rate_err"])
        assert f"Velocity {shown(MONTH * zone['rate_mm_day'], digits)} ± " in page
        assert f"Mean change {shown(zone['dz_mean_m'], 3)} m" in page
        last = [row for row in record["course"][zone["zone_id"]] if "dz_mean_m" in row][-1]
        digits = digits_of_error(last["dz_err_m"])
        assert f"{last['epoch']} {last['days']} {shown(last['dz_mean_m'], digits)} ± " in page


def test_pages_are_full_and_alert_levels_are_explained(signed):
    _, pages = signed
    assert min(pages.lowest_ink) >= 0.5
    assert min(pages.filled) >= LEAST_FILLED
    assert max(pages.widest_gap) <= WIDEST_GAP
    assert len(pages.texts) <= 12
    assert "Inspect within days and consider instruments that measure continuously" in pages.text
    assert "S7, Series of" in pages.texts[0]


def test_a_sliding_zone_shows_its_rate_along_the_surface_and_says_so(signed):
    """The heights of ground that slides change by what moved on; its velocity is another one."""
    row = {
        "zone_id": "S009", "kind": "sliding", "alert_level": 1, "alert": "observe", "rate_mm_day": -0.31,
        "rate_err": 0.04, "rate_last": -0.2, "rate_last_err": 0.1, "motion_m": 0.17, "motion_err_m": 0.03,
        "motion_rate_mm_day": 1.24, "motion_rate_err": 0.28, "motion_azimuth_deg": 40.0, "motion_off_dip_deg": 116.0,
        "geometry": Point(0, 0).buffer(1),
    }  # fmt: skip
    facts = dict(_series_facts(row, rate_unit([1.24])))
    assert facts["Velocity along the surface"] == "37.7\u00a0±\u00a08.5\u00a0mm/month"
    assert facts["Velocity of the heights"] == "\u22129.4\u00a0±\u00a01.2\u00a0mm/month"
    assert "Velocity" not in facts
    zones = gpd.GeoDataFrame([row, {**row, "zone_id": "S010", "kind": "subsidence"}], crs=32651)
    folder, _ = signed
    record = read_record(folder)
    source = read_source(record, folder, PageWords())
    table = zone_table(source, zones)
    rates = [cells[-2] for cells in table["rows"]]
    assert rates == ["37.7\u00a0±\u00a08.5", "\u22129.4\u00a0±\u00a01.2"]
    assert table["caption"] == "The rate of a sliding zone is that along the surface."
    assert zone_table(source, zones.iloc[1:])["caption"] == ""


def test_other_details_do_not_make_it_another_series(tmp_path):
    record = RunRecord("series", {"details": DetailParameters(author="B")})
    earlier = {"inputs": [], "parameters": {"details": {"author": "A", "pdf": True}}}
    refuse_another_series(tmp_path, earlier, record)
