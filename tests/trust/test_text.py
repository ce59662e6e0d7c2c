"""Text from files stays text: no script in a report or map tip, no formula in a table, no path out of a folder."""

from __future__ import annotations

import csv
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import geopandas
import pytest
import shapely
from PIL import Image
from slopewatch.engine.core.table_text import cell, text_of
from slopewatch.engine.maps import qgis_styles
from slopewatch.engine.series.alerts import DEFAULT_TABLE, alerts_csv, read_alerts
from slopewatch.tests.builders.bad_inputs import X, Y, slope
from slopewatch.tests.builders.bad_inputs import cloud as write
from slopewatch.tests.builders.program import run
from slopewatch.workflows.batch import alert_events

SCRIPT = "<script>alert(1)</script><img src=x onerror=alert(2)>\"'&{{7*7}}$x^$"
FORMULAS = ("=1+1", "+1", "-1", "@SUM(A1)", "\tx", "\rx", "'=1", "=cmd|' /C calc'!A0")


class Page(HTMLParser):
    """Elements and attributes of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs

    def handle_data(self, data: str) -> None:
        self.text += data


def harmless(path: Path) -> Page:
    page = Page(path.read_text(encoding="utf-8"))
    assert "script" not in page.tags
    assert not [name for name, _ in page.attributes if name.startswith("on")]
    for name, value in page.attributes:
        if name in ("src", "href"):
            assert (value or "").startswith(("data:", "#")), value
    assert "49" not in re.findall(r"\{\{7\*7\}\}|\b49\b(?= )", page.text)
    return page


@pytest.fixture(scope="module")
def changed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A change of clouds whose names, lines and system's name are hostile; with a zone, whose review is, too."""
    folder = tmp_path_factory.mktemp("hostile")
    second = slope(2)
    second[second[:, 0] < X + 4, 2] -= 0.3
    name = SCRIPT.replace("/", "")[:80]
    first = write(folder / f"a {name}.laz", slope(1))
    later = write(folder / f"=b {name}.laz", second)
    lines = geopandas.GeoDataFrame(
        {"name": [SCRIPT, *FORMULAS]},
        geometry=[shapely.LineString([(X + 1, Y + 1 + k), (X + 11, Y + 1 + k)]) for k in range(1 + len(FORMULAS))],
        crs=32651,
    )
    lines.to_file(folder / "lines.gpkg")
    words = ["change", first, later, "--cell", 0.5, "--profiles", folder / "lines.gpkg", "--output-dir", folder / "out"]
    done = run(*words)
    assert done.returncode == 0, done.stderr
    zones = geopandas.read_file(folder / "out" / "zones.gpkg", layer="zones")
    assert len(zones) > 0
    return folder / "out"


def test_names_and_lines_cannot_become_script(changed: Path) -> None:
    page = harmless(changed / "report.html")
    assert "alert(1)" in page.text, "it is shown, as text"


def test_a_review_cannot_become_script(changed: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(changed, out)
    zones = geopandas.read_file(out / "zones.gpkg", layer="zones")
    zones["remarks"], zones["reviewer"], zones["review_status"] = SCRIPT, "</td></tr><b>", "confirmed"
    zones.to_file(out / "zones.gpkg", layer="zones")
    done = run("report", out)
    assert done.returncode == 0, done.stderr
    assert "alert(1)" in harmless(out / "report.html").text


def test_a_record_cannot_become_script_or_reach_out_of_its_folder(changed: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(changed, out)
    Image.new("RGB", (8, 8), (1, 2, 3)).save(tmp_path / "secret.png")
    record = json.loads((out / "run.json").read_text(encoding="utf-8"))
    for key in ("software", "command", "run_id"):
        record[key] = SCRIPT
    record["warnings"] = [SCRIPT]
    record["metrics"]["screened_zone_count"] = 1
    record["inputs"][0]["path"] = record["inputs"][0]["sha256"] = SCRIPT
    record["parameters"][SCRIPT] = {SCRIPT: SCRIPT}
    record["versions"][SCRIPT] = SCRIPT
    record["zones"] = [z | {"zone_id": SCRIPT, "kind": SCRIPT, "severity": SCRIPT} for z in record["zones"]]
    for path in ("../secret.png", str(tmp_path / "secret.png"), "a/../../secret.png"):
        record["outputs"]["screened_map"] = path
        (out / "run.json").write_text(json.dumps(record), encoding="utf-8")
        done = run("report", out)
        assert done.returncode == 0, done.stderr
        page = harmless(out / "report.html")
        assert page.tags.count("img") == Page((changed / "report.html").read_text(encoding="utf-8")).tags.count("img")


def test_tables_hold_no_formula(changed: Path) -> None:
    for path in changed.glob("*.csv"):
        with path.open(encoding="utf-8", newline="") as file:
            for row in csv.reader(file):
                for value in row:
                    number = re.fullmatch(r"[+-]?[0-9.eE+-]+", value)
                    assert number or not value.startswith(("=", "+", "-", "@", "\t", "\r")), (path.name, value)
    with (changed / "profiles.csv").open(encoding="utf-8", newline="") as file:
        names = {text_of(row["profile"]) for row in csv.DictReader(file)}
    assert names >= {SCRIPT, *(text.strip() for text in FORMULAS)}, "the report finds them by their own names"


@pytest.mark.parametrize("text", [*FORMULAS, "plain", "", "'quoted'", "''=x", "3 - 1", "a=b"])
def test_a_text_comes_back_from_its_cell(text: str) -> None:
    assert text_of(cell(text)) == text
    assert not cell(text).startswith(("=", "+", "-", "@", "\t", "\r"))


def test_alert_levels_are_no_formula_nor_markup(tmp_path: Path) -> None:
    lines = DEFAULT_TABLE.read_text(encoding="utf-8").splitlines()
    values = lines[2].split(",")
    values[1], values[-1] = "=1+1<script>", '"@evil, \' <b>"'
    table = tmp_path / "alerts.csv"
    table.write_text("\n".join([*lines[:2], ",".join(values), *lines[3:]]) + "\n", encoding="utf-8")
    levels = read_alerts(table)
    assert levels[1].name == "=1+1<script>"
    written = tmp_path / "used.csv"
    written.write_text(alerts_csv(levels), encoding="utf-8")
    assert read_alerts(written) == levels
    with written.open(encoding="utf-8", newline="") as file:
        assert not [value for row in csv.reader(file) for value in row if value.startswith(("=", "@"))]
    style = ElementTree.fromstring(qgis_styles.series_zones_qml(levels).split("?>", 1)[-1])
    labels = [category.get("label") for category in style.iter("category")]
    assert "1 =1+1<script>" in labels


def test_control_characters_are_no_text_of_a_table(tmp_path: Path) -> None:
    table = tmp_path / "alerts.csv"
    table.write_text(DEFAULT_TABLE.read_text(encoding="utf-8").replace("planned", "pl\x0bned"), encoding="utf-8")
    done = run("series", tmp_path, "--alerts", table, "--output-dir", tmp_path / "out")
    assert done.returncode == 2
    assert "Internal" not in done.stderr


SCREENED = (
    "zone_id", "kind", "confidence", "probability", "area_m2", "height_med_m", "height_p95_m", "points", "confirmed",
    "compared_share", "change_share", "opposite_share", "dz_signif_m",
)  # fmt: skip
CORRIDOR_ZONES = (
    "zone_id", "slope", "source", "attention", "kind", "severity", "alert", "rate_mm_day", "dz_mean_m", "dz_p95_m",
    "area_m2", "vol_net_m3", "alert_reason",
)  # fmt: skip
STYLES = {
    "zones": qgis_styles.zones_qml,
    "screened": lambda: qgis_styles.hazards_qml(SCREENED),
    "footprints": qgis_styles.footprints_qml,
    "series": lambda: qgis_styles.series_zones_qml(read_alerts(None)),
    "corridor zones": lambda: qgis_styles.corridor_zones_qml(CORRIDOR_ZONES),
    "corridor alerts": lambda: qgis_styles.corridor_alerts_qml(
        alert_events.FIELDS, alert_events.STATES, alert_events.ENTERED
    ),
}
EVALUATE = """
import sys
from qgis.core import QgsExpression, QgsExpressionContext, QgsFeature, QgsField, QgsFields
from qgis.PyQt.QtCore import QVariant
tip, text = sys.stdin.read().split("\\0")
fields = QgsFields()
import re
for name in sorted(set(re.findall(r'"(\\w+)"', tip))):
    fields.append(QgsField(name, QVariant.String))
feature = QgsFeature(fields)
for k in range(fields.count()):
    feature.setAttribute(k, text)
context = QgsExpressionContext()
context.setFeature(feature)
context.setFields(fields)
print(QgsExpression.replaceExpressionText(tip, context))
"""


@pytest.mark.parametrize("name", STYLES)
def test_map_tips_show_text_as_text(name: str) -> None:
    """As QGIS itself fills them in, where it is there."""
    style = ElementTree.fromstring(STYLES[name]().split("?>", 1)[-1])
    tip = style.findtext("mapTip") or ""
    for expression in re.findall(r"\[%(.*?)%\]", tip, re.DOTALL):
        # of numbers only, with words of the style's own around them
        rest = re.sub(
            r"'[^']*'|format_number\(\"\w+\", \d\)|\"\w+\" is (not )?null", "", expression, flags=re.IGNORECASE
        )
        assert expression.strip().startswith(("format_number(", "replace(replace(")) or '"' not in rest, expression
    if subprocess.run(["/usr/bin/python3", "-c", "import qgis.core"], capture_output=True, check=False).returncode:
        pytest.skip("QGIS's Python is not here")
    done = subprocess.run(
        ["/usr/bin/python3", "-c", EVALUATE],
        input=f"{tip}\0<img src=x>&[% 1 + 1 %]",
        capture_output=True,
        text=True,
        check=True,
    )
    assert "<img" not in done.stdout
    assert "&lt;img src=x>&amp;[% 1 + 1 %]" in done.stdout


def test_a_terminal_gets_no_commands(tmp_path: Path) -> None:
    path = tmp_path / "a\x1b]0;owned\x07\nError: forged.laz"
    path.write_bytes(b"")
    for words in (("info", path), ("info", path, "--progress", "json")):
        done = run(*words)
        assert done.returncode == 2
        assert "\x1b" not in done.stdout + done.stderr
        assert len([line for line in done.stderr.splitlines() if line.startswith("Error: ")]) == 1
