"""The reports of ``m3c2``: HTML, PDF to sign, and both made again."""

from __future__ import annotations

import json
import shutil

import geopandas as gpd
import pytest
from PIL import Image
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.interface.parameters import DetailParameters, ReportParameters
from slopewatch.tests.builders.signed_folder import Pages
from slopewatch.tests.builders.steep_pair import run
from slopewatch.workflows.report import report_step
from slopewatch.workflows.report_corridor import report_of_folder


@pytest.fixture(scope="module")
def signed(pair, tmp_path_factory):
    """A run whose zones lie in another folder than its record."""
    folder = tmp_path_factory.mktemp("signed")
    details = DetailParameters(pdf=True, slope_name="North wall")
    return run(*pair, folder / "wall.laz", raster_dir=folder / "zones", details=details).outputs


def again(place, **given):
    return report_step(place, ReportParameters(), profiles=None, progress=Progress(), **given).outputs


def test_the_report_to_sign_has_a_sheet_for_each_zone_with_its_figures(signed):
    assert signed["report_pdf"] == signed["run"].with_name("wall_report.pdf")
    assert not signed["run"].with_name("report.pdf").exists()
    pages = Pages(signed["report_pdf"])
    zone = gpd.read_file(signed["m3c2_zones"], layer="zones").iloc[0]
    assert "North wall" in pages.texts[0]
    assert f"{zone['vol_net_m3']:+.2f}" in pages.texts[1]
    assert f"Zone {zone['zone_id']}: {zone['kind']}" in pages.texts[1]
    assert "Distance along the normal (m)" in " ".join(pages.texts) or "Elevation change" not in " ".join(pages.texts)
    assert "of which one in twenty is unchanged at most" in " ".join(" ".join(pages.texts).split())


def test_both_reports_are_made_again_with_the_same_bytes_from_folder_or_record(signed):
    before = {key: signed[key].read_bytes() for key in ("report", "report_pdf")}
    for place in (signed["run"], signed["run"].parent):
        for key in before:
            signed[key].unlink()
        made = again(place)
        assert {key: made[key] for key in before} == {key: signed[key] for key in before}
        assert {key: signed[key].read_bytes() for key in before} == before


def test_a_report_without_pdf_gets_one_and_the_record_keeps_what_was_said(pair, tmp_path):
    outputs = run(*pair, tmp_path / "wall.laz").outputs
    assert "report_pdf" not in outputs
    page = outputs["report"].read_bytes()
    assert set(again(tmp_path)) == {"report"}
    assert outputs["report"].read_bytes() == page
    made = again(tmp_path, details=DetailParameters(pdf=True, client="Road Directorate"))
    assert "Road Directorate" in Pages(made["report_pdf"]).texts[0]
    record = json.loads(outputs["run"].read_text(encoding="utf-8"))
    assert record["parameters"]["details"]["client"] == "Road Directorate"
    assert record["outputs"]["report_pdf"] == "wall_report.pdf"


def test_of_several_runs_in_a_folder_the_record_is_to_be_given(signed, tmp_path):
    folder = shutil.copytree(signed["run"].parent, tmp_path / "two")
    shutil.copy(folder / "wall_run.json", folder / "other_run.json")
    (folder / "ground_run.json").write_text('{"command": "ground"}', encoding="utf-8")
    with pytest.raises(InputError, match=r"several runs of M3C2; give one of their records: other_run.json, wall_run"):
        again(folder)
    given = report_of_folder(folder / "other_run.json", ReportParameters(), profiles=None, progress=Progress())
    assert given.outputs["report"] == folder / "other_report.html"


def test_photos_of_zones_stand_in_both_reports(signed, tmp_path):
    folder = shutil.copytree(signed["run"].parent, tmp_path / "copy")
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    Image.new("RGB", (60, 40), "red").save(pictures / "Z001 crack.png")
    pages = (folder / "wall_report.html").read_text(encoding="utf-8").count("data:image/")
    made = again(folder, photos=pictures)
    assert made["report"].read_text(encoding="utf-8").count("data:image/") == pages + 1
    assert (folder / "zones" / "photos" / "Z001.png").is_file()
