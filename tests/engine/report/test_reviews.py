"""Reviews as the report shows them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.report.compose import write_report
from slopewatch.engine.report.reviews import Review, zone_reviews
from slopewatch.engine.series.tables import ZONE_FIELDS
from slopewatch.engine.vector.geopackage import write_layer
from slopewatch.tests.builders.zone_layers import entered, zone_layer
from slopewatch.workflows.products.zones import write_zones


def test_zones_of_which_something_was_said(tmp_path: Path) -> None:
    path = tmp_path / "zones.gpkg"
    assert zone_reviews(path) == {}
    zones = zone_layer([(0, 0, 1, 1)] * 5)
    entered(zones, 1, review_status="confirmed", reviewer=" A. Sato ")
    entered(zones, 2, remarks="crack")
    entered(zones, 3, route="S1")
    zones.loc[4, "review_status"] = ""
    write_zones(path, zones)
    assert zone_reviews(path) == {
        "Z002": Review("Z002", "confirmed", "A. Sato", ""),
        "Z003": Review("Z003", "unreviewed", "", "crack"),
    }
    # of a version that had no remarks
    older = tmp_path / "older.gpkg"
    write_layer(older, zones.drop(columns=["remarks"]), "zones")
    assert list(zone_reviews(older)) == ["Z002"]
    path.write_text("no GeoPackage")
    with pytest.raises(InputError, match=r"zones\.gpkg cannot be read"):
        zone_reviews(path)


def series_folder(folder: Path, count: int) -> Path:
    """The record of a series with ``count`` zones, and their file, of which the first and the last are reviewed."""
    zones = zone_layer([(0, 0, 1, 1)] * count, ids=[f"S{i:03d}" for i in range(count)], fields=ZONE_FIELDS)
    entered(zones, 0, review_status="rejected", reviewer="<b>B. Ito", remarks="a car & more")
    entered(zones, count - 1, review_status="confirmed", reviewer="C. Abe")
    write_zones(folder / "series.gpkg", zones)
    rows = [{"zone_id": zone, "kind": "subsidence", "alert": "none", "trend": "steady"} for zone in zones["zone_id"]]
    record = {
        "software": "SlopeWatch", "command": "series", "started": "2025-01-01", "parameters": {}, "inputs": [],
        "metrics": {"epoch_count": 2, "zone_count": count}, "warnings": [], "outputs": {}, "versions": {},
        "zones": rows,
    }  # fmt: skip
    (folder / "run.json").write_text(json.dumps(record))
    return folder


def test_the_table_shows_a_review_below_its_zone_and_lists_those_of_zones_it_leaves_out(tmp_path: Path) -> None:
    page = " ".join(write_report(series_folder(tmp_path, 60)).read_text(encoding="utf-8").split())
    said = "Review: Rejected by &lt;b&gt;B. Ito. a car &amp; more"
    assert page.index("S000</th>") < page.index(said) < page.index("S001</th>")
    assert page.count('class="review"') == 1
    others = page[page.index("Reviews of the other zones") :]
    assert "S059</th><td" in others
    assert "C. Abe" in others
    assert "B. Ito" not in others


def test_without_reviews_nothing_is_said_of_them(tmp_path: Path) -> None:
    folder = series_folder(tmp_path, 2)
    write_zones(folder / "series.gpkg", zone_layer([(0, 0, 1, 1)], fields=ZONE_FIELDS))
    page = write_report(folder).read_text(encoding="utf-8")
    assert "Review" not in page
