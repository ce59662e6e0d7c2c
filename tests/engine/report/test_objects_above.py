"""Objects above the ground in the report and its PDF: each volume stands with its range."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

from slopewatch.engine.core.templates import render
from slopewatch.engine.report.figures import Figures
from slopewatch.engine.report.signed.parts import objects_above

TEMPLATE = Path(__file__).parents[3] / "engine" / "report" / "templates" / "_objects.html.j2"
ROW = {
    "object_id": "O001", "kind": "boulder", "change": "appeared", "zone_id": "", "height_m": 1.2, "length_m": 2.4,
    "width_m": 2.2, "volume_m3": 4.52, "n_points": 17, "confidence": 0.999, "deposit": 1, "x": 3.0, "y": 4.0,
}  # fmt: skip
RANGE = {"volume_low_m3": 3.61, "volume_high_m3": 5.43}


def page(row):
    metrics = {"objects_vegetation": 0, "object_deposits_beside_zones_m3": 4.52}
    record = {"objects": [row], "metrics": metrics}
    return render(TEMPLATE, record=record, metrics=metrics, fig=Figures(record), most_zones=9)


def test_the_volume_stands_with_its_range():
    assert all(figure in page(ROW | RANGE) for figure in ("4.52", "3.61", "5.43"))
    told = str(objects_above(SimpleNamespace(record={"objects": [ROW | RANGE]})))
    assert "3.61 to 5.43" in told


def test_a_record_of_before_has_none():
    assert "4.52" in page(ROW)
    assert "4.52" in str(objects_above(SimpleNamespace(record={"objects": [ROW]})))
