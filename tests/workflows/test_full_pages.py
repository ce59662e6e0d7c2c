"""Reports to sign of every kind of run that has one: no page is more than half empty, no part floats in white."""

from __future__ import annotations

import json
from pathlib import Path

import geopandas as gpd
import pytest
from slopewatch.engine.core.progress import Progress
from slopewatch.interface.parameters import DetailParameters, ReportParameters
from slopewatch.interface.rounding import digits_of_error
from slopewatch.tests.builders.handed_over import motion, pit
from slopewatch.tests.builders.screened_folder import screened_folder
from slopewatch.tests.builders.signed_folder import LEAST_FILLED, WIDEST_GAP, Pages
from slopewatch.workflows.report import report_step

KINDS = ("demchange", "displacement", "screening")
"""That of a change is looked at in ``test_pdf.py``; series and corridors have tests of their own."""


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A folder of each kind, with its report to sign."""
    base = tmp_path_factory.mktemp("kinds")
    found = {"demchange": pit(base), "displacement": motion(base), "screening": screened_folder(base / "screening")}
    for folder in found.values():
        report_step(folder, ReportParameters(), details=DetailParameters(pdf=True), profiles=None, progress=Progress())
    return found


@pytest.mark.parametrize("kind", KINDS)
def test_no_page_is_more_than_half_empty(folders: dict[str, Path], kind: str) -> None:
    pages = Pages(folders[kind] / "report.pdf")
    assert min(pages.lowest_ink) >= 0.5
    assert min(pages.filled) >= LEAST_FILLED
    assert max(pages.widest_gap) <= WIDEST_GAP
    assert all(pages.fonts_embedded.values())


def test_motion_alone_has_its_verdict_its_zones_and_what_is_not_known(folders: dict[str, Path]) -> None:
    pages = Pages(folders["displacement"] / "report.pdf")
    facts = json.loads((folders["displacement"] / "run.json").read_text(encoding="utf-8"))["displacement"]
    assert facts["zones"]
    for zone in facts["zones"]:
        digits = digits_of_error(zone["length_err_m"])
        length = f"{zone['length_m']:.{digits}f} ± {zone['length_err_m']:.{digits}f}"
        assert f"{zone['zone_id']} {length} {zone['direction']}" in pages.texts[0]
    assert "along the surface: its relief is found again, shifted as a whole." in pages.texts[0]
    assert f"Smallest motion that shows {facts['smallest_median_m']:.3f} m" in pages.texts[0]
    for row in facts["refused"]:
        assert row["reason"] in pages.text
    assert "Screened zone" not in pages.text


def test_a_screening_has_verdict_figures_and_zones_on_its_first_page(folders: dict[str, Path]) -> None:
    pages = Pages(folders["screening"] / "report.pdf")
    zones = gpd.read_file(folders["screening"] / "screened_zones.gpkg", layer="zones")
    first = pages.texts[0]
    assert f"{len(zones)} zones of ground that looks raised or lowered were found" in first
    assert "They are shapes of one survey, not movement." in first
    assert "Smallest hazard that shows 0.17 m" in first
    assert "On half of this slope a hazard 3 m wide must stand 0.17 m out" in first
    for zone in zones.to_dict("records"):
        assert f"{zone['zone_id']} {zone['kind']} {zone['confidence']}" in first
